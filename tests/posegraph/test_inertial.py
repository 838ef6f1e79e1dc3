# SPDX-License-Identifier: MIT
"""What an IMU adds to a graph: Jacobians, gravity, mounting angle, level maps."""

from __future__ import annotations

import numpy as np
import pytest
import spatial_worlds as worlds
from scipy.spatial.transform import Rotation
from test_spatial import analytic_jacobians, numeric_jacobians

from slamcli.errors import EstimationError
from slamcli.posegraph.inertial import Inertia, inertia_of, inertial_terms, joined
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.spatial import optimise_spatial

pytestmark = pytest.mark.kernels
NONE = Loss()


def random_inertia(rng):
    return Inertia(
        gravity_m_s2=np.array([9.7, 9.9]), extrinsics_xyzw=Rotation.from_rotvec(rng.normal(size=(2, 3))).as_quat(),
        acceleration_nodes=np.array([[0, 1, 2], [1, 2, 3], [4, 0, 3]]), acceleration_imu=np.array([0, 1, 1]),
        delta_velocity=rng.normal(size=(3, 3)), seconds=rng.uniform(0.5, 2, size=(3, 2)),
        rotation_nodes=np.array([[0, 1], [2, 4]]), rotation_imu=np.array([1, 0]),
        delta_rotation_xyzw=Rotation.from_rotvec(rng.normal(size=(2, 3))).as_quat(),
        acceleration_weight=3.0, rotation_weight=5.0,
    )  # fmt: skip


@pytest.mark.parametrize("which", [0, 1])
def test_jacobians_are_the_differences_of_the_residuals(which):
    rng = np.random.default_rng(1)
    inertia = random_inertia(rng)
    state = np.concatenate([worlds.random_poses(rng, 5), inertia.rows()])
    term = inertial_terms(inertia, 5)[which]
    np.testing.assert_allclose(analytic_jacobians(term, state), numeric_jacobians(term, state), atol=1e-7)


def ride_graph(ride, seconds=20.0, spacing=0.2, rate=200):
    """Exact poses of a ride, odometry edges between them, and the IMU's residuals."""
    stamps = np.round(np.arange(0, seconds, spacing) * 1e9).astype(np.int64)
    imu_stamps = np.round(np.arange(0, seconds + 0.1, 1 / rate) * 1e9).astype(np.int64)
    poses = ride.poses(stamps * 1e-9)
    rates, forces = ride.imu(imu_stamps * 1e-9 + 0.5 / rate)  # the mean over the time that each sample holds
    nodes = np.arange(len(stamps))
    edges = worlds.edges(nodes[:-1], nodes[1:], worlds.seen_from(poses[:-1], poses[1:]), 1e3, 1e3)
    return poses, edges, (stamps, nodes, imu_stamps, rates, forces)


def test_residuals_are_small_at_the_truth():
    poses, _, measurements = ride_graph(worlds.Ride())
    inertia = inertia_of(*measurements, acceleration_weight=1.0, rotation_weight=1.0)
    state = np.concatenate([poses, inertia.rows()])
    acceleration, rotation = (term.residuals(state) for term in inertial_terms(inertia, len(poses)))
    assert acceleration.shape == (len(poses) - 2, 3)
    assert rotation.shape == (len(poses) - 1, 3)
    assert np.abs(acceleration).max() < 0.01  # m/s in 0.2 s; differences of positions are not velocities
    assert np.abs(rotation).max() < 1e-4


def test_gravity_levels_the_map_and_is_measured():
    ride = worlds.Ride(gravity=9.79)
    poses, edges, measurements = ride_graph(ride)
    tilt = Rotation.from_rotvec([0.1, -0.05, 0.0])
    turned = (tilt * Rotation.from_quat(poses[:, 3:])).as_quat()
    start = np.concatenate([tilt.apply(poses[:, :3]), turned], axis=1)
    inertia = inertia_of(*measurements)
    solution = optimise_spatial(
        start, np.zeros(len(poses), bool), edges, loss=NONE, max_iterations=50, inertia=inertia, tolerance=1e-10
    )
    assert solution.held[0].tolist() == [True, True, True, False, False, True]
    up = Rotation.from_quat(solution.poses[:, 3:]).inv().apply([0, 0, 1])
    true_up = Rotation.from_quat(poses[:, 3:]).inv().apply([0, 0, 1])
    assert np.arccos(np.clip(np.sum(up * true_up, axis=1), -1, 1)).max() < 2e-3
    assert solution.gravity_m_s2[0] == pytest.approx(9.79, abs=0.01)


def test_the_mounting_angle_of_the_imu_is_found():
    mount = np.array([0.03, -0.02, 0.05])
    poses, edges, measurements = ride_graph(worlds.Ride(mount=mount))
    inertia = inertia_of(*measurements, estimate_extrinsics=True)
    solution = optimise_spatial(
        poses, np.zeros(len(poses), bool), edges, loss=NONE, max_iterations=50, inertia=inertia, tolerance=1e-10
    )
    np.testing.assert_allclose(Rotation.from_quat(solution.extrinsics_xyzw[0]).as_rotvec(), mount, atol=2e-3)


def test_the_mounting_angle_stays_where_it_is_not_estimated():
    poses, edges, measurements = ride_graph(worlds.Ride(mount=[0.03, -0.02, 0.05]))
    solution = optimise_spatial(
        poses, np.zeros(len(poses), bool), edges, loss=NONE, max_iterations=5, inertia=inertia_of(*measurements)
    )
    np.testing.assert_array_equal(solution.extrinsics_xyzw[0], [0, 0, 0, 1])


def test_gaps_and_missing_nodes_leave_residuals_out():
    _, _, (stamps, nodes, imu_stamps, rates, forces) = ride_graph(worlds.Ride(), seconds=4.0)
    kept = (imu_stamps < 1.0e9) | (imu_stamps > 2.1e9)
    linked = np.ones(len(nodes) - 1, bool)
    linked[-3] = False
    inertia = inertia_of(stamps, nodes, imu_stamps[kept], rates[kept], forces[kept], linked=linked)
    seconds = stamps[inertia.rotation_nodes[:, 0]] * 1e-9
    assert not np.any((seconds > 0.95) & (seconds < 2.05))
    assert len(nodes) - 4 not in inertia.rotation_nodes[:, 0]
    assert len(nodes) - 4 not in inertia.acceleration_nodes[:, 0]
    assert len(nodes) - 4 not in inertia.acceleration_nodes[:, 1]


def test_joined_imus_keep_their_own_nodes():
    rng = np.random.default_rng(0)
    both = joined([random_inertia(rng), random_inertia(rng)])
    assert len(both.gravity_m_s2) == 4
    np.testing.assert_array_equal(both.acceleration_imu, [0, 1, 1, 2, 3, 3])
    np.testing.assert_array_equal(both.rotation_imu, [1, 0, 3, 2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda i: i.delta_velocity.__setitem__((2, 0), np.nan), "IMU residual 2: delta_velocity"),
        (lambda i: i.seconds.__setitem__((1, 0), 0.0), "IMU residual 1 spans no time"),
        (lambda i: i.rotation_nodes.__setitem__((0, 0), 9), "rotation_nodes of the IMU's residuals holds 9"),
    ],
)
def test_unusable_residuals_are_named(change, message):
    inertia = random_inertia(np.random.default_rng(0))
    change(inertia)
    edges = worlds.edges([0], [1], np.zeros((1, 7)))
    with pytest.raises(EstimationError, match=message):
        optimise_spatial(np.zeros((5, 7)), np.zeros(5, bool), edges, loss=NONE, max_iterations=1, inertia=inertia)


def test_nodes_that_go_back_in_time_are_named():
    one = np.ones((2, 3))
    with pytest.raises(EstimationError, match="nodes do not increase in time at 3 ns"):
        inertia_of(np.array([5, 3]), np.array([0, 1]), np.array([1, 2]), one, one)
