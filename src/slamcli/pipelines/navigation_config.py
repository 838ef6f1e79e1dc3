# SPDX-License-Identifier: MIT
"""What launch files, parameter files and the command line say to the navigation stack."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native import Setting, read_launch, read_ros_yaml
from slamcli.native.settings import find_native
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.layered_files import read_costmaps
from slamcli.navigation.layered_parameters import LayeredParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS, LocalPlannerKind, find_local_planner
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import Declaration, convert, declarations, resolve, unknown_name
from slamcli.pipelines.config import parse_set
from slamcli.runtime import RunLog
from slamcli.simulation import SimulationParameters

DEFAULT_FILE = "move_base.launch"
"""The navigation set-up that slamcli brings along, and uses if no file is given."""

_COSTMAPS = ("global_costmap", "local_costmap")
_GLOBAL_PLANNERS = ("NavfnROS", "GlobalPlanner", "navfn", "planner")
_RECOVERIES = {
    "conservative_reset": "clear_costmap",
    "aggressive_reset": "clear_costmap",
    "clear_costmap": "clear_costmap",
    "rotate_recovery": "rotate_recovery",
    "move_slow_and_clear": "move_slow_and_clear",
    "back_up": "back_up",
}
_OF_TRAJECTORY_PLANNER = {
    "yaw_goal_tolerance": "rotate_recovery.yaw_goal_tolerance",
    "acc_lim_th": "rotate_recovery.acc_lim_theta",
    "acc_lim_theta": "rotate_recovery.acc_lim_theta",
    "max_rotational_vel": "rotate_recovery.max_rotational_vel",
    "max_vel_theta": "rotate_recovery.max_rotational_vel",
    "min_in_place_rotational_vel": "rotate_recovery.min_in_place_rotational_vel",
    "min_in_place_vel_theta": "rotate_recovery.min_in_place_rotational_vel",
}
"""What rotate_recovery reads from TrajectoryPlannerROS, and its own names for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationConfig:
    """Every parameter of the navigation stack, resolved."""

    amcl: AmclParameters
    global_costmap: LayeredParameters
    local_costmap: LayeredParameters
    planner: PlannerParameters
    move_base: MoveBaseParameters
    recovery: RecoveryParameters
    monitor: CollisionMonitorParameters
    local_planner: LocalPlannerKind
    local_parameters: Any
    """Parameters of the local planner that was chosen."""
    simulation: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the simulated robot and its surroundings by native name."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Where each value that was given stands, by its name with its section."""
    files: tuple[Path, ...] = ()


def load_navigation(
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    *,
    local_planner: str | None = None,
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> NavigationConfig:
    """Return the parameters of the whole stack: defaults, then files in their order, then `sets`.

    Parameters
    ----------
    files
        Launch files with nodes move_base and amcl, and parameter YAML as they load it. A bare name that is not here
        means slamcli's own file of that name. None at all: slamcli's move_base.launch.
    sets
        ``KEY=VALUE``: ``DWAPlannerROS/max_vel_x=0.4``, ``amcl/min_particles=200``, ``local_costmap/width=6``,
        ``laser.beams=720``. A name without section goes where there is only one of that name.
    local_planner
        dwa, teb or pursuit; None: what base_local_planner says.
    log
        Gets a note for each parameter that has no effect here.
    arguments
        Values for the arguments of launch files.

    Raises
    ------
    ConfigError
        If a file cannot be read, a name is unknown, or a value has the wrong type or range. The message has the place.
    """
    log = log or RunLog()
    paths = [find_native(Path(file)) for file in files] or [find_native(Path(DEFAULT_FILE))]
    collected = _Collected(log)
    for path in paths:
        for setting in _read(path, log, arguments or {}):
            collected.take(setting)
    if not collected.has_costmaps:  # as with no file at all: slamcli's own
        for setting in _read(find_native(Path(DEFAULT_FILE)), log, {}):
            if setting.name.partition("/")[0] in _COSTMAPS:
                collected.take(setting)
    for text in sets:
        collected.take(parse_set(text), anywhere=True)
    return collected.build(local_planner, tuple(paths))


def _read(path: Path, log: RunLog, arguments: Mapping[str, str]) -> Iterable[Setting]:
    """Yield what a file sets, with the sections that move_base and amcl know it by."""
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        yield from read_ros_yaml(path)
        return
    if suffix not in (".launch", ".xml"):
        raise ConfigError(f"{path}: navigation reads launch files (.launch, .xml) and parameter files (.yaml)")
    launch = read_launch(path, arguments)
    for note in launch.notes:
        log.note(note)
    nodes = [node for node in launch.nodes if node.type in ("move_base", "amcl")]
    if not nodes:
        there = ", ".join(f"{node.package}/{node.type}" for node in launch.nodes) or "none"
        raise ConfigError(f"{path}: starts neither move_base nor amcl (nodes: {there})")
    for node in nodes:
        for name, setting in node.params.items():
            section = "amcl/" if node.type == "amcl" else ""
            yield Setting(section + name, setting.value, setting.file, setting.line)


class _Collected:
    """Sorts settings into the sections that they belong to."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._values: dict[str, dict[str, Any]] = {}
        self._costmaps: list[tuple[str, Any, str]] = []
        self._sources: dict[str, str] = {}
        self._known: dict[str, dict[str, Declaration]] = {
            "amcl": _table(AmclParameters),
            "move_base": _table(MoveBaseParameters),
            "planner": _table(PlannerParameters),
            "recovery": _table(RecoveryParameters),
            "monitor": _table(CollisionMonitorParameters),
            "simulation": _table(SimulationParameters),
            **{kind: _table(planner.parameters) for kind, planner in LOCAL_PLANNERS.items()},
        }
        self._sections: dict[str, LocalPlannerKind] = {p.section: kind for kind, p in LOCAL_PLANNERS.items()}
        self._ignored: dict[str, list[str]] = {}

    def take(self, setting: Setting, *, anywhere: bool = False) -> None:
        """Put one setting where it belongs; `anywhere` lets a name without section find its place."""
        parts = setting.name.replace("/", ".").split(".")
        while len(parts) > 1 and parts[0] in ("move_base", "ros__parameters", "amcl") and parts[0] != "amcl":
            parts = parts[1:]
        head, rest = parts[0], ".".join(parts[1:])
        name = ".".join(parts)
        if head in _COSTMAPS:
            self._costmaps.append((name, setting.value, setting.source))
            self._sources[name] = setting.source
        elif head == "amcl" and rest:
            self._put("amcl", rest.removeprefix("ros__parameters."), setting)
        elif head in self._sections and rest:
            kind = self._sections[head]
            self._put(kind, LOCAL_PLANNERS[kind].today(rest), setting)
        elif head in _GLOBAL_PLANNERS and rest:
            self._put("planner", rest, setting)
        elif head in _RECOVERIES and rest:
            self._put("recovery", f"{_RECOVERIES[head]}.{_recovery_name(rest)}", setting)
        elif head == "collision_monitor" and rest:
            self._put("monitor", name, setting)
        elif head == "TrajectoryPlannerROS" and rest:
            self._take_trajectory(rest, setting)
        elif name in self._known["move_base"]:
            self._put("move_base", name, _listed(setting) if name == "recovery_behaviors" else setting)
        elif name in self._known["simulation"] and anywhere:
            self._put("simulation", name, setting)
        elif anywhere and (section := self._only(name, setting)) is not None:
            self._put(section, name, setting)
        else:
            self._costmaps.append((name, setting.value, setting.source))  # of both, or unknown
            self._sources[name] = setting.source

    @property
    def has_costmaps(self) -> bool:
        """Whether anything was said of a costmap."""
        return bool(self._costmaps)

    def build(self, local_planner: str | None, files: tuple[Path, ...]) -> NavigationConfig:
        """Return the parameters, checked."""
        costmaps = read_costmaps(self._costmaps)
        for name, _, source in costmaps.rest:
            raise ConfigError(unknown_name(name, self._names(), source))
        for note in costmaps.notes:
            self._log.note(note)
        move_base = resolve(MoveBaseParameters, self._values.get("move_base", {}))
        kind = find_local_planner(local_planner or move_base.base_local_planner)
        for why, names in self._ignored.items():
            self._log.note(f"accepted without effect: {', '.join(names)} ({why})")
        local_values = self._borrowed(kind) | self._values.get(kind, {})
        return NavigationConfig(
            amcl=resolve(AmclParameters, self._values.get("amcl", {})),
            global_costmap=costmaps.global_costmap,
            local_costmap=costmaps.local_costmap,
            planner=resolve(PlannerParameters, self._values.get("planner", {})),
            move_base=move_base,
            recovery=resolve(RecoveryParameters, self._values.get("recovery", {})),
            monitor=resolve(CollisionMonitorParameters, self._values.get("monitor", {})),
            local_planner=kind,
            local_parameters=resolve(LOCAL_PLANNERS[kind].parameters, local_values),
            simulation=self._values.get("simulation", {}),
            sources=self._sources,
            files=files,
        )

    def _borrowed(self, kind: LocalPlannerKind) -> dict[str, Any]:
        """Return the robot's limits that a local planner takes over from DWA's section where its own does not say."""
        own = self._values.get(kind, {})
        lent = LOCAL_PLANNERS[kind].borrow(self._values.get("dwa", {}))
        values = {name: value for name, value in lent.items() if name not in own}
        if values:
            taken = ", ".join(f"{name} {value:g}" for name, value in values.items())
            self._log.note(f"{LOCAL_PLANNERS[kind].section} takes the robot's limits from DWAPlannerROS: {taken}")
        return values

    def _put(self, section: str, name: str, setting: Setting) -> None:
        known = self._known[section]
        if name not in known:
            raise ConfigError(unknown_name(name, known, f"{setting.source}, {section}"))
        try:
            value = convert(known[name], setting.value)
        except ConfigError as error:
            raise ConfigError(f"{setting.source}: {error}") from error
        if not known[name].effective:
            self._ignored.setdefault(known[name].help, []).append(f"{section}/{name}")
        self._values.setdefault(section, {})[name] = value
        self._sources[f"{section}.{name}"] = setting.source

    def _only(self, name: str, setting: Setting) -> str | None:
        """Return the one section that knows a name; None if none does."""
        found = [section for section, known in self._known.items() if name in known]
        if len(found) > 1:
            choices = ", ".join(f"{self._title(section)}/{name}" for section in found)
            raise ConfigError(f"{setting.source} {name}: several parts have a parameter of that name: write {choices}")
        return found[0] if found else None

    def _names(self) -> list[str]:
        return [f"{self._title(section)}/{name}" for section, known in self._known.items() for name in known]

    def _title(self, section: str) -> str:
        return next((p.section for kind, p in LOCAL_PLANNERS.items() if kind == section), section)

    def _take_trajectory(self, name: str, setting: Setting) -> None:
        if name in _OF_TRAJECTORY_PLANNER:
            self._put("recovery", _OF_TRAJECTORY_PLANNER[name], setting)
        else:
            why = "TrajectoryPlannerROS is not one of the local planners here: choose dwa, teb or pursuit"
            self._ignored.setdefault(why, []).append(f"TrajectoryPlannerROS/{name}")


def _table(parameters: type) -> dict[str, Declaration]:
    return {declaration.name: declaration for declaration in declarations(parameters)}


def _recovery_name(name: str) -> str:
    """Return our name of what the original calls otherwise in a behaviour's namespace."""
    return name.split(".")[-1]


def _listed(setting: Setting) -> Setting:
    """Return recovery_behaviors as names, where it is ROS's list of names and types."""
    if not isinstance(setting.value, list):
        return setting
    names = []
    for entry in setting.value:
        name = str(entry.get("name", "")) if isinstance(entry, dict) else str(entry)
        kind = str(entry.get("type", "")).rpartition("/")[2] if isinstance(entry, dict) else ""
        names.append(_BY_TYPE.get(kind, name) if name not in _RECOVERIES else name)
    return Setting(setting.name, " ".join(names), setting.file, setting.line)


_BY_TYPE = {
    "ClearCostmapRecovery": "conservative_reset",
    "RotateRecovery": "rotate_recovery",
    "MoveSlowAndClear": "move_slow_and_clear",
}
