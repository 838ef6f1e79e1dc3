# SPDX-License-Identifier: MIT
"""Paths on a saved map: costmap from its files and options, planner, one path or many."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import PlanningError, UsageError
from slamcli.formats.maps import MapFile, read_map
from slamcli.native import read_ros_yaml
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_files import NavigationSettings, read_settings
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.global_planner import METHODS, GlobalPlanner, Method, PlannedPath
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import as_dict, declarations
from slamcli.runtime import RunLog

_FROM_OPTIONS = "--set"
_MANY = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanningSite:
    """A loaded map with its costmap and planner: plans any number of paths."""

    map: MapFile
    planner: GlobalPlanner
    costmap_parameters: CostmapParameters
    costmap_files: tuple[Path, ...]

    @property
    def parameters(self) -> dict[str, Any]:
        """Every resolved parameter by name; radii as they were used."""
        costmap = self.planner.costmap
        return {
            **as_dict(self.costmap_parameters),
            "inflation_layer.inflation_radius": costmap.inflation_radius_m,
            **as_dict(self.planner.parameters),
            "planner": self.planner.method,
            "inscribed_radius_m": costmap.inscribed_radius_m,
            "circumscribed_radius_m": costmap.circumscribed_radius_m,
        }

    @property
    def defaults(self) -> dict[str, Any]:
        """Every parameter's default by name."""
        return {d.name: d.default for kind in (CostmapParameters, PlannerParameters) for d in declarations(kind)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Answer:
    """What became of one request."""

    start: tuple[float, ...]
    goal: tuple[float, ...]
    status: str
    """ok, start_outside, start_blocked, goal_outside, goal_blocked or unreachable."""
    time_ms: float
    """Time that planning took, without reading the map and computing its costmap."""
    path: PlannedPath | None = None
    failure: NoPathError | None = None

    def document(self, *, points: bool = False, timing: bool = True) -> dict[str, Any]:
        """Return the answer as JSON has it; `points` adds the path itself as ``[x, y, yaw]``."""
        found: dict[str, Any] = {"status": self.status, "start": list(self.start), "goal": list(self.goal)}
        if self.path is not None:
            path = self.path
            found |= {
                "planner": path.method,
                "length_m": path.length_m,
                "cost": path.cost,
                "clearance_m": path.clearance_m if math.isfinite(path.clearance_m) else None,
                "unknown_m": path.unknown_m,
                "goal_offset_m": path.goal_offset_m,
                "num_points": len(path.points_m),
            }
            if path.directions is not None:
                found["reverse_m"] = path.reverse_m
        if self.failure is not None:
            failure = self.failure
            found |= {
                "length_m": None,
                "cost": None,
                "message": str(failure),
                "nearest": None if failure.nearest_m is None else list(failure.nearest_m),
                "distance_m": failure.distance_m if math.isfinite(failure.distance_m) else None,
            }
        if timing:
            found["time_ms"] = self.time_ms
        if points and self.path is not None:
            poses = zip(self.path.points_m.tolist(), self.path.yaws_rad.tolist(), strict=True)
            found["path"] = [[x, y, yaw] for (x, y), yaw in poses]
            if self.path.directions is not None:
                found["directions"] = self.path.directions.tolist()
        return found


def load_site(
    map_path: str | os.PathLike[str],
    *,
    planner: str = "navfn",
    costmap_files: Sequence[str | os.PathLike[str]] = (),
    settings: Mapping[str, Any] | None = None,
    log: RunLog | None = None,
) -> PlanningSite:
    """Read a map and make it ready for planning.

    Parameters
    ----------
    map_path
        The map's YAML.
    planner
        navfn, dijkstra, astar, theta_star, hybrid_astar or global_planner.
    costmap_files
        costmap_2d parameter files; of two values for one name the later counts.
    settings
        Parameters by costmap_2d's and navfn's names, over the files.
    log
        Takes notes, warnings and timing.

    Raises
    ------
    FormatError
        If the map cannot be read.
    ConfigError
        If a parameter is unknown or wrong.
    """
    log = log or RunLog()
    method = _method(planner)
    resolved = _resolve(costmap_files, settings or {}, log)
    costmap_parameters, planner_parameters = resolved.build()
    with log.stage("read map"):
        map_file = read_map(map_path)
    for warning in map_file.warnings:
        log.warn(warning)
    with log.stage("costmap"):
        costmap = compute_costmap(map_file.grid, costmap_parameters, from_file=bool(costmap_files))
        site = GlobalPlanner(costmap, planner_parameters, method)
    with log.stage("prepare"):
        site.prepare()
    for warning in costmap.warnings:
        log.warn(warning)
    if costmap.circumscribed_radius_m == 0.0 and costmap_parameters.robot_radius is None:
        log.note(
            f"no robot given: planned for a point that keeps away from walls (cost up to {costmap.inflation_radius_m:g} m);"
            " say --robot-radius METRES for yours"
        )
    return PlanningSite(
        map=map_file,
        planner=site,
        costmap_parameters=costmap_parameters,
        costmap_files=tuple(Path(p) for p in costmap_files),
    )


def plan(site: PlanningSite, start: Sequence[float], goal: Sequence[float], *, log: RunLog | None = None) -> Answer:
    """Return the answer to one request: a path, or why there is none and what is nearest.

    Points are x, y or x, y, yaw in metres and radians, map frame.

    Raises
    ------
    UsageError
        If a point has another number of values, or one that is not finite.
    """
    start, goal = _point("start", start), _point("goal", goal)
    log = log or RunLog()
    began = time.perf_counter()
    try:
        with log.stage("plan"):
            path = site.planner.plan(start, goal)
    except NoPathError as failure:
        return Answer(start=start, goal=goal, status=failure.status, time_ms=_since(began), failure=failure)
    answer = Answer(start=start, goal=goal, status="ok", time_ms=_since(began), path=path)
    if path.unknown_m > 0:
        log.warn(f"{path.unknown_m:.2f} m of the path lead through unknown space; --no-allow-unknown forbids it")
    return answer


def plan_many(site: PlanningSite, pairs: Sequence[Sequence[float]]) -> Iterator[Answer]:
    """Yield the answers to requests ``start_x, start_y, goal_x, goal_y`` in their order."""
    if len(pairs) >= _MANY:
        site.planner.prepare_for_many()
    for pair in pairs:
        yield plan(site, pair[:2], pair[2:4])


def require_path(answer: Answer) -> PlannedPath:
    """Return the path of an answer.

    Raises
    ------
    PlanningError
        If it has none; the message says why and what is nearest.
    """
    if answer.path is not None:
        return answer.path
    raise answer.failure or PlanningError("no path")


def _method(name: str) -> Method:
    for method in METHODS:
        if name == method:
            return method
    raise UsageError(f"no planner {name!r}: choose one of {', '.join(METHODS)}")


def _resolve(files: Sequence[str | os.PathLike[str]], settings: Mapping[str, Any], log: RunLog) -> NavigationSettings:
    entries = [(s.name, s.value, s.source) for path in files for s in read_ros_yaml(Path(path))]
    entries += [(name, value, _FROM_OPTIONS) for name, value in settings.items()]
    resolved = read_settings(entries)
    for note in resolved.notes:
        log.note(note)
    return resolved


def _point(role: str, point: Sequence[float]) -> tuple[float, ...]:
    values = tuple(float(v) for v in point)
    if len(values) not in (2, 3) or not all(math.isfinite(v) and abs(v) < 1e9 for v in values):
        raise UsageError(f"{role} {','.join(f'{v:g}' for v in values)}: write it as X,Y or X,Y,YAW (metres, radians)")
    return values


def _since(began: float) -> float:
    return (time.perf_counter() - began) * 1e3
