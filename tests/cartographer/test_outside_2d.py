# SPDX-License-Identifier: MIT
"""Landmarks and fixes bend a graph whose local SLAM drifted back to where the robot truly drove."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from slamcli.cartographer.graph_2d import PoseGraph2d, TrajectoryPart
from slamcli.cartographer.outside_2d import Outside2d
from slamcli.cartographer.parameters import PoseGraph
from slamcli.cartographer.timeline_2d import Timeline
from slamcli.geometry import quaternion, se2
from slamcli.mapper import Setup
from slamcli.measurements import LandmarkObservation, Landmarks, StampedPose
from slamcli.posegraph import Id, MapState
from slamcli.runtime import RunLog

START, S, NUM = 1_700_000_000_000_000_000, 1_000_000_000, 120
RADIUS_M = 20.0
STAMPS = START + S * np.arange(NUM, dtype=np.int64)
FRAME = np.array([100.0, -50.0, 2.0])
"""Where the fixed frame truly lies in the map."""


def true_path() -> np.ndarray:
    """One time around a circle, starting at the origin towards x."""
    angle = 2 * math.pi * np.arange(NUM) / (NUM - 1)
    return np.column_stack([RADIUS_M * np.sin(angle), RADIUS_M * (1 - np.cos(angle)), se2.wrap_angle(angle)])


def drifted(path: np.ndarray) -> np.ndarray:
    """The same motions, each turned by a little too much."""
    steps = se2.between(path[:-1], path[1:]) + np.array([0.0, 0.0, 0.004])
    poses = [path[0]]
    for step in steps:
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def graph_of(local: np.ndarray, slack_m: float = 0.1) -> PoseGraph2d:
    per_submap = 10
    submaps = local[::per_submap].copy()
    part = TrajectoryPart(
        trajectory=0, frozen=False, submap_ids=[Id(0, k) for k in range(len(submaps))], submap_local=submaps,
        submap_map=submaps.copy(), grids=[None] * len(submaps), finished=[True] * len(submaps),
        node_ids=[Id(0, k) for k in range(len(local))], node_local=local, node_map=local.copy(),
        points=[np.zeros((0, 2))] * len(local), members=[(k // per_submap,) for k in range(len(local))],
        slack_m=np.full(len(local), slack_m),
    )  # fmt: skip
    return PoseGraph2d(PoseGraph(), [part])


def outside(log: RunLog | None = None, **mounts: np.ndarray) -> Outside2d:
    named = {f"/{name}": mount for name, mount in mounts.items()}
    return Outside2d(Setup(T_base_laser={}, T_base_sensor=named, log=log or RunLog()))


def adjusted(graph: PoseGraph2d, found: Outside2d) -> np.ndarray:
    found.attach(graph, STAMPS, graph.node_local, np.arange(NUM))
    graph.optimise(50)
    return graph.node


def fix(k: float, position: np.ndarray, **changes: Any) -> StampedPose:
    covariance = np.diag([0.04, 0.04, 1.0, math.inf, math.inf, math.inf])
    values: dict[str, Any] = dict(
        stamp_ns=round(START + k * S), frame_id="earth_plane", position_m=np.append(position[:2], 500.0),
        quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), covariance=covariance, topic="/fix",
    )  # fmt: skip
    return StampedPose(**{**values, **changes})


def in_frame(poses: np.ndarray) -> np.ndarray:
    return se2.between(np.broadcast_to(FRAME, poses.shape), poses)


def worst_m(nodes: np.ndarray, truth: np.ndarray) -> float:
    return float(np.hypot(*(nodes[:, :2] - truth[:, :2]).T).max())


def test_fixes_take_the_drift_out():
    truth = true_path()
    graph, found = graph_of(drifted(truth)), outside()
    assert worst_m(graph.node, truth) > 5.0
    for k, pose in enumerate(in_frame(truth)):
        found.add(fix(k, pose))
    nodes = adjusted(graph, found)
    # The first submap stays, so that the frame's place is known as well as the first stretch tells its heading.
    frame = graph.extra[0]
    assert worst_m(se2.between(np.broadcast_to(frame, nodes.shape), nodes), in_frame(truth)) < 0.25
    summary = found.summary(graph)
    assert summary["fixes"] == NUM
    assert summary["fix_residual_median_m"] < 0.1


def test_fixes_that_are_far_off_count_little_and_an_antenna_has_its_place():
    truth, rng = true_path(), np.random.default_rng(4)
    mount = np.eye(4)
    mount[:3, 3] = [1.0, 0.5, 1.2]
    graph, found = graph_of(drifted(truth)), outside(fix=mount)
    antenna = se2.compose(truth, np.broadcast_to([1.0, 0.5, 0.0], truth.shape))
    for k, pose in enumerate(in_frame(antenna)):
        wrong = 30.0 if k % 12 == 7 else 0.0
        found.add(fix(k, pose + wrong * rng.standard_normal(3)))
    nodes = adjusted(graph, found)
    frame = graph.extra[0]
    assert worst_m(se2.between(np.broadcast_to(frame, nodes.shape), nodes), in_frame(truth)) < 0.5


def test_poses_of_another_system_tell_the_heading_as_well():
    truth = true_path()[:3]
    local = np.zeros((3, 3))
    log = RunLog()
    graph, found = graph_of(local), outside(log)
    pose = np.array([5.0, 1.0, 0.7])
    for k in range(3):
        found.add(fix(k, pose, quat_xyzw=quaternion.from_yaw(0.7), covariance=None))
    found.attach(graph, STAMPS[:3], local, np.arange(3))
    graph.optimise(20)
    np.testing.assert_allclose(se2.compose(graph.extra[0], pose), [0, 0, 0], atol=1e-6)
    assert not log.warnings
    assert len(truth) == 3


def test_fixes_that_tell_nothing_are_left_out_with_a_warning():
    log = RunLog()
    graph, found = graph_of(np.zeros((NUM, 3))), outside(log)
    for k in range(NUM):
        found.add(fix(k, np.array([3.0, 4.0, 0.0])))
    adjusted(graph, found)
    assert len(graph.extra) == 0
    assert "too close together to tell directions" in log.warnings[0]
    graph, found = graph_of(true_path()), outside(log)
    found.add(fix(-500, np.zeros(3)))
    adjusted(graph, found)
    assert "no fix was measured while there were scans" in log.warnings[1]
    assert found.summary(graph) == {}


def seen(k: float, names: dict[str, np.ndarray], tilt: np.ndarray) -> Landmarks:
    observations = tuple(
        LandmarkObservation(
            id=name, position_m=np.append(pose[:2], 1.0), translation_weight=1.5e4, rotation_weight=3e4,
            quat_xyzw=quaternion.multiply(quaternion.from_yaw(pose[2]), tilt),
        )
        for name, pose in names.items()
    )  # fmt: skip
    return Landmarks(stamp_ns=round(START + k * S), frame_id="base_link", observations=observations, topic="/tags")


@pytest.mark.parametrize("roll_pitch", [(0.0, 0.0), (math.pi / 2, 0.3), (0.2, math.pi / 2)])
def test_a_landmark_that_is_seen_again_closes_the_loop(roll_pitch: tuple[float, float]):
    truth = true_path()
    tilt = quaternion.from_roll_pitch_yaw(*roll_pitch, 0.4)
    graph, found = graph_of(drifted(truth)), outside()
    end_before = float(np.hypot(*(graph.node[-1, :2] - truth[-1, :2])))
    place = np.array([1.0, 2.0, 0.3])
    for k in (*range(10), *range(NUM - 10, NUM)):
        found.add(seen(k, {"tag 1": se2.between(truth[k], place)}, tilt))
    nodes = adjusted(graph, found)
    assert end_before > 2.0
    assert np.hypot(*(nodes[-1, :2] - truth[-1, :2])) < 0.1
    assert abs(se2.wrap_angle(nodes[-1, 2] - truth[-1, 2])) < 0.05
    np.testing.assert_allclose(graph.extra[0, :2], place[:2], atol=0.08)
    state = MapState(nodes=(), submaps=(), constraints=())
    kept = found.kept(graph, state)
    assert list(kept.landmarks) == ["tag 1"]
    assert len(kept.landmark_observations[0]) == 20
    assert found.summary(graph) == {"landmarks": 1}


def test_a_detectors_mount_and_observations_between_nodes():
    truth = true_path()
    mount = np.eye(4)
    mount[:3, :3] = quaternion.to_matrix(quaternion.from_yaw(math.pi / 2))
    mount[:3, 3] = [0.3, 0.0, 0.5]
    graph, found = graph_of(truth), outside(tags=mount)
    sensor = se2.compose(truth, np.broadcast_to([0.3, 0.0, math.pi / 2], truth.shape))
    place = np.array([-3.0, 4.0, 0.0])
    for k in range(3):
        halfway = se2.compose(sensor[k], 0.5 * se2.between(sensor[k], sensor[k + 1]))
        found.add(seen(k + 0.5, {"a": se2.between(halfway, place)}, np.array([0.0, 0.0, 0.0, 1.0])))
    adjusted(graph, found)
    np.testing.assert_allclose(graph.extra[0, :2], place[:2], atol=0.02)


def test_where_the_robot_was_between_nodes():
    poses = np.column_stack([np.arange(5.0), np.zeros(5), np.full(5, 0.0)])
    stamps = START + 10 * S * np.arange(5, dtype=np.int64)
    line = Timeline.of_scans(np.array([7, 9]), poses[[0, 4]], stamps, poses, np.array([0, 4]))
    query = START + np.array([-8, 0, 12, 28, 45, 47], dtype=np.int64) * S
    rows, relative, known = line.seen_from_nodes(query)
    assert rows.tolist() == [7, 7, 7, 9, 9, 9]
    np.testing.assert_allclose(relative[:, 0], [0.0, 0.0, 1.2, -1.2, 0.0, 0.0], atol=1e-12)
    assert known.tolist() == [False, True, True, True, True, False]
    none = Timeline.of_nodes(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64))
    assert not none.seen_from_nodes(query)[2].any()
    one = Timeline.of_nodes(np.array([3]), poses[:1], stamps[:1])
    assert one.seen_from_nodes(query)[0].tolist() == [3] * 6
