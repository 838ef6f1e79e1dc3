# SPDX-License-Identifier: MIT
"""Residuals between inertial states: a naive twin, GTSAM's factor, numeric derivatives, gaps."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from imu_worlds import GRAVITY, NOISE, Ride, ride_samples, ride_state
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.inertial_links import (
    InertialStates,
    link_residuals,
    link_states,
    moved_states,
    rotation_of,
)

pytestmark = pytest.mark.kernels
SECOND = 1_000_000_000
BIASES = np.array([0.01, -0.02, 0.03, 0.2, -0.1, 0.15])


def ride_states(ride, times, biases):
    at = [ride_state(ride, t, biases) for t in times]
    return InertialStates(
        rotations=np.array([s.T_map_imu[:3, :3] for s in at]), positions=np.array([s.T_map_imu[:3, 3] for s in at]),
        velocities=np.array([s.velocity_map for s in at]), biases=np.array([s.biases for s in at]),
    )  # fmt: skip


def chain(times=(1.0, 1.4, 2.1, 2.5), size=0.05, seed=0):
    """Links along a ride and states that are off by `size`."""
    ride, rng = Ride(), np.random.default_rng(seed)
    samples, _ = ride_samples(ride, 0.0, 4.0, biases=BIASES)
    stamps = np.round(np.array(times) * SECOND).astype(np.int64)
    motions = preintegrate(samples, stamps[:-1], stamps[1:], BIASES, NOISE)
    n = np.arange(len(times))
    states = ride_states(ride, times, BIASES)
    return link_states(n[:-1], n[1:], motions), moved_states(states, rng.normal(size=(len(times), 15)) * size)


def naive_residual(links, states, k):
    i, j, m = links.first[k], links.second[k], links.motions
    t, change = m.seconds[k], m.jacobians[k] @ (states.biases[i] - m.biases[k])
    said = Rotation.from_matrix(m.rotations[k]) * Rotation.from_rotvec(change[:3])
    first, second = Rotation.from_matrix(states.rotations[i]), Rotation.from_matrix(states.rotations[j])
    turn = (said.inv() * first.inv() * second).as_rotvec()
    speed = first.inv().apply(states.velocities[j] - states.velocities[i] - GRAVITY * t)
    place = first.inv().apply(states.positions[j] - states.positions[i] - states.velocities[i] * t - GRAVITY * t**2 / 2)
    speed, place = speed - m.velocities[k] - change[3:6], place - m.positions[k] - change[6:]
    return np.concatenate([turn, speed, place, states.biases[j] - states.biases[i]])


@pytest.mark.parametrize("size", [0.0, 0.05, 0.5])
def test_residuals_are_those_of_the_naive_twin(size):
    links, states = chain(size=size)
    ours = link_residuals(links, states, GRAVITY, derivatives=False)[0]
    for k in range(len(links)):
        raw = naive_residual(links, states, k)
        cost = raw @ np.linalg.solve(links.motions.covariances[k], raw)
        assert ours[k] @ ours[k] == pytest.approx(cost, rel=1e-6, abs=1e-6)
        np.testing.assert_allclose(np.linalg.solve(links.roots[k], ours[k]), raw, atol=1e-9)
    if size == 0.0:
        assert np.abs(ours).max() < 0.05


def test_residuals_are_those_of_gtsam():
    """Its samples act as ours do when they are many: 2 kHz, along the same states."""
    ride, times, rate = Ride(), (1.0, 1.4), 2000
    samples, _ = ride_samples(ride, 0.0, 2.0, rate, biases=BIASES)
    stamps = np.round(np.array(times) * SECOND).astype(np.int64)
    motions = preintegrate(samples, stamps[:-1], stamps[1:], BIASES, NOISE)
    size = np.repeat([0.1, 0.01], [9, 6])  # biases matter to first order only, in other coordinates
    states = moved_states(ride_states(ride, times, BIASES), np.random.default_rng(3).normal(size=(2, 15)) * size)
    p = gtsam.PreintegrationParams.MakeSharedU(9.80665)
    theirs = gtsam.PreintegratedImuMeasurements(p, gtsam.imuBias.ConstantBias(BIASES[3:], BIASES[:3]))
    first, last = np.searchsorted(samples.stamps_ns, stamps)
    for i in range(first, last):
        pair = slice(i, i + 2)
        force, turn = samples.acceleration_m_s2[pair].mean(0), samples.angular_rad_s[pair].mean(0)
        theirs.integrateMeasurement(force, turn, 1 / rate)
    nodes = [
        gtsam.NavState(gtsam.Rot3(states.rotations[k]), gtsam.Point3(*states.positions[k]), states.velocities[k])
        for k in range(2)
    ]
    said = theirs.predict(nodes[0], gtsam.imuBias.ConstantBias(states.biases[0, 3:], states.biases[0, :3]))
    links = link_states(np.array([0]), np.array([1]), motions)
    raw = np.linalg.solve(links.roots[0], link_residuals(links, states, GRAVITY, derivatives=False)[0][0])
    turn = Rotation.from_matrix(said.attitude().matrix().T @ states.rotations[1]).as_rotvec()
    back = states.rotations[0].T
    np.testing.assert_allclose(raw[:3], turn, atol=1e-4)
    np.testing.assert_allclose(raw[3:6], back @ (states.velocities[1] - said.velocity()), atol=5e-3)
    np.testing.assert_allclose(raw[6:9], back @ (states.positions[1] - said.position()), atol=1e-3)


def test_derivatives_are_those_of_small_steps():
    links, states = chain(size=0.2, seed=4)
    _, by_first, by_second, by_gravity = link_residuals(links, states, GRAVITY)
    step = 1e-6
    for axis in range(15):
        for end, ours in ((links.first, by_first), (links.second, by_second)):
            for k in range(len(links)):
                steps = np.zeros((len(states), 15))
                steps[end[k], axis] = step
                more = link_residuals(links, moved_states(states, steps), GRAVITY, derivatives=False)[0][k]
                less = link_residuals(links, moved_states(states, -steps), GRAVITY, derivatives=False)[0][k]
                size = np.abs(ours[k]).max()
                np.testing.assert_allclose(ours[k, :, axis] / size, (more - less) / (2 * step) / size, atol=1e-7)
    for axis in range(3):
        moved = [
            link_residuals(links, states, GRAVITY + s * np.eye(3)[axis], derivatives=False)[0] for s in (step, -step)
        ]
        size = np.abs(by_gravity).max()
        np.testing.assert_allclose(by_gravity[:, :, axis] / size, (moved[0] - moved[1]) / (2 * step) / size, atol=1e-7)


def test_half_turns_are_no_trouble():
    links, states = chain(size=0.0)
    for vector in ([np.pi, 0, 0], [0, 3.1, 0.3], [-2.2, 0, 2.2]):
        turned = InertialStates(
            rotations=states.rotations.copy(), positions=states.positions, velocities=states.velocities,
            biases=states.biases,
        )  # fmt: skip
        turned.rotations[1] = states.rotations[1] @ rotation_of(np.array([vector]))[0]
        raw = np.linalg.solve(links.roots[0], link_residuals(links, turned, GRAVITY, derivatives=False)[0][0])
        exact = Rotation.from_rotvec(vector).as_matrix()
        np.testing.assert_allclose(Rotation.from_rotvec(raw[:3]).as_matrix(), exact, atol=1e-5)


def test_long_gaps_say_nothing_about_the_motion():
    ride = Ride()
    samples, _ = ride_samples(ride, 0.0, 2.0)
    stamps = np.array([1.0, 1.9, 2.8]) * SECOND  # samples end at 2.0
    motions = preintegrate(samples, stamps[:-1].astype(int), stamps[1:].astype(int), np.zeros(6), NOISE)
    links = link_states(np.array([0, 1]), np.array([1, 2]), motions)
    np.testing.assert_array_equal(links.usable, [True, False])
    states = moved_states(ride_states(ride, (1.0, 1.9, 2.8), np.zeros(6)), np.full((3, 15), 0.0))
    cost = (link_residuals(links, states, GRAVITY, derivatives=False)[0] ** 2).sum(axis=1)
    assert cost[1] < 0.01
    walked = moved_states(states, np.eye(15)[[0, 0, 9]] * np.array([[0], [0], [1e-4]]))
    cost = (link_residuals(links, walked, GRAVITY, derivatives=False)[0] ** 2).sum(axis=1)
    assert cost[1] == pytest.approx((1e-4 / NOISE.gyroscope_walk) ** 2 / 0.9, rel=0.01)


def test_pairs_and_motions_must_be_as_many():
    links, _ = chain()
    with pytest.raises(EstimationError, match="3 motions"):
        link_states(links.first[:2], links.second[:2], links.motions)
