# SPDX-License-Identifier: MIT
"""Reduced camera systems: against dense elimination of numeric derivatives, sparse orders, and steps that points follow."""

from __future__ import annotations

import dataclasses

import camera_scenes as scenes
import numpy as np
import pytest
from test_bundle_adjustment import disturbed, half_mono, naive_residuals

from slamcli.vision.bundle_problem import MONO_BOUND, STEREO_BOUND
from slamcli.vision.bundle_reduction import BundleReduction
from slamcli.vision.bundle_system import BundleState, BundleSystem
from slamcli.vision.camera_system import CameraSystem

pytestmark = pytest.mark.kernels


def naive_jacobian(problem, free):
    """Residuals and their numeric derivatives by the increments of the free cameras and of all points."""
    size = 6 * len(free) + 3 * len(problem.points)

    def residuals(x):
        poses = problem.T_camera_map.copy()
        for step, k in zip(x[: 6 * len(free)].reshape(-1, 6), free, strict=True):
            poses[k] = scenes.pose(step[:3], step[3:]) @ poses[k]
        return naive_residuals(problem, poses, problem.points + x[6 * len(free) :].reshape(-1, 3)).ravel()

    steps = 1e-6 * np.eye(size)
    return residuals(np.zeros(size)), np.array([(residuals(s) - residuals(-s)) / 2e-6 for s in steps]).T


def test_the_terms_are_those_of_a_naive_elimination():
    problem = disturbed(half_mono(scenes.scene(4, 12, noise=1.0, seen_by=3)), 1, distance=0.005)
    reduction = BundleReduction(problem)
    terms = reduction.linearise(problem.T_camera_map, problem.points, robust=False)
    error, jacobian = naive_jacobian(problem, reduction.free)
    H, g = jacobian.T @ jacobian, jacobian.T @ error
    c = 6 * len(reduction.free)
    eliminated = H[:c, c:] @ np.linalg.inv(H[c:, c:])
    np.testing.assert_allclose(
        terms.hessian, H[:c, :c] - eliminated @ H[c:, :c], rtol=1e-5, atol=1e-5 * H[:c, :c].max()
    )
    np.testing.assert_allclose(terms.gradient, g[:c] - eliminated @ g[c:], rtol=1e-5, atol=1e-6 * np.abs(g).max())
    assert terms.cost == pytest.approx(0.5 * error @ error)
    steps = np.linalg.solve(terms.hessian, -terms.gradient)
    whole = np.linalg.solve(H, -g)
    np.testing.assert_allclose(steps, whole[:c], atol=1e-6)
    poses = problem.T_camera_map.copy()
    for step, k in zip(steps.reshape(-1, 6), reduction.free, strict=True):
        poses[k] = scenes.pose(step[:3], step[3:]) @ poses[k]
    points, cost = reduction.follow(poses, steps, robust=False)
    np.testing.assert_allclose(points, problem.points + whole[c:].reshape(-1, 3), atol=1e-6)
    assert cost == pytest.approx(0.5 * np.sum(naive_residuals(problem, poses, points) ** 2))


@pytest.mark.parametrize(("size", "band"), [(1, 1), (9, 3), (60, 4), (40, 40)])
def test_solutions_are_those_of_a_naive_dense_matrix(size, band):
    rng = np.random.default_rng(size)
    near = np.abs(np.arange(size)[:, None] - np.arange(size)) < band
    near |= near[::-1]  # a loop and its crossing
    pairs = np.triu(near | near.T | np.eye(size, dtype=bool))
    system = CameraSystem(pairs)
    blocks = rng.normal(size=(len(system.rows), 6, 6))
    blocks[system.diagonal_slots] += np.eye(6) * 12 * size
    dense = system.dense(blocks)
    np.testing.assert_array_equal(dense, dense.T)
    right = rng.normal(size=(size, 6))
    by_rank = np.empty_like(right)
    by_rank[system.ranks] = right
    assert system.factorise(blocks)
    found = system.solve(by_rank)[system.ranks]
    np.testing.assert_allclose(found.ravel(), np.linalg.solve(dense, right.ravel()), rtol=1e-9, atol=1e-12)
    blocks[system.diagonal_slots[size // 2]] -= np.eye(6) * 1e4 * size
    assert not system.factorise(blocks)


@pytest.mark.parametrize("robust", [False, True])
def test_costs_and_gradients_are_those_of_a_naive_loss(robust):
    scene = half_mono(scenes.scene(4, 12, noise=2.0, seen_by=3))
    problem = disturbed(scene, 1, distance=0.01)
    bound = np.where(np.isnan(problem.right), MONO_BOUND, STEREO_BOUND)

    def cost(step=(0.0, 0.0, 0.0)):
        points = problem.points.copy()
        points[5] += step
        square = np.sum(naive_residuals(problem, problem.T_camera_map, points) ** 2, axis=1)
        return 0.5 * np.sum(np.where(robust & (square > bound), 2 * np.sqrt(bound * square) - bound, square))

    all_fixed = dataclasses.replace(problem, fixed=np.ones(4, bool))
    system = BundleSystem(all_fixed, np.arange(12) != 5)
    state = BundleState(
        poses=problem.T_camera_map[:, :3].copy(), points=problem.points.copy(), camera=problem.camera.array
    )
    reduced = system.linearise(state, 1e9, robust)
    assert reduced.cost == pytest.approx(cost(), rel=1e-12)
    moved, lower = system.step(state, np.zeros((0, 6)), robust)
    gradient = np.array([(cost(s) - cost(-s)) / 2e-6 for s in 1e-6 * np.eye(3)])
    assert np.all((moved.points[5] - state.points[5]) * gradient < 0)  # so much damping: down each axis, a little
    assert reduced.cost > lower > reduced.cost - 1e-6 * np.abs(gradient).sum()
    assert np.array_equal(moved.points[np.arange(12) != 5], state.points[np.arange(12) != 5])


@pytest.mark.parametrize(("share", "goes"), [(1.5, 1.0), (6.0, 0.25), (1000.0, 0.0)])
def test_a_point_whose_step_does_not_pay_goes_less_far_or_stays(share, goes):
    problem = disturbed(scenes.scene(4, 12), 4)
    local = scenes.moved(problem.T_camera_map[1], problem.points[3])
    problem.points[3] = scenes.moved(np.linalg.inv(problem.T_camera_map[1]), share * local)
    held = np.zeros(12, bool)
    system = BundleSystem(problem, held)
    state = BundleState(
        poses=problem.T_camera_map[:, :3].copy(), points=problem.points.copy(), camera=problem.camera.array
    )
    before = system.linearise(state, 0.0, False).cost
    moved, cost = system.step(state, np.zeros((0, 6)), False)
    error, jacobian = naive_jacobian(problem, np.zeros(0, np.int64))
    whole = np.linalg.lstsq(jacobian[:, 9:12], -error, rcond=None)[0]
    np.testing.assert_allclose(moved.points[3] - state.points[3], goes * whole, rtol=1e-3, atol=1e-9)
    assert cost == pytest.approx(
        0.5 * np.sum(naive_residuals(problem, problem.T_camera_map, moved.points) ** 2), rel=1e-9
    )
    assert cost < before
