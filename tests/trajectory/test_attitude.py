# SPDX-License-Identifier: MIT
"""Heading and tilt from an IMU on bodies whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import quaternion
from slamcli.trajectory.attitude import Attitude, level_rotation, track_attitude

START, HZ, G = 1_700_000_000_000_000_000, 100, 9.80665
TIMES = np.arange(20 * HZ) / HZ
STAMPS = (START + np.rint(TIMES * 1e9).astype(np.int64)).tolist()


def at(*seconds: float) -> np.ndarray:
    return START + np.rint(np.array(seconds) * 1e9).astype(np.int64)


def level(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    zeros = np.zeros((len(TIMES), 2))
    return np.column_stack([zeros, turn]), np.column_stack([zeros, np.full(len(TIMES), G)])


def naive(rates: np.ndarray, forces: np.ndarray, constant_s: float) -> np.ndarray:
    """Integrate rotation matrices, drawn to a gravity vector that turns with them and follows the forces."""
    first = forces[: HZ + 1].mean(axis=0)
    gravity = first / np.linalg.norm(first)
    pose = quaternion.to_matrix(level_rotation(gravity))
    poses = [pose]
    for k in range(1, len(rates)):
        turn = 0.5 * (rates[k] + rates[k - 1]) / HZ
        angle = np.linalg.norm(turn)
        axis = turn / angle if angle > 0 else np.array([0.0, 0.0, 1.0])
        step = np.append(np.sin(angle / 2) * axis, np.cos(angle / 2))
        pose = pose @ quaternion.to_matrix(step)
        gravity = gravity - np.cross(turn, gravity)
        share = 1 - np.exp(-1 / HZ / constant_s)
        gravity = gravity + share * (forces[k] / np.linalg.norm(forces[k]) - gravity)
        up = pose @ gravity
        pose = quaternion.to_matrix(level_rotation(up / np.linalg.norm(up))) @ pose
        poses.append(pose)
    return np.array(poses)


@pytest.mark.kernels
def test_the_kernel_does_what_matrices_do():
    rng = np.random.default_rng(5)
    rates = 0.3 * rng.normal(size=(300, 3))
    forces = np.array([0.0, 0.0, G]) + rng.normal(size=(300, 3))
    found = track_attitude(STAMPS[:300], rates, forces, 2.0)
    np.testing.assert_allclose(quaternion.to_matrix(found.quats_xyzw), naive(rates, forces, 2.0), atol=1e-9)


@pytest.mark.kernels
def test_a_level_robot_that_turns():
    found = track_attitude(STAMPS, *level(np.sin(TIMES)), 10.0)
    np.testing.assert_allclose(found.yaws(at(0, 1.003, 7.5)), 1 - np.cos([0, 1.003, 7.5]), atol=2e-5)
    np.testing.assert_allclose(found.tilt(int(at(7.5)[0])), [0, 0, 0, 1], atol=1e-9)
    # Nothing turns before the first and after the last sample.
    np.testing.assert_allclose(found.yaws(at(-5, 30)), [0, 1 - np.cos(TIMES[-1])], atol=2e-5)
    assert found.has_gravity
    assert found.num_gaps == 0


def test_a_tilted_robot_turns_about_gravity():
    # Rolled by 10°, turning about the vertical: gravity and rate lie along the same direction of the body.
    roll = np.radians(10.0)
    up = np.array([0.0, np.sin(roll), np.cos(roll)])
    rates, forces = np.outer(np.full(len(TIMES), 0.5), up), np.outer(np.full(len(TIMES), G), up)
    found = track_attitude(STAMPS, rates, forces, 10.0)
    assert found.yaws(at(4.0))[0] - found.yaws(at(0.0))[0] == pytest.approx(2.0, abs=1e-6)
    tilt = found.tilt(int(at(4.0)[0]))
    np.testing.assert_allclose(quaternion.rotate(tilt, up), [0, 0, 1], atol=1e-6)
    assert quaternion.yaw(tilt) == pytest.approx(0.0, abs=1e-9)


def test_the_gyroscope_carries_the_vertical_through_a_ramp():
    # From 0 to 15° of pitch within a second, while a push of 2 m/s² forward for that second bends the force.
    pitch = np.radians(15.0) * np.clip(TIMES - 10.0, 0.0, 1.0)
    rates = np.column_stack([np.zeros_like(TIMES), np.gradient(pitch, TIMES), np.zeros_like(TIMES)])
    push = np.where((TIMES >= 10) & (TIMES < 11), 2.0, 0.0)
    forces = np.column_stack([-G * np.sin(pitch) + push, np.zeros_like(TIMES), G * np.cos(pitch)])
    found = track_attitude(STAMPS, rates, forces, 10.0)
    told = quaternion.to_roll_pitch_yaw(found.quats_xyzw)[:, 1]
    assert np.degrees(np.abs(told - pitch).max()) < 1.5


def test_gaps_backward_stamps_and_no_gravity():
    rates, forces = level(np.full(len(TIMES), 0.1))
    kept = np.r_[0:500, 700:1500]
    found = track_attitude([STAMPS[k] for k in kept], rates[kept], forces[kept], 10.0)
    assert found.num_gaps == 1
    assert found.yaws(at(14.0))[0] == pytest.approx(1.4, abs=1e-6)
    swapped = [*STAMPS[:100], STAMPS[101], STAMPS[100], *STAMPS[102:]]
    assert track_attitude(swapped, rates, forces, 10.0).yaws(at(10.0))[0] == pytest.approx(1.0, abs=1e-3)
    floating = track_attitude(STAMPS, rates, 0.0 * forces, 10.0)
    assert not floating.has_gravity
    assert floating.yaws(at(10.0))[0] == pytest.approx(1.0, abs=1e-6)
    one = track_attitude(STAMPS[:1], rates[:1], forces[:1], 10.0)
    assert isinstance(one, Attitude)
    np.testing.assert_allclose(one.yaws(at(0, 5)), 0.0)


def test_the_smallest_rotation_that_levels():
    rng = np.random.default_rng(3)
    up = rng.normal(size=(50, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    for one in [*up, np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])]:
        turned = level_rotation(one)
        np.testing.assert_allclose(quaternion.rotate(turned, one), [0, 0, 1], atol=1e-9)
        assert turned[2] == 0.0
