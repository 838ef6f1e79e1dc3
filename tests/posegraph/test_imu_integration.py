# SPDX-License-Identifier: MIT
"""Integration of IMU samples: a naive twin, GTSAM, known motions, bad input."""

from __future__ import annotations

import itertools

import gtsam
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from spatial_worlds import Ride

from slamcli.errors import EstimationError
from slamcli.posegraph.imu_integration import integrate_imu

pytestmark = pytest.mark.kernels


def naive_integral(stamps, rates, forces, begin, end):
    """The same with scipy's rotations: each sample holds until the next, forces act half way through its rotation."""
    turn, velocity = Rotation.identity(), np.zeros(3)
    edges = [begin, *(int(s) for s in stamps[1:] if begin < s < end), end]
    for low, high in itertools.pairwise(edges):
        i = max(int(np.searchsorted(stamps, low, side="right")) - 1, 0)
        seconds = (high - low) * 1e-9
        velocity = velocity + (turn * Rotation.from_rotvec(rates[i] * seconds / 2)).apply(forces[i] * seconds)
        turn = turn * Rotation.from_rotvec(rates[i] * seconds)
    return turn, velocity


@pytest.mark.parametrize("seed", range(4))
def test_integrals_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.integers(1, 20_000_000, 200))
    rates, forces = rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) * 5
    begins = rng.integers(-(10**8), stamps[-1], 30)
    ends = begins + rng.integers(0, 10**9, 30)
    rotations, velocities, _ = integrate_imu(stamps, rates, forces, begins, ends)
    for k in range(30):
        turn, velocity = naive_integral(stamps, rates, forces, int(begins[k]), int(ends[k]))
        assert (turn.inv() * Rotation.from_quat(rotations[k])).magnitude() < 1e-10
        np.testing.assert_allclose(velocities[k], velocity, atol=1e-9)


def test_integrals_are_those_of_gtsam():
    ride, rate = Ride(), 1000
    t = np.arange(1000) / rate
    rates, forces = ride.imu(t)
    theirs = gtsam.PreintegratedImuMeasurements(
        gtsam.PreintegrationParams.MakeSharedU(9.80665), gtsam.imuBias.ConstantBias()
    )
    for i in range(len(t)):
        theirs.integrateMeasurement(forces[i], rates[i], 1 / rate)
    stamps = np.round(t * 1e9).astype(np.int64)
    rotations, velocities, gaps = integrate_imu(stamps, rates, forces, np.array([0]), np.array([10**9]))
    assert (
        Rotation.from_matrix(theirs.deltaRij().matrix()).inv() * Rotation.from_quat(rotations[0])
    ).magnitude() < 5e-6  # it integrates rotation vectors
    np.testing.assert_allclose(velocities[0], theirs.deltaVij(), atol=5e-3)  # its forces act before the rotation
    assert gaps[0] == pytest.approx(1e-3)


def test_a_steady_turn_is_integrated_to_second_order():
    rate, seconds = np.array([[0.0, 0.0, 2.0]]), 0.01
    stamps = (np.arange(100) * 10_000_000).astype(np.int64)
    force = np.array([[1.0, 0.0, 0.0]])
    rotations, velocities, _ = integrate_imu(
        stamps, np.repeat(rate, 100, 0), np.repeat(force, 100, 0), np.array([0]), np.array([10**9])
    )
    np.testing.assert_allclose(rotations[0], [0, 0, np.sin(1), np.cos(1)], atol=1e-12)
    exact = np.array([np.sin(2) / 2, (1 - np.cos(2)) / 2, 0])
    np.testing.assert_allclose(velocities[0], exact, atol=(2 * seconds) ** 2 / 24)


def test_gaps_are_measured_also_where_samples_end():
    stamps, zero = np.array([10, 20, 50], np.int64) * 10**8, np.zeros((3, 3))
    gaps = integrate_imu(stamps, zero, zero, np.array([12, 0, 21, 60]) * 10**8, np.array([19, 11, 22, 75]) * 10**8)[2]
    np.testing.assert_allclose(gaps, [1.0, 1.0, 3.0, 2.5])


def test_an_empty_interval_is_no_motion():
    rotations, velocities, _ = integrate_imu(
        np.array([5]), np.ones((1, 3)), np.ones((1, 3)), np.array([7]), np.array([7])
    )
    np.testing.assert_array_equal(rotations[0], [0, 0, 0, 1])
    np.testing.assert_array_equal(velocities[0], 0)


@pytest.mark.parametrize(
    ("stamps", "value", "begin", "message"),
    [
        ([], 0.0, 0, "no IMU sample"),
        ([1, 1], 0.0, 0, "do not increase in time at 1 ns"),
        ([1, 2], np.nan, 0, "sample at 1 ns is not finite"),
        ([1, 2], 0.0, 9, "ends before it begins, at 9 ns"),
    ],
)
def test_unusable_samples_are_named(stamps, value, begin, message):
    values = np.full((len(stamps), 3), value)
    with pytest.raises(EstimationError, match=message):
        integrate_imu(np.array(stamps, np.int64), values, values, np.array([begin]), np.array([5]))
