# SPDX-License-Identifier: MIT
"""Pose adjustment in the plane: exact worlds, GTSAM as a second opinion, Jacobians, gauge, outliers, bad input."""

from __future__ import annotations

import gtsam
import numpy as np
import planar_worlds as worlds
import pytest

from slamcli.errors import EstimationError
from slamcli.posegraph import planar
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import optimise_planar

pytestmark = pytest.mark.kernels
NONE = Loss()


def fixed_first(count):
    return np.arange(count) == 0


def between(measured):
    """The error of an edge and its Jacobians for GTSAM, whose own factor takes the logarithm of the pose's error."""

    def error(factor, values, jacobians):
        a, b = (values.atPose2(key) for key in list(factor.keys()))
        relative = a.between(b)
        c, s = np.cos(a.theta()), np.sin(a.theta())
        turn_b = np.eye(3)
        turn_b[:2, :2] = a.rotation().matrix().T @ b.rotation().matrix()  # GTSAM moves poses along their own axes
        if jacobians is not None:
            jacobians[0] = np.array([[-1, 0, relative.y()], [0, -1, -relative.x()], [0, 0, -1.0]])
            jacobians[1] = turn_b
        dx, dy = b.x() - a.x(), b.y() - a.y()
        yaw = worlds.wrap(b.theta() - a.theta() - measured[2])
        return np.array([c * dx + s * dy - measured[0], c * dy - s * dx - measured[1], yaw])

    return error


def gtsam_minimum(start, first, second, measured, sigmas, huber=None, robust=None):
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, pose in enumerate(start):
        values.insert(i, gtsam.Pose2(*pose))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*start[0]), gtsam.noiseModel.Constrained.All(3)))
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas))
    for i, (a, b, m) in enumerate(zip(first.tolist(), second.tolist(), measured, strict=True)):
        model = noise
        if huber is not None and robust[i]:
            model = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(huber), noise)
        graph.add(gtsam.CustomFactor(model, [a, b], between(m)))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(0.0)
    settings.setMaxIterations(300)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    poses = [result.atPose2(i) for i in range(len(start))]
    return np.array([[pose.x(), pose.y(), pose.theta()] for pose in poses])


@pytest.mark.parametrize("ratio", [None, 0.3])
def test_jacobians_are_the_differences_of_the_residuals(ratio):
    rng = np.random.default_rng(3)
    poses = rng.normal(size=(6, 3))
    between = {} if ratio is None else {"until": np.array([1, 2, 5, 0]), "ratio": np.full(4, ratio)}
    edges = worlds.edges([0, 1, 2, 3], [3, 4, 5, 1], rng.normal(size=(4, 3)), **between)
    term = planar.terms_of(edges, NONE)
    dense = np.zeros((4, 3, 6, 3))
    for n, row in enumerate(term.variables):
        for k, variable in enumerate(row):
            if variable >= 0:
                dense[n, :, variable] += term.jacobians(poses)[n, :, 3 * k : 3 * k + 3]
    for i in range(6):
        for axis in range(3):
            step = np.zeros((6, 3))
            step[i, axis] = 1e-6
            numeric = (term.residuals(poses + step) - term.residuals(poses - step)) / 2e-6
            np.testing.assert_allclose(dense[:, :, i, axis], numeric, atol=2e-8)


def test_a_noiseless_graph_comes_out_exact():
    truth, start, first, second, measured = worlds.ring(translation_sigma=0, rotation_sigma=0)
    rng = np.random.default_rng(1)
    start = truth + rng.normal(size=truth.shape) * [0.5, 0.5, 0.1] * (np.arange(len(truth)) > 0)[:, None]
    edges = worlds.edges(first, second, measured)
    solution = optimise_planar(start, fixed_first(len(truth)), edges, loss=NONE, max_iterations=50, tolerance=1e-12)
    assert solution.converged
    assert solution.cost_after < 1e-12 < solution.cost_before
    np.testing.assert_allclose(solution.poses[:, :2], truth[:, :2], atol=1e-7)
    np.testing.assert_allclose(worlds.wrap(solution.poses[:, 2] - truth[:, 2]), 0, atol=1e-7)
    np.testing.assert_array_equal(solution.poses[0], truth[0])


@pytest.mark.parametrize("huber", [None, 1.0])
def test_the_minimum_is_that_of_gtsam(huber):
    _, start, first, second, measured = worlds.ring()
    robust = np.arange(len(first)) >= len(start) - 1
    measured[-1] += [2.0, 1.0, 0.3]  # an outlier
    edges = worlds.edges(first, second, measured, robust=robust)
    loss = NONE if huber is None else Loss(kind="huber", scale=huber)
    ours = optimise_planar(start, fixed_first(len(start)), edges, loss=loss, max_iterations=300, tolerance=1e-14)
    theirs = gtsam_minimum(start, first, second, measured, [0.1, 0.1, 0.05], huber, robust)
    np.testing.assert_allclose(ours.poses[:, :2], theirs[:, :2], atol=1e-6)
    np.testing.assert_allclose(worlds.wrap(ours.poses[:, 2] - theirs[:, 2]), 0, atol=1e-6)


def test_information_is_meant_along_the_axes_of_the_measured_pose():
    matrix = np.array([[400.0, 30.0, 2.0], [30.0, 25.0, 1.0], [2.0, 1.0, 90.0]])
    measured = np.array([[1.0, 2.0, 0.7]])
    edges = worlds.edges([0], [1], measured, information=matrix[None])
    poses = np.array([[0.3, -0.2, 0.5], [0.1, 1.9, 1.6]])
    solution = optimise_planar(poses, np.ones(2, bool), edges, loss=NONE, max_iterations=1)
    error = worlds.seen_from(measured, worlds.seen_from(poses[:1], poses[1:]))[0]  # as g2o: of Z^-1 A^-1 B
    assert solution.cost_before == pytest.approx(0.5 * error @ matrix @ error, rel=1e-12)


def test_a_landmark_seen_between_two_nodes_is_found_where_it_stands():
    nodes = np.array([[0.0, 0.0, 3.0], [2.0, 1.0, -3.0]])  # the yaw passes pi in between
    landmark = np.array([[4.0, -1.0, 0.4]])
    ratio = 0.25
    turn = worlds.wrap(nodes[1, 2] - nodes[0, 2])
    observer = nodes[:1] + ratio * np.array([[2.0, 1.0, turn]])
    edges = worlds.edges([0], [2], worlds.seen_from(observer, landmark), until=np.array([1]), ratio=np.array([ratio]))
    start = np.concatenate([nodes, np.zeros((1, 3))])
    fixed = np.array([True, True, False])
    solution = optimise_planar(start, fixed, edges, loss=NONE, max_iterations=20, tolerance=1e-14)
    np.testing.assert_allclose(solution.poses[2], landmark[0], atol=1e-8)


def test_each_component_without_a_fixed_pose_keeps_its_first_one():
    poses = np.array([[0.0, 0, 0], [1, 0, 0], [5, 5, 1], [6, 5, 1], [9, 9, 2]])
    edges = worlds.edges([0, 2], [1, 3], [[2.0, 0, 0], [2.0, 0, 0]])
    solution = optimise_planar(poses, np.zeros(5, bool), edges, loss=NONE, max_iterations=20, tolerance=1e-14)
    np.testing.assert_array_equal(solution.held, [True, False, True, False, True])
    np.testing.assert_array_equal(solution.poses[[0, 2, 4]], poses[[0, 2, 4]])
    np.testing.assert_allclose(solution.poses[1], [2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(solution.poses[3], [5 + 2 * np.cos(1), 5 + 2 * np.sin(1), 1], atol=1e-9)


def test_frozen_poses_stay_and_the_rest_joins_them():
    truth, _, first, second, measured = worlds.ring(translation_sigma=0, rotation_sigma=0)
    fixed = np.arange(len(truth)) < 30
    start = truth + (~fixed)[:, None] * [0.3, -0.2, 0.05]
    edges = worlds.edges(first, second, measured)
    solution = optimise_planar(start, fixed, edges, loss=NONE, max_iterations=50, tolerance=1e-14)
    np.testing.assert_array_equal(solution.poses[fixed], truth[fixed])
    np.testing.assert_allclose(solution.poses[:, :2], truth[:, :2], atol=1e-6)


@pytest.mark.parametrize("kind", ["geman_mcclure", "truncated"])
def test_graduated_losses_tell_outliers_from_inliers(kind):
    truth, start, first, second, measured = worlds.ring(loops=40)
    rng = np.random.default_rng(5)
    loops = np.arange(len(first)) >= len(start) - 1
    outliers = loops & (rng.random(len(first)) < 0.5)
    measured[outliers] += rng.uniform(-4, 4, size=(outliers.sum(), 3))
    edges = worlds.edges(first, second, measured, translation=50.0, rotation=100.0, robust=loops)
    loss = Loss(kind=kind, scale=5.0, graduated=True)
    solution = optimise_planar(start, fixed_first(len(start)), edges, loss=loss, max_iterations=50)
    assert np.all(solution.weights[outliers] < 0.1)
    assert np.all(solution.weights[~outliers] > 0.3)
    kept = ~outliers
    sound = worlds.edges(first[kept], second[kept], measured[kept], translation=50.0, rotation=100.0)
    best = optimise_planar(truth, fixed_first(len(start)), sound, loss=NONE, max_iterations=50, tolerance=1e-12)
    np.testing.assert_allclose(solution.poses[:, :2], best.poses[:, :2], atol=0.03)


def test_the_same_input_gives_the_same_bytes():
    _, start, first, second, measured = worlds.ring()
    edges = worlds.edges(first, second, measured, robust=True)
    runs = [
        optimise_planar(start, fixed_first(len(start)), edges, loss=Loss(kind="cauchy"), max_iterations=9)
        for _ in range(2)
    ]
    assert runs[0].poses.tobytes() == runs[1].poses.tobytes()


def test_moving_the_start_moves_the_answer():
    _, start, first, second, measured = worlds.ring()
    edges = worlds.edges(first, second, measured)
    turn, shift = 0.7, np.array([3.0, -2.0])
    c, s = np.cos(turn), np.sin(turn)
    moved = start @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [*shift, turn]
    runs = [
        optimise_planar(p, fixed_first(len(p)), edges, loss=NONE, max_iterations=90, tolerance=1e-13).poses
        for p in (start, moved)
    ]
    np.testing.assert_allclose(runs[0][:, :2] @ np.array([[c, s], [-s, c]]) + shift, runs[1][:, :2], atol=1e-6)


def test_an_empty_graph_stays():
    edges = worlds.edges([], [], np.zeros((0, 3)))
    solution = optimise_planar(np.ones((2, 3)), np.zeros(2, bool), edges, loss=NONE, max_iterations=5)
    np.testing.assert_array_equal(solution.poses, np.ones((2, 3)))
    assert solution.converged


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda e: e.measured.__setitem__((1, 2), np.nan), r"edge 1 \(from pose 1 to 2\) of the graph: measured"),
        (lambda e: e.rotation_weight.__setitem__(0, np.inf), r"edge 0 \(from pose 0 to 1\) of the graph: rotation"),
        (lambda e: e.second.__setitem__(1, 7), r"edge 1 \(from pose 1 to 7\) of the graph names no pose"),
    ],
)
def test_unusable_input_is_named(change, message):
    edges = worlds.edges([0, 1], [1, 2], np.zeros((2, 3)))
    change(edges)
    with pytest.raises(EstimationError, match=message):
        optimise_planar(np.zeros((3, 3)), np.zeros(3, bool), edges, loss=NONE, max_iterations=1)


def test_a_pose_that_is_not_finite_is_named():
    edges = worlds.edges([0], [1], np.zeros((1, 3)))
    with pytest.raises(EstimationError, match="pose 1 of the graph is not finite"):
        optimise_planar(np.array([[0.0, 0, 0], [0, np.inf, 0]]), np.zeros(2, bool), edges, loss=NONE, max_iterations=1)
