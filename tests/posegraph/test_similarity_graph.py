# SPDX-License-Identifier: MIT
"""Graphs of similarities: exact loops with drift of scale, numeric derivatives, gtsam, gauge, bad input."""

from __future__ import annotations

import dataclasses

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from slamcli.errors import DataError, EstimationError
from slamcli.posegraph import similarity_graph
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.similarity_graph import Similarities, SimilarityEdges, optimise_similarities, relative


def random(rng, count, spread=1.0):
    return Similarities(
        rotations=Rotation.from_rotvec(spread * rng.normal(size=(count, 3))).as_matrix(),
        translations=2 * spread * rng.normal(size=(count, 3)), scales=np.exp(0.3 * spread * rng.normal(size=count)),
    )  # fmt: skip


def matrices(group):
    """(N, 4, 4) with the scale in the rotation."""
    out = np.tile(np.eye(4), (len(group), 1, 1))
    out[:, :3, :3] = group.scales[:, None, None] * group.rotations
    out[:, :3, 3] = group.translations
    return out


def looped(rng, count=30, *, noise=0.0, fix_scale=False):
    """True vertices on a loop, edges to the next three and closing ones, and a start with drift along the chain."""
    truth = random(rng, count)
    if fix_scale:
        truth = dataclasses.replace(truth, scales=np.ones(count))
    first = np.concatenate([np.arange(count), np.arange(count), np.arange(count)])
    second = (first + np.repeat([1, 2, 3], count)) % count
    measured = relative(truth, first, second)
    if noise:
        bent = random(rng, len(first), noise)
        bent = dataclasses.replace(bent, scales=np.ones(len(first))) if fix_scale else bent
        measured = bent @ measured
    step = random(rng, count, 0.03)
    start = [truth[np.array([0])]]
    for i in range(1, count):
        link = relative(truth, np.array([i - 1]), np.array([i]))
        start.append(step[np.array([i])] @ link @ start[-1])
    names = ("rotations", "translations", "scales")
    start = Similarities(**{name: np.concatenate([getattr(s, name) for s in start]) for name in names})
    if fix_scale:
        start = dataclasses.replace(start, scales=np.ones(count))
    return truth, SimilarityEdges(first=first, second=second, measured=measured), start


def test_products_inverses_and_points_are_those_of_matrices():
    rng = np.random.default_rng(1)
    a, b, points = random(rng, 7), random(rng, 7), rng.normal(size=(7, 3))
    np.testing.assert_allclose(matrices(a @ b), matrices(a) @ matrices(b), atol=1e-12)
    np.testing.assert_allclose(matrices(a.inverse()), np.linalg.inv(matrices(a)), atol=1e-12)
    whole = np.concatenate([points, np.ones((7, 1))], axis=1)
    np.testing.assert_allclose(a.transform(points), np.einsum("nij,nj->ni", matrices(a), whole)[:, :3], atol=1e-12)
    centres = np.linalg.inv(matrices(a))[:, :3, 3]
    np.testing.assert_allclose(np.linalg.inv(a.poses())[:, :3, 3], centres, atol=1e-12)
    np.testing.assert_allclose(Similarities.from_poses(b.poses(), 1.7).poses(), b.poses(), atol=1e-12)


@pytest.mark.parametrize("fix_scale", [False, True])
def test_an_exact_loop_is_closed_from_a_drifted_start(fix_scale):
    truth, edges, start = looped(np.random.default_rng(2), fix_scale=fix_scale)
    found = optimise_similarities(
        start, np.arange(30) == 0, edges, fix_scale=fix_scale, max_iterations=50, tolerance=1e-14
    )
    np.testing.assert_allclose(matrices(found.vertices), matrices(truth), atol=1e-7)
    assert found.cost_after < 1e-15 < found.cost_before
    if fix_scale:
        np.testing.assert_array_equal(found.vertices.scales, 1.0)


@pytest.mark.parametrize("spread", [1.0, 1e-7])
@pytest.mark.parametrize("weighted", [False, True])
def test_jacobians_are_the_differences_of_the_residuals(spread, weighted):
    rng = np.random.default_rng(5)
    group, information = random(rng, 5), None
    first, second = np.array([0, 1, 2, 4]), np.array([1, 3, 0, 2])
    if weighted:
        root = rng.normal(size=(4, 7, 7))
        information = root @ root.transpose(0, 2, 1)
    measured = random(rng, 4, 0.4 * spread) @ relative(group, first, second)
    term = similarity_graph._terms(
        SimilarityEdges(first=first, second=second, measured=measured, information=information), Loss()
    )
    state = similarity_graph._packed(group)
    columns = []
    for i in range(9 * 5):
        step = np.zeros(9 * 5)
        step[i] = 1e-6
        high, low = (term.residuals(similarity_graph._retract(state, s.reshape(-1, 3))) for s in (step, -step))
        columns.append((high - low) / 2e-6)
    numeric = np.stack(columns, axis=-1)
    analytic = np.zeros_like(numeric)
    for n, block in enumerate(term.jacobians(state)):
        for k, vertex in enumerate((first[n], second[n])):
            analytic[n, :, 9 * vertex : 9 * vertex + 9] += block[:, 9 * k : 9 * k + 9]
    np.testing.assert_allclose(analytic, numeric, atol=1e-7)


def test_a_noisy_loop_ends_where_gtsam_ends():
    _, edges, start = looped(np.random.default_rng(7), noise=0.002)
    found = optimise_similarities(
        start, np.arange(30) == 0, edges, fix_scale=False, max_iterations=100, tolerance=1e-13
    )
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()

    def sim3(group, i):
        # x -> scale (R x + t) in gtsam
        return gtsam.Similarity3(
            gtsam.Rot3(group.rotations[i]), group.translations[i] / group.scales[i], group.scales[i]
        )

    unit, tight = (gtsam.noiseModel.Isotropic.Sigma(7, sigma) for sigma in (1.0, 1e-6))
    back, inverse = start.inverse(), edges.measured.inverse()
    for i in range(30):
        values.insert(i, sim3(back, i))
    graph.add(gtsam.PriorFactorSimilarity3(0, sim3(back, 0), tight))
    for n, (a, b) in enumerate(zip(edges.first.tolist(), edges.second.tolist(), strict=True)):
        graph.add(gtsam.BetweenFactorSimilarity3(a, b, sim3(inverse, n), unit))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-13)
    settings.setAbsoluteErrorTol(0.0)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    theirs = np.array([result.atSimilarity3(i).matrix() for i in range(30)])
    scales = np.array([result.atSimilarity3(i).scale() for i in range(30)])
    ours = found.vertices.inverse()
    np.testing.assert_allclose(ours.scales, scales, rtol=1e-4)
    np.testing.assert_allclose(ours.rotations, theirs[:, :3, :3], atol=1e-4)


def test_noise_leaves_the_cost_that_is_expected():
    costs = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        _, edges, start = looped(rng)
        noise = 0.01 * rng.normal(size=(90, 7))
        bent = Similarities(
            rotations=Rotation.from_rotvec(noise[:, :3]).as_matrix(),
            translations=noise[:, 3:6],
            scales=np.exp(noise[:, 6]),
        )
        information = np.tile(np.eye(7) / 0.01**2, (90, 1, 1))
        edges = dataclasses.replace(edges, measured=bent @ edges.measured, information=information)
        costs.append(
            optimise_similarities(start, np.arange(30) == 0, edges, fix_scale=False, max_iterations=50).cost_after
        )
    assert 2 * np.mean(costs) == pytest.approx(7 * (90 - 29), rel=0.1)


def test_a_robust_loss_bears_a_wrong_loop():
    truth, edges, start = looped(np.random.default_rng(3))
    wrong = dataclasses.replace(
        edges, first=np.append(edges.first, 4), second=np.append(edges.second, 19),
        measured=Similarities(
            rotations=np.concatenate([edges.measured.rotations, np.eye(3)[None]]),
            translations=np.concatenate([edges.measured.translations, np.zeros((1, 3))]),
            scales=np.append(edges.measured.scales, 2.0),
        ),
    )  # fmt: skip
    loss = Loss(kind="geman_mcclure", scale=0.3, graduated=True)
    found = optimise_similarities(start, np.arange(30) == 0, wrong, fix_scale=False, max_iterations=50, loss=loss)
    np.testing.assert_allclose(found.vertices.translations, truth.translations, atol=2e-2)


def test_parts_without_a_fixed_vertex_keep_their_first():
    _, edges, start = looped(np.random.default_rng(4))
    found = optimise_similarities(start, np.zeros(30, np.bool_), edges, fix_scale=False)
    np.testing.assert_allclose(matrices(found.vertices)[0], matrices(start)[0], atol=1e-15)
    fixed = np.isin(np.arange(30), (3, 9))
    found = optimise_similarities(start, fixed, edges, fix_scale=False)
    np.testing.assert_allclose(matrices(found.vertices)[fixed], matrices(start)[fixed], atol=1e-12)


def test_bad_input_is_named():
    _, edges, start = looped(np.random.default_rng(4))
    fixed = np.arange(30) == 0
    second, scales = edges.second.copy(), start.scales.copy()
    second[2], scales[5] = 99, 0.0
    astray, flat = dataclasses.replace(edges, second=second), dataclasses.replace(start, scales=scales)
    with pytest.raises(EstimationError, match=r"edge 2 \(from 2 to 99\) names no vertex"):
        optimise_similarities(start, fixed, astray, fix_scale=False)
    with pytest.raises(EstimationError, match="vertex 5 is not finite or its scale"):
        optimise_similarities(flat, fixed, edges, fix_scale=False)
    with pytest.raises(DataError, match="do not fit"):
        optimise_similarities(start, fixed[:3], edges, fix_scale=False)
    with pytest.raises(DataError, match="information"):
        optimise_similarities(start, fixed, dataclasses.replace(edges, information=np.eye(7)), fix_scale=False)
