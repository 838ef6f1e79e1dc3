# SPDX-License-Identifier: MIT
"""Whole runs in a field where scans tell nothing: fixes, landmarks and odometry decide what the map looks like."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from pole_field import BEND_RAD_M, FIELD, LANDMARKS, fixes, landmarks, path, run, scans, wheels

from slamcli.cartographer.parameters import CartographerParameters, OptimizationProblem, PoseGraph
from slamcli.formats.pbstream.reading import read_state
from slamcli.formats.pbstream.writing import write_state
from slamcli.geometry import quaternion, se2, se3
from slamcli.geometry.alignment import umeyama
from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog

STAMPS, TRUTH = path()


@pytest.fixture(scope="module")
def bare():
    return run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH))


def off_m(result):
    """Root mean square and largest distance from the truth after the best alignment."""
    truth = np.column_stack([TRUTH[:, :2], np.zeros(len(TRUTH))])
    found = result.trajectory.positions_m
    fit = umeyama(found, truth)
    distances = np.linalg.norm(found @ fit.rotation.T + fit.translation_m - truth, axis=1)
    return math.sqrt(float((distances**2).mean())), float(distances.max())


def test_without_them_the_map_is_bent(bare):
    assert off_m(bare)[0] > 2.5
    assert not {"fixes", "landmarks"} & bare.summary.keys()
    state = bare.state
    assert len(state.odometry[0]) == len(STAMPS)
    assert (state.imu, state.fixed_frame_poses, state.landmarks, state.trajectory_data) == ({}, {}, {}, {})


def test_fixes_straighten_it_and_their_frame_is_found():
    result = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), fixes(STAMPS, TRUTH))
    rms, largest = off_m(result)
    assert rms < 0.45
    assert largest < 1.2
    assert result.summary["fixes"] == 81
    frame = result.state.trajectory_data[0].T_map_fixed_frame
    # Where the field's frame has the middle of the drive, the map has it too.
    middle = TRUTH[len(TRUTH) // 2]
    there = se3.to_se2(frame @ se3.from_se2(se2.compose(FIELD, middle)))
    mapped = result.trajectory.poses_se2[len(TRUTH) // 2]
    assert math.hypot(*(there - mapped)[:2]) < 1.0
    assert len(result.state.fixed_frame_poses[0]) == 81


def test_wrong_fixes_count_little():
    result = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), fixes(STAMPS, TRUTH, wrong=0.15))
    assert off_m(result)[0] < 0.6


def test_fixes_within_the_tolerance_cost_nothing():
    def graph(**changes):
        return CartographerParameters(pose_graph=PoseGraph(optimization_problem=OptimizationProblem(**changes)))

    wide = graph(
        fixed_frame_pose_use_tolerant_loss=True, fixed_frame_pose_tolerant_loss_param_a=1e8, fixed_frame_pose_tolerant_loss_param_b=1e4
    )  # fmt: skip
    narrow = graph(fixed_frame_pose_use_tolerant_loss=True)
    streams = scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), fixes(STAMPS, TRUTH)
    streams = [list(stream) for stream in streams]
    assert off_m(run(*streams, parameters=wide))[0] > 2.0
    assert off_m(run(*streams, parameters=narrow))[0] < 0.45


@pytest.mark.parametrize(
    ("listed", "message"),
    [
        (lambda: list(fixes(STAMPS, TRUTH))[30:31], "too close together"),
        (lambda: fixes(STAMPS - 3_600_000_000_000, TRUTH), "no fix was measured while there were scans"),
    ],
)
def test_one_fix_or_fixes_of_another_time_change_nothing(bare, listed, message):
    log = RunLog()
    result = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), listed(), log=log)
    np.testing.assert_array_equal(result.trajectory.positions_m, bare.trajectory.positions_m)
    assert [message in warning for warning in log.warnings].count(True) == 1
    assert result.state.trajectory_data == {}


def test_landmarks_close_a_loop_that_scans_cannot(bare):
    result = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), landmarks(STAMPS, TRUTH))
    end = math.hypot(*(result.trajectory.poses_se2[-1] - TRUTH[-1])[:2])
    assert math.hypot(*(bare.trajectory.poses_se2[-1] - TRUTH[-1])[:2]) > 5.0
    assert end < 0.3
    assert off_m(result)[0] < 0.4
    assert result.summary["landmarks"] == 3
    found = result.state.landmarks
    for name, place in LANDMARKS.items():
        assert np.hypot(*(found[name][:2, 3] - place[:2])) < 0.4
        assert found[name][2, 3] == pytest.approx(1.0)
        lying = quaternion.multiply(quaternion.from_yaw(place[2]), [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
        np.testing.assert_allclose(found[name][:3, :3], quaternion.to_matrix(lying), atol=0.1)


def test_the_term_of_the_odometry_is_what_the_original_has():
    """With the wheels' weights far above all others the path is that of the wheels."""
    parameters = CartographerParameters(
        pose_graph=PoseGraph(
            optimization_problem=OptimizationProblem(
                odometry_term="always", odometry_translation_weight=1e7, odometry_rotation_weight=1e7
            )
        )
    )
    streams = [list(stream) for stream in (scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), landmarks(STAMPS, TRUTH))]
    result = run(*streams, parameters=parameters)
    told = np.array([one.pose_se2 for one in streams[1]])
    np.testing.assert_allclose(result.trajectory.poses_se2[:, :2], told[:, :2], atol=0.05)
    assert off_m(result)[0] > 2.5
    assert BEND_RAD_M > 0


def test_an_imu_that_is_used_is_kept_in_the_frame_of_the_robot():
    count = 10 * len(STAMPS)
    stamps = np.linspace(STAMPS[0], STAMPS[-1], count).astype(np.int64)
    rate = np.interp(stamps[:-1] - STAMPS[0], STAMPS[:-1] - STAMPS[0], np.diff(np.unwrap(TRUTH[:, 2])) / 0.25)
    samples = [
        ImuSample(
            stamp_ns=int(stamp), frame_id="imu", angular_rad_s=np.array([0.0, 0.0, w]), topic="/imu",
            acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
        )
        for stamp, w in zip(stamps.tolist(), rate.tolist(), strict=False)
    ]  # fmt: skip
    result = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), [*samples, samples[-1]])
    assert off_m(result)[0] < 0.5  # the gyroscope knows the heading
    kept = result.state.imu[0]
    assert len(kept) == len(samples)  # one stamp twice: once
    assert {sample.frame_id for sample in kept} == {"base_link"}


@pytest.mark.parametrize("observed", [True, False])
def test_a_second_run_is_laid_on_a_loaded_map_by_its_landmarks(tmp_path, observed):
    """Also where the state holds only where the landmarks are."""
    first = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), landmarks(STAMPS, TRUTH))
    write_state(tmp_path / "first.pbstream", first.state)
    state = replace(read_state(tmp_path / "first.pbstream"), frozen=frozenset({0}))
    if not observed:
        state = replace(state, landmark_observations={})
    part = slice(0, 40)
    begun = np.array([1.5, -0.5, 0.6])
    poses = se2.compose(begun, TRUTH[part])
    stamps = STAMPS[part] + 10**13
    log = RunLog()
    second = run(scans(stamps, poses), wheels(stamps, poses, bend=0.0), landmarks(stamps, poses), state=state, log=log)
    found = second.trajectory.poses_se2
    assert np.hypot(*(found - poses)[:20, :2].T).max() < 0.4
    for name in LANDMARKS:
        np.testing.assert_allclose(
            second.state.landmarks[name], state.landmarks[name], atol=1e-9 if not observed else 0.1
        )
    np.testing.assert_allclose(
        [node.T_map_node for node in second.state.nodes if node.id.trajectory == 0],
        [node.T_map_node for node in state.nodes],
        atol=1e-12,
    )
    assert sorted(second.state.landmark_observations) == ([0, 1] if observed else [1])


def test_a_state_keeps_what_fixes_say(tmp_path):
    first = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), fixes(STAMPS, TRUTH, turned=True))
    write_state(tmp_path / "first.pbstream", first.state)
    state = read_state(tmp_path / "first.pbstream")
    kept = np.array([fix.pose_se2 for fix in state.fixed_frame_poses[0]])
    truth = se2.compose(FIELD, TRUTH[::4])
    assert np.hypot(*(kept - truth)[:, :2].T).mean() < 0.8  # of the robot, not of the antenna; their deviation is 0.5 m
    np.testing.assert_allclose(se2.wrap_angle(kept[:, 2] - truth[:, 2]), 0.0, atol=1e-6)
    np.testing.assert_allclose(
        state.trajectory_data[0].T_map_fixed_frame, first.state.trajectory_data[0].T_map_fixed_frame, atol=1e-12
    )


def test_going_on_with_a_map_that_fixes_straightened_does_not_bend_it_back(tmp_path):
    first = run(scans(STAMPS, TRUTH), wheels(STAMPS, TRUTH), fixes(STAMPS, TRUTH))
    write_state(tmp_path / "first.pbstream", first.state)
    state = read_state(tmp_path / "first.pbstream")
    weights = [c.translation_weight for c in state.constraints]
    assert max(weights) == 500.0
    assert min(weights) < 480.0  # scans told nothing on the way
    stamps = STAMPS[:20] + 10**13
    second = run(scans(stamps, TRUTH[:20]), wheels(stamps, TRUTH[:20]), state=state)
    before = np.array([node.T_map_node[:2, 3] for node in first.state.nodes])
    after = np.array([node.T_map_node[:2, 3] for node in second.state.nodes if node.id.trajectory == 0])
    assert np.hypot(*(after - before).T).max() < 0.9  # by the wheels alone it would be 10
