# SPDX-License-Identifier: MIT
"""What a run of the navigation stack is asked for, and the robot that it makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map
from slamcli.native import read_launch
from slamcli.native.settings import find_native
from slamcli.navigation.planner_methods import Method
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.live_slam import files_of_tier
from slamcli.pipelines.mission import Waypoint
from slamcli.pipelines.navigate import Navigator, SlamChoice
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.runtime import RunLog
from slamcli.simulation.builtin import find_world


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigateRequest:
    """Where to drive, with what, and what to leave behind."""

    waypoints: tuple[Waypoint, ...]
    map_path: Path | None = None
    """What the robot knows; None with `slam`."""
    slam: str | None = None
    """The tier that makes the map while the robot drives."""
    start: tuple[float, ...] | None = None
    """x, y and perhaps yaw (metres, radians) in map; None: the world's own."""
    world: str | None = None
    """What is simulated if it is not what the map shows; needed with `slam`."""
    config_files: tuple[Path, ...] = ()
    sets: tuple[str, ...] = ()
    slam_sets: tuple[str, ...] = ()
    """``KEY=VALUE`` with native keys of the tier that maps."""
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    local_planner: str | None = None
    global_planner: Method | None = None
    """None: what ``base_global_planner`` says."""
    dwa_scaling: Literal["noetic", "kinetic"] = "noetic"
    localization: Literal["amcl", "truth"] = "amcl"
    people: int = 0
    timeout_s: float | None = None
    """For each way, simulated seconds; None: by its length."""
    seed: int = 0
    output: Path | None = None
    """Folder for everything; None: no folder."""
    recording: Path | None = None
    """Where the recording goes; None: into the folder."""
    film: Path | None = None
    """Where the animation goes; None: into the folder."""
    lean: bool = False
    """Leave recording and animation out of the folder."""
    command: str = ""
    """The command line that asks for this, for ``run.json``."""


def inputs_of(request: NavigateRequest) -> list[Path]:
    """Return the files that say what the robot knows and what is simulated."""
    files = [] if request.map_path is None else [request.map_path, read_map(request.map_path).image]
    return files if request.world is None else [*files, find_world(request.world)]


def build_robot(request: NavigateRequest, log: RunLog) -> Navigator:
    """Return the robot at its start, with everything that the request asks for.

    Raises
    ------
    InputError
        If the map, the world, a parameter or the start cannot be used.
    """
    of_tier: tuple[Path, ...] = ()
    if request.slam is not None:
        of_tier = files_of_tier(request.slam, request.config_files, request.launch_arguments)
    config = load_navigation(
        [f for f in request.config_files if _is_for_navigation(f, of_tier, request.launch_arguments)], request.sets,
        local_planner=request.local_planner, global_planner=request.global_planner, log=log, arguments=request.launch_arguments,
    )  # fmt: skip
    slam = None
    if request.slam is not None:
        slam = SlamChoice(algo=request.slam, files=of_tier, sets=request.slam_sets)
    return Navigator(
        request.map_path, start=_start(request), config=config, world=request.world, localization=request.localization,
        slam=slam, dwa_scaling=request.dwa_scaling, people=request.people,
        seed=request.seed, log=log,
    )  # fmt: skip


def _is_for_navigation(file: Path, of_tier: tuple[Path, ...], arguments: Mapping[str, str]) -> bool:
    """Whether a file says something to navigation: all do but those that speak to the tier alone."""
    path = find_native(file)
    if path not in of_tier:
        return True
    return path.suffix.lower() != ".lua" and any(
        node.type in ("move_base", "amcl") for node in read_launch(path, arguments).nodes
    )


def _start(request: NavigateRequest) -> tuple[float, ...]:
    if request.start is not None:
        return request.start
    place = open_world(request.world) if request.world is not None else None
    if place is None or place.start is None:
        raise UsageError("where does the robot stand? give --start X,Y,YAW (metres, radians)")
    return place.start
