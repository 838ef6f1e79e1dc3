# SPDX-License-Identifier: MIT
"""Pose adjustment in space: exact worlds, GTSAM as a second opinion, Jacobians, gauge, bad input."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
import spatial_worlds as worlds
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError
from slamcli.posegraph import spatial
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.spatial import optimise_spatial

pytestmark = pytest.mark.kernels
NONE = Loss()


def fixed_first(count):
    return np.arange(count) == 0


def numeric_jacobians(term, state):
    """Derivatives (N, M, V, 3) of the residuals of `term` by central differences."""
    size = 2 * len(state)
    columns = []
    for i in range(3 * size):
        step = np.zeros(3 * size)
        step[i] = 1e-6
        low, high = (spatial._retract(state, sign * step.reshape(size, 3)) for sign in (-1, 1))
        columns.append((term.residuals(high) - term.residuals(low)) / 2e-6)
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, size, 3)


def analytic_jacobians(term, state):
    values = term.jacobians(state)
    dense = np.zeros((*values.shape[:2], 2 * len(state), 3))
    for n, row in enumerate(term.variables):
        for k, variable in enumerate(row):
            if variable >= 0:
                dense[n, :, variable] += values[n, :, 3 * k : 3 * k + 3]
    return dense


def naive_residuals(poses, first, until, ratio, second, measured, weights):
    """Residuals (N, 6) with scipy's rotations."""
    out = []
    for n, (a, u, b) in enumerate(zip(first, until, second, strict=True)):
        start, end = Rotation.from_quat(poses[a, 3:]), Rotation.from_quat(poses[u, 3:])
        turn = start * Rotation.from_rotvec(ratio[n] * (start.inv() * end).as_rotvec())
        place = poses[a, :3] + ratio[n] * (poses[u, :3] - poses[a, :3])
        translation = turn.inv().apply(poses[b, :3] - place) - measured[n, :3]
        relative = turn.inv() * Rotation.from_quat(poses[b, 3:])
        rotation = (Rotation.from_quat(measured[n, 3:]).inv() * relative).as_rotvec()
        out.append(np.concatenate([weights[0] * translation, weights[1] * rotation]))
    return np.array(out)


@pytest.mark.parametrize("ratio", [None, 0.3])
def test_residuals_are_those_of_the_naive_twin(ratio):
    rng = np.random.default_rng(3)
    poses, measured = worlds.random_poses(rng, 6), worlds.random_poses(rng, 4)
    first, second, until = np.array([0, 1, 2, 3]), np.array([3, 4, 5, 1]), np.array([1, 2, 5, 0])
    between = {} if ratio is None else {"until": until, "ratio": np.full(4, ratio)}
    term = spatial._terms(worlds.edges(first, second, measured, **between), NONE)
    naive = naive_residuals(poses, first, until, np.full(4, ratio or 0.0), second, measured, (10.0, 20.0))
    np.testing.assert_allclose(term.residuals(poses), naive, atol=1e-11)


@pytest.mark.parametrize("spread", [1.0, 1e-6])
@pytest.mark.parametrize("ratio", [None, 0.3])
@pytest.mark.parametrize("full", [False, True])
def test_jacobians_are_the_differences_of_the_residuals(ratio, full, spread):
    rng = np.random.default_rng(3)
    poses = worlds.random_poses(rng, 6)
    poses[:, 3:] = Rotation.from_rotvec(rng.normal(size=(6, 3)) * spread).as_quat()
    measured = worlds.random_poses(rng, 4)
    measured[:, 3:] = Rotation.from_rotvec(rng.normal(size=(4, 3)) * spread).as_quat()
    between = {} if ratio is None else {"until": np.array([1, 2, 5, 0]), "ratio": np.full(4, ratio)}
    root = rng.normal(size=(4, 6, 6))
    information = root @ root.transpose(0, 2, 1) if full else None
    edges = worlds.edges([0, 1, 2, 3], [3, 4, 5, 1], measured, information=information, **between)
    term = spatial._terms(edges, NONE)
    np.testing.assert_allclose(analytic_jacobians(term, poses), numeric_jacobians(term, poses), atol=1e-7)


def test_a_noiseless_graph_comes_out_exact():
    truth, start, first, second, measured = worlds.helix(translation_sigma=0, rotation_sigma=0)
    edges = worlds.edges(first, second, measured)
    solution = optimise_spatial(start, fixed_first(len(truth)), edges, loss=NONE, max_iterations=50, tolerance=1e-13)
    assert solution.converged
    assert solution.cost_after < 1e-12 < solution.cost_before
    np.testing.assert_allclose(solution.poses[:, :3], truth[:, :3], atol=1e-7)
    np.testing.assert_allclose(worlds.rotation_errors(solution.poses, truth), 0, atol=1e-7)


def split_error(measured, sigma):
    """Our error for GTSAM's custom factors, with Jacobians by differences of its own retraction."""
    inverse = gtsam.Rot3.Quaternion(measured[6], *measured[3:6]).inverse()

    def plain(a, b):
        relative = a.between(b)
        turn = gtsam.Rot3.Logmap(inverse.compose(relative.rotation()))
        return np.concatenate([(relative.translation() - measured[:3]) / sigma[0], turn / sigma[1]])

    def error(factor, values, jacobians):
        a, b = (values.atPose3(key) for key in list(factor.keys()))
        if jacobians is not None:
            steps = np.eye(6) * 1e-6
            jacobians[0] = np.stack([(plain(a.retract(s), b) - plain(a.retract(-s), b)) / 2e-6 for s in steps], axis=1)
            jacobians[1] = np.stack([(plain(a, b.retract(s)) - plain(a, b.retract(-s))) / 2e-6 for s in steps], axis=1)
        return plain(a, b)

    return error


def test_the_minimum_is_that_of_gtsam():
    truth, start, first, second, measured = worlds.helix(nodes=25, loops=10)
    edges = worlds.edges(first, second, measured)
    ours = optimise_spatial(start, fixed_first(len(truth)), edges, loss=NONE, max_iterations=100, tolerance=1e-15)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    place = [gtsam.Pose3(gtsam.Rot3.Quaternion(p[6], *p[3:6]), p[:3]) for p in start]
    for i, pose in enumerate(place):
        values.insert(i, pose)
    graph.add(gtsam.PriorFactorPose3(0, place[0], gtsam.noiseModel.Constrained.All(6)))
    unit = gtsam.noiseModel.Unit.Create(6)
    for a, b, m in zip(first.tolist(), second.tolist(), measured, strict=True):
        graph.add(gtsam.CustomFactor(unit, [a, b], split_error(m, (0.1, 0.05))))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-13)
    settings.setAbsoluteErrorTol(0.0)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    assert graph.error(result) == pytest.approx(ours.cost_after, rel=1e-9)
    theirs = np.array([result.atPose3(i).translation() for i in range(len(start))])
    np.testing.assert_allclose(ours.poses[:, :3], theirs, atol=1e-6)


def test_a_landmark_seen_between_two_nodes_is_found_where_it_stands():
    rng = np.random.default_rng(2)
    nodes, landmark = worlds.random_poses(rng, 2), worlds.random_poses(rng, 1)
    start, end = (Rotation.from_quat(node[3:]) for node in nodes)
    turn = start * Rotation.from_rotvec(0.25 * (start.inv() * end).as_rotvec())
    observer = np.concatenate([0.75 * nodes[0, :3] + 0.25 * nodes[1, :3], turn.as_quat()])
    seen = worlds.seen_from(observer[None], landmark)
    edges = worlds.edges([0], [2], seen, until=np.array([1]), ratio=np.array([0.25]))
    poses = np.concatenate([nodes, worlds.random_poses(rng, 1)])
    fixed = np.array([True, True, False])
    solution = optimise_spatial(poses, fixed, edges, loss=NONE, max_iterations=50, tolerance=1e-14)
    np.testing.assert_allclose(solution.poses[2, :3], landmark[0, :3], atol=1e-8)
    assert worlds.rotation_errors(solution.poses[2:], landmark)[0] < 1e-8


def test_a_component_without_a_fixed_pose_keeps_its_first_one():
    truth, start, first, second, measured = worlds.helix(nodes=10, loops=4)
    both = np.concatenate([start, start])
    edges = worlds.edges(
        np.concatenate([first, first + 10]), np.concatenate([second, second + 10]), [*measured, *measured]
    )
    solution = optimise_spatial(both, np.zeros(20, bool), edges, loss=NONE, max_iterations=30, tolerance=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(solution.held.all(axis=1)), [0, 10])
    np.testing.assert_allclose(solution.poses[:10], solution.poses[10:], atol=1e-9)
    np.testing.assert_array_equal(solution.poses[0], truth[0])


def test_heights_stay_where_they_are_fixed():
    _, start, first, second, measured = worlds.helix(nodes=20)
    fixed = np.zeros((20, 6), bool)
    fixed[:, 2] = True
    edges = worlds.edges(first, second, measured)
    solution = optimise_spatial(start, fixed, edges, loss=NONE, max_iterations=50)
    np.testing.assert_array_equal(solution.poses[:, 2], start[:, 2])
    assert solution.cost_after < 0.5 * solution.cost_before


def test_a_frame_that_is_estimated_in_yaw_only_stays_level():
    rng = np.random.default_rng(4)
    nodes = worlds.random_poses(rng, 8, spread=10)
    frame = worlds.pose([3.0, -2.0, 1.0], [0, 0, 0.8])
    measured = worlds.disturbed(worlds.seen_from(np.repeat(frame[None], 8, 0), nodes), rng, 0.05, 0.0)
    edges = worlds.edges(np.full(8, 8), np.arange(8), measured)
    poses = np.concatenate([nodes, [[0, 0, 0, 0, 0, 0, 1.0]]])
    fixed = np.repeat((np.arange(9) < 8)[:, None], 6, axis=1)
    fixed[8, 3:5] = True
    found = optimise_spatial(poses, fixed, edges, loss=NONE, max_iterations=50, tolerance=1e-12).poses[8]
    np.testing.assert_allclose(found[3:5], 0, atol=1e-12)
    np.testing.assert_allclose(found[:3], frame[:3], atol=0.1)
    assert worlds.rotation_errors(found[None], frame[None])[0] < 0.02


def test_a_robust_loss_lets_an_outlier_go():
    truth, start, first, second, measured = worlds.helix(nodes=30)
    loops = np.arange(len(first)) >= 29
    measured[-1] = worlds.pose([8.0, 8.0, 8.0], [1.0, 1.0, 1.0])
    edges = worlds.edges(first, second, measured, translation=50.0, rotation=100.0, robust=loops)
    loss = Loss(kind="truncated", scale=6.0, graduated=True)
    solution = optimise_spatial(start, fixed_first(30), edges, loss=loss, max_iterations=50)
    assert solution.weights[-1] == 0.0
    assert np.all(solution.weights[:-1] > 0.9)
    assert np.linalg.norm((solution.poses - truth)[:, :3], axis=1).max() < 0.15


def test_the_same_input_gives_the_same_bytes():
    _, start, first, second, measured = worlds.helix()
    edges = worlds.edges(first, second, measured, robust=True)
    runs = [
        optimise_spatial(start, fixed_first(50), edges, loss=Loss(kind="huber"), max_iterations=9) for _ in range(2)
    ]
    assert runs[0].poses.tobytes() == runs[1].poses.tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: e.measured.__setitem__((1, 4), np.nan), r"edge 1 \(from pose 1 to 2\) of the graph: measured"),
        (lambda e: e.second.__setitem__(1, -1), r"edge 1 \(from pose 1 to -1\) of the graph names no pose"),
    ],
)
def test_unusable_input_is_named(change, message):
    edges = worlds.edges([0, 1], [1, 2], np.zeros((2, 7)))
    change(edges)
    with pytest.raises(EstimationError, match=message):
        optimise_spatial(np.zeros((3, 7)), np.zeros(3, bool), edges, loss=NONE, max_iterations=1)


def test_a_pose_that_is_not_finite_is_named():
    poses = np.zeros((2, 7))
    poses[1, 3] = np.inf
    with pytest.raises(EstimationError, match="pose 1 of the graph is not finite"):
        optimise_spatial(
            poses, np.zeros(2, bool), worlds.edges([0], [1], np.zeros((1, 7))), loss=NONE, max_iterations=1
        )
