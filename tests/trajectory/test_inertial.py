# SPDX-License-Identifier: MIT
"""Heading and tilt from an IMU on bodies whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.geometry import quaternion
from slamcli.measurements import ImuSample
from slamcli.runtime import RunLog
from slamcli.trajectory.inertial import InertialTrack, inertial_track, level_rotation

START, HZ = 1_700_000_000_000_000_000, 100
TIMES = np.arange(20 * HZ) / HZ
G = 9.80665


def track(rates: np.ndarray, forces: np.ndarray, mount: np.ndarray | None = None) -> tuple[InertialTrack, RunLog]:
    log = RunLog()
    samples = [
        ImuSample(stamp_ns=START + round(t * 1e9), frame_id="imu", angular_rad_s=w, acceleration_m_s2=f, topic="/imu")
        for t, w, f in zip(TIMES, rates, forces, strict=True)
    ]
    mounts = {} if mount is None else {"/imu": mount}
    found = inertial_track(samples, mounts, 10.0, log)
    assert found is not None
    return found, log


def level(turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    zeros = np.zeros((len(TIMES), 2))
    return np.column_stack([zeros, turn]), np.column_stack([zeros, np.full(len(TIMES), G)])


def test_a_level_robot_that_turns():
    found, log = track(*level(np.sin(TIMES)))
    query = START + np.array([0, 1_003_000_000, 7_500_000_000], dtype=np.int64)
    yaws, known = found.headings(query)
    np.testing.assert_allclose(yaws, 1 - np.cos([0, 1.003, 7.5]), atol=2e-5)
    assert known.all()
    np.testing.assert_allclose(found.tilts(query), [[0, 0, 0, 1]] * 3, atol=1e-12)
    assert not log.warnings
    assert not found.is_level


def test_headings_are_not_known_outside_and_in_gaps():
    rates, forces = level(np.ones(len(TIMES)))
    found, _ = track(rates, forces)
    sparse = InertialTrack(
        stamps_ns=np.concatenate([found.stamps_ns[:100], found.stamps_ns[150:]]),
        rates_rad_s=rates[50:],
        up=found.up[50:],
        has_gravity=True,
    )
    query = START + np.array([-5, 500_000_000, 1_200_000_000, 1_700_000_000, 25_000_000_000], dtype=np.int64)
    yaws, known = sparse.headings(query)
    assert known.tolist() == [False, True, False, True, False]
    np.testing.assert_allclose(yaws[1:4], [0.5, 1.2, 1.7], atol=1e-9)


def test_a_tilted_robot_turns_about_gravity():
    # Rolled by 10°, turning about the vertical: gravity and rate lie along the same direction of the body.
    roll = np.radians(10.0)
    up = np.array([0.0, np.sin(roll), np.cos(roll)])
    found, _ = track(np.outer(np.full(len(TIMES), 0.5), up), np.outer(np.full(len(TIMES), G), up))
    query = START + np.array([4_000_000_000], dtype=np.int64)
    assert found.headings(query)[0][0] == pytest.approx(2.0, abs=1e-9)
    np.testing.assert_allclose(quaternion.rotate(found.tilts(query)[0], up), [0, 0, 1], atol=1e-9)


def test_the_gyroscope_carries_the_vertical_through_a_ramp():
    # From 0 to 15° of pitch within a second, while a push of 2 m/s² forward for that second bends the force.
    pitch = np.radians(15.0) * np.clip(TIMES - 10.0, 0.0, 1.0)
    rates = np.column_stack([np.zeros_like(TIMES), np.gradient(pitch, TIMES), np.zeros_like(TIMES)])
    push = np.where((TIMES >= 10) & (TIMES < 11), 2.0, 0.0)
    forces = np.column_stack([-G * np.sin(pitch) + push, np.zeros_like(TIMES), G * np.cos(pitch)])
    found, _ = track(rates, forces)
    told = np.arctan2(-found.up[:, 0], found.up[:, 2])
    assert np.degrees(np.abs(told - pitch).max()) < 1.5


def test_a_mount_that_is_known_and_one_that_is_not():
    rates, forces = level(np.full(len(TIMES), 0.3))
    # The IMU lies on its side: its y axis points up.
    sideways = np.eye(4)
    sideways[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    on_side = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    seen = rates @ on_side, forces @ on_side
    query = START + np.array([10_000_000_000], dtype=np.int64)
    for mount, warned in ((sideways, False), (None, True)):
        found, log = track(*seen, mount)
        assert found.headings(query)[0][0] == pytest.approx(3.0, abs=1e-9)
        np.testing.assert_allclose(found.tilts(query), [[0, 0, 0, 1]], atol=1e-9)
        assert found.is_level == warned
        assert any("90° from the vertical" in warning for warning in log.warnings) == warned


@pytest.mark.parametrize(
    ("scale", "has_gravity", "warning"),
    [(1.0 / G, True, "multiples of gravity"), (0.0, False, "not gravity"), (5.0, False, "not gravity")],
)
def test_forces_in_other_units_or_without_gravity(scale: float, has_gravity: bool, warning: str):
    rates, forces = level(np.full(len(TIMES), 0.1))
    found, log = track(rates, forces * scale)
    assert found.has_gravity == has_gravity
    assert warning in log.warnings[0]
    query = START + np.array([10_000_000_000], dtype=np.int64)
    assert found.headings(query)[0][0] == pytest.approx(1.0)
    np.testing.assert_allclose(found.tilts(query), [[0, 0, 0, 1]], atol=1e-12)


def test_samples_that_cannot_be_used():
    log = RunLog()
    force = np.array([0.0, 0.0, G])
    stamps = [1, 2, 2, 1, 3, 4]
    rates = [0.0, 0.0, 0.0, 0.0, np.nan, 0.0]
    samples = [
        ImuSample(stamp_ns=START + s * 10_000_000, frame_id="imu", angular_rad_s=np.full(3, w), acceleration_m_s2=force)
        for s, w in zip(stamps, rates, strict=True)
    ]
    found = inertial_track(samples, {}, 10.0, log)
    assert found is not None
    assert len(found.stamps_ns) == 3
    assert log.counts == {
        "IMU samples that are not finite": 1,
        "IMU samples that are not later than the one before": 2,
    }
    assert inertial_track(samples[:1], {}, 10.0, log) is None
    fast, log = track(*level(np.full(len(TIMES), 60.0)))
    assert "degrees per second" in log.warnings[0]
    assert fast.has_gravity


def test_the_smallest_rotation_that_levels():
    rng = np.random.default_rng(3)
    up = rng.normal(size=(50, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    up = np.vstack([up, [[0, 0, -1], [0, 0, 1]]])
    turned = level_rotation(up)
    np.testing.assert_allclose(quaternion.rotate(turned, up), [[0, 0, 1]] * len(up), atol=1e-9)
    np.testing.assert_allclose(turned[:, 2], 0.0, atol=1e-12)
