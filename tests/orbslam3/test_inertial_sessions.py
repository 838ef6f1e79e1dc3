# SPDX-License-Identifier: MIT
"""Whole sessions with an IMU: metres from one camera, gravity, blind spells, standing still, the same bytes twice."""

from __future__ import annotations

import numpy as np
import pytest
from inertial_world import BIASES, position_errors, travel

from slamcli.orbslam3.inertial_start import scale_map


def tilt(session, turn):
    """Degrees between the up that was found and the room's."""
    up = turn @ session.inertial.up(session.map)
    return float(np.degrees(np.arccos(np.clip(up[2], -1, 1))))


def test_one_camera_and_an_imu_find_metres():
    session, truth = travel(6.0, stereo=False)
    assert session.counts["maps aligned with the IMU"] == 1
    errors, scale, turn = position_errors(session, truth)
    assert scale == pytest.approx(1.0, abs=0.02)
    assert np.sqrt((errors**2).mean()) < 0.03
    assert tilt(session, turn) < 0.3
    inertia = session.inertial.of(session.map)
    biases = inertia.biases(inertia.known(session.map))
    np.testing.assert_allclose(biases[:, :3].mean(axis=0), BIASES[:3], atol=2e-3)
    np.testing.assert_allclose(biases[:, 3:].mean(axis=0), BIASES[3:], atol=0.05)
    # frames tracked before the map had metres have them too
    first = next(frame for frame in session.tracked if frame.number > 3)
    assert np.linalg.norm(first.T_frame_reference[:3, 3]) < 1.0
    assert session.inertial.complaints(session.map) == []
    assert session.inertial.summary(session.map)["imu_samples"] == len(session.inertial.imu.buffer)


def test_an_imu_makes_stereo_no_worse():
    plain, truth = travel(4.5, stereo=True, inertial=False)
    inertial, _ = travel(4.5, stereo=True)
    before, after = (np.sqrt((position_errors(s, truth)[0] ** 2).mean()) for s in (plain, inertial))
    assert after < max(1.1 * before, 0.005)
    assert position_errors(inertial, truth)[1] == pytest.approx(1.0, abs=0.005)
    assert tilt(inertial, position_errors(inertial, truth)[2]) < 0.3
    again, _ = travel(4.5, stereo=True)
    assert again.map.T_camera_map.tobytes() == inertial.map.T_camera_map.tobytes()


def test_keyframes_follow_one_another_in_time():
    session, _ = travel(4.5, stereo=True)
    stamps = np.sort(session.map.stamp_ns[session.map.living_keyframes])
    assert np.diff(stamps).max() <= 1.1e9


def test_a_blind_second_is_bridged():
    session, truth = travel(7.0, stereo=True, blind=(4.0, 5.0))
    assert session.counts["frames posed by the IMU alone"] >= 14
    assert len(session.maps) == 1
    assert [frame.number for frame in session.tracked] == list(range(105))
    errors, _, turn = position_errors(session, truth)
    assert errors.max() < 0.03
    poses = session.map.poses_of_all()
    T = np.array([np.linalg.inv(f.T_frame_reference @ poses[f.reference]) for f in session.tracked])
    moved = T[60:76, :3, 3] - T[0, :3, 3]
    true = (truth[60:76, :3, 3] - truth[0, :3, 3]) @ turn
    assert np.linalg.norm(moved - true, axis=1).max() < 0.02


@pytest.mark.parametrize("stereo", [True, False])
def test_standing_still_is_said(stereo):
    session, _ = travel(3.0, stereo=stereo, still=True)
    complaint = session.inertial.complaints(session.map)[0]
    assert "the IMU was not used, not enough motion" in complaint
    assert session.inertial.up(session.map) is None
    assert session.counts["maps aligned with the IMU"] == 0
    if stereo:
        assert len(session.tracked) == 45
        assert np.abs(session.map.centres).max() < 0.01


def test_lengths_of_a_map_are_changed_together():
    session, _ = travel(2.0, stereo=True, inertial=False)
    sparse_map = session.map
    alive = np.flatnonzero(sparse_map.point_alive)
    before = sparse_map.centres.copy(), sparse_map.positions[alive].copy(), sparse_map.far[alive].copy()
    scale_map(sparse_map, 2.5)
    np.testing.assert_allclose(sparse_map.centres, 2.5 * before[0])
    np.testing.assert_allclose(sparse_map.positions[alive], 2.5 * before[1])
    np.testing.assert_allclose(sparse_map.far[alive], 2.5 * before[2])


@pytest.mark.parametrize("clock_s", [0.02, -0.03])
def test_a_clock_that_is_off_is_put_right(clock_s):
    session, truth = travel(4.0, stereo=True, clock_s=clock_s)
    assert session.inertial.imu.buffer.offset_ns * 1e-9 == pytest.approx(clock_s, abs=0.004)
    errors, scale, _ = position_errors(session, truth)
    assert scale == pytest.approx(1.0, abs=0.006)
    assert np.sqrt((errors**2).mean()) < 0.006
    which = "ahead of" if clock_s > 0 else "behind"
    assert f"ms {which} the camera's" in session.inertial.complaints(session.map)[0]


def test_an_imu_in_other_units_is_not_believed():
    session, truth = travel(3.0, stereo=True, factors=(57.3, 1.0))
    assert "contradict the cameras' motion" in session.inertial.complaints(session.map)[0]
    assert session.inertial.up(session.map) is None
    assert position_errors(session, truth)[0].max() < 0.01
