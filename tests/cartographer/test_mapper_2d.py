# SPDX-License-Identifier: MIT
"""The whole tier in the plane, around a corridor and in a room: error, determinism, lost sight, bad wheels, many sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from box_room import BOXES
from box_room import drive as drive_in_the_room
from ring_world import (
    drive,
    errors,
    gyroscope,
    mapped,
    odometry,
    parameters,
    recorded,
    scan,
    stamps_of,
    wheels,
)  # fmt: skip

from slamcli.cartographer.parameters import PoseGraph
from slamcli.cartographer.parameters.pose_graph import BatchSearch
from slamcli.cartographer.parameters.trajectory_builder_2d import ScanOdometry2d
from slamcli.errors import DataError, EstimationError
from slamcli.geometry import se2
from slamcli.runtime import RunLog

ONLINE = PoseGraph(batch_search=BatchSearch(enabled=False), optimize_every_n_nodes=40)
NO_SCAN_ODOMETRY = {"scan_odometry": ScanOdometry2d(enabled=False)}
POSES = drive()
STAMPS = stamps_of(len(POSES))
TOLD = wheels(POSES, seed=3)


def content(result):
    """Everything of a result that must be the same to the byte."""
    state = result.state
    return b"".join(
        np.ascontiguousarray(values).tobytes()
        for values in (
            result.trajectory.poses_se2, result.grid.cells, *result.steps.values(),
            *(node.T_map_node for node in state.nodes), *(submap.grid.cells for submap in state.submaps),
            *(c.T_submap_node for c in state.constraints), [search.score for search in result.loop_searches],
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def batch():
    return mapped(recorded(POSES, told=TOLD))


@pytest.fixture(scope="module")
def online():
    return mapped(recorded(POSES, told=TOLD), parameters(ONLINE))


@pytest.mark.parametrize("kind", ["batch", "online"])
def test_the_loop_around_the_block_closes(kind, request):
    result = request.getfixturevalue(kind)
    distance, turn = errors(result, POSES)
    assert distance.max() < 0.04
    assert turn.max() < 0.01
    dead_reckoned = np.hypot(*(TOLD - se2.between(POSES[0], POSES))[:, :2].T)
    assert dead_reckoned.max() > 1.0
    accepted = [search for search in result.loop_searches if search.accepted]
    assert len(accepted) == result.summary["constraints_inter"] > 30
    around = [search for search in accepted if search.node.number - 20 * search.submap.number > 100]
    assert len(around) > 10  # the second time around
    calibration = result.summary["wheel_calibration"]
    assert calibration["scale"] == pytest.approx(1 / 1.02, abs=0.01)
    assert calibration["turn_scale"] == pytest.approx(1 / 1.03, abs=0.01)


@pytest.mark.parametrize(("kind", "pose_graph"), [("batch", None), ("online", ONLINE)])
def test_threads_change_no_byte(kind, pose_graph, request):
    again = mapped(recorded(POSES, told=TOLD), parameters(pose_graph), jobs=2)
    assert content(again) == content(request.getfixturevalue(kind))


def test_the_two_orders_of_searching_agree(batch, online):
    off = se2.between(batch.trajectory.poses_se2, online.trajectory.poses_se2)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.03
    # The original tries each pair once; covariances are those of a match in all directions alike.
    assert online.summary["loops_rejected"] == {}
    pairs = [(search.submap, search.node) for search in online.loop_searches]
    assert len(pairs) == len(set(pairs)) <= online.summary["loop_trials"]


def test_as_the_original_along_the_corridor():
    result = mapped(recorded(POSES, told=TOLD), parameters(ONLINE, **NO_SCAN_ODOMETRY))
    distance, turn = errors(result, POSES)
    assert "wheel_calibration" not in result.summary
    assert "scan_odometry_quality" not in result.steps
    assert distance.max() < 0.15
    assert turn.max() < 0.06


@pytest.mark.parametrize("gyro", [False, True], ids=["scans", "gyro"])
def test_as_the_original_without_wheels(gyro):
    stamps, poses = drive_in_the_room(150)
    scans = [scan(pose, stamp, beams=360, boxes=BOXES) for stamp, pose in zip(stamps, poses, strict=True)]
    imu = gyroscope(stamps, poses, bias=0.0) if gyro else []
    measurements = sorted([*imu, *scans], key=lambda m: m.stamp_ns)
    p = parameters(ONLINE, use_online_correlative_scan_matching=True, **NO_SCAN_ODOMETRY)
    result = mapped(measurements, p)
    distance, turn = errors(result, poses)
    assert distance.max() < 0.15
    assert turn.max() < 0.08


@pytest.mark.parametrize("sensors", ["scans", "gyro", "no gravity"])
def test_without_wheels(sensors):
    gravity = 0.0 if sensors == "no gravity" else 9.81
    imu = [] if sensors == "scans" else gyroscope(STAMPS, POSES, gravity=gravity)
    log = RunLog()
    distance, turn = errors(mapped(recorded(POSES, imu=imu), log=log), POSES)
    assert distance.max() < 0.05
    assert turn.max() < 0.01
    assert any("no odometry" in note for note in log.notes)


def test_after_a_blind_stretch_new_submaps_begin():
    blind = range(90, 150)
    result = mapped(recorded(POSES, told=TOLD, blind=blind))
    distance, _ = errors(result, POSES)
    assert distance.max() < 0.1  # wheels lead through it, and loops tie both sides
    state, scans = result.state, result.steps["scan_index"][result.steps["inserted"] == 1]
    assert not set(scans.tolist()) & set(blind)
    before = {node.id for node, k in zip(state.nodes, scans, strict=True) if k < 90}
    for submap in state.submaps:
        held = {c.node for c in state.constraints if c.kind == "intra" and c.submap == submap.id}
        assert held <= before or not held & before  # none goes on over the blind stretch


def test_blind_all_the_time_is_an_error():
    with pytest.raises(EstimationError, match="nothing to map"):
        mapped(recorded(POSES[:20], told=TOLD, blind=range(20)))
    with pytest.raises(DataError, match="no scan was read"):
        mapped([odometry(STAMPS[0], TOLD[0])])


def test_blind_at_first():
    result = mapped(recorded(POSES, told=TOLD, blind=range(15)))
    assert len(result.trajectory) == len(POSES)
    distance, _ = errors(result, POSES)
    assert distance.max() < 0.06


def test_a_jump_of_the_odometry_is_left_out():
    told, log = TOLD.copy(), RunLog()
    told[100:] = se2.compose(np.array([50.0, -20.0, 1.0]), told[100:])
    distance, _ = errors(mapped(recorded(POSES, told=told), log=log), POSES)
    assert distance.max() < 0.25
    assert log.counts["jumps of the odometry"] == 1
    assert any("jumps 1 times" in warning for warning in log.warnings)


@pytest.mark.parametrize("p", [{}, NO_SCAN_ODOMETRY], ids=["scan odometry", "original"])
def test_three_messages_make_a_scan(p):
    told = wheels(POSES, scale=1.0, turn=1.0, seed=3) if p else TOLD  # the original believes them
    result = mapped(recorded(POSES, told=told), parameters(None, num_accumulated_range_data=3, **p))
    assert result.steps["scan_index"].tolist() == list(range(2, len(POSES), 3))
    assert len(result.trajectory) == len(POSES)  # a pose for every message, those before the first match too
    distance, turn = errors(result, POSES)
    assert distance.max() < (0.15 if p else 0.05)
    assert turn.max() < (0.06 if p else 0.01)


def test_two_scanners_that_look_to_both_ends():
    noise = np.random.default_rng(5)
    front, back = (0.3, 0.05, 0.0), (-0.3, -0.05, math.pi)
    mounts, measurements = {}, []
    for topic, mount in (("/front", front), ("/back", back)):
        mounts[topic] = np.eye(4)
        mounts[topic][:2, :2] = [[math.cos(mount[2]), -math.sin(mount[2])], [math.sin(mount[2]), math.cos(mount[2])]]
        mounts[topic][:2, 3] = mount[:2]
    for k, (pose, stamp) in enumerate(zip(POSES, STAMPS, strict=True)):
        topic, mount = (("/front", front), ("/back", back))[k % 2]
        measurements += [
            odometry(stamp, TOLD[k]),
            scan(pose, stamp, topic=topic, mount=mount, fov=1.5 * math.pi, beams=180, noise=noise),
        ]
    result = mapped(measurements, parameters(None, num_accumulated_range_data=2), mounts=mounts)
    distance, turn = errors(result, POSES)
    assert distance.max() < 0.08
    assert turn.max() < 0.02


def test_stamps_that_run_backwards():
    stamps, log = STAMPS.copy(), RunLog()
    stamps[10::7] -= 150_000_000
    result = mapped(recorded(POSES, stamps, told=TOLD), log=log)
    distance, _ = errors(result, POSES)
    assert distance.max() < 0.1
    np.testing.assert_array_equal(result.trajectory.stamps_ns, stamps)  # as they were recorded
