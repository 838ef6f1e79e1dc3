# SPDX-License-Identifier: MIT
"""The relations metric: exact values, and equal to the independent script on the real logs' odometry."""

import numpy as np
import pytest

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation import Relations, relation_errors
from slamcli.trajectory import Trajectory

S = 10**9


def relations(*rows):
    a = np.array(rows, dtype=float)
    planar = np.column_stack([a[:, 2:4], np.zeros(len(a))]), np.column_stack([np.zeros((len(a), 2)), a[:, 4]])
    return Relations((a[:, 0] * S).astype(np.int64), (a[:, 1] * S).astype(np.int64), *planar)


def straight():
    """One metre a second along x, turning left at the end."""
    return Trajectory.from_se2([0, S, 2 * S, 3 * S], [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, np.pi / 2]])


def test_true_relations_have_no_error():
    result = relation_errors(straight(), relations([0, 2, 2, 0, 0], [1, 3, 1, 0, np.pi / 2], [3, 0, 0, 2, -np.pi / 2]))
    np.testing.assert_allclose(result.trans_m, 0, atol=1e-15)
    np.testing.assert_allclose(result.rot_rad, 0, atol=1e-15)
    assert result.num_matched == result.num_relations == 3


def test_errors_are_those_put_in():
    result = relation_errors(straight(), relations([0, 2, 2.3, 0.4, 0], [0, 0.5, 0.5, 0, 0.1]))
    np.testing.assert_allclose(result.trans_m, [0.5, 0], atol=1e-12)
    np.testing.assert_allclose(result.rot_rad, [0, 0.1], atol=1e-12)
    assert result.trans.mean == pytest.approx(0.25)
    assert result.trans_squared.mean == pytest.approx(0.125)
    assert result.rot_deg.max == pytest.approx(np.degrees(0.1))
    assert result.rot_squared_deg.mean == pytest.approx(np.degrees(0.1) ** 2 / 2)


def test_times_without_a_pose_are_unmatched_not_dropped():
    result = relation_errors(straight(), relations([0, 3.4, 2, 0, np.pi / 2], [0, 3.6, 2, 0, 0], [-5, 1, 0, 0, 0]))
    assert result.matched.tolist() == [True, False, False]
    assert result.num_relations == 3
    assert result.num_matched == 1


def test_order_of_poses_does_not_matter_and_yaw_wraps():
    angles = np.linspace(0, 20, 200)
    poses = np.column_stack([np.cos(angles), np.sin(angles), angles])
    stamps = (angles * S).astype(np.int64)
    shuffled = np.random.default_rng(0).permutation(200)
    rows = [[t, t + 3, np.sin(3), 1 - np.cos(3), 3] for t in (1.0, 5.0, 11.0)]
    rows = relations(*rows)
    a = relation_errors(Trajectory.from_se2(stamps, poses), rows)
    b = relation_errors(Trajectory.from_se2(stamps[shuffled], poses[shuffled]), rows)
    np.testing.assert_array_equal(a.trans_m, b.trans_m)
    assert a.rot_rad.max() < 1e-9


def test_moving_the_map_changes_nothing():
    from slamcli.geometry import se2

    rows = relations([0, 2, 2.3, 0.4, 0.2], [0.3, 2.5, 1, 0, 0.1])
    moved = se2.compose([3.0, -4.0, 2.0], straight().poses_se2)
    a, b = (relation_errors(t, rows) for t in (straight(), Trajectory.from_se2(straight().stamps_ns, moved)))
    np.testing.assert_allclose(a.trans_m, b.trans_m, atol=1e-12)
    np.testing.assert_allclose(a.rot_rad, b.rot_rad, atol=1e-12)


def test_too_few_poses_and_no_stamps():
    with pytest.raises(EstimationError, match="at least two poses"):
        relation_errors(Trajectory.from_se2([0, 0], [[0, 0, 0]] * 2), relations([0, 1, 0, 0, 0]))
    from dataclasses import replace

    with pytest.raises(UsageError, match="no stamps"):
        relation_errors(replace(straight(), timed=False), relations([0, 1, 0, 0, 0]))
