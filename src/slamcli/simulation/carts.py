# SPDX-License-Identifier: MIT
"""Carts and boxes that come, stand or move, and go."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.people import BODY_RADIUS_M
from slamcli.simulation.site import Site
from slamcli.simulation.world import Cart

Array = NDArray[np.float64]

_SIZE_M = (0.8, 0.5)
_AWAY_M = 1e9
_APPEARS_FROM_M = 0.5
"""A cart waits until the robot is farther from where it comes; nothing falls onto robots or people."""
_STOPS_M = 0.5


class Carts:
    """Rounded boxes of `world.carts` and of `carts.count` others that choose their places themselves."""

    def __init__(
        self, site: Site, declared: tuple[Cart, ...], parameters: SimulationParameters, near: Array,
        seeds: list[np.random.Generator],
    ) -> None:  # fmt: skip
        """Seeds (one for each of `carts.count`) draw where and when others than the `declared` come."""
        self._declared, self._seeds, self._site, self._near = declared, seeds, site, near
        self._stay_s, self._away_s = parameters.carts_stay, parameters.carts_away
        count = len(declared) + len(seeds)
        self.boxes: Array = np.zeros((count, 9))
        self.boxes[:, 0], self.boxes[:, 2] = _AWAY_M, 1.0
        self.present: NDArray[np.bool_] = np.zeros(count, np.bool_)
        self._ways = [_way(cart) for cart in declared]
        self._passed = np.zeros(len(declared))
        self._changes = np.array([cart.appears_s for cart in declared] + [r.exponential(self._away_s) for r in seeds])

    def step(self, time_s: float, step_s: float, robot: Array, around_m: float, people: Array) -> None:
        """Move everything to `time_s` (seconds from the start) and set velocities for the next `step_s`.

        `robot` (3,) is its pose in the map and `around_m` the radius of its body; `people` (P, 2) are where they are.
        """
        for i in range(len(self._declared)):
            self._declared_step(i, time_s, step_s, robot, around_m, people)
        for i in range(len(self._declared), len(self.boxes)):
            if time_s >= self._changes[i]:
                self._other_change(i, time_s, robot, around_m, people)

    def _declared_step(
        self, i: int, time_s: float, step_s: float, robot: Array, around_m: float, people: Array
    ) -> None:
        cart = self._declared[i]
        if not self.present[i]:
            if cart.appears_s <= time_s < cart.leaves_s:
                self._appear(i, self._box(i), robot, around_m, people)
            return
        if time_s >= cart.leaves_s:
            self._leave(i)
        elif len(cart.points) > 1:
            self.boxes[i] = self._box(i)
            ahead = robot[:2] - self.boxes[i, :2]
            size = self.boxes[i, 4] + self.boxes[i, 6]
            near = math.hypot(*ahead) - around_m - size < _STOPS_M
            if near and float(ahead @ self.boxes[i, 2:4]) > 0.0:
                return
            self._passed[i] += cart.speed_m_s * step_s
            self.boxes[i, 7:9] = (self._box(i)[:2] - self.boxes[i, :2]) / step_s

    def _box(self, i: int) -> Array:
        """Return the box (9,) of a declared cart where it has got to, at rest."""
        cart, (points, lengths) = self._declared[i], self._ways[i]
        yaw = cart.yaw_rad
        place = points[0]
        if len(points) > 1:
            at = self._passed[i] % lengths[-1]
            leg = min(int(np.searchsorted(lengths, at, side="right")) - 1, len(points) - 2)
            way = points[leg + 1] - points[leg]
            place = points[leg] + way * (at - lengths[leg]) / max(lengths[leg + 1] - lengths[leg], 1e-9)
            yaw = math.atan2(way[1], way[0])
        half = (0.5 * cart.size_m[0], 0.5 * cart.size_m[1])
        return np.array([place[0], place[1], math.cos(yaw), math.sin(yaw), *half, cart.radius_m, 0.0, 0.0])

    def _other_change(self, i: int, time_s: float, robot: Array, around_m: float, people: Array) -> None:
        """Let cart i, which nobody declared, go, or come to a place drawn at random."""
        rng = self._seeds[i - len(self._declared)]
        if self.present[i]:
            self._leave(i)
            self._changes[i] = time_s + rng.exponential(self._away_s)
            return
        cells = self._site.destinations(self._near[:2]).cells
        row, column = cells[rng.integers(0, len(cells))]
        yaw = rng.uniform(-math.pi, math.pi)
        x0, y0, size = self._site.space.cells[2]
        x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
        half = np.array(_SIZE_M) / 2
        has_room = self._site.space.room(np.array([[x, y]]))[0] > math.hypot(*half)
        box = np.array([x, y, math.cos(yaw), math.sin(yaw), *half, 0.0, 0.0, 0.0])
        if has_room and self._appear(i, box, robot, around_m, people):
            self._changes[i] = time_s + rng.exponential(self._stay_s)

    def _appear(self, i: int, box: Array, robot: Array, around_m: float, people: Array) -> bool:
        reach = math.hypot(box[4], box[5]) + box[6]
        if math.hypot(box[0] - robot[0], box[1] - robot[1]) - around_m - reach < _APPEARS_FROM_M:
            return False
        if len(people) and np.hypot(*(people - box[:2]).T).min() < reach + BODY_RADIUS_M:
            return False
        self.boxes[i], self.present[i] = box, True
        return True

    def _leave(self, i: int) -> None:
        self.boxes[i] = 0.0
        self.boxes[i, 0], self.boxes[i, 2] = _AWAY_M, 1.0
        self.present[i] = False


def _way(cart: Cart) -> tuple[Array, Array]:
    """Return the points (N, 2) of a cart's way there and back, and the lengths (N,) passed at each."""
    points = cart.points
    if len(points) > 1:
        points = np.concatenate([points, points[-2::-1]])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return points, np.concatenate([[0.0], np.cumsum(steps)])
