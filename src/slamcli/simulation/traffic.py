# SPDX-License-Identifier: MIT
"""Everything that moves beside a robot, as what it can run into and as what its scanner sees."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from slamcli.simulation.body import Body
from slamcli.simulation.carts import Carts
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.site import site_of
from slamcli.simulation.social_force import STEP_S, Pedestrians
from slamcli.simulation.world import World

Array = NDArray[np.float64]


class Traffic:
    """People and carts; bodies are rounded boxes (M, 9): x, y, cos, sin, half length, half width, radius, vx, vy."""

    def __init__(
        self, world: World, parameters: SimulationParameters, robot: Array, body: Body,
        stream: Callable[[str], np.random.Generator],
    ) -> None:  # fmt: skip
        """Place everybody around the robot at `robot` (3,).

        Raises
        ------
        PlanningError
            If there is no room for people, or no way between the points of a walker.
        """
        site = site_of(world)
        count = len(world.walkers) + parameters.people_count
        self._body = body
        self._people: Pedestrians | None = None
        if count:
            seeds = [stream(f"person {i}") for i in range(count)]
            self._people = Pedestrians(site, world.walkers, parameters, robot, seeds)
        seeds = [stream(f"cart {i}") for i in range(parameters.carts_count)]
        self._carts = Carts(site, world.carts, parameters, robot, seeds)
        self.num_people = count
        self._join()

    @property
    def is_empty(self) -> bool:
        """Whether nothing ever moves."""
        return self._people is None and not len(self._carts.boxes)

    @property
    def present(self) -> NDArray[np.bool_]:
        """Bool (M,), which bodies are there: people always are, carts come and go."""
        return np.concatenate([np.ones(self.num_people, np.bool_), self._carts.present])

    def step(self, time_s: float, robot: Array) -> None:
        """Let people and carts decide how they move for the next 50 ms, from `time_s`; `robot` (6,) is pose and velocity."""
        people = np.zeros((0, 2)) if self._people is None else self._people.now()
        self._carts.step(time_s, STEP_S, robot[:3], self._body.around_m, people)
        if self._people is not None:
            self._people.walk(robot, self._body.outline, self._body.radius_m, self._carts.boxes)
        self._join()

    def _join(self) -> None:
        carts = self._carts.boxes
        if self._people is None:
            self.bodies, self.seen = carts.copy(), carts.copy()
        else:
            self.bodies = np.concatenate([self._people.bodies, carts])
            self.seen = np.concatenate([self._people.seen, carts])
