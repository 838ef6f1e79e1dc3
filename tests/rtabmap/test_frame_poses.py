# SPDX-License-Identifier: MIT
"""Frames between nodes: what odometry lost is spread along the way."""

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.frame_poses import frame_poses
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.node_input import OdometryStep


def _line(xs: list[float]) -> np.ndarray:
    return se3.from_se2(np.array([[x, 0.0, 0.0] for x in xs]))


def test_drift_is_spread_along_the_way_and_not_along_time() -> None:
    odom = _line([0.0, 1.0, 1.0, 1.0, 4.0])
    stamps = np.arange(5, dtype=np.int64) * 1_000_000_000
    placed = frame_poses(stamps, odom, np.array([0, 4]), _line([0.0, 4.4]))
    # 0.4 m were lost on 4 m of way: a tenth of each metre, nothing while it stood
    np.testing.assert_allclose(placed[:, 0, 3], [0.0, 1.1, 1.1, 1.1, 4.4], atol=1e-3)


def test_beyond_the_last_node_odometry_leads_on() -> None:
    odom = _line([0.0, 1.0, 2.0])
    turned = se3.from_se2(np.array([[5.0, 5.0, np.pi / 2]]))
    placed = frame_poses(np.arange(3, dtype=np.int64), odom, np.array([1]), turned)
    np.testing.assert_allclose(placed[:, :2, 3], [[5.0, 4.0], [5.0, 5.0], [5.0, 6.0]], atol=1e-12)


def test_frames_of_nodes_lie_exactly_where_the_graph_has_them() -> None:
    rng = np.random.default_rng(3)
    odom = se3.from_se2(rng.normal(size=(20, 3)))
    rows = np.array([0, 7, 8, 19])
    nodes = se3.from_se2(rng.normal(size=(4, 3)))
    placed = frame_poses(np.arange(20, dtype=np.int64), odom, rows, nodes)
    np.testing.assert_allclose(placed[rows], nodes, atol=1e-9)


def _step(stamp: int, x: float | None) -> OdometryStep:
    pose = None if x is None else _line([x])[0]
    return OdometryStep(stamp_ns=stamp, T_odom_base=pose, covariance=np.zeros((6, 6)))


def test_lost_frames_and_stretches_without_nodes_have_no_pose() -> None:
    track = FrameTrack()
    track.add(_step(0, 0.0), begins=True)
    track.mark_node(1)
    track.add(_step(10, None), begins=False)
    track.add(_step(20, 1.0), begins=False)
    track.add(_step(30, 7.0), begins=True)
    placed = track.placed({1: _line([2.0])[0]})
    assert placed.rows.tolist() == [0, 2]
    np.testing.assert_allclose(placed.T_map_base[:, 0, 3], [2.0, 3.0])
    assert track.num_lost == 1
    assert track.has_pose.tolist() == [True, False, True, True]


def test_refined_poses_replace_those_of_the_same_stamp_only() -> None:
    track = FrameTrack()
    track.add(_step(0, 0.0), begins=True)
    track.mark_node(1)
    track.add(_step(10, None), begins=False)
    track.add(_step(20, 1.0), begins=False)
    track.refine(np.array([10, 20], dtype=np.int64), _line([9.0, 1.5]))
    placed = track.placed({1: np.eye(4)})
    assert placed.stamps_ns.tolist() == [0, 20]  # what was lost stays lost
    np.testing.assert_allclose(placed.T_map_base[:, 0, 3], [0.0, 1.5])
    pose = track.node_pose(1)
    assert pose is not None
    np.testing.assert_allclose(pose, np.eye(4))
    assert track.node_pose(5) is None
