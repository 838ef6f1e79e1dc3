# SPDX-License-Identifier: MIT
"""What an IMU says about consecutive nodes of a pose graph in space: changes of velocity, and rotations.

The terms of Cartographer's 3D optimisation: velocities are differences of the nodes' positions, so that no velocity is
estimated, gravity's size and the IMU's mounting angle are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import quaternion
from slamcli.posegraph.imu_integration import integrate_imu
from slamcli.posegraph.levenberg_marquardt import Terms
from slamcli.posegraph.losses import Loss

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inertia:
    """Residuals of I IMUs, one per trajectory: A triples of nodes and B pairs.

    With R, t the poses of nodes, C the extrinsic rotation and g the size of gravity of the IMU:

    * acceleration: weight (R1 C dv - g (d0 + d1) / 2 z - ((t2 - t1) / d1 - (t1 - t0) / d0)) for nodes 0, 1, 2,
    * rotation: weight times the vector part of the quaternion of R1' R0 C dR C' for nodes 0 and 1: half the angle, as
      Cartographer weighs it.
    """

    gravity_m_s2: Floats
    """float64 (I,), where to begin."""
    extrinsics_xyzw: Floats
    """float64 (I, 4), where to begin: rotation from the IMU's axes to the node's."""
    acceleration_nodes: Integers
    """int64 (A, 3), indices of poses."""
    acceleration_imu: Integers
    """int64 (A,)."""
    delta_velocity: Floats
    """float64 (A, 3), m/s, from half way between the first two nodes to half way between the last two, gravity included,
    in the IMU's axes at the middle node."""
    seconds: Floats
    """float64 (A, 2), from the first node to the middle one and from there to the last."""
    rotation_nodes: Integers
    """int64 (B, 2)."""
    rotation_imu: Integers
    """int64 (B,)."""
    delta_rotation_xyzw: Floats
    """float64 (B, 4), turns the IMU's axes at the second node into those at the first."""
    acceleration_weight: float = 1.1e2
    rotation_weight: float = 1.6e4
    estimate_gravity: bool = True
    estimate_extrinsics: bool = False

    def rows(self) -> Floats:
        """Return the IMUs as rows (I, 7) of the state: gravity, two numbers that are held, extrinsic rotation."""
        rows = np.zeros((len(self.gravity_m_s2), 7))
        rows[:, 0] = self.gravity_m_s2
        rows[:, 3:] = quaternion.normalise(self.extrinsics_xyzw)
        return rows


def inertia_of(
    stamps_ns: Integers,
    nodes: Integers,
    imu_stamps_ns: Integers,
    angular_rad_s: Floats,
    linear_m_s2: Floats,
    *,
    linked: NDArray[np.bool_] | None = None,
    longest_gap_s: float = 0.5,
    acceleration_weight: float = 1.1e2,
    rotation_weight: float = 1.6e4,
    gravity_m_s2: float = STANDARD_GRAVITY,
    estimate_extrinsics: bool = False,
) -> Inertia:
    """Return the residuals of one IMU between the consecutive nodes of its trajectory.

    Parameters
    ----------
    stamps_ns : int64 (K,), increasing, of the nodes.
    nodes : int64 (K,), their indices among the poses.
    imu_stamps_ns, angular_rad_s, linear_m_s2 : the IMU's samples, as in
        :func:`~slamcli.posegraph.imu_integration.integrate_imu`.
    linked : bool (K - 1,), whether each node is followed by the next, which it is not where nodes between were trimmed;
        None for everywhere.
    longest_gap_s : where the samples leave a longer gap, there is no residual.

    Raises
    ------
    EstimationError
        As :func:`~slamcli.posegraph.imu_integration.integrate_imu`, or if nodes do not increase in time.
    """
    t, half = np.asarray(stamps_ns, np.int64), np.asarray(stamps_ns[:-1], np.int64)
    if len(t) > 1 and np.any(np.diff(t) <= 0):
        raise EstimationError(f"nodes do not increase in time at {t[1:][np.diff(t) <= 0][0]} ns")
    half = half + np.diff(t) // 2
    samples = (imu_stamps_ns, angular_rad_s, linear_m_s2)
    whole, _, gaps = integrate_imu(*samples, t[:-1], t[1:])
    to_centre, _, _ = integrate_imu(*samples, t[:-1], half)
    _, between, _ = integrate_imu(*samples, half[:-1], half[1:])
    back = quaternion.multiply(quaternion.conjugate(whole[:-1]), to_centre[:-1])
    known = gaps <= longest_gap_s
    if linked is not None:
        known &= linked
    both = known[:-1] & known[1:]
    triples = np.stack([nodes[:-2], nodes[1:-1], nodes[2:]], axis=1)[both]
    pairs = np.stack([nodes[:-1], nodes[1:]], axis=1)[known]
    seconds = np.diff(t) * 1e-9
    return Inertia(
        gravity_m_s2=np.array([gravity_m_s2]), extrinsics_xyzw=np.array([[0.0, 0.0, 0.0, 1.0]]),
        acceleration_nodes=triples.astype(np.int64), acceleration_imu=np.zeros(len(triples), np.int64),
        delta_velocity=quaternion.rotate(back, between)[both], seconds=np.stack([seconds[:-1], seconds[1:]], axis=1)[both],
        rotation_nodes=pairs.astype(np.int64), rotation_imu=np.zeros(len(pairs), np.int64),
        delta_rotation_xyzw=whole[known], acceleration_weight=acceleration_weight, rotation_weight=rotation_weight,
        estimate_extrinsics=estimate_extrinsics,
    )  # fmt: skip


def joined(inertias: Sequence[Inertia]) -> Inertia:
    """Return the residuals of several IMUs (trajectories) as one; the settings are those of the first."""
    offsets = np.cumsum([0, *(len(i.gravity_m_s2) for i in inertias)])[:-1]
    shifted = [(i.acceleration_imu + n, i.rotation_imu + n) for i, n in zip(inertias, offsets, strict=True)]
    return replace(
        inertias[0],
        gravity_m_s2=np.concatenate([i.gravity_m_s2 for i in inertias]),
        extrinsics_xyzw=np.concatenate([i.extrinsics_xyzw for i in inertias]),
        acceleration_nodes=np.concatenate([i.acceleration_nodes for i in inertias]),
        acceleration_imu=np.concatenate([imus for imus, _ in shifted]),
        delta_velocity=np.concatenate([i.delta_velocity for i in inertias]),
        seconds=np.concatenate([i.seconds for i in inertias]),
        rotation_nodes=np.concatenate([i.rotation_nodes for i in inertias]),
        rotation_imu=np.concatenate([imus for _, imus in shifted]),
        delta_rotation_xyzw=np.concatenate([i.delta_rotation_xyzw for i in inertias]),
    )


def check_inertia(inertia: Inertia, poses: int) -> None:
    """Refuse numbers that are not finite and indices that name no pose or IMU.

    Raises
    ------
    EstimationError
        Naming what and where.
    """
    i = inertia
    for name in ("gravity_m_s2", "extrinsics_xyzw", "delta_velocity", "seconds", "delta_rotation_xyzw"):
        values = getattr(i, name)
        if not np.all(np.isfinite(values)):
            bad = int(np.argmin(np.isfinite(values).reshape(len(values), -1).all(axis=1)))
            raise EstimationError(f"IMU residual {bad}: {name} is not finite")
    if np.any(i.seconds <= 0):
        raise EstimationError(f"IMU residual {int(np.argmax((i.seconds <= 0).any(axis=1)))} spans no time")
    limits = {"acceleration_nodes": poses, "rotation_nodes": poses}
    limits |= {"acceleration_imu": len(i.gravity_m_s2), "rotation_imu": len(i.gravity_m_s2)}
    for name, limit in limits.items():
        values = getattr(i, name)
        if values.size and not (values.min() >= 0 and values.max() < limit):
            raise EstimationError(f"{name} of the IMU's residuals holds {int(values.max())}: there are {limit}")


def inertial_terms(inertia: Inertia, poses: int) -> list[Terms]:
    """Return the residuals of the descent; IMU i is row `poses` + i of the state."""
    return [_acceleration_terms(inertia, poses), _rotation_terms(inertia, poses)]


def _acceleration_terms(inertia: Inertia, poses: int) -> Terms:
    nodes, rows, weight = inertia.acceleration_nodes, inertia.acceleration_imu + poses, inertia.acceleration_weight
    before, after = inertia.seconds[:, :1], inertia.seconds[:, 1:]
    middle = (before + after) / 2
    variables = np.stack(
        [2 * nodes[:, 0], 2 * nodes[:, 1], 2 * nodes[:, 2], 2 * nodes[:, 1] + 1, 2 * rows, 2 * rows + 1], axis=1
    )

    def residuals(state: Floats) -> Floats:
        t0, t1, t2 = (state[nodes[:, k], :3] for k in range(3))
        felt = quaternion.rotate(state[rows, 3:], inertia.delta_velocity)
        felt = quaternion.rotate(state[nodes[:, 1], 3:], felt)
        felt[:, 2] -= state[rows, 0] * middle[:, 0]
        return weight * (felt - (t2 - t1) / after + (t1 - t0) / before)

    def jacobians(state: Floats) -> Floats:
        mounted = quaternion.rotate(state[rows, 3:], inertia.delta_velocity)
        turn = quaternion.to_matrix(state[nodes[:, 1], 3:])
        out = np.zeros((len(nodes), 3, 18))
        for axis in range(3):
            out[:, axis, axis] = -weight / before[:, 0]
            out[:, axis, 3 + axis] = weight * (1 / before[:, 0] + 1 / after[:, 0])
            out[:, axis, 6 + axis] = -weight / after[:, 0]
        out[:, :, 9:12] = -weight * _cross_matrices((turn @ mounted[:, :, None])[:, :, 0])
        out[:, 2, 12] = -weight * middle[:, 0]
        out[:, :, 15:18] = -weight * turn @ _cross_matrices(mounted)
        return out

    return _squared(variables, residuals, jacobians)


def _rotation_terms(inertia: Inertia, poses: int) -> Terms:
    first, second = inertia.rotation_nodes[:, 0], inertia.rotation_nodes[:, 1]
    rows, weight = inertia.rotation_imu + poses, inertia.rotation_weight
    delta = quaternion.normalise(inertia.delta_rotation_xyzw)
    variables = np.stack([2 * first + 1, 2 * second + 1, 2 * rows + 1], axis=1)

    def parts(state: Floats) -> tuple[Floats, Floats]:
        """The rotation from the second to the first node, and the error."""
        mount = state[rows, 3:]
        back = quaternion.multiply(quaternion.conjugate(state[second, 3:]), state[first, 3:])
        said = quaternion.multiply(quaternion.multiply(mount, delta), quaternion.conjugate(mount))
        error = quaternion.multiply(back, said)
        return back, np.where(error[:, 3:] < 0, -error, error)

    def residuals(state: Floats) -> Floats:
        return weight * parts(state)[1][:, :3]

    def jacobians(state: Floats) -> Floats:
        back, error = parts(state)
        by_turn = 0.5 * weight * (error[:, 3:, None] * np.eye(3) - _cross_matrices(error[:, :3]))
        to_second = quaternion.to_matrix(state[second, 3:]).transpose(0, 2, 1)
        out = np.empty((len(first), 3, 9))
        out[:, :, :3] = by_turn @ to_second
        out[:, :, 3:6] = -out[:, :, :3]
        out[:, :, 6:] = by_turn @ (quaternion.to_matrix(back) - quaternion.to_matrix(error))
        return out

    return _squared(variables, residuals, jacobians)


def _squared(
    variables: Integers, residuals: Callable[[Floats], Floats], jacobians: Callable[[Floats], Floats]
) -> Terms:
    """Return terms that no loss applies to."""
    none = np.zeros(len(variables), np.bool_)
    variables = variables.astype(np.int64)
    return Terms(variables=variables, residuals=residuals, jacobians=jacobians, loss=Loss(), robust=none)


def _cross_matrices(vectors: Floats) -> Floats:
    """Return the matrices (N, 3, 3) of the cross product with vectors (N, 3)."""
    out = np.zeros((len(vectors), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = vectors.T
    out[:, 1, 2], out[:, 2, 0], out[:, 0, 1] = -vectors.T
    return out
