# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slamcli.errors import DataError
from slamcli.measurements import LaserScan
from slamcli.recordings.scan_normalisation import (
    Fan,
    clean_ranges,
    most_frequent_fan,
    normalise_scans,
    resample,
    turn_counter_clockwise,
)
from slamcli.runtime import RunLog


def _scan(ranges: Any, first: float = -1.0, increment: float = 0.5, **more: Any) -> LaserScan:
    values: dict[str, Any] = dict(
        stamp_ns=1,
        frame_id="laser",
        angle_min_rad=first,
        angle_increment_rad=increment,
        range_min_m=0.1,
        range_max_m=10.0,
        ranges_m=np.asarray(ranges, dtype=np.float32),
    )
    return LaserScan(**{**values, **more})


def _points(scan: LaserScan) -> np.ndarray:
    return np.column_stack([scan.ranges_m * np.cos(scan.angles_rad), scan.ranges_m * np.sin(scan.angles_rad)])


def test_readings_after_rep_117() -> None:
    nan, inf = np.nan, np.inf
    read = clean_ranges(np.array([1, 0.1, 0.09, 0, -1, -inf, nan, 9.99, 10, 11, inf], np.float32), 0.1, 10.0)
    np.testing.assert_array_equal(read, np.array([1, 0.1, nan, nan, nan, nan, nan, 9.99, inf, inf, inf], np.float32))


def test_no_range_max_is_no_limit() -> None:
    for limit in (0.0, -1.0, math.nan):
        assert clean_ranges(np.array([500.0, np.inf], np.float32), 0.0, limit).tolist() == [500.0, np.inf]


def test_a_clockwise_scan_sees_the_same_points() -> None:
    counter = _scan([1, 2, 3, 4], intensities=np.arange(4, dtype=np.float32), time_increment_s=0.01)
    clockwise = _scan([4, 3, 2, 1], 0.5, -0.5, intensities=np.arange(4, dtype=np.float32)[::-1], time_increment_s=0.01)
    turned = turn_counter_clockwise(clockwise)
    np.testing.assert_allclose(turned.angles_rad, counter.angles_rad)
    np.testing.assert_array_equal(turned.ranges_m, counter.ranges_m)
    np.testing.assert_array_equal(turned.intensities, counter.intensities)
    assert turned.time_increment_s == -0.01
    assert turned.stamp_ns == counter.stamp_ns


def test_an_upside_down_scan_mirrors_its_points() -> None:
    scan = _scan([1, 2, 3, 4], first=-0.25)
    turned = turn_counter_clockwise(scan, mirrored=True)
    assert turned.angle_increment_rad > 0
    np.testing.assert_allclose(_points(turned)[::-1], _points(scan) * [1, -1], atol=1e-7)


def test_resampling_takes_the_nearest_beam() -> None:
    scan = _scan([1, 2, 3, 4, 5], first=0.0, increment=0.1)
    fan = Fan(angle_min_rad=-0.16, angle_increment_rad=0.2, num_beams=4)
    np.testing.assert_array_equal(resample(scan, fan).ranges_m, np.array([np.nan, 1, 3, 5], np.float32))
    finer = Fan(angle_min_rad=0.0, angle_increment_rad=0.05, num_beams=9)
    assert np.isfinite(resample(scan, finer).ranges_m).all()
    assert resample(scan, finer).ranges_m[::2].tolist() == [1, 2, 3, 4, 5]


@settings(max_examples=200, deadline=None)
@given(
    num=st.integers(1, 40),
    first=st.floats(-3, 3),
    increment=st.floats(0.01, 0.2),
    fan=st.builds(
        Fan, angle_min_rad=st.floats(-3, 3), angle_increment_rad=st.floats(0.01, 0.2), num_beams=st.integers(1, 40)
    ),
)
def test_resampling_equals_a_search_for_the_nearest(num: int, first: float, increment: float, fan: Fan) -> None:
    scan = _scan(np.arange(1, num + 1), first, increment, range_max_m=1000.0)
    result = resample(scan, fan).ranges_m
    reach = 0.5 * max(increment, fan.angle_increment_rad)
    for k in range(fan.num_beams):
        angle = fan.angle_min_rad + k * fan.angle_increment_rad
        off = np.abs(scan.angles_rad - angle)
        nearest = off.min()
        if abs(nearest - reach) < 1e-5 or np.sum(off < nearest + 1e-6) > 1:
            continue
        expected = scan.ranges_m[np.argmin(off)] if nearest < reach else np.nan
        np.testing.assert_equal(result[k], np.float32(expected))


def test_scans_that_change_size_come_out_on_one_fan() -> None:
    scans = [_scan(np.ones(9), 0.0, 0.1)] + [_scan(np.ones(10), 0.0, 0.1) for _ in range(5)] + [_scan([], 0.0, 0.0)]
    log = RunLog()
    result = list(normalise_scans(scans, mirrored=False, log=log))
    assert [scan.num_beams for scan in result] == [10] * 7
    assert np.isnan(result[0].ranges_m).tolist() == [False] * 9 + [True]
    assert np.isnan(result[-1].ranges_m).all()
    assert log.counts == {"scans resampled to one fan": 2}
    assert "2 scans have other beams than the rest: resampled to 10 beams of 5.730° from 0.0°" in log.warnings[0]


def test_tiny_differences_are_no_other_fan() -> None:
    scans = [_scan(np.ones(100), -1.0 + 1e-5 * i, 0.02) for i in range(5)]
    log = RunLog()
    result = list(normalise_scans(scans, mirrored=False, log=log))
    assert not log.counts
    assert [scan.angle_min_rad for scan in result] == [scan.angle_min_rad for scan in scans]


def test_scans_without_beams_and_no_scans() -> None:
    assert list(normalise_scans([], mirrored=False, log=RunLog())) == []
    assert most_frequent_fan([]) is None
    with pytest.raises(DataError, match="have no beams"):
        list(normalise_scans([_scan([])], mirrored=False, log=RunLog()))
