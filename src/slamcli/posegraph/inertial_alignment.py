# SPDX-License-Identifier: MIT
"""Gravity, scale, biases and velocities from poses that cameras found and what an IMU says between them.

The inertial-only maximum-a-posteriori estimate of Campos, Montiel and Tardós, "Inertial-only optimization for
visual-inertial initialization", ICRA 2020, doi:10.1109/ICRA40945.2020.9197334, started from the linear solution that Qin,
Li and Shen (T-RO 2018, doi:10.1109/TRO.2018.2853729, section V) give. Other than there, poses are no truth: each has a
prior of its own, so that noise of the cameras does not end in the biases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.measurements import ImuNoise
from slamcli.posegraph.alignment_descent import AlignmentDescent
from slamcli.posegraph.alignment_records import AlignmentSettings, InertialAlignment, VisualPoses
from slamcli.posegraph.imu_preintegration import Preintegration, preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_links import InertialLinks, link_states

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
__all__ = ["AlignmentSettings", "InertialAlignment", "VisualPoses", "align_inertial", "objection"]


def align_inertial(
    poses: VisualPoses, samples: ImuSamples, noise: ImuNoise, settings: AlignmentSettings
) -> InertialAlignment:
    """Return gravity, scale, biases and velocities.

    Raises
    ------
    EstimationError
        If there are fewer than four poses, stamps do not increase, or no link has enough samples.

    Notes
    -----
    Whether the motion was enough is for the caller to judge by the deviations: see :func:`objection`.
    """
    count = len(poses.stamps_ns)
    if count < 4:
        raise EstimationError(
            f"{count} poses are not enough to find gravity and biases of an IMU: at least 4 are needed"
        )
    n = np.arange(count)
    biases = np.zeros(6)
    motions = _integrated(poses, samples, biases, noise)
    biases[:3] = _gyroscope_bias(poses, motions)
    motions = _integrated(poses, samples, biases, noise)
    links = link_states(n[:-1], n[1:], motions)
    if not links.usable.any():
        raise EstimationError("IMU samples are missing between all poses")
    scale, gravity, velocities = _linear_start(poses, links, settings)
    descent = AlignmentDescent(poses, links, settings, scale, gravity, velocities, biases)
    converged = descent.descend(samples, noise)
    sigmas, mean_square = descent.deviations()
    return InertialAlignment(
        scale=float(np.exp(descent.log_scale)), gravity_map=descent.gravity, biases=descent.biases,
        velocities=descent.states.velocities, log_scale_sigma=0.0 if settings.fixed_scale else float(sigmas[0]),
        gravity_sigma_rad=float(sigmas[1:3].max()), biases_sigma=sigmas[3:], excitation_m_s2=descent.excitation(),
        mean_square=mean_square, converged=converged,
    )  # fmt: skip


def objection(alignment: InertialAlignment, *, log_scale_sigma: float = 0.02, gravity_sigma_rad: float = 0.02) -> str:
    """Return why an alignment is not to be trusted, or "" if it is."""
    if not alignment.converged:
        return "the estimate did not settle"
    if alignment.mean_square > 100 and alignment.excitation_m_s2 >= 0.02:
        return (
            "its samples contradict the cameras' motion (are its mount, its units and its axes right?): "
            f"residuals are {alignment.mean_square**0.5:.0f} times what is expected"
        )
    if alignment.excitation_m_s2 < 0.02:
        return f"not enough motion: accelerations differ by {alignment.excitation_m_s2:.3f} m/s^2 only"
    if alignment.log_scale_sigma > log_scale_sigma:
        return f"not enough motion: the scale is known to {100 * alignment.log_scale_sigma:.1f} % only"
    if alignment.gravity_sigma_rad > gravity_sigma_rad:
        return f"not enough motion: gravity is known to {np.degrees(alignment.gravity_sigma_rad):.1f} degrees only"
    return ""


def _integrated(poses: VisualPoses, samples: ImuSamples, biases: Floats, noise: ImuNoise) -> Preintegration:
    return preintegrate(samples, poses.stamps_ns[:-1], poses.stamps_ns[1:], biases, noise)


def _gyroscope_bias(poses: VisualPoses, motions: Preintegration) -> Floats:
    """Return the bias (3,) with which rotations of the IMU are those of the camera, to first order.

    The median of what single links say: one wrong pose does no harm.
    """
    turns, _ = poses.lever()
    error = motions.rotations.transpose(0, 2, 1) @ turns[:-1].transpose(0, 2, 1) @ turns[1:]
    vectors = np.stack(
        [error[:, 2, 1] - error[:, 1, 2], error[:, 0, 2] - error[:, 2, 0], error[:, 1, 0] - error[:, 0, 1]]
    )
    return np.asarray(
        np.median(np.linalg.solve(motions.jacobians[:, :3, :3], 0.5 * vectors.T[:, :, None])[:, :, 0], axis=0)
    )


def _linear_start(
    poses: VisualPoses, links: InertialLinks, settings: AlignmentSettings
) -> tuple[float, Floats, Floats]:
    """Return scale, gravity (3,) of the right size and velocities (N, 3) from linear equations, weighed twice."""
    scale = 1.0
    for _ in range(2):
        rows, values = _linear_rows(poses, links, settings, scale)
        if settings.fixed_scale:
            values = values - rows[:, 0]
            rows[:, 0] = 0.0
        normal = rows.T @ rows
        normal += np.diag(1e-12 * np.diag(normal) + 1e-12)
        found: Floats = np.asarray(np.linalg.solve(normal, rows.T @ values), np.float64)
        # A scale that is negative or vanishes is none: the descent has to find it from 1.
        scale = 1.0 if settings.fixed_scale or not found[0] > 1e-6 else float(found[0])
    gravity = found[1:4] * settings.gravity_m_s2 / max(float(np.linalg.norm(found[1:4])), 1e-9)
    return scale, gravity, found[4:].reshape(-1, 3)


def _linear_rows(
    poses: VisualPoses, links: InertialLinks, settings: AlignmentSettings, scale: float
) -> tuple[Floats, Floats]:
    """Return rows (6 K, 4 + 3 N) and right-hand sides of: scale, gravity, velocities."""
    m, (turns, lever) = links.motions, poses.lever()
    count, t = len(links), m.seconds
    covariances = np.einsum("kii->ki", m.covariances)
    spread = (scale * settings.position_sigma) ** 2 * 2
    tilt = (settings.gravity_m_s2 * settings.rotation_sigma_rad) ** 2
    fast = 1 / np.sqrt(covariances[:, 3:6].mean(axis=1) + tilt * t**2)
    far = 1 / np.sqrt(covariances[:, 6:9].mean(axis=1) + spread + tilt * t**4 / 4)
    fast, far = np.where(links.usable, fast, 0.0), np.where(links.usable, far, 0.0)
    rows, values = np.zeros((count, 6, 4 + 3 * len(turns))), np.zeros((count, 6))
    arm = turns @ lever
    k = np.arange(count)
    rows[:, :3, 0] = np.diff(poses.positions, axis=0) * far[:, None]
    values[:, :3] = (np.einsum("kij,kj->ki", turns[:-1], m.positions) - np.diff(arm, axis=0)) * far[:, None]
    values[:, 3:] = np.einsum("kij,kj->ki", turns[:-1], m.velocities) * fast[:, None]
    for axis in range(3):
        rows[:, axis, 1 + axis] = -0.5 * t * t * far
        rows[:, 3 + axis, 1 + axis] = -t * fast
        rows[k, axis, 4 + 3 * k + axis] = -t * far
        rows[k, 3 + axis, 4 + 3 * k + axis] = -fast
        rows[k, 3 + axis, 7 + 3 * k + axis] = fast
    return rows.reshape(6 * count, -1), values.ravel()
