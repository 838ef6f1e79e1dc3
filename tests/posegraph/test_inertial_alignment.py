# SPDX-License-Identifier: MIT
"""Inertial-only initialisation: exact without noise, within its own deviations with it, and honest about too little motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_worlds import NOISE, camera_ride
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError
from slamcli.posegraph.alignment_descent import AlignmentDescent
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_alignment import AlignmentSettings, align_inertial, objection
from slamcli.posegraph.inertial_links import link_residuals, link_states

GRAVITY_M_S2 = 9.80665
SETTINGS = AlignmentSettings(gravity_m_s2=GRAVITY_M_S2, rotation_sigma_rad=5e-4, position_sigma=2e-3 / 2.5)


def tilt(found, gravity):
    return float(np.degrees(np.arccos(np.clip(found @ gravity / GRAVITY_M_S2**2, -1, 1))))


@pytest.mark.parametrize("scale", [0.02, 1.0, 30.0])
def test_all_is_found_without_noise(scale):
    poses, samples, gravity, biases = camera_ride(5.0, 3, noise=None, position_m=0, rotation_rad=0, scale=scale)
    settings = replace(SETTINGS, position_sigma=1e-4 / scale, accelerometer_bias_sigma=10.0)
    found = align_inertial(poses, samples, NOISE, settings)
    assert found.scale == pytest.approx(scale, rel=2e-4)
    assert tilt(found.gravity_map, gravity) < 0.01
    np.testing.assert_allclose(found.biases, biases, atol=2e-3)
    speed = np.gradient(poses.positions, poses.stamps_ns * 1e-9, axis=0)[1:-1] * scale
    np.testing.assert_allclose(found.velocities[1:-1], speed, atol=0.15)
    assert found.converged
    assert objection(found) == ""


@pytest.mark.parametrize(("seconds", "bound"), [(2.0, 0.05), (5.0, 0.01), (15.0, 0.01)])
def test_the_scale_is_found_as_well_as_the_motion_allows(seconds, bound):
    errors, tilts = [], []
    for seed in range(4 if seconds < 10 else 2):
        poses, samples, gravity, _ = camera_ride(seconds, seed, begin=1 + 0.7 * seed)
        found = align_inertial(poses, samples, NOISE, SETTINGS)
        errors.append(abs(found.scale / 2.5 - 1))
        tilts.append(tilt(found.gravity_map, gravity))
        assert errors[-1] < 10 * found.log_scale_sigma
    assert np.median(errors) < bound
    assert np.median(tilts) < 0.5


def test_a_known_scale_is_kept_and_helps():
    poses, samples, gravity, biases = camera_ride(2.0, 4, scale=1.0)
    found = align_inertial(poses, samples, NOISE, replace(SETTINGS, fixed_scale=True, position_sigma=2e-3))
    assert found.scale == 1.0
    assert found.log_scale_sigma == 0.0
    assert tilt(found.gravity_map, gravity) < 0.5
    np.testing.assert_allclose(found.biases[:3], biases[:3], atol=1e-3)
    free = align_inertial(poses, samples, NOISE, replace(SETTINGS, position_sigma=2e-3))
    assert found.biases_sigma[3:].sum() < free.biases_sigma[3:].sum()


@pytest.mark.parametrize("fixed_scale", [False, True])
def test_standing_still_is_said(fixed_scale):
    poses, samples, _, _ = camera_ride(4.0, 1, still=True, scale=1.0, position_m=2e-4)
    found = align_inertial(poses, samples, NOISE, replace(SETTINGS, fixed_scale=fixed_scale))
    assert "not enough motion" in objection(found)


def test_the_map_may_be_turned_and_moved():
    poses, samples, _, _ = camera_ride(3.0, 2)
    turn = Rotation.from_rotvec([0.5, 1.0, -2.0]).as_matrix()
    moved = replace(poses, rotations=turn @ poses.rotations, positions=poses.positions @ turn.T + [100.0, -20.0, 7.0])
    first, second = (align_inertial(p, samples, NOISE, SETTINGS) for p in (poses, moved))
    assert second.scale == pytest.approx(first.scale, rel=1e-4)
    np.testing.assert_allclose(second.gravity_map, turn @ first.gravity_map, atol=1e-3)
    np.testing.assert_allclose(second.velocities, first.velocities @ turn.T, atol=1e-3)


def test_a_hole_in_the_samples_is_survived():
    poses, samples, gravity, _ = camera_ride(6.0, 5)
    keep = (samples.stamps_ns < 3.1e9) | (samples.stamps_ns > 4.2e9)
    holed = ImuSamples(
        stamps_ns=samples.stamps_ns[keep], angular_rad_s=samples.angular_rad_s[keep],
        acceleration_m_s2=samples.acceleration_m_s2[keep],
    )  # fmt: skip
    found = align_inertial(poses, holed, NOISE, SETTINGS)
    assert found.scale == pytest.approx(2.5, rel=0.03)
    assert tilt(found.gravity_map, gravity) < 0.5


def test_derivatives_are_those_of_small_steps():
    poses, samples, gravity, _ = camera_ride(1.0, 0)
    n = np.arange(len(poses.stamps_ns))
    links = link_states(
        n[:-1], n[1:], preintegrate(samples, poses.stamps_ns[:-1], poses.stamps_ns[1:], np.zeros(6), NOISE)
    )
    problem = AlignmentDescent(poses, links, SETTINGS, 2.0, gravity, np.zeros((len(n), 3)), np.full(6, 0.01))
    _, slope = problem.normal_equations()
    for column in range(1, len(slope)):  # the weight of positions grows with the scale: left out of its derivative
        step = np.zeros(len(slope))
        step[column] = 1e-6
        more, less = (problem.cost(*problem.moved(s)) for s in (step, -step))
        assert slope[column] == pytest.approx((more - less) / 4e-6, rel=1e-4, abs=1e-2)


def test_the_step_is_that_of_dense_least_squares():
    """The normal equations against J'J from small steps of every residual."""
    poses, samples, gravity, _ = camera_ride(1.0, 0)
    n = np.arange(len(poses.stamps_ns))
    links = link_states(
        n[:-1], n[1:], preintegrate(samples, poses.stamps_ns[:-1], poses.stamps_ns[1:], np.zeros(6), NOISE)
    )
    problem = AlignmentDescent(poses, links, SETTINGS, 2.0, gravity, np.zeros((len(n), 3)), np.full(6, 0.01))
    normal, _ = problem.normal_equations()

    def residuals(states, down, log_scale):
        motion = link_residuals(links, states, down, derivatives=False)[0][:, :9]
        prior = states.biases[0] / np.repeat([0.1, 0.2], 3)
        return np.concatenate([motion.ravel(), problem.pose_residuals(states, log_scale).ravel(), prior])

    rows = []
    for column in range(len(normal)):
        step = np.zeros(len(normal))
        step[column] = 1e-6
        more, less = (residuals(*problem.moved(s)) for s in (step, -step))
        rows.append((more - less) / 2e-6)
    dense = np.array(rows) @ np.array(rows).T
    size = np.sqrt(np.diag(dense))
    np.testing.assert_allclose(
        (normal / np.outer(size, size))[1:, 1:], (dense / np.outer(size, size))[1:, 1:], atol=1e-5
    )


def test_too_few_poses_and_no_samples_are_named():
    poses, samples, _, _ = camera_ride(2.0, 0)
    few = replace(poses, stamps_ns=poses.stamps_ns[:3], rotations=poses.rotations[:3], positions=poses.positions[:3])
    with pytest.raises(EstimationError, match="3 poses"):
        align_inertial(few, samples, NOISE, SETTINGS)
    one = ImuSamples(stamps_ns=np.array([0]), angular_rad_s=np.zeros((1, 3)), acceleration_m_s2=np.zeros((1, 3)))
    with pytest.raises(EstimationError, match="missing between all"):
        align_inertial(poses, one, NOISE, SETTINGS)
