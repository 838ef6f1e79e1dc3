# SPDX-License-Identifier: MIT
"""What is known about an IMU along a map: kept, completed, turned with loops, joined with another map's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from inertial_world import NOISE, T_CAMERA_IMU, reading
from loop_world import World
from scipy.spatial.transform import Rotation

from slamcli.errors import CalibrationError, EstimationError
from slamcli.geometry import se3
from slamcli.mapper import Setup
from slamcli.measurements import CameraModel, CameraRig, ImuSample
from slamcli.orbslam3.inertial_mapping import InertialMapping
from slamcli.orbslam3.inertial_start import align_map
from slamcli.orbslam3.inertial_state import Imu, MapInertia
from slamcli.orbslam3.mapper import OrbSlam3Mapper
from slamcli.orbslam3.parameters import OrbSlam3Parameters

DOWN = np.array([0.0, 0.0, -9.80665])


def imu(fixed_scale=True):
    return Imu(T_camera_imu=T_CAMERA_IMU, given_noise=NOISE, fixed_scale=fixed_scale)


@pytest.fixture
def sparse_map():
    """Six keyframes, 0.1 s apart."""
    return World(focal_error=0.0, count=800).build(0.05 * np.arange(6))


def known(sparse_map, keyframes, seed=0):
    inertia, rng = MapInertia(), np.random.default_rng(seed)
    inertia.set(
        sparse_map, np.array(keyframes), rng.normal(size=(len(keyframes), 3)), rng.normal(size=(len(keyframes), 6))
    )
    return inertia


def test_gravity_must_be_known_to_be_used():
    inertia = MapInertia()
    with pytest.raises(EstimationError, match="not aligned with the IMU"):
        _ = inertia.gravity


def test_culled_keyframes_are_forgotten(sparse_map):
    inertia = known(sparse_map, [0, 2, 3])
    assert inertia.known(sparse_map).tolist() == [0, 2, 3]
    sparse_map.remove_keyframe(2)
    assert inertia.known(sparse_map).tolist() == [0, 3]


def test_velocities_come_from_positions_where_nothing_is_known(sparse_map):
    inertia = known(sparse_map, [0, 5])
    inertia.complete(sparse_map, sparse_map.living_keyframes, imu())
    assert inertia.known(sparse_map).tolist() == list(range(6))
    T_map_imu = se3.inverse(sparse_map.T_camera_map) @ T_CAMERA_IMU
    speed = (T_map_imu[4, :3, 3] - T_map_imu[2, :3, 3]) / 0.2
    np.testing.assert_allclose(inertia.velocities(np.array([3]))[0], speed, atol=1e-9)
    np.testing.assert_array_equal(inertia.biases(np.array([1, 4])), inertia.biases(np.array([0, 5])))


def test_velocities_turn_with_a_loop(sparse_map):
    inertia = known(sparse_map, [0, 1])
    before = inertia.velocities(np.array([0, 1]))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    sparse_map.T_camera_map[:] = sparse_map.T_camera_map @ se3.inverse(turn)
    inertia.follow(sparse_map)
    np.testing.assert_array_equal(inertia.velocities(np.array([0, 1])), before)  # local mapping turns them itself
    sparse_map.version += 1
    inertia.follow(sparse_map)
    np.testing.assert_allclose(inertia.velocities(np.array([0, 1])), before @ turn[:3, :3].T, atol=1e-12)


@pytest.mark.parametrize(("old_knows", "newer_knows"), [(True, True), (True, False), (False, True), (False, False)])
def test_maps_are_joined(sparse_map, old_knows, newer_knows):
    newer_map = World(focal_error=0.0, count=800, seed=1).build(0.05 * np.arange(4))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.0, 0.4, -0.2]).as_matrix()
    merged = World(focal_error=0.0, count=800).build(0.05 * np.arange(10))
    merged.T_camera_map[:6], merged.version = sparse_map.T_camera_map, 1
    merged.T_camera_map[6:] = newer_map.T_camera_map @ se3.inverse(turn)
    mapping = InertialMapping(imu(), {})
    parts = []
    for part, knows, keyframes in ((sparse_map, old_knows, [0, 3]), (newer_map, newer_knows, [1])):
        inertia = known(part, keyframes) if knows else MapInertia()
        inertia.gravity_map = DOWN.copy() if knows else None
        mapping._of[id(part)] = (part, inertia)
        parts.append(inertia)
    mapping.join(sparse_map, newer_map, merged, 6)
    joined = mapping.of(merged)
    if not (old_knows or newer_knows):
        assert joined.gravity_map is None
        return
    down = DOWN if old_knows else turn[:3, :3] @ DOWN
    np.testing.assert_allclose(mapping.up(merged), -down / 9.80665, atol=1e-9)
    assert joined.known(merged).tolist() == [0, 3] * old_knows + [7] * newer_knows
    if newer_knows:
        expected = parts[1].velocities(np.array([1])) @ turn[:3, :3].T
        np.testing.assert_allclose(joined.velocities(np.array([7])), expected, atol=1e-9)


def test_a_map_without_metres_makes_the_whole_unknown(sparse_map):
    newer_map = World(focal_error=0.0, count=800, seed=1).build(0.05 * np.arange(3))
    newer = known(newer_map, [0])
    newer.gravity_map = DOWN
    joined = MapInertia().joined(newer, sparse_map, newer_map, sparse_map, 3, fixed_scale=False)
    assert joined.gravity_map is None


def test_a_map_that_is_too_young_is_not_aligned(sparse_map):
    inertia, device = MapInertia(), imu()
    rng = np.random.default_rng(0)
    for k in range(200):
        values = reading(k / 200, rng)
        device.buffer.add(
            ImuSample(stamp_ns=k * 5_000_000, frame_id="imu", angular_rad_s=values[:3], acceleration_m_s2=values[3:])
        )
    assert align_map(sparse_map, inertia, device) is None
    assert inertia.objection == (
        "not enough motion: 10 keyframes within at least 1 s are needed, there are 6 within 0.5 s"
    )
    assert device.noise.frequency_hz == pytest.approx(200)


def test_bad_samples_are_complained_of(sparse_map):
    mapping = InertialMapping(imu(), {})
    assert mapping.complaints(sparse_map) == ["no IMU sample could be used: the map is what the cameras see alone"]
    for stamp, value in ((0, 0.0), (5, 0.0), (5, 0.0), (10, math.nan), (10, 0.0), (500, 0.0), (505, 0.0)):
        mapping.imu.buffer.add(
            ImuSample(
                stamp_ns=stamp * 10**6, frame_id="imu", angular_rad_s=np.full(3, value), acceleration_m_s2=np.zeros(3)
            )
        )
    _, bad, gap = mapping.complaints(sparse_map)
    assert bad == "2 IMU samples were left out: 1 repeated, 0 late, 1 not finite"
    assert gap == "IMU samples are missing in 1 places, for 0.49 s at most"
    assert mapping.summary(sparse_map)["imu_samples_gaps"] == 1


def test_an_imu_that_hangs_nowhere_is_refused():
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    model = CameraModel(
        stamp_ns=0, frame_id="camera", width=640, height=480, distortion_model="plumb_bob", distortion=np.zeros(5),
        intrinsics=matrix, rectification=np.eye(3), projection=np.column_stack([matrix, np.zeros(3)]),
    )  # fmt: skip
    rig = CameraRig(mode="mono", main=model, inertial=True)
    with pytest.raises(CalibrationError, match=r"IMU\.T_b_c1"):
        OrbSlam3Mapper(OrbSlam3Parameters(), Setup(T_base_laser={}, rig=rig))
