# SPDX-License-Identifier: MIT
"""The descent behind inertial alignment: normal equations of a chain of states and nine numbers that all of them share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuNoise
from slamcli.posegraph.alignment_records import AlignmentSettings, VisualPoses
from slamcli.posegraph.imu_preintegration import preintegrate
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.posegraph.inertial_links import (
    InertialLinks,
    InertialStates,
    gravity_turns,
    link_residuals,
    link_states,
    moved_states,
)

Floats = NDArray[np.float64]

GLOBALS = 9
"""Log scale, two of gravity's direction, six biases; then nine of every state: rotation, position, velocity."""


class AlignmentDescent:
    """The estimate as it descends by Levenberg and Marquardt."""

    def __init__(
        self, poses: VisualPoses, links: InertialLinks, settings: AlignmentSettings,
        scale: float, gravity: Floats, velocities: Floats, biases: Floats,
    ) -> None:  # fmt: skip
        self.poses, self.links, self.settings = poses, links, settings
        self.turns, self.lever = poses.lever()
        self.around = poses.positions - poses.positions.mean(axis=0)
        self.log_scale, self.gravity = float(np.log(scale)), gravity
        self.states = InertialStates(
            rotations=self.turns.copy(), positions=scale * self.around + self.turns @ self.lever,
            velocities=velocities.copy(), biases=np.tile(biases, (len(self.around), 1)),
        )  # fmt: skip

    @property
    def biases(self) -> Floats:
        """float64 (6,), the same in all states."""
        return np.asarray(self.states.biases[0])

    def _sigmas(self) -> Floats:
        s = self.settings
        return np.repeat([s.gyroscope_bias_sigma, s.accelerometer_bias_sigma], 3)

    def pose_residuals(self, states: InertialStates, log_scale: float) -> Floats:
        """Return (N, 6): how far rotations and positions are from the camera's, over their deviations."""
        s, scale = self.settings, float(np.exp(log_scale))
        turned = self.turns.transpose(0, 2, 1) @ states.rotations
        angles = 0.5 * np.stack(
            [turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]],
            axis=1,
        )
        off = states.positions - scale * self.around - states.rotations @ self.lever
        return np.concatenate([angles / s.rotation_sigma_rad, off / (scale * s.position_sigma)], axis=1)

    def cost(self, states: InertialStates, gravity: Floats, log_scale: float) -> float:
        """Return the sum of squares at a state."""
        out = link_residuals(self.links, states, gravity, derivatives=False)[0][:, :9]
        prior = states.biases[0] / self._sigmas()
        return float((out**2).sum() + (self.pose_residuals(states, log_scale) ** 2).sum() + (prior**2).sum())

    def normal_equations(self) -> tuple[Floats, Floats]:
        """Return the matrix (9 + 9 N, 9 + 9 N) and the gradient where the estimate is."""
        s, count = self.settings, len(self.states)
        out, one, two, down = link_residuals(self.links, self.states, self.gravity)
        size = GLOBALS + 9 * count
        normal, slope = np.zeros((size, size)), np.zeros(size)
        shared = np.zeros((len(self.links), 9, GLOBALS))
        shared[:, :, 1:3] = down[:, :9] @ gravity_turns(self.gravity)
        shared[:, :, 3:] = one[:, :9, 9:]
        rows = np.concatenate([shared, one[:, :9, :9], two[:, :9, :9]], axis=2)
        products, slopes = rows.transpose(0, 2, 1) @ rows, np.einsum("krc,kr->kc", rows, out[:, :9])
        g = slice(0, GLOBALS)
        for i, j, product, part in zip(self.links.first, self.links.second, products, slopes, strict=True):
            _add(normal, slope, product, part, (g, _own(i), _own(j)))

        weight = 1 / (float(np.exp(self.log_scale)) * s.position_sigma)
        rows = np.zeros((count, 6, GLOBALS + 9))
        rows[:, :3, GLOBALS : GLOBALS + 3] = np.eye(3) / s.rotation_sigma_rad
        rows[:, 3:, GLOBALS : GLOBALS + 3] = self.states.rotations @ _cross(self.lever) * weight
        rows[:, 3:, GLOBALS + 3 : GLOBALS + 6] = np.eye(3) * weight
        if not s.fixed_scale:
            rows[:, 3:, 0] = -self.around / s.position_sigma
        products = rows.transpose(0, 2, 1) @ rows
        slopes = np.einsum("krc,kr->kc", rows, self.pose_residuals(self.states, self.log_scale))
        for i, (product, part) in enumerate(zip(products, slopes, strict=True)):
            _add(normal, slope, product, part, (g, _own(i)))

        normal[3:9, 3:9] += np.diag(1 / self._sigmas() ** 2)
        slope[3:9] += self.biases / self._sigmas() ** 2
        if s.fixed_scale:
            normal[0, 0] = 1.0
        return normal, slope

    def moved(self, step: Floats) -> tuple[InertialStates, Floats, float]:
        """Return states, gravity and log scale after a step (9 + 9 N,)."""
        steps = np.concatenate([step[GLOBALS:].reshape(-1, 9), np.tile(step[3:9], (len(self.states), 1))], axis=1)
        gravity = self.gravity + gravity_turns(self.gravity) @ step[1:3]
        gravity *= self.settings.gravity_m_s2 / np.linalg.norm(gravity)
        return moved_states(self.states, steps), gravity, self.log_scale + float(step[0])

    def descend(self, samples: ImuSamples, noise: ImuNoise) -> bool:
        """Go down to the minimum; return whether it was reached."""
        damping = 1e-4
        for _ in range(self.settings.iterations):
            normal, slope = self.normal_equations()
            cost = self.cost(self.states, self.gravity, self.log_scale)
            while damping < 1e10:
                step = -np.asarray(
                    np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-9), slope), np.float64
                )
                step[0] = np.clip(step[0], -1.0, 1.0)
                moved = self.moved(step)
                better = cost - self.cost(*moved)
                if better > 0:
                    break
                damping *= 10
            else:
                return True  # no step is downhill: this is the minimum, to what numbers can tell
            self.states, self.gravity, self.log_scale = moved
            damping = max(damping / 10, 1e-9)
            if not self._integrate_anew(samples, noise) and better < 1e-5 * cost:
                return True
        return False

    def _integrate_anew(self, samples: ImuSamples, noise: ImuNoise) -> bool:
        """Integrate again if the biases moved beyond what first order is good for; return whether it was done."""
        away = np.abs(self.biases - self.links.motions.biases[0])
        if away[:3].max() < 2e-3 and away[3:].max() < 2e-2:
            return False
        stamps = self.poses.stamps_ns
        motions = preintegrate(samples, stamps[:-1], stamps[1:], self.biases, noise)
        self.links = link_states(self.links.first, self.links.second, motions)
        return True

    def deviations(self) -> tuple[Floats, float]:
        """Return deviations (9,) of what all states share, and the mean square of residuals that they grow with."""
        normal, _ = self.normal_equations()
        freedoms = 9 * int(self.links.usable.sum()) - 3 * len(self.states)
        mean_square = self.cost(self.states, self.gravity, self.log_scale) / max(freedoms, 1)
        normal += np.diag(1e-12 * np.diag(normal) + 1e-12)
        covariance = np.linalg.solve(normal, np.eye(len(normal), GLOBALS))[:GLOBALS] * max(mean_square, 1.0)
        return np.sqrt(np.maximum(np.diag(covariance), 0.0)), mean_square

    def excitation(self) -> float:
        """Return the root mean square of the accelerations around their mean, m/s^2."""
        m = self.links.motions
        pull = np.einsum("kij,kj->ki", self.turns[:-1], m.velocities) / m.seconds[:, None] + self.gravity
        pull = pull[self.links.usable]
        return float(np.sqrt(((pull - pull.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _own(state: int) -> slice:
    begin = GLOBALS + 9 * int(state)
    return slice(begin, begin + 9)


def _add(normal: Floats, slope: Floats, product: Floats, part: Floats, places: tuple[slice, ...]) -> None:
    """Add a product of rows whose columns are nine for each of the places."""
    for a, rows in enumerate(places):
        slope[rows] += part[9 * a : 9 * a + 9]
        for b, columns in enumerate(places):
            normal[rows, columns] += product[9 * a : 9 * a + 9, 9 * b : 9 * b + 9]


def _cross(v: Floats) -> Floats:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
