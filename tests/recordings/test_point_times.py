# SPDX-License-Identifier: MIT
"""Point times in the conventions of the drivers of lidars."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slamcli.recordings.point_times import point_times

STAMP = 1_700_000_000_123_456_789
SWEEP_S = np.array([0.0, 0.05, 0.099])
SWEEP_NS = [0, 50_000_000, 99_000_000]


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        (np.array([0, 50_000_000, 99_000_000], "u4"), SWEEP_NS),  # Ouster, Livox, Autoware: ns
        (np.array([0, 50_000, 99_000], "u4"), SWEEP_NS),  # us
        (SWEEP_S.astype("f4"), SWEEP_NS),  # Velodyne: s
        ((SWEEP_S - 0.1).astype("f4"), [-100_000_000, -50_000_000, -1_000_000]),  # Velodyne, stamped at the end
        ((1e3 * SWEEP_S).astype("f4"), SWEEP_NS),  # ms
        ((1e6 * SWEEP_S).astype("f8"), SWEEP_NS),  # us as floats
        ((1e9 * SWEEP_S).astype("f4"), SWEEP_NS),  # ns as floats
        (np.array(SWEEP_NS, "u8") + np.uint64(STAMP), SWEEP_NS),  # absolute ns
        ((np.array(SWEEP_NS, "i8") + STAMP) // 1000, SWEEP_NS),  # absolute us
        ((np.array(SWEEP_NS, "i8") + STAMP).astype("f8"), SWEEP_NS),  # Livox: absolute ns as floats
        (STAMP / 1e9 + SWEEP_S, SWEEP_NS),  # Hesai: absolute s
        (STAMP / 1e9 + SWEEP_S - 0.1, [-100_000_000, -50_000_000, -1_000_000]),  # RoboSense: stamped at the end
        (STAMP / 1e3 + 1e6 * SWEEP_S, SWEEP_NS),  # absolute us as floats
        (np.zeros(3, "f4"), [0, 0, 0]),  # simulators
        (np.array([-2.0, 0.0], "f4"), [-2_000_000_000, 0]),  # assembled over seconds
        (np.array([], "f8"), []),
    ],
)
def test_units_and_zeros_that_drivers_write(times: Any, expected: list[int]) -> None:
    found = point_times(times, STAMP)
    assert found.offset_ns is not None
    np.testing.assert_allclose(found.offset_ns, expected, atol=1500)
    assert found.offset_ns.dtype == np.int64
    assert not found.own_clock


@pytest.mark.parametrize(
    "times",
    [
        5321.4 + SWEEP_S,  # s since the sensor started
        np.array(SWEEP_NS, "u8") + np.uint64(4_321_000_000_000),  # ns since then
        STAMP / 1e9 + 37.0 + SWEEP_S,  # TAI
        np.array(SWEEP_NS, "i8") + STAMP + 37 * 10**9,
        STAMP / 1e9 + 1e8 + SWEEP_S,  # a clock that is years off
    ],
)
def test_a_clock_of_its_own_begins_at_the_stamp(times: Any) -> None:
    found = point_times(times, STAMP)
    assert found.own_clock
    assert found.offset_ns is not None
    np.testing.assert_allclose(found.offset_ns, SWEEP_NS, atol=500)


def test_absolute_times_where_the_stamp_is_unset_or_of_a_simulation() -> None:
    for stamp in (0, 12_500_000_000):
        found = point_times(STAMP / 1e9 + SWEEP_S, stamp)
        assert found.own_clock
        np.testing.assert_allclose(found.offset_ns, SWEEP_NS, atol=500)


def test_times_that_tell_nothing() -> None:
    # Absolute seconds in float32 are all the same; and no sweep lasts for years.
    assert point_times((STAMP / 1e9 + SWEEP_S).astype("f4"), STAMP).offset_ns is None
    assert point_times(np.array([-1e18, 1e18]), STAMP).offset_ns is None
