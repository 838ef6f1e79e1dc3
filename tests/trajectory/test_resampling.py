# SPDX-License-Identifier: MIT
"""Interpolation, cropping and thinning of trajectories."""

import numpy as np
import pytest

from slamcli.errors import DataError, EstimationError, UsageError
from slamcli.trajectory import Trajectory, crop_time, downsample, interpolate, motion_filter, path_lengths

S = 10**9


def line(n=11):
    poses = np.column_stack([np.arange(n), np.zeros(n), np.linspace(0, 1, n)])
    return Trajectory.from_se2(np.arange(n) * S, poses)


def test_interpolation_is_linear_and_holds_its_ends():
    found = interpolate(line(), [-S, 0, S // 2, 9 * S + S // 4, 50 * S])
    np.testing.assert_allclose(found.positions_m[:, 0], [0, 0, 0.5, 9.25, 10], atol=1e-12)
    np.testing.assert_allclose(found.poses_se2[:, 2], [0, 0, 0.05, 0.925, 1], atol=1e-9)


def test_interpolation_does_not_mind_the_order_of_poses():
    shuffled = line().select(np.random.default_rng(0).permutation(11))
    np.testing.assert_array_equal(
        interpolate(shuffled, [3 * S + 1]).positions_m, interpolate(line(), [3 * S + 1]).positions_m
    )
    with pytest.raises(EstimationError, match="fewer than two"):
        interpolate(line(1), [0])


def test_crop_is_inclusive_and_says_what_there_is():
    assert crop_time(line(), 2, 4).stamps_s.tolist() == [2, 3, 4]
    assert len(crop_time(line(), None, 4)) == 5
    assert crop_time(line()) is not None
    with pytest.raises(UsageError, match=r"covers 0.000000 to 10.000000 s"):
        crop_time(line(), 20)


def test_downsample_keeps_first_and_last():
    assert downsample(line(), 3).stamps_s.tolist() == [0, 5, 10]
    assert len(downsample(line(), 100)) == 11
    with pytest.raises(UsageError, match="0 poses"):
        downsample(line(), 0)


def test_motion_filter_by_distance_or_angle():
    assert motion_filter(line(), 3.0, 100).stamps_s.tolist() == [0, 3, 6, 9]
    assert motion_filter(line(), 100, 0.25).stamps_s.tolist() == [0, 3, 6, 9]
    assert motion_filter(line(), 2.0, 0.1 - 1e-9).stamps_s.tolist() == list(range(11))
    with pytest.raises(UsageError, match="must not be negative"):
        motion_filter(line(), -1, 0)
    with pytest.raises(DataError, match="fewer than two"):
        motion_filter(line(1), 1, 1)


def test_path_lengths_start_at_zero():
    assert path_lengths(line(4).positions_m).tolist() == [0, 1, 2, 3]
