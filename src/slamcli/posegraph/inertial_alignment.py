# SPDX-License-Identifier: MIT
"""Gravity, scale, biases and velocities from poses that cameras found and what an IMU says between them.

The inertial-only maximum-a-posteriori estimate of Campos, Montiel and Tardós, "Inertial-only optimization for
visual-inertial initialization", ICRA 2020, doi:10.1109/ICRA40945.2020.9197334, started from the linear solution that Qin,
Li and Shen (T-RO 2018, doi:10.1109/TRO.2018.2853729, section V) give. Other than there, poses are no truth: each has a
prior of its own, so that noise of the cameras does not end in the biases.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_preintegration import Preintegration, preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_links import (
    InertialLinks,
    InertialStates,
    link_residuals,
    link_states,
    moved_states,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

GLOBALS = 9
"""Log scale, two of gravity's direction, six biases; then nine of every state."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualPoses:
    """N poses of a camera that carries an IMU, in a map whose metre may be of any length."""

    stamps_ns: Integers
    """int64 (N,), increasing."""
    rotations: Floats
    """float64 (N, 3, 3), from the camera's frame to the map."""
    positions: Floats
    """float64 (N, 3), of the camera, in units of the map."""
    T_camera_imu: Floats
    """float64 (4, 4), metres."""

    def lever(self) -> tuple[Floats, Floats]:
        """Return rotations (N, 3, 3) of the IMU and the vector (3,) from camera to IMU in the IMU's frame."""
        turn = self.T_camera_imu[:3, :3]
        return self.rotations @ turn, turn.T @ self.T_camera_imu[:3, 3]


@dataclass(frozen=True, slots=True, kw_only=True)
class AlignmentSettings:
    """What is known beforehand."""

    fixed_scale: bool = False
    """Whether units of the map are metres (stereo, RGB-D)."""
    gravity_m_s2: float = 9.81
    gyroscope_bias_sigma: float = 0.1
    """rad/s, of the prior around zero; the paper's information of 1e2."""
    accelerometer_bias_sigma: float = 0.2
    """m/s^2; the paper holds it at zero at first, which costs 5 % of scale where the bias is 0.1 m/s^2."""
    rotation_sigma_rad: float = 1e-3
    """Of the cameras' poses."""
    position_sigma: float = 5e-3
    """Of the cameras' poses, in units of the map."""
    iterations: int = 25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InertialAlignment:
    """What makes poses of a camera fit an IMU."""

    scale: float
    """Metres per unit of the map."""
    gravity_map: Floats
    """float64 (3,), m/s^2, pointing down."""
    biases: Floats
    """float64 (6,), gyroscope and accelerometer."""
    velocities: Floats
    """float64 (N, 3), m/s in the map's axes, of the IMU."""
    log_scale_sigma: float
    """Standard deviation of the scale's logarithm (its relative error); 0 where it was known."""
    gravity_sigma_rad: float
    biases_sigma: Floats
    """float64 (6,)."""
    excitation_m_s2: float
    """Root mean square of the accelerations around their mean."""
    mean_square: float
    """Mean square of whitened residuals: 1 where noise is as assumed; the deviations above grow with it beyond 1."""
    converged: bool


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
    problem = _Problem(poses, links, settings, scale, gravity, velocities, biases)
    converged = problem.descend(samples, noise)
    return problem.result(converged)


def objection(alignment: InertialAlignment, *, log_scale_sigma: float = 0.02, gravity_sigma_rad: float = 0.02) -> str:
    """Return why an alignment is not to be trusted, or "" if it is."""
    if not alignment.converged:
        return "the estimate did not settle"
    if alignment.excitation_m_s2 < 0.02:
        return f"not enough motion: accelerations differ by {alignment.excitation_m_s2:.3f} m/s^2 only"
    if alignment.log_scale_sigma > log_scale_sigma:
        return f"not enough motion: the scale is known to {100 * alignment.log_scale_sigma:.1f} % only"
    if alignment.gravity_sigma_rad > gravity_sigma_rad:
        return f"not enough motion: gravity is known to {np.degrees(alignment.gravity_sigma_rad):.1f} degrees only"
    if alignment.mean_square > 100:
        return f"poses and IMU contradict each other: residuals are {alignment.mean_square**0.5:.0f} times what is expected"
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
        found: Floats = np.asarray(np.linalg.lstsq(rows, values, rcond=1e-12)[0], np.float64)
        # A scale that is negative or vanishes is none: the descent has to find it from 1.
        scale = 1.0 if settings.fixed_scale or not found[0] > 1e-6 else float(found[0])
    gravity: Floats = found[1:4] * settings.gravity_m_s2 / max(float(np.linalg.norm(found[1:4])), 1e-9)
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


class _Problem:
    """The estimate as it descends: Levenberg-Marquardt on dense normal equations."""

    def __init__(
        self, poses: VisualPoses, links: InertialLinks, settings: AlignmentSettings,
        scale: float, gravity: Floats, velocities: Floats, biases: Floats,
    ) -> None:  # fmt: skip
        self.poses, self.links, self.settings = poses, links, settings
        self.turns, self.lever = poses.lever()
        self.centre = poses.positions.mean(axis=0)
        self.around = poses.positions - self.centre
        self.log_scale, self.gravity, self.biases = float(np.log(scale)), gravity, biases
        positions = scale * self.around + self.turns @ self.lever
        every = np.tile(biases, (len(positions), 1))
        self.states = InertialStates(
            rotations=self.turns.copy(), positions=positions, velocities=velocities.copy(), biases=every
        )

    def residuals(
        self, states: InertialStates, gravity: Floats, log_scale: float, *, derivatives: bool
    ) -> tuple[Floats, Floats]:
        """Return whitened residuals (R,) and, where wanted, their derivatives (R, 9 + 9 N)."""
        s, count, n_links = self.settings, len(states), len(self.links)
        out, one, two, down = link_residuals(self.links, states, gravity, derivatives=derivatives)
        turned = self.turns.transpose(0, 2, 1) @ states.rotations
        angles = 0.5 * np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0],
                                 turned[:, 1, 0] - turned[:, 0, 1]], axis=1)  # fmt: skip
        scale = float(np.exp(log_scale))
        weight = 1 / (scale * s.position_sigma)
        off = states.positions - scale * self.around - states.rotations @ self.lever
        sigmas = np.repeat([s.gyroscope_bias_sigma, s.accelerometer_bias_sigma], 3)
        parts = [
            out[:, :9].ravel(),
            (angles / s.rotation_sigma_rad).ravel(),
            (off * weight).ravel(),
            states.biases[0] / sigmas,
        ]
        values = np.concatenate(parts)
        if not derivatives:
            return values, np.empty((0, 0))
        rows = np.zeros((len(values), GLOBALS + 9 * count))
        for k in range(n_links):
            link = slice(9 * k, 9 * k + 9)
            i, j = GLOBALS + 9 * int(self.links.first[k]), GLOBALS + 9 * int(self.links.second[k])
            rows[link, i : i + 9] = one[k, :9, :9]
            rows[link, j : j + 9] = two[k, :9, :9]
            rows[link, 3:9] = one[k, :9, 9:]
            rows[link, 1:3] = down[k, :9] @ self.downward(gravity)
        begin = 9 * n_links
        for k in range(count):
            i, at, also = GLOBALS + 9 * k, begin + 3 * k, begin + 3 * count + 3 * k
            rows[at : at + 3, i : i + 3] = np.eye(3) / s.rotation_sigma_rad
            rows[also : also + 3, i : i + 3] = states.rotations[k] @ _cross(self.lever) * weight
            rows[also : also + 3, i + 3 : i + 6] = np.eye(3) * weight
            if not s.fixed_scale:
                rows[also : also + 3, 0] = -scale * self.around[k] * weight
        rows[-6:, 3:9] = np.diag(1 / sigmas)
        return values, rows

    @staticmethod
    def downward(gravity: Floats) -> Floats:
        """Return how gravity changes (3, 2) when it is turned about two axes perpendicular to it."""
        axis = np.eye(3)[int(np.argmin(np.abs(gravity)))]
        first = np.cross(gravity, axis)
        first /= np.linalg.norm(first)
        second = np.cross(gravity, first) / np.linalg.norm(gravity)
        return np.stack([np.cross(first, gravity), np.cross(second, gravity)], axis=1)

    def moved(self, step: Floats) -> tuple[InertialStates, Floats, float]:
        """Return states, gravity and log scale after a step."""
        steps = np.concatenate([step[GLOBALS:].reshape(-1, 9), np.tile(step[3:9], (len(self.states), 1))], axis=1)
        gravity = self.gravity + self.downward(self.gravity) @ step[1:3]
        gravity *= self.settings.gravity_m_s2 / np.linalg.norm(gravity)
        return moved_states(self.states, steps), gravity, self.log_scale + float(step[0])

    def descend(self, samples: ImuSamples, noise: ImuNoise) -> bool:
        """Go down to the minimum; return whether it was reached."""
        damping = 1e-4
        for _ in range(self.settings.iterations):
            values, rows = self.residuals(self.states, self.gravity, self.log_scale, derivatives=True)
            normal, slope, cost = rows.T @ rows, rows.T @ values, float(values @ values)
            if self.settings.fixed_scale:
                normal[0, 0] = 1.0
            while damping < 1e10:
                step: Floats = -np.asarray(np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), slope))
                step[0] = np.clip(step[0], -1.0, 1.0)
                moved = self.moved(step)
                better = cost - float((self.residuals(*moved, derivatives=False)[0] ** 2).sum())
                if better > 0:
                    break
                damping *= 10
            else:
                return True  # no step is downhill: this is the minimum, to what numbers can tell
            self.states, self.gravity, self.log_scale = moved
            self.biases = self.states.biases[0]
            damping = max(damping / 10, 1e-9)
            if self._integrate_anew(samples, noise):
                continue
            if better < 1e-6 * cost:
                return True
        return False

    def _integrate_anew(self, samples: ImuSamples, noise: ImuNoise) -> bool:
        """Integrate again if the biases moved beyond what first order is good for; return whether it was done."""
        away = np.abs(self.biases - self.links.motions.biases[0])
        if away[:3].max() < 2e-3 and away[3:].max() < 2e-2:
            return False
        motions = _integrated(self.poses, samples, self.biases, noise)
        self.links = link_states(self.links.first, self.links.second, motions)
        return True

    def result(self, converged: bool) -> InertialAlignment:
        """Return the estimate with its deviations."""
        values, rows = self.residuals(self.states, self.gravity, self.log_scale, derivatives=True)
        normal = rows.T @ rows
        if self.settings.fixed_scale:
            normal[0, 0] = 1.0
        freedoms = max(len(values) - rows.shape[1], 1)
        mean_square = float(values @ values) / freedoms
        covariance = np.linalg.pinv(normal)[:GLOBALS, :GLOBALS] * max(mean_square, 1.0)
        sigmas = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        m = self.links.motions
        pull = np.einsum("kij,kj->ki", self.turns[:-1], m.velocities) / m.seconds[:, None] + self.gravity
        pull = pull[self.links.usable]
        return InertialAlignment(
            scale=float(np.exp(self.log_scale)), gravity_map=self.gravity, biases=self.biases,
            velocities=self.states.velocities, log_scale_sigma=0.0 if self.settings.fixed_scale else float(sigmas[0]),
            gravity_sigma_rad=float(sigmas[1:3].max()), biases_sigma=sigmas[3:],
            excitation_m_s2=float(np.sqrt(((pull - pull.mean(axis=0)) ** 2).sum(axis=1).mean())),
            mean_square=mean_square, converged=converged,
        )  # fmt: skip


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
