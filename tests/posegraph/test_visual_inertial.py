# SPDX-License-Identifier: MIT
"""Visual-inertial bundle adjustment: GTSAM's minimum, truth, scale, gravity, what is held, bad input."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from imu_worlds import GRAVITY, T_CAMERA_IMU
from visual_inertial_worlds import CAMERA, world

from slamcli.errors import DataError
from slamcli.posegraph import _visual_inertial_kernels as kernels
from slamcli.posegraph import visual_inertial
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.inertial_links import InertialStates, link_residuals, link_states
from slamcli.posegraph.visual_inertial import adjust_visual_inertial, without
from slamcli.vision.bundle_adjustment import adjust_bundle

pytestmark = pytest.mark.kernels


def centres(T):
    return -np.einsum("kji,kj->ki", T[:, :3, :3], T[:, :3, 3])


def gtsam_minimum(problem, biases_at):
    """The same problem without losses, its links integrated at `biases_at`, through gtsam's projection factors."""
    graph, values, b = gtsam.NonlinearFactorGraph(), gtsam.Values(), problem.bundle
    pose, point, speed, bias = (lambda i, c=c: gtsam.symbol(c, int(i)) for c in "xlvb")
    T_imu_camera = gtsam.Pose3(np.linalg.inv(T_CAMERA_IMU))
    lens = gtsam.Cal3_S2(CAMERA.fx, CAMERA.fy, 0.0, CAMERA.cx, CAMERA.cy)
    for k, T in enumerate(b.T_camera_map):
        values.insert(pose(k), gtsam.Pose3(np.linalg.inv(T) @ T_CAMERA_IMU))
        values.insert(speed(k), problem.velocities[k])
        values.insert(bias(k), problem.biases[k])
        if b.fixed[k]:
            graph.add(gtsam.NonlinearEqualityPose3(pose(k), values.atPose3(pose(k))))
    for i, place in enumerate(b.points):
        values.insert(point(i), gtsam.Point3(*place))
    for c, i, pixel, sigma in zip(b.camera_index, b.point_index, b.pixels, b.sigmas, strict=True):
        noise = gtsam.noiseModel.Isotropic.Sigma(2, sigma)
        graph.add(gtsam.GenericProjectionFactorCal3_S2(pixel, noise, pose(c), point(i), lens, T_imu_camera))
    first, second = problem.links.T
    stamps = problem.stamps_ns
    motions = preintegrate(problem.samples, stamps[first], stamps[second], biases_at[first], problem.noise)
    whole = link_states(np.zeros(len(first), int), np.ones(len(first), int), motions)

    def link(k):
        one = replace(whole, first=whole.first[:1], second=whole.second[:1], roots=whole.roots[k : k + 1],
                      motions=type(motions)(**{n: getattr(motions, n)[k : k + 1] for n in motions.__slots__}))  # fmt: skip

        def error(factor, at, jacobians):
            keys = factor.keys()
            poses = [at.atPose3(keys[i]) for i in (0, 3)]
            turns = np.array([p.rotation().matrix() for p in poses])
            states = InertialStates(
                rotations=turns, positions=np.array([p.translation() for p in poses]),
                velocities=np.array([at.atVector(keys[i]) for i in (1, 4)]),
                biases=np.array([at.atVector(keys[i]) for i in (2, 5)]),
            )  # fmt: skip
            out, *by, _ = link_residuals(one, states, GRAVITY)
            if jacobians is not None:
                for end in range(2):
                    d = by[end][0]
                    moved = np.concatenate([d[:, :3], d[:, 3:6] @ turns[end]], axis=1)
                    for m, column in enumerate((moved, d[:, 6:9], d[:, 9:])):
                        jacobians[3 * end + m] = column
            return out[0]

        return error

    unit = gtsam.noiseModel.Unit.Create(15)
    for k, (i, j) in enumerate(problem.links):
        keys = [pose(i), speed(i), bias(i), pose(j), speed(j), bias(j)]
        graph.add(gtsam.CustomFactor(unit, keys, link(k)))
    sigmas = np.repeat([problem.gyroscope_bias_sigma, problem.accelerometer_bias_sigma], 3)
    graph.add(gtsam.PriorFactorVector(bias(0), np.zeros(6), gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(100)
    settings.setRelativeErrorTol(1e-12)
    settings.setAbsoluteErrorTol(1e-12)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    T = np.array([T_CAMERA_IMU @ np.linalg.inv(result.atPose3(pose(k)).matrix()) for k in range(len(b.T_camera_map))])
    return T, np.array([result.atVector(speed(k)) for k in range(len(T))]), graph.error(result)


def test_the_minimum_is_that_of_gtsam(monkeypatch):
    monkeypatch.setattr(visual_inertial, "LINK_BOUND", 1e12)
    problem, *_, biases = world(np.arange(1.0, 3.6, 0.5), points=60, disturbed=0.3)
    ours = adjust_visual_inertial(problem, iterations=60, robust=False, tolerance=1e-12)
    theirs, velocities, cost = gtsam_minimum(problem, np.tile(biases.mean(axis=0), (len(biases), 1)))
    assert ours.cost == pytest.approx(cost, rel=1e-4)
    np.testing.assert_allclose(centres(ours.T_camera_map), centres(theirs), atol=2e-4)
    np.testing.assert_allclose(ours.velocities, velocities, atol=2e-4)


@pytest.mark.parametrize("stereo", [False, True])
def test_truth_is_found(stereo):
    problem, T, places, velocities, biases = world(np.arange(1.0, 6.0, 0.5), stereo=stereo)
    found = adjust_visual_inertial(problem, iterations=30)
    assert found.converged
    assert found.cost < 0.05 * found.cost_before
    assert np.linalg.norm(centres(found.T_camera_map) - centres(T), axis=1).max() < 0.03
    assert np.abs(found.velocities - velocities).max() < 0.02
    assert np.abs(found.biases[:, :3] - biases[:, :3]).max() < 2e-3
    assert np.abs(found.biases[:, 3:] - biases[:, 3:]).max() < 0.05
    assert np.median(np.linalg.norm(found.points - places, axis=1)) < 0.05
    assert found.link_squares.mean() < 15


@pytest.mark.parametrize("off", [-0.2, 0.3])
def test_a_wrong_scale_is_put_right(off):
    problem, T, *_ = world(np.arange(1.0, 6.0, 0.5), scale_error=off, disturbed=0.2)
    found = adjust_visual_inertial(problem, iterations=40)
    path, truth = centres(found.T_camera_map), centres(T)
    size = np.linalg.norm(np.diff(path, axis=0), axis=1).sum() / np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert size == pytest.approx(1.0, abs=0.01)


def test_gravity_is_found_from_three_degrees_away():
    problem, *_ = world(np.arange(1.0, 6.0, 0.5), disturbed=0.2, gravity_moves=True)
    tilted = replace(problem, gravity_map=np.array([0.5, -0.2, -np.sqrt(9.80665**2 - 0.29)]))
    found = adjust_visual_inertial(tilted, iterations=40)
    angle = np.degrees(np.arccos(found.gravity_map @ GRAVITY / 9.80665**2))
    assert angle < 0.3
    assert np.linalg.norm(found.gravity_map) == pytest.approx(9.80665)
    assert found.cost < 1.05 * adjust_visual_inertial(problem, iterations=40).cost


def test_without_links_it_is_bundle_adjustment():
    problem, *_ = world(np.arange(1.0, 4.0, 0.5), stereo=True)
    alone = replace(problem, links=np.zeros((0, 2), int))
    found = adjust_visual_inertial(alone, iterations=30, tolerance=1e-10)
    plain = adjust_bundle(problem.bundle, iterations=30, tolerance=1e-10)
    np.testing.assert_allclose(found.T_camera_map, plain.T_camera_map, atol=1e-6)
    np.testing.assert_array_equal(found.velocities, problem.velocities)
    assert len(found.link_squares) == 0


def test_what_is_held_stays():
    problem, *_ = world(np.arange(1.0, 4.0, 0.5), fixed=2)
    held = np.array([True, False, False, True, False, False])
    found = adjust_visual_inertial(replace(problem, held=held), iterations=10)
    np.testing.assert_array_equal(found.velocities[held], problem.velocities[held])
    np.testing.assert_array_equal(found.biases[held], problem.biases[held])
    np.testing.assert_array_equal(found.T_camera_map[:2], problem.bundle.T_camera_map[:2])
    assert not np.any(found.velocities[~held] == problem.velocities[~held])


def test_cameras_may_be_more_than_states_and_in_any_order():
    problem, T, *_ = world(np.arange(1.0, 6.0, 0.5))
    some = np.array([7, 1, 3, 5])  # the states that remain, out of order
    order = np.argsort(problem.stamps_ns[some])
    fewer = replace(
        problem, cameras=some, stamps_ns=problem.stamps_ns[some], velocities=problem.velocities[some],
        biases=problem.biases[some], held=problem.held[some], links=np.stack([order[:-1], order[1:]], axis=1),
    )  # fmt: skip
    found = adjust_visual_inertial(fewer, iterations=40)
    assert np.linalg.norm(centres(found.T_camera_map) - centres(T), axis=1).max() < 0.1


def test_the_same_bytes_come_out_twice():
    problem, *_ = world(np.arange(1.0, 4.0, 0.5))
    first, second = (adjust_visual_inertial(problem, iterations=5) for _ in range(2))
    for name in ("T_camera_map", "points", "velocities", "biases"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_observations_can_be_left_out():
    problem, *_ = world(np.arange(1.0, 4.0, 0.5))
    result = adjust_visual_inertial(problem, iterations=5)
    kept = np.arange(len(problem.bundle)) % 3 != 0
    again = without(problem, result, kept)
    assert len(again.bundle) == kept.sum()
    np.testing.assert_array_equal(again.bundle.points, result.points)
    np.testing.assert_array_equal(again.velocities, result.velocities)


def test_sums_are_those_of_the_naive_twin():
    rng, size = np.random.default_rng(0), 8
    nodes = np.array([[0, 1, 2, 3, -1, 4, 7], [3, -1, 4, 5, 6, 2, 7]])
    derivatives, residuals, weights = rng.normal(size=(2, 15, 42)), rng.normal(size=(2, 15)), np.array([1.0, 0.3])
    ranks = rng.permutation(size)
    slots = np.full((size, size), -1)
    upper = np.triu_indices(size)
    slots[upper] = np.arange(len(upper[0]))
    blocks, gradient = np.zeros((len(upper[0]), 6, 6)), np.zeros((size, 6))
    kernels.add_links(nodes, derivatives, residuals, weights, ranks, slots, blocks, gradient)
    dense, right = np.zeros((size, 6, size, 6)), np.zeros((size, 6))
    for k in range(2):
        wide = np.zeros((15, size, 6))
        for a, node in enumerate(nodes[k]):
            if node >= 0:
                wide[:, ranks[node]] += derivatives[k, :, 6 * a : 6 * a + 6]
        dense += weights[k] * np.einsum("rai,rbj->aibj", wide, wide)
        right += weights[k] * np.einsum("rai,r->ai", wide, residuals[k])
    np.testing.assert_allclose(gradient, right, atol=1e-12)
    for row, column in zip(*upper, strict=True):
        np.testing.assert_allclose(blocks[slots[row, column]], dense[row, :, column], atol=1e-12)
    visual = rng.normal(size=(3, 6, 6))
    out = np.zeros_like(blocks)
    kernels.add_visual(np.array([0, 0, 1]), np.array([0, 2, 2]), visual, ranks, slots, out)
    for row, column, block in zip((0, 0, 1), (0, 2, 2), visual, strict=True):
        r, c = ranks[row], ranks[column]
        np.testing.assert_allclose(out[slots[min(r, c), max(r, c)]], block if r <= c else block.T)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocities": np.zeros((3, 3))}, "velocities is"),
        ({"links": np.array([[0, 99]])}, "links holds 99"),
        ({"gravity_map": np.array([0, np.nan, 0])}, "gravity_map has numbers"),
    ],
)
def test_bad_input_is_named(change, message):
    problem, *_ = world(np.arange(1.0, 3.0, 0.5), points=20)
    with pytest.raises(DataError, match=message):
        replace(problem, **change)
