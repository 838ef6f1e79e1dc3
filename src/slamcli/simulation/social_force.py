# SPDX-License-Identifier: MIT
"""People who walk beside a robot: they give way to it, to each other and to walls, and some of them never arrive.

The forces are those of Moussaid, Helbing, Garnier, Johansson, Combe and Theraulaz, Experimental study of the behavioural
mechanisms underlying self-organization in human crowds, Proc. R. Soc. B 276, 2009, with its measured parameters; the idea
is Helbing and Molnar, Social force model for pedestrian dynamics, Phys. Rev. E 51, 1995. Ways round walls are theirs who
follow the cost to a place downhill as far as they see. Nobody reacts harder than 6 m/s^2 or sees farther than 4 m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import PlanningError
from slamcli.simulation import _crowd_kernels
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.people import BODY_RADIUS_M, LEG_RADIUS_M, LEGS_APART_M, STRIDE_M
from slamcli.simulation.site import Destinations, Site
from slamcli.simulation.world import Walker

Array = NDArray[np.float64]

STEP_S = 0.05
_ROBOT_KEEPS_M = 1.2
"""Nobody starts nearer to the robot."""
_SPEED_SPREAD = 0.15
_ON_WAY = -2


class Pedestrians:
    """Everybody who walks, in arrays; `walk` moves them all by one step of 50 ms."""

    def __init__(
        self, site: Site, walkers: tuple[Walker, ...], parameters: SimulationParameters, robot: Array,
        seeds: list[np.random.Generator],
    ) -> None:  # fmt: skip
        """Place `walkers` on their ways and `people.count` others anywhere, none of them on the robot at `robot` (3,).

        Raises
        ------
        PlanningError
            If nobody can walk in the world, or a walker cannot get from one of its points to the next.
        """
        self._site, self._seeds = site, seeds
        self._social = parameters.people_model == "social_force"
        self._legs = parameters.people_shape == "legs"
        count = len(seeds)
        self._people = np.zeros((count, 16))
        self._targets = np.full((count, 2), -1, np.int64)
        self._way_ends = np.zeros((count, 2), np.int64)
        self._goals: Destinations = site.destinations(robot[:2])
        grid = site.space.grid
        self._frame = np.array([*grid.origin[:2], grid.resolution_m, self._goals.cell_m])
        self._ways = self._place_walkers(walkers)
        self._place_others(len(walkers), parameters, robot)
        self.bodies: Array = np.zeros((count, 9))
        self.seen: Array = np.zeros((2 * count if self._legs else count, 9))
        self._show()

    def walk(self, robot: Array, outline: Array, margin_m: float, carts: Array) -> None:
        """Let everybody walk for 50 ms.

        Parameters
        ----------
        robot
            float64 (6,), its pose and velocity in the map.
        outline, margin_m
            Its body: float64 (N, 2) in base_link, and the radius around it.
        carts
            float64 (C, 9), rounded boxes and their velocities.
        """
        asking = _crowd_kernels.walk(
            STEP_S, self._people, self._targets, self._goals.fields, self._frame, self._site.room, self._ways,
            self._way_ends, self._social, robot, outline, margin_m, carts, BODY_RADIUS_M,
        )  # fmt: skip
        if asking:
            for i in np.flatnonzero(self._targets[:, 0] == -1).tolist():
                self._choose(i)
        self._show()

    def now(self) -> Array:
        """Return where everybody has got to, float64 (P, 2), metres, map frame."""
        return self._people[:, :2]

    def _show(self) -> None:
        _crowd_kernels.see(
            self._people,
            STEP_S,
            BODY_RADIUS_M,
            self._legs,
            LEG_RADIUS_M,
            LEGS_APART_M,
            STRIDE_M,
            self.bodies,
            self.seen,
        )

    def _choose(self, i: int) -> None:
        """Give person i another place to walk to."""
        rng, goals = self._seeds[i], self._goals
        place = int(rng.integers(0, len(goals.points)))
        goals.prepare(place)
        self._targets[i, 0] = place
        self._people[i, 8:10] = goals.points[place]
        self._people[i, 10] = rng.uniform(0.4, 1.2)
        self._people[i, 11:16] = 0.0, np.inf, *self._people[i, :2], 0.0

    def _place_walkers(self, walkers: tuple[Walker, ...]) -> Array:
        """Return the points (N, 2) of all their ways; nobody walks through a wall between them."""
        points = [np.zeros((0, 2))]
        for i, walker in enumerate(walkers):
            way = _to_and_fro(walker, self._site)
            begin = sum(len(p) for p in points)
            self._way_ends[i] = begin, begin + len(way)
            self._targets[i] = _ON_WAY, begin + 1
            self._set_out(i, way[0], walker.speed_m_s)
            points.append(way)
        return np.concatenate(points)

    def _place_others(self, first: int, parameters: SimulationParameters, robot: Array) -> None:
        x0, y0, size = self._site.space.cells[2]
        centres = np.array([x0, y0]) + (self._goals.cells[:, ::-1] + 0.5) * size
        away = np.hypot(centres[:, 0] - robot[0], centres[:, 1] - robot[1]) > _ROBOT_KEEPS_M
        if not away.any() and first < len(self._seeds):
            raise PlanningError(
                f"world {self._site.world.name}: no room for people: nowhere is {_ROBOT_KEEPS_M} m from the robot"
            )
        centres = centres[away]
        for i in range(first, len(self._seeds)):
            rng = self._seeds[i]
            speed = parameters.people_speed * float(np.clip(1.0 + _SPEED_SPREAD * rng.standard_normal(), 0.6, 1.4))
            drawn = centres[rng.integers(0, len(centres), 16)]
            others = self._people[:i, :2]
            gaps = np.min(np.hypot(*(drawn[:, None] - others).T), axis=0) if i else np.full(len(drawn), np.inf)
            apart = np.flatnonzero(gaps > 2.5 * BODY_RADIUS_M)
            self._set_out(i, drawn[apart[0] if len(apart) else int(np.argmax(gaps))], speed)
            self._choose(i)

    def _set_out(self, i: int, point: Array, speed: float) -> None:
        me = self._people[i]
        me[:2], me[4], me[6] = point, speed, 1.0
        me[5] = self._seeds[i].uniform(0.0, 2 * STRIDE_M)


def _to_and_fro(walker: Walker, site: Site) -> Array:
    """Return one closed way through the walker's points and back."""
    points = np.concatenate([walker.points, walker.points[-2:0:-1]])
    way = [points[0]]
    for point in [*points[1:], points[0]]:
        is_clear = site.space.is_clear(way[-1], point, BODY_RADIUS_M + 0.05)
        way.extend([point] if is_clear else site.space.way(way[-1], point)[1:])
    return np.array(way[:-1])


def warm() -> None:
    """Compile the kernels of this module."""
    people, targets = np.zeros((2, 16)), np.full((2, 2), -2, np.int64)
    targets[0, 0] = 0
    room, frame, ends = np.ones((2, 2), np.float32), np.array([0.0, 0.0, 0.1, 0.2]), np.array([[0, 1], [0, 1]])
    _crowd_kernels.walk(
        STEP_S, people, targets, np.zeros((1, 1, 1), np.int32), frame, room, np.zeros((1, 2)), ends, True, np.ones(6),
        np.zeros((1, 2)), 0.2, np.zeros((0, 9)), BODY_RADIUS_M,
    )  # fmt: skip
    _crowd_kernels.see(
        people, STEP_S, BODY_RADIUS_M, True, LEG_RADIUS_M, LEGS_APART_M, STRIDE_M, np.zeros((2, 9)), np.zeros((4, 9))
    )
