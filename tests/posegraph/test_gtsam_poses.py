# SPDX-License-Identifier: MIT
"""Pose graphs by GTSAM, against our own adjustment and the truth."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from lap_graphs import SIGMAS, lap_graph, rms

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.posegraph.gtsam_poses import IncrementalPoses, optimise_poses
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.pose_problem import GtsamSettings, PoseKnowledge
from slamcli.posegraph.spatial import SpatialEdges, optimise_spatial


def plain(problem):
    return replace(problem, edges=replace(problem.edges, robust=np.zeros(len(problem.edges.first), np.bool_)))


def part(problem, count):
    """The first `count` poses and what lies between them."""
    edges = problem.edges
    kept = (edges.first < count) & (edges.second < count)
    columns = {name: getattr(edges, name)[kept] for name in type(edges).__slots__}
    return replace(
        problem, keys=problem.keys[:count], T_map_pose=problem.T_map_pose[:count], edges=replace(edges, **columns)
    )


@pytest.mark.parametrize("method", ["gauss_newton", "levenberg", "dogleg"])
@pytest.mark.parametrize("planar", [False, True])
def test_closures_pull_the_drift_out(method, planar):
    problem, truth = lap_graph(planar=planar)
    found = optimise_poses(plain(problem), GtsamSettings(method=method, planar=planar))
    freedom = (3 if planar else 6) * (len(problem.edges.first) - len(problem.keys) + 1)
    assert rms(found.T_map_pose, truth) < 0.5 * rms(problem.T_map_pose, truth)
    assert 0.6 * freedom < 2 * found.error_after < 1.4 * freedom
    assert found.error_after < 0.03 * found.error_before
    assert np.allclose(found.T_map_pose[0], problem.T_map_pose[0], atol=1e-12)


def test_same_minimum_as_ours():
    problem, _ = lap_graph(30, 8)
    rng = np.random.default_rng(3)
    mixed = rng.normal(size=(len(problem.edges.first), 6, 6))
    information = np.diag(SIGMAS**-2.0) + 500.0 * mixed @ mixed.transpose(0, 2, 1)
    edges = problem.edges
    exact = optimise_poses(
        replace(plain(problem), edges=replace(plain(problem).edges, information=information)),
        GtsamSettings(epsilon=1e-12, iterations=100),
    )
    # Ours takes information along the axes of the pose that is seen, translation only.
    turn = np.tile(np.eye(6), (len(information), 1, 1))
    turn[:, :3, :3] = edges.T_first_second[:, :3, :3]
    one = np.ones(len(edges.first))
    measured = np.concatenate(se3.to_position_quaternion(edges.T_first_second), axis=1)
    ours = optimise_spatial(
        np.concatenate(se3.to_position_quaternion(problem.T_map_pose), axis=1), np.arange(30) == 0,
        SpatialEdges(
            first=edges.first, second=edges.second, measured=measured, translation_weight=one, rotation_weight=one,
            robust=one > 1, information=turn.transpose(0, 2, 1) @ information @ turn,
        ), loss=Loss(), max_iterations=100, tolerance=1e-12,
    )  # fmt: skip
    # The rotation's error is measured in the axes of different poses: the same to first order.
    assert ours.cost_after == pytest.approx(exact.error_after, rel=0.05)
    assert np.abs(ours.poses[:, :3] - exact.T_map_pose[:, :3, 3]).max() < 0.02


def test_wrong_closures_lose_their_weight():
    problem, truth = lap_graph(wrong=3)
    strained = optimise_poses(plain(problem), GtsamSettings())
    robust = optimise_poses(problem, GtsamSettings(iterations=100))
    good, _ = lap_graph(wrong=0)
    clean = optimise_poses(plain(good), GtsamSettings())
    assert rms(strained.T_map_pose, truth) > 3 * rms(clean.T_map_pose, truth)
    assert rms(robust.T_map_pose, truth) < 1.2 * rms(clean.T_map_pose, truth)
    assert robust.weights.round(3).tolist() == [1.0] * (len(robust.weights) - 3) + [0.0] * 3


@pytest.mark.parametrize("planar", [False, True])
def test_increments_come_to_the_same(planar):
    problem, _ = lap_graph(planar=planar)
    problem = plain(problem)
    incremental = IncrementalPoses(GtsamSettings(planar=planar, relinearise_threshold=1e-4))
    for count in (20, 35, 36, 60):
        found = incremental.optimise(part(problem, count))
    whole = optimise_poses(problem, GtsamSettings(planar=planar))
    assert np.abs(found.T_map_pose - whole.T_map_pose).max() < 1e-3
    assert found.error_after == pytest.approx(whole.error_after, rel=1e-3)


def test_increments_forget_edges_and_begin_anew_without_poses():
    problem, _ = lap_graph(wrong=2)
    problem = plain(problem)
    incremental = IncrementalPoses(GtsamSettings(relinearise_threshold=1e-4))
    incremental.optimise(problem)
    edges = problem.edges
    columns = {name: getattr(edges, name)[:-2] for name in type(edges).__slots__}
    fewer = replace(problem, edges=replace(edges, **columns))
    found, whole = incremental.optimise(fewer), optimise_poses(fewer, GtsamSettings())
    assert np.abs(found.T_map_pose - whole.T_map_pose).max() < 2e-3
    found, whole = incremental.optimise(part(fewer, 40)), optimise_poses(part(fewer, 40), GtsamSettings())
    assert np.abs(found.T_map_pose - whole.T_map_pose).max() < 2e-3


def test_gravity_levels_the_graph_and_a_prior_places_it():
    problem, truth = lap_graph()
    tilted = np.array(problem.T_map_pose)
    tilt = np.eye(4)
    tilt[1:3, 1:3] = [[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]
    count = len(tilted)
    gravity = PoseKnowledge(
        row=np.arange(count), T_map_pose=truth, information=np.tile(np.eye(6), (count, 1, 1)),
        gravity=np.ones(count, np.bool_),
    )  # fmt: skip
    level = optimise_poses(replace(plain(problem), T_map_pose=tilt @ tilted, known=gravity), GtsamSettings())
    ups = level.T_map_pose[:, 2, :3]
    assert np.degrees(np.arccos(np.clip((ups * truth[:, 2, :3]).sum(axis=1), -1, 1))).max() < 1.5
    assert np.allclose(level.T_map_pose[0, :3, 3], (tilt @ tilted)[0, :3, 3], atol=0.01)
    away = np.eye(4)
    away[:3, 3] = 100.0, 0.0, 0.0
    prior = PoseKnowledge(
        row=np.array([7]), T_map_pose=(away @ truth)[7:8], information=1e6 * np.eye(6)[None],
        gravity=np.zeros(1, np.bool_),
    )  # fmt: skip
    for planar in (False, True):
        flat, at = lap_graph(planar=planar)
        known = replace(prior, T_map_pose=(away @ at)[7:8])
        placed = optimise_poses(replace(plain(flat), known=known), GtsamSettings(planar=planar))
        assert np.abs(placed.T_map_pose[7, :3, 3] - (away @ at)[7, :3, 3]).max() < 0.01


def test_same_bytes_twice():
    problem, _ = lap_graph()
    first, second = (optimise_poses(problem, GtsamSettings()).T_map_pose.tobytes() for _ in range(2))
    assert first == second


def test_what_nothing_holds_is_refused_with_a_sentence():
    problem, _ = lap_graph(10, 2)
    edges = problem.edges
    loose = {name: getattr(edges, name)[1:] for name in type(edges).__slots__}
    for solve in (lambda p: optimise_poses(p, GtsamSettings()), IncrementalPoses(GtsamSettings()).optimise):
        with pytest.raises(EstimationError, match="GTSAM could not solve the graph of poses"):
            solve(replace(plain(problem), edges=replace(plain(problem).edges, **loose)))
        bad = edges.T_first_second.copy()
        bad[3, 0, 3] = np.nan
        with pytest.raises(EstimationError, match="edge 3 of the graph is not finite"):
            solve(replace(problem, edges=replace(edges, T_first_second=bad)))


def test_rotations_that_are_not_quite_any_more_come_back_as_rotations():
    # With another root at each call an error of the root's rotation grew from call to call.
    from slamcli.posegraph.gtsam_factors import solved_poses

    gtsam = pytest.importorskip("gtsam")
    poses = np.stack([np.eye(4), np.eye(4)])
    poses[0, :3, :3] *= 1.001
    poses[1, 0, 3] = 1.0
    values = gtsam.Values()
    for key in (3, 8):
        values.insert(key, gtsam.Pose3(poses[int(key == 8)]))
    known = SimpleNamespace(gravity=np.zeros(0), row=np.zeros(0, np.int64))
    problem = SimpleNamespace(keys=np.array([3, 8]), T_map_pose=poses, root=0, known=known)
    solved = solved_poses(problem, values, planar=False)
    np.testing.assert_allclose(
        solved[:, :3, :3] @ solved[:, :3, :3].transpose(0, 2, 1), np.stack([np.eye(3)] * 2), atol=1e-12
    )
