# SPDX-License-Identifier: MIT
"""What a robot that drove itself did, as columns over time, and the figures that sum it up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that happened at one moment."""

    time_s: float
    kind: str
    """A state of move_base, ``recovery``, ``collision`` or ``goal``."""
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalStory:
    """What became of one goal."""

    name: str
    goal: tuple[float, float, float]
    """x, y (metres), yaw (radians; NaN: any) in map."""
    status: str
    """succeeded, aborted, timeout or unreachable."""
    message: str
    begin_s: float
    end_s: float
    length_m: float
    """Way that the robot truly drove."""
    optimum_m: float
    """Length of the shortest way for the inflated robot; NaN where it is not known."""
    clearance_m: float
    """Least distance of its body to anything; infinite if nothing was ever near."""
    collisions: int
    caused: int
    """Those in which the robot moved into what it hit."""
    recoveries: tuple[str, ...]
    plans: int
    """Number of global plans."""

    @property
    def succeeded(self) -> bool:
        """Whether the robot arrived."""
        return self.status == "succeeded"

    @property
    def ratio(self) -> float:
        """Way driven over the shortest; NaN where that is not known or nothing, and of a goal that was not reached."""
        return self.length_m / self.optimum_m if self.succeeded and self.optimum_m > 0.0 else math.nan

    def document(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return {
            "name": self.name,
            "goal": [_finite(v) for v in self.goal],
            "status": self.status,
            "message": self.message,
            "time_s": round(self.end_s - self.begin_s, 3),
            "begin_s": round(self.begin_s, 3),
            "end_s": round(self.end_s, 3),
            "length_m": self.length_m,
            "optimum_m": _finite(self.optimum_m),
            "ratio": _finite(self.ratio),
            "clearance_m": _finite(self.clearance_m),
            "collisions": self.collisions,
            "collisions_caused": self.caused,
            "recoveries": list(self.recoveries),
            "plans": self.plans,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveStory:
    """A whole run; all poses are in map, times are simulated seconds from its start, every N may be 0."""

    grid: OccupancyGrid | None
    """The newest map."""
    times_s: Array
    """float64 (N,), of the next three."""
    truth: Array
    """float64 (N, 3), where the robot truly was."""
    estimate: Array
    """float64 (N, 3), where its localiser thought it was; NaN before its first word."""
    twists: Array
    """float64 (N, 3), how it truly moved, in its own frame."""
    command_times_s: Array
    """float64 (M,)."""
    commands: Array
    """float64 (M, 3), what it was asked for."""
    plans: tuple[Array, ...]
    """Global plans, float64 (P, 3) each, in the order in which they were made."""
    people_times_s: Array
    """float64 (K,)."""
    people: tuple[Array, ...]
    """float64 (D, 5) at each of these times: x, y, radius, vx, vy."""
    events: tuple[Event, ...]
    goals: tuple[GoalStory, ...]

    @property
    def duration_s(self) -> float:
        """Time from the first to the last pose."""
        return float(self.times_s[-1] - self.times_s[0]) if len(self.times_s) else 0.0

    @property
    def length_m(self) -> float:
        """Way that the robot truly drove."""
        return float(np.hypot(*np.diff(self.truth[:, :2], axis=0).T).sum()) if len(self.truth) else 0.0

    def errors(self) -> tuple[Array, Array]:
        """Return how far the localiser was off, metres and radians, float64 (N,) each; NaN before its first word."""
        off = se2.between(self.truth, self.estimate)
        return np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])

    def place_at(self, time_s: float) -> Array:
        """Return where the robot was, float64 (2,); its first or last place outside of the run's time."""
        return np.array([np.interp(time_s, self.times_s, self.truth[:, i]) for i in (0, 1)])

    def people_ways(self, most_step_m: float = 0.6) -> list[Array]:
        """Return the ways of what else moved, float64 (M, 2) each.

        People have no names: the i-th of one moment is the i-th of the next, unless their number changed or it would
        have jumped.
        """
        ways: list[list[Array]] = []
        open_ways: list[list[Array]] = []
        for discs in self.people:
            if len(discs) != len(open_ways):
                open_ways = [[] for _ in discs]
                ways += open_ways
            for i, place in enumerate(discs[:, :2]):
                if open_ways[i] and float(np.hypot(*(place - open_ways[i][-1]))) > most_step_m:
                    open_ways[i] = []
                    ways.append(open_ways[i])
                open_ways[i].append(place)
        return [np.array(way) for way in ways if len(way) > 1]

    def figures(self) -> dict[str, Any]:
        """Return what sums the run up, for ``run.json``."""
        position, heading = self.errors() if len(self.truth) else (np.zeros(0), np.zeros(0))
        known = np.isfinite(position)
        optimum = sum(g.optimum_m for g in self.goals if g.succeeded and math.isfinite(g.ratio))
        driven = sum(g.length_m for g in self.goals if g.succeeded and math.isfinite(g.ratio))
        clearance = min((g.clearance_m for g in self.goals), default=math.inf)
        return {
            "goals": len(self.goals),
            "reached": sum(g.succeeded for g in self.goals),
            "duration_s": round(self.duration_s, 3),
            "path_length_m": self.length_m,
            "optimum_m": optimum if optimum > 0.0 else None,
            "ratio": driven / optimum if optimum > 0.0 else None,
            "clearance_m": _finite(clearance),
            "collisions": sum(g.collisions for g in self.goals),
            "collisions_caused": sum(g.caused for g in self.goals),
            "recoveries": sum(len(g.recoveries) for g in self.goals),
            "plans": len(self.plans),
            "localisation_rmse_m": _rms(position[known]),
            "localisation_max_m": float(position[known].max()) if known.any() else None,
            "localisation_rmse_rad": _rms(heading[known]),
            "top_speed_m_s": float(np.hypot(self.twists[:, 0], self.twists[:, 1]).max()) if len(self.twists) else None,
            "by_goal": [goal.document() for goal in self.goals],
        }


def _rms(values: Sequence[float] | Array) -> float | None:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
