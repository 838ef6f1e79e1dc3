# SPDX-License-Identifier: MIT
"""Residuals between states of an IMU and what its samples say happened between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import quaternion
from slamcli.measurements import ImuNoise
from slamcli.posegraph import _preintegration_kernels as kernels
from slamcli.posegraph.imu_preintegration import Preintegration, preintegrate
from slamcli.posegraph.imu_samples import ImuSamples

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LONGEST_GAP_S = 0.3
"""Where samples are missing for longer, a link says nothing about the motion, only that biases walk."""
UNKNOWN_VARIANCE = 1e6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialStates:
    """States of one IMU at S times, as columns."""

    rotations: Floats
    """float64 (S, 3, 3), from the IMU's frame to the map."""
    positions: Floats
    """float64 (S, 3), metres in the map."""
    velocities: Floats
    """float64 (S, 3), m/s in the map."""
    biases: Floats
    """float64 (S, 6), gyroscope rad/s and accelerometer m/s^2."""

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.positions)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialLinks:
    """K pairs of states with the motion between them."""

    first: Integers
    """int64 (K,), index of a state."""
    second: Integers
    motions: Preintegration
    roots: Floats
    """float64 (K, 15, 15), lower triangles W with W' W the inverse covariance; the first 9 rows weigh the motion without
    what the biases did in the meantime."""
    usable: NDArray[np.bool_]
    """bool (K,), False where samples are missing for too long: the motion counts for nothing there."""

    def __len__(self) -> int:
        """Return the number of links."""
        return len(self.first)


def link_states(first: Integers, second: Integers, motions: Preintegration) -> InertialLinks:
    """Return links with their weights.

    Raises
    ------
    EstimationError
        If there are not as many pairs as motions.
    """
    if not len(first) == len(second) == len(motions):
        raise EstimationError(f"{len(motions)} motions of the IMU cannot link {len(first)} and {len(second)} states")
    covariances = motions.covariances.copy()
    usable = motions.gaps_s <= LONGEST_GAP_S
    covariances[~usable, :9, :9] += UNKNOWN_VARIANCE * np.eye(9)
    roots = np.zeros_like(covariances)
    kernels.whiten(covariances, roots)
    return InertialLinks(
        first=np.asarray(first, np.int64),
        second=np.asarray(second, np.int64),
        motions=motions,
        roots=roots,
        usable=usable,
    )


def link_residuals(
    links: InertialLinks, states: InertialStates, gravity_map: Floats, *, derivatives: bool = True
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return whitened residuals and their derivatives by the first and second state and by gravity.

    Parameters
    ----------
    gravity_map : float64 (3,), m/s^2, pointing down.

    Returns
    -------
    residuals : float64 (K, 15): rotation, velocity, position, change of the gyroscope's and accelerometer's bias.
    by_first, by_second : float64 (K, 15, 15), by rotation (vector on the right), position, velocity and biases of the state;
        empty where not asked for, as the next.
    by_gravity : float64 (K, 15, 3).

    References
    ----------
    Forster et al., T-RO 2017, eq. 37 and appendix C.
    """
    m, count = links.motions, len(links)
    rows = count if derivatives else 0
    out, by_gravity = np.zeros((count, 15)), np.zeros((rows, 15, 3))
    by_first, by_second = np.zeros((rows, 15, 15)), np.zeros((rows, 15, 15))
    columns = (states.rotations, states.positions, states.velocities, states.biases, gravity_map)
    kernels.residuals(
        links.first, links.second, m.seconds, m.rotations, m.velocities, m.positions, m.jacobians, m.biases, links.roots,
        *(np.ascontiguousarray(column, np.float64) for column in columns),
        out, by_first, by_second, by_gravity,
    )  # fmt: skip
    return out, by_first, by_second, by_gravity


def rotation_of(vectors: Floats) -> Floats:
    """Return the rotations (N, 3, 3) by the vectors (N, 3), radians."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    half = 0.5 * np.sinc(angle / (2 * np.pi)) * vectors
    return quaternion.to_matrix(np.concatenate([half, np.cos(angle / 2)], axis=1))


def moved_states(states: InertialStates, steps: Floats) -> InertialStates:
    """Return the states after steps (S, 15) in the coordinates of `link_residuals`."""
    return InertialStates(
        rotations=states.rotations @ rotation_of(steps[:, :3]), positions=states.positions + steps[:, 3:6],
        velocities=states.velocities + steps[:, 6:9], biases=states.biases + steps[:, 9:],
    )  # fmt: skip


def gravity_axes(gravity: Floats) -> Floats:
    """Return two unit vectors (3, 2) perpendicular to gravity and to each other."""
    first = np.cross(gravity, np.eye(3)[int(np.argmin(np.abs(gravity)))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(first, gravity) / np.linalg.norm(gravity)], axis=1)


def gravity_turns(gravity: Floats) -> Floats:
    """Return how gravity changes (3, 2) when it is turned about its `gravity_axes`."""
    return np.stack([np.cross(axis, gravity) for axis in gravity_axes(gravity).T], axis=1)


def warm() -> None:
    """Compile the kernels of this module with two samples."""
    stamps, zero = np.array([0, 5_000_000], np.int64), np.zeros((2, 3))
    samples = ImuSamples(stamps_ns=stamps, angular_rad_s=zero, acceleration_m_s2=zero)
    motions = preintegrate(samples, stamps[:1], stamps[1:], np.zeros(6), ImuNoise())
    states = InertialStates(
        rotations=np.tile(np.eye(3), (2, 1, 1)), positions=zero, velocities=zero, biases=np.zeros((2, 6))
    )
    link_residuals(link_states(np.array([0]), np.array([1]), motions), states, np.zeros(3))
