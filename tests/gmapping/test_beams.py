# SPDX-License-Identifier: MIT
"""Which readings are matched, which clear space, which are hits, and where they lie in the base frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import CalibrationError
from slamcli.geometry import quaternion, se3
from slamcli.gmapping import GmappingParameters
from slamcli.gmapping.beams import BeamModel
from slamcli.measurements import LaserScan


def scan(values, **changes):
    settings = {
        "stamp_ns": 1, "frame_id": "laser", "angle_min_rad": 0.0, "angle_increment_rad": math.pi / 2, "range_min_m": 0.1,
        "range_max_m": 10.0, "ranges_m": np.array(values, dtype=np.float32),
    }  # fmt: skip
    return LaserScan(**settings | changes)


def beams(values, no_return="ignore", mount=None, **parameters):
    mount = np.eye(4) if mount is None else mount
    return BeamModel(GmappingParameters(**parameters), mount, no_return).beams(scan(values))


def test_bad_readings_are_dropped():
    found = beams([2.0, math.nan, math.inf, -math.inf])
    np.testing.assert_allclose(found.points, [[2.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(found.directions, [[1.0, 0.0]], atol=1e-12)
    assert found.hit.tolist() == [True]
    assert len(beams([0.05, 0.0, -1.0, 10.0]).ends) == 0  # below the minimum, and at the maximum: no return
    assert beams([]).points.shape == beams([]).ends.shape == (0, 2)


def test_beams_beyond_the_usable_range_clear_up_to_it():
    found = beams([2.0, 5.0, 9.0, 9.995], maxUrange=4.0)
    np.testing.assert_allclose(found.points, [[2.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(found.ends, [[2, 0], [0, 4], [-4, 0]], atol=1e-6)  # the fourth is over range_max - 0.01
    assert found.hit.tolist() == [True, False, False]


@pytest.mark.parametrize(("policy", "count", "hits"), [("ignore", 1, 1), ("free", 3, 1), ("max", 3, 3)])
def test_the_policy_for_no_return(policy, count, hits):
    found = beams([2.0, math.inf, 10.0, math.nan], no_return=policy, maxUrange=4.0)
    assert len(found.ends) == count
    assert found.hit.sum() == hits
    assert len(found.points) == 1
    np.testing.assert_allclose(np.linalg.norm(found.ends[1:], axis=1), 4.0)


def test_max_range_and_usable_range():
    model = BeamModel(GmappingParameters(), np.eye(4))
    assert model.limits(scan([1.0])) == pytest.approx((9.99, 9.99))
    model = BeamModel(GmappingParameters(maxRange=5.0, maxUrange=8.0), np.eye(4))
    assert model.limits(scan([1.0])) == (5.0, 5.0)


def test_lskip_thins_what_is_matched_and_not_what_is_drawn():
    found = beams([1.0, 2.0, 3.0, 4.0], lskip=1)
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), [1.0, 3.0], rtol=1e-6)
    assert len(found.ends) == 4


def test_the_mount_moves_and_turns_the_beams():
    mount = se3.from_position_quaternion([0.5, -0.2, 1.0], quaternion.from_yaw(math.pi / 2))
    found = beams([1.0, 2.0], mount=mount)
    np.testing.assert_allclose(found.start, [[0.5, -0.2]])
    np.testing.assert_allclose(found.points, [[0.5, 0.8], [-1.5, -0.2]], atol=1e-6)
    np.testing.assert_allclose(found.directions, [[0, 1], [-1, 0]], atol=1e-12)


def test_a_scanner_upside_down_sweeps_the_other_way():
    mount = se3.from_position_quaternion([0, 0, 1.0], quaternion.from_roll_pitch_yaw(math.pi, 0.0, 0.0))
    np.testing.assert_allclose(beams([1.0, 2.0], mount=mount).points, [[1, 0], [0, -2]], atol=1e-6)


def test_a_tilted_scanner_is_refused():
    mount = se3.from_position_quaternion([0, 0, 1.0], quaternion.from_roll_pitch_yaw(0.0, 0.1, 0.0))
    with pytest.raises(CalibrationError, match=r"tilted by 5\.7 degrees"):
        BeamModel(GmappingParameters(), mount)


def test_a_fan_that_changes_is_followed():
    model = BeamModel(GmappingParameters(), np.eye(4))
    first = model.beams(scan([1.0, 1.0])).points
    model.beams(scan([1.0, 1.0], angle_min_rad=1.0))
    np.testing.assert_array_equal(model.beams(scan([1.0, 1.0])).points, first)


@pytest.mark.parametrize("policy", ["free", "max"])
def test_without_any_limit_a_beam_without_return_clears_nothing(policy):
    found = beams([2.0, math.inf], no_return=policy, maxRange=math.inf)
    np.testing.assert_allclose(found.ends, [[2.0, 0.0]], atol=1e-6)


@pytest.mark.parametrize("reverse", [False, True])
def test_deskewed_beams_lie_where_a_moving_robot_saw_them(reverse):
    """A base that turns and drives while each beam is measured sees fixed points; put right they are where they are."""
    count, step, twist = 8, 0.02, np.array([0.8, -0.1, 0.9])
    targets = np.column_stack([np.linspace(2, 4, count), np.linspace(-2, 2, count)])
    times = np.arange(count) * step
    times = times[::-1] if reverse else times
    found = []
    for target, seconds in zip(targets, times, strict=True):
        # The sweep is short: the base has moved by v t and turned by w t, to first order.
        pose = np.array([twist[0] * seconds, twist[1] * seconds, twist[2] * seconds])
        c, s = math.cos(pose[2]), math.sin(pose[2])
        seen = np.array([[c, s], [-s, c]]) @ (target - pose[:2])
        angle, distance = math.atan2(seen[1], seen[0]), float(np.hypot(*seen))
        values = np.full(count, np.nan, dtype=np.float32)
        index = int(np.flatnonzero(times == seconds)[0])
        values[index] = distance
        swept = LaserScan(
            stamp_ns=0, frame_id="laser", angle_min_rad=angle - index * 0.1, angle_increment_rad=0.1, range_min_m=0.1,
            range_max_m=10.0, ranges_m=values, time_increment_s=-step if reverse else step,
        )  # fmt: skip
        model = BeamModel(GmappingParameters(), np.eye(4))
        put_right = model.beams(swept, twist)
        np.testing.assert_allclose(put_right.ends, put_right.points)
        np.testing.assert_allclose(np.linalg.norm(put_right.directions, axis=1), 1.0)
        assert np.linalg.norm(model.beams(swept).points[0] - target) > 0.02 or seconds < 0.02
        found.append(put_right.points[0])
    np.testing.assert_allclose(found, targets, atol=0.012)
