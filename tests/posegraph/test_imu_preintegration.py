# SPDX-License-Identifier: MIT
"""Preintegration: a naive twin, GTSAM, known rides, biases, covariance, gaps, bad input."""

from __future__ import annotations

import itertools

import gtsam
import numpy as np
import pytest
from imu_worlds import GRAVITY, NOISE, Ride, ride_samples, ride_state
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError
from slamcli.measurements import ImuNoise, ImuSample
from slamcli.posegraph import _preintegration_kernels as kernels
from slamcli.posegraph.imu_preintegration import corrected, predict, preintegrate, reintegrated
from slamcli.posegraph.imu_samples import ImuBuffer, ImuSamples

pytestmark = pytest.mark.kernels
SECOND = 1_000_000_000
BIASES = np.array([0.01, -0.02, 0.03, 0.2, -0.1, 0.15])


def naive_motion(samples, begin, end, biases):
    """Trapezoids of linearly interpolated readings with scipy's rotations."""
    stamps = samples.stamps_ns
    edges = [begin, *(int(s) for s in stamps if begin < s < end), end]
    readings = np.concatenate([samples.angular_rad_s, samples.acceleration_m_s2], axis=1)
    at = np.stack([np.interp(edges, stamps, readings[:, i]) for i in range(6)], axis=1) - biases
    turn, velocity, position = Rotation.identity(), np.zeros(3), np.zeros(3)
    for k, (low, high) in enumerate(itertools.pairwise(edges)):
        t, (rate, force) = (high - low) * 1e-9, np.split((at[k] + at[k + 1]) / 2, 2)
        pull = (turn * Rotation.from_rotvec(rate * t / 2)).apply(force)
        position = position + velocity * t + pull * t * t / 2
        velocity = velocity + pull * t
        turn = turn * Rotation.from_rotvec(rate * t)
    return turn.as_matrix(), velocity, position


def random_samples(rng, count=150):
    stamps = np.cumsum(rng.integers(1_000_000, 9_000_000, count))
    return ImuSamples(
        stamps_ns=stamps, angular_rad_s=rng.normal(size=(count, 3)), acceleration_m_s2=rng.normal(size=(count, 3)) * 5
    )


@pytest.mark.parametrize("seed", range(3))
def test_motions_are_those_of_the_naive_twin(seed):
    rng = np.random.default_rng(seed)
    samples = random_samples(rng)
    begins = rng.integers(-(10**8), samples.stamps_ns[-1], 12)
    ends = begins + rng.integers(1, 3 * 10**8, 12)
    biases = rng.normal(size=(12, 6)) * 0.1
    motions = preintegrate(samples, begins, ends, biases, NOISE)
    for k in range(12):
        turn, velocity, position = naive_motion(samples, int(begins[k]), int(ends[k]), biases[k])
        np.testing.assert_allclose(motions.rotations[k], turn, atol=1e-11)
        np.testing.assert_allclose(motions.velocities[k], velocity, atol=1e-11)
        np.testing.assert_allclose(motions.positions[k], position, atol=1e-11)


def test_bias_jacobians_are_the_derivatives():
    samples, step = random_samples(np.random.default_rng(5)), 1e-6
    span = samples.stamps_ns[[3]], samples.stamps_ns[[120]]
    at = preintegrate(samples, *span, BIASES, NOISE)
    for axis in range(6):
        moved = BIASES + step * np.eye(6)[axis]
        more = preintegrate(samples, *span, moved, NOISE)
        less = preintegrate(samples, *span, 2 * BIASES - moved, NOISE)
        turn = Rotation.from_matrix(less.rotations[0].T @ more.rotations[0]).as_rotvec()
        numeric = np.concatenate([turn, more.velocities[0] - less.velocities[0], more.positions[0] - less.positions[0]])
        np.testing.assert_allclose(at.jacobians[0, :, axis], numeric / (2 * step), atol=2e-6)
    to_first_order = corrected(at, BIASES[None] + 1e-3)
    anew = preintegrate(samples, *span, BIASES + 1e-3, NOISE)
    for ours, theirs in zip(to_first_order, (anew.rotations, anew.velocities, anew.positions), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_motion_and_covariance_are_those_of_gtsam():
    ride, rate = Ride(), 1000
    samples, _ = ride_samples(ride, 0.0, 1.0, rate, biases=BIASES)
    p = gtsam.PreintegrationCombinedParams.MakeSharedU(9.80665)
    p.setGyroscopeCovariance(np.eye(3) * NOISE.gyroscope**2)
    p.setAccelerometerCovariance(np.eye(3) * NOISE.accelerometer**2)
    p.setBiasOmegaCovariance(np.eye(3) * NOISE.gyroscope_walk**2)
    p.setBiasAccCovariance(np.eye(3) * NOISE.accelerometer_walk**2)
    p.setIntegrationCovariance(np.eye(3) * 1e-10)
    theirs = gtsam.PreintegratedCombinedMeasurements(p, gtsam.imuBias.ConstantBias(BIASES[3:], BIASES[:3]))
    middle = [(column[:-1] + column[1:]) / 2 for column in (samples.acceleration_m_s2, samples.angular_rad_s)]
    for force, turn in zip(*middle, strict=True):
        theirs.integrateMeasurement(force, turn, 1 / rate)
    ours = preintegrate(samples, np.array([0]), np.array([SECOND]), BIASES, NOISE)
    np.testing.assert_allclose(ours.rotations[0], theirs.deltaRij().matrix(), atol=1e-6)
    np.testing.assert_allclose(ours.velocities[0], theirs.deltaVij(), atol=6e-3)  # its forces act before the rotation
    np.testing.assert_allclose(ours.positions[0], theirs.deltaPij(), atol=3e-3)
    # gtsam: rotation, position, velocity, accelerometer's and gyroscope's bias
    order = np.concatenate([np.arange(i, i + 3) for i in (0, 6, 3, 12, 9)])
    covariance = theirs.preintMeasCov()[np.ix_(order, order)]
    turned = np.eye(15)  # its rotations are rotation vectors, ours are vectors on the right of the rotation
    turned[:3, :3] = gtsam.Rot3.ExpmapDerivative(gtsam.Rot3.Logmap(theirs.deltaRij()))
    turned[9:, 9:] *= -1  # its changes of the biases are first minus second
    covariance = turned @ covariance @ turned.T
    size = np.sqrt(np.diag(ours.covariances[0]))
    np.testing.assert_allclose(covariance / np.outer(size, size), ours.covariances[0] / np.outer(size, size), atol=0.01)


def errors_of(state, truth):
    turn = Rotation.from_matrix(truth.T_map_imu[:3, :3].T @ state.T_map_imu[:3, :3]).as_rotvec()
    back = truth.T_map_imu[:3, :3]
    return turn, back.T @ (state.velocity_map - truth.velocity_map), state.T_map_imu[:3, 3] - truth.T_map_imu[:3, 3]


@pytest.mark.parametrize("seconds", [0.05, 0.523, 2.0])
def test_the_next_state_is_predicted(seconds):
    ride = Ride()
    samples, _ = ride_samples(ride, 0.0, 4.0, biases=BIASES)
    begin, end = 1_001_700_000, 1_001_700_000 + round(seconds * SECOND)  # between samples
    motion = preintegrate(samples, np.array([begin]), np.array([end]), BIASES, NOISE)
    said = predict(ride_state(ride, begin * 1e-9, BIASES), motion, GRAVITY)
    turn, velocity, position = errors_of(said, ride_state(ride, end * 1e-9))
    assert np.linalg.norm(turn) < 2e-6 * (1 + seconds)
    assert np.linalg.norm(velocity) < 4e-5 * (1 + seconds)
    assert np.linalg.norm(position) < 4e-5 * (1 + seconds)
    np.testing.assert_array_equal(said.biases, BIASES)


def test_the_covariance_is_that_of_noisy_samples():
    """Normalised squared errors of 300 noisy rides: 15 on average, as many freedoms as there are."""
    ride, errors = Ride(), []
    start, truth = ride_state(ride, 1.0), ride_state(ride, 2.0)
    for seed in range(300):
        samples, off = ride_samples(ride, 1.0, 2.0, noise=NOISE, seed=seed)
        motion = preintegrate(samples, np.array([SECOND]), np.array([2 * SECOND]), off[0], NOISE)
        said = predict(start, motion, GRAVITY)
        turn = Rotation.from_matrix(truth.T_map_imu[:3, :3].T @ said.T_map_imu[:3, :3]).as_rotvec()
        back = start.T_map_imu[:3, :3].T
        rest = [back @ (said.velocity_map - truth.velocity_map), back @ (said.T_map_imu - truth.T_map_imu)[:3, 3]]
        error = np.concatenate([turn, *rest, off[0] - off[-1]])
        errors.append(error @ np.linalg.solve(motion.covariances[0], error))
    assert np.mean(errors) == pytest.approx(15, abs=1.5)
    assert np.mean(np.array(errors) < 30.58) > 0.97  # 99 %


def test_integration_is_repeated_where_biases_moved():
    samples = random_samples(np.random.default_rng(2))
    begins = samples.stamps_ns[[3, 40, 80]]
    motions = preintegrate(samples, begins, begins + 10**8, np.zeros(6), NOISE)
    biases = np.zeros((3, 6))
    assert reintegrated(motions, samples, biases + 1e-3, NOISE) is motions
    biases[1] = BIASES
    anew = reintegrated(motions, samples, biases, NOISE)
    exact = preintegrate(samples, begins[1:2], begins[1:2] + 10**8, BIASES, NOISE)
    np.testing.assert_array_equal(anew.biases, biases)
    for name in ("rotations", "velocities", "positions", "jacobians", "covariances"):
        np.testing.assert_array_equal(getattr(anew, name)[[0, 2]], getattr(motions, name)[[0, 2]])
        np.testing.assert_array_equal(getattr(anew, name)[1], getattr(exact, name)[0])


def test_a_gap_is_bridged_and_makes_uncertain():
    ride = Ride()
    whole, _ = ride_samples(ride, 0.0, 2.0)
    keep = (whole.stamps_ns <= 0.8 * SECOND) | (whole.stamps_ns >= 1.0 * SECOND)
    gapped = ImuSamples(
        stamps_ns=whole.stamps_ns[keep], angular_rad_s=whole.angular_rad_s[keep],
        acceleration_m_s2=whole.acceleration_m_s2[keep],
    )  # fmt: skip
    span = np.array([SECOND // 2]), np.array([3 * SECOND // 2])
    full, bridged = (preintegrate(s, *span, np.zeros(6), NOISE) for s in (whole, gapped))
    assert full.gaps_s[0] == pytest.approx(0.005)
    assert bridged.gaps_s[0] == pytest.approx(0.2)
    error = np.abs(bridged.velocities[0] - full.velocities[0])
    sigmas = np.sqrt(np.diag(bridged.covariances[0]))[3:6]
    assert np.all(sigmas > 3 * np.sqrt(np.diag(full.covariances[0]))[3:6])
    assert np.all(error < 3 * sigmas)


def test_beyond_the_samples_the_outermost_hold():
    samples = ImuSamples(
        stamps_ns=np.array([SECOND, 2 * SECOND]), angular_rad_s=np.zeros((2, 3)),
        acceleration_m_s2=np.array([[1.0, 0, 0], [3.0, 0, 0]]),
    )  # fmt: skip
    motion = preintegrate(samples, np.array([0]), np.array([3 * SECOND]), np.zeros(6), NOISE)
    np.testing.assert_allclose(motion.velocities[0], [1 + 2 + 3, 0, 0])
    assert motion.gaps_s[0] == pytest.approx(1.0)


def naive_whitened(covariance, residual):
    return residual @ np.linalg.solve(covariance, residual)


def test_whitening_is_the_inverse_root():
    motions = preintegrate(random_samples(np.random.default_rng(1)), np.array([0, 10**8]), np.array([10**8, 4 * 10**8]),
                           BIASES, NOISE)  # fmt: skip
    roots = np.zeros((2, 15, 15))
    kernels.whiten(motions.covariances, roots)
    for root, covariance in zip(roots, motions.covariances, strict=True):
        np.testing.assert_allclose(root @ covariance @ root.T, np.eye(15), atol=1e-6)


def test_a_single_step_can_be_weighed():
    motions = preintegrate(random_samples(np.random.default_rng(1)), np.array([1]), np.array([500_000]), BIASES,
                           ImuNoise(gyroscope_walk=0.0, accelerometer_walk=0.0))  # fmt: skip
    roots = np.zeros((1, 15, 15))
    kernels.whiten(motions.covariances, roots)
    assert np.isfinite(roots).all()


def reading(stamp, value=0.0):
    return ImuSample(stamp_ns=stamp, frame_id="imu", angular_rad_s=np.full(3, value), acceleration_m_s2=np.zeros(3))


def test_samples_that_cannot_be_used_are_counted():
    buffer = ImuBuffer()
    assert buffer.last_ns is None
    assert buffer.counts().used == 0
    stamps = [0, 5, 5, 4, 10, 15, 40, 45]
    for stamp in stamps:
        buffer.add(reading(stamp * 10**6))
    buffer.add(reading(50 * 10**6, np.nan))
    counts = buffer.counts()
    assert (counts.used, counts.repeated, counts.late, counts.not_finite, counts.gaps) == (6, 1, 1, 1, 1)
    assert counts.longest_gap_s == pytest.approx(0.025)
    assert buffer.last_ns == 45 * 10**6
    np.testing.assert_array_equal(buffer.samples(12 * 10**6).stamps_ns, np.array([10, 15, 40, 45]) * 10**6)
    np.testing.assert_array_equal(buffer.samples(-5).stamps_ns, np.array([0, 5, 10, 15, 40, 45]) * 10**6)


def test_a_clock_is_put_right_for_all_samples():
    buffer = ImuBuffer()
    for stamp in (10, 15):
        buffer.add(reading(stamp))
    buffer.shift(4)
    buffer.add(reading(20))
    np.testing.assert_array_equal(buffer.samples().stamps_ns, [6, 11, 16])
    buffer.shift(-1)
    np.testing.assert_array_equal(buffer.samples().stamps_ns, [7, 12, 17])
    assert buffer.offset_ns == 3


def test_the_buffer_grows():
    buffer = ImuBuffer()
    for stamp in range(3000):
        buffer.add(reading(stamp, float(stamp)))
    assert len(buffer) == 3000
    np.testing.assert_array_equal(buffer.samples().angular_rad_s[:, 0], np.arange(3000.0))


@pytest.mark.parametrize(
    ("stamps", "value", "span", "message"),
    [
        ([], 0.0, (0, 5), "no IMU sample"),
        ([1, 1], 0.0, (0, 5), "do not increase in time at 1 ns"),
        ([1, 2], np.inf, (0, 5), "sample at 1 ns is not finite"),
        ([1, 2], 0.0, (5, 5), "spans no time, at 5 ns"),
    ],
)
def test_unusable_input_is_named(stamps, value, span, message):
    values = np.full((len(stamps), 3), value)
    samples = ImuSamples(stamps_ns=np.array(stamps, np.int64), angular_rad_s=values, acceleration_m_s2=values)
    with pytest.raises(EstimationError, match=message):
        preintegrate(samples, np.array([span[0]]), np.array([span[1]]), np.zeros(6), NOISE)


def test_a_bias_that_is_not_finite_is_named():
    with pytest.raises(EstimationError, match="bias"):
        preintegrate(random_samples(np.random.default_rng(0)), np.array([0]), np.array([9]), np.full(6, np.nan), NOISE)
