# SPDX-License-Identifier: MIT
"""The bands that are kept from cycle to cycle, and the choice among them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.teb.band import Band, band_along, warm_start
from slamcli.navigation.teb.homotopy import Classes, Mark
from slamcli.navigation.teb.obstacle_field import ObstacleField
from slamcli.navigation.teb.optimise import BandOptimiser, Costs
from slamcli.navigation.teb.parameters import TebParameters

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative:
    """A band and what is known of it."""

    band: Band
    mark: Mark
    along_plan: bool
    """Whether it is of the global plan's class."""
    chosen: bool = False
    """Whether it was the last choice."""
    costs: Costs | None = None


class Alternatives:
    """Several bands to the same goal, of different classes, optimised from cycle to cycle.

    Parameters
    ----------
    seed
        For the random points from which classes are found, and for dropping.

    References
    ----------
    Roesmann, Hoffmann, Bertram: Integrated online trajectory planning and optimization in distinctive topologies, Robotics
    and Autonomous Systems 88, 2017, algorithms 1 and 2.
    """

    def __init__(self, parameters: TebParameters, *, seed: int = 0) -> None:
        self._parameters = parameters
        self._rng = np.random.default_rng(seed)
        self._kept: list[Alternative] = []
        self._switched_s = -np.inf

    @property
    def kept(self) -> tuple[Alternative, ...]:
        """The bands of the last cycle, the best first."""
        return tuple(self._kept)

    def clear(self) -> None:
        """Forget all bands."""
        self._kept = []

    def drop_first(self, count: int) -> None:
        """Forget the best bands, which cannot be driven; the next one is the choice."""
        if count:
            self._kept = [replace(kept, chosen=k == 0) for k, kept in enumerate(self._kept[count:])]

    def plan(self, path: Array, optimiser: BandOptimiser, obstacles: ObstacleField, time_s: float) -> tuple[Band, ...]:
        """Return optimised bands along the local plan `path`, float64 (N, 3), N >= 2, from its first to its last pose.

        The chosen one comes first, the others follow by their cost.
        """
        rules = self._parameters.homotopy
        self._follow(path[0], path[-1])
        classes = Classes(self._parameters, obstacles, path[0], path[-1])
        plan_mark = classes.mark(path)
        self._renew(classes, plan_mark, obstacles)
        if rules.enable_homotopy_class_planning:
            if not obstacles.is_blocked(path) and not any(kept.along_plan for kept in self._kept):
                self._add(path, path, plan_mark, along_plan=True)
            known = [kept.mark for kept in self._kept]
            if len(known) < rules.max_number_classes:
                for way in classes.explore(known, rules.max_number_classes - len(known), self._rng):
                    mark = classes.mark(way)
                    self._add(way, path, mark, along_plan=classes.are_same(mark, plan_mark))
        if not self._kept:
            self._add(path, path, plan_mark, along_plan=True)
        self._kept = [self._optimised(alternative, optimiser) for alternative in self._kept]
        self._choose(time_s)
        return tuple(alternative.band for alternative in self._kept)

    def _follow(self, start: Array, goal: Array) -> None:
        """Move the ends of all bands to where robot and goal are now; begin anew if the goal has jumped."""
        rules = self._parameters.trajectory
        if self._kept:
            end = self._kept[0].band.poses[-1]
            far = np.hypot(*(goal[:2] - end[:2])) >= rules.force_reinit_new_goal_dist
            if far or abs(se2.wrap_angle(goal[2] - end[2])) >= rules.force_reinit_new_goal_angular:
                self._kept = []
        self._kept = [replace(kept, band=warm_start(kept.band, start, goal, rules.min_samples)) for kept in self._kept]

    def _renew(self, classes: Classes, plan_mark: Mark, obstacles: ObstacleField) -> None:
        """Keep one band of each class that does not lead through obstacles; drop others by chance if asked to."""
        rules = self._parameters.homotopy
        if not rules.enable_homotopy_class_planning:
            self._kept = self._kept[:1]
            return
        renewed: list[Alternative] = []
        for kept in self._kept:
            if not kept.chosen and rules.selection_dropping_probability > self._rng.random():
                continue
            mark = classes.mark(kept.band.poses, kept.band.times)
            known = any(classes.are_same(mark, other.mark) for other in renewed)
            if mark.is_valid and not known and not obstacles.is_blocked(kept.band.poses):
                renewed.append(replace(kept, mark=mark, along_plan=classes.are_same(mark, plan_mark)))
        self._kept = renewed

    def _add(self, way: Array, path: Array, mark: Mark, *, along_plan: bool) -> None:
        band = band_along(way, path[0], path[-1], self._parameters)
        self._kept.append(Alternative(band=band, mark=mark, along_plan=along_plan))

    def _optimised(self, alternative: Alternative, optimiser: BandOptimiser) -> Alternative:
        drawn = self._parameters.homotopy.viapoints_all_candidates or alternative.along_plan
        band, costs = optimiser.optimise(alternative.band, with_via_points=drawn)
        return replace(alternative, band=band, costs=costs)

    def _choose(self, time_s: float) -> None:
        """Put the best band first, after dropping detours."""
        rules = self._parameters.homotopy
        self._kept.sort(key=self._cost)
        last = next((k for k, kept in enumerate(self._kept) if kept.chosen), None)
        if last and time_s - self._switched_s < rules.switching_blocking_period:
            self._kept.insert(0, self._kept.pop(last))
        elif last != 0:
            self._switched_s = time_s
        best = self._kept[0]
        rest = [kept for kept in self._kept[1:] if not rules.delete_detours_backwards or self._is_near(kept, best)]
        self._kept = [replace(kept, chosen=kept is best) for kept in [best, *rest]]

    def _cost(self, alternative: Alternative) -> float:
        """Return what an alternative costs in the choice."""
        rules, costs = self._parameters.homotopy, alternative.costs
        if costs is None or not np.isfinite(costs.other + costs.obstacles + costs.time):
            return float("inf")
        total = alternative.band.duration_s if rules.selection_alternative_time_cost else costs.time
        total += costs.other + rules.selection_obst_cost_scale * costs.obstacles
        total += rules.selection_viapoint_cost_scale * costs.via_points
        if alternative.chosen:
            total *= rules.selection_cost_hysteresis
        return total * rules.selection_prefer_initial_plan if alternative.along_plan else total

    def _is_near(self, alternative: Alternative, best: Alternative) -> bool:
        """Whether an alternative is no detour: begins in about the same direction as the best one, and lasts no ages."""
        rules = self._parameters.homotopy
        bearings = [_bearing(kept.band, rules.length_start_orientation_vector) for kept in (alternative, best)]
        if bearings[0] is None or bearings[1] is None:
            return bearings[1] is None
        turn = abs(float(se2.wrap_angle(bearings[0] - bearings[1])))
        ratio = alternative.band.duration_s / best.band.duration_s
        return turn <= rules.detours_orientation_tolerance and ratio <= rules.max_ratio_detours_duration_best_duration


def _bearing(band: Band, length_m: float) -> float | None:
    """Return the direction in which a band leaves a circle of a radius about its start; None if it does not."""
    away = band.poses[:, :2] - band.poses[0, :2]
    out = np.flatnonzero(np.hypot(away[:, 0], away[:, 1]) > length_m)
    return float(np.arctan2(away[out[0], 1], away[out[0], 0])) if len(out) else None
