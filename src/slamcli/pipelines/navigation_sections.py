# SPDX-License-Identifier: MIT
"""Sorts what files and the command line say to the parts of the navigation stack."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from slamcli.errors import ConfigError
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native import Setting
from slamcli.native.ros_yaml import parse_value
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS, LocalPlannerKind
from slamcli.navigation.move_base_parameters import DEFAULT_RESET_DISTANCE_M, MoveBaseParameters, RecoveryParameters
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.recovery_list import KINDS, USUAL_NAMES, BehaviourKind, behaviours_as_text, parse_behaviours
from slamcli.parameters import convert_at, declarations, resolve, unknown_name
from slamcli.runtime import RunLog
from slamcli.simulation import SimulationParameters

COSTMAPS = ("global_costmap", "local_costmap")

_GLOBAL_PLANNERS = ("NavfnROS", "GlobalPlanner", "navfn", "planner")
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

_TYPES: Mapping[str, type] = {
    "amcl": AmclParameters,
    "move_base": MoveBaseParameters,
    "planner": PlannerParameters,
    "recovery": RecoveryParameters,
    "monitor": CollisionMonitorParameters,
    "simulation": SimulationParameters,
    **{kind: planner.parameters for kind, planner in LOCAL_PLANNERS.items()},
}
_TITLES: dict[str, str] = {"monitor": "collision_monitor"}
_TITLES.update({kind: planner.section for kind, planner in LOCAL_PLANNERS.items()})
_KNOWN = {section: {entry.name: entry for entry in declarations(kind)} for section, kind in _TYPES.items()}
_LOCAL: Mapping[str, LocalPlannerKind] = {planner.section: kind for kind, planner in LOCAL_PLANNERS.items()}
_OF_BOTH = frozenset(_KNOWN["move_base"]) & frozenset(entry.name for entry in declarations(CostmapParameters))
_OF_COSTMAPS = frozenset(entry.name for entry in declarations(CostmapParameters))


class Sections:
    """Collects settings, each checked where it is taken.

    Parameters
    ----------
    log
        Gets notes.
    """

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._given: dict[str, dict[str, Any]] = {}
        self._own: dict[str, dict[str, Any]] = {}
        self._kinds: dict[str, BehaviourKind] = dict(USUAL_NAMES)
        self._listed_as_in_ros = False
        self._ignored: dict[str, list[str]] = {}
        self.sources: dict[str, str] = {}
        """Where each value stands, by section and name."""
        self.costmaps: list[tuple[str, Any, str]] = []
        """What is of a costmap, or of nobody: name, value, place."""

    def learn(self, settings: Iterable[Setting]) -> None:
        """Find out what recovery behaviours are called; their namespaces may come before their list."""
        for setting in settings:
            if _parts(setting.name) == ["recovery_behaviors"]:
                text = _as_text(setting)
                try:
                    named = {behaviour.name: behaviour.kind for behaviour in parse_behaviours(text)}
                except ConfigError as error:
                    raise ConfigError(f"{setting.source}: {error}") from error
                self._kinds = {**USUAL_NAMES, **named}
                self._listed_as_in_ros = ":" in text

    def take(self, setting: Setting, *, anywhere: bool = False) -> None:
        """Put one setting where it belongs; `anywhere` lets a name without section find its place.

        Raises
        ------
        ConfigError
            If the name is unknown there, or the value has the wrong type or range.
        """
        parts = _parts(setting.name)
        head, rest, name = parts[0], ".".join(parts[1:]), ".".join(parts)
        if head in COSTMAPS:
            self._take_costmap(name, setting)
        elif rest and head in _SECTIONS:
            self._put(_SECTIONS[head], rest, setting)
        elif rest and head in _LOCAL:
            self._put(_LOCAL[head], LOCAL_PLANNERS[_LOCAL[head]].today(rest), setting)
        elif rest and head == "collision_monitor":
            self._put("monitor", name, setting)
        elif rest and (head in self._kinds or head in KINDS):
            self._take_behaviour(head, rest, setting)
        elif rest and head == "TrajectoryPlannerROS":
            self._take_trajectory(rest, setting)
        elif name in _KNOWN["move_base"]:
            listed = name == "recovery_behaviors"
            self._put(
                "move_base",
                name,
                setting if not listed else Setting(name, _as_text(setting), setting.file, setting.line),
            )
            if name in _OF_BOTH and not anywhere:
                self._take_costmap(name, setting)
        elif anywhere and name in _KNOWN["simulation"]:
            self._put("simulation", name, setting)
        elif anywhere and (section := self._only(name, setting)) is not None:
            self._put(section, name, setting)
        else:
            self._take_costmap(name, setting)

    @property
    def has_costmaps(self) -> bool:
        """Whether anything was said of a costmap."""
        return bool(self.costmaps)

    def values(self, section: str) -> Mapping[str, Any]:
        """Return what was given to a section, by name."""
        return self._given.get(section, {})

    def resolve(self, section: str, below: Mapping[str, Any] | None = None) -> Any:
        """Return the parameters of a section: its defaults, `below` over them, and what was given."""
        try:
            return resolve(_TYPES[section], below or {}, self.values(section))
        except ConfigError as error:
            raise self.placed(section, error) from error

    def behaviours(self, move_base: MoveBaseParameters) -> dict[str, RecoveryParameters]:
        """Return the parameters of recovery behaviours that have some of their own."""
        found: dict[str, RecoveryParameters] = {}
        for behaviour in parse_behaviours(move_base.recovery_behaviors):
            own = self._own.get(behaviour.name, {})
            as_in_ros = self._listed_as_in_ros and behaviour.kind == "clear_costmap"
            if own or as_in_ros:  # in a list of ROS's no behaviour has a width because of its name
                base = {"clear_costmap.reset_distance": DEFAULT_RESET_DISTANCE_M} if as_in_ros else {}
                found[behaviour.name] = resolve(RecoveryParameters, base, self.values("recovery"), own)
        return found

    def borrowed(self, kind: LocalPlannerKind) -> dict[str, Any]:
        """Return the robot's limits that a local planner takes over from DWA's section where its own does not say."""
        own = self.values(kind)
        lent = LOCAL_PLANNERS[kind].borrow(self.values("dwa"))
        values = {name: value for name, value in lent.items() if name not in own}
        if values:
            taken = ", ".join(f"{name} {value:g}" for name, value in values.items())
            self._log.note(f"{LOCAL_PLANNERS[kind].section} takes the robot's limits from DWAPlannerROS: {taken}")
        return values

    def ignored(self) -> Iterator[str]:
        """Yield a note for each reason why something has no effect."""
        for why, names in self._ignored.items():
            yield f"accepted without effect: {', '.join(dict.fromkeys(names))} ({why})"

    def unknown(self, name: str, source: str) -> ConfigError:
        """Return the error for a name that no part knows."""
        known = [f"{_title(section)}/{entry}" for section, table in _KNOWN.items() for entry in table]
        return ConfigError(unknown_name(name, [*known, *sorted(_OF_COSTMAPS)], source))

    def placed(self, section: str, error: ConfigError) -> ConfigError:
        """Return the error with the places of the values that it names."""
        places = [
            self.sources[f"{_title(section)}.{name}"]
            for name in self.values(section)
            if re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", str(error))
        ]
        where = ", ".join(dict.fromkeys(places))
        return ConfigError(f"{where}: {error}") if where else error

    def _take_costmap(self, name: str, setting: Setting) -> None:
        self.costmaps.append((name, setting.value, setting.source))

    def _take_behaviour(self, head: str, rest: str, setting: Setting) -> None:
        """Take a value of a behaviour's namespace, or of all behaviours of a kind."""
        kind = self._kinds.get(head) or next(kind for kind in KINDS if kind == head)
        if rest == "layer_names":
            setting = Setting(setting.name, _joined(setting.value), setting.file, setting.line)
        name = f"{kind}.{rest}"
        if name not in _KNOWN["recovery"]:
            there = [known.removeprefix(f"{kind}.") for known in _KNOWN["recovery"] if known.startswith(f"{kind}.")]
            raise ConfigError(unknown_name(rest, there, f"{setting.source}, {head}"))
        if head == kind:
            self._put("recovery", name, setting)
            return
        self._own.setdefault(head, {})[name] = self._converted("recovery", name, setting)
        self.sources[f"{head}.{rest}"] = setting.source

    def _put(self, section: str, name: str, setting: Setting) -> None:
        self._given.setdefault(section, {})[name] = self._converted(section, name, setting)
        title = _title(section)
        self.sources[f"{title}.{name.removeprefix(f'{title}.')}"] = setting.source

    def _converted(self, section: str, name: str, setting: Setting) -> Any:
        known = _KNOWN[section]
        if name not in known:
            raise ConfigError(unknown_name(name, known, f"{setting.source}, {_title(section)}"))
        value = convert_at(known[name], setting.value, setting.source)
        if not known[name].effective:
            self._ignored.setdefault(known[name].help, []).append(f"{_title(section)}/{name}")
        return value

    def _only(self, name: str, setting: Setting) -> str | None:
        """Return the one section that knows a name; None if none does."""
        found = [section for section, known in _KNOWN.items() if name in known]
        costmaps = COSTMAPS if name in _OF_COSTMAPS else ()
        if len(found) > 1 or (found and costmaps):
            choices = ", ".join(f"{title}/{name}" for title in (*(_title(section) for section in found), *costmaps))
            raise ConfigError(f"{setting.source} {name}: several parts have a parameter of that name: write {choices}")
        return found[0] if found else None

    def _take_trajectory(self, name: str, setting: Setting) -> None:
        if name in _OF_TRAJECTORY_PLANNER:
            self._put("recovery", _OF_TRAJECTORY_PLANNER[name], setting)
        else:
            why = "TrajectoryPlannerROS is not one of the local planners here: choose dwa, teb or pursuit"
            self._ignored.setdefault(why, []).append(f"TrajectoryPlannerROS/{name}")


_SECTIONS = {
    "amcl": "amcl",
    "recovery": "recovery",
    "simulation": "simulation",
    **dict.fromkeys(_GLOBAL_PLANNERS, "planner"),
}


def _parts(name: str) -> list[str]:
    """Return the parts of a name without the node's; slashes and dots are the same."""
    parts = [part for part in name.replace("/", ".").split(".") if part] or [name]
    while len(parts) > 1 and parts[0] == "move_base":
        parts = parts[1:]
    return parts


def _as_text(setting: Setting) -> str:
    """Return recovery_behaviors as text, where it is ROS's list of names and types."""
    value = setting.value
    if isinstance(value, str) and value.lstrip().startswith("["):
        value = parse_value(value, setting.source)
    try:
        return behaviours_as_text(value) if isinstance(value, list) else str(value)
    except ConfigError as error:
        raise ConfigError(f"{setting.source}: {error}") from error


def _joined(value: Any) -> Any:
    """Return a list of layers as text."""
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        return " ".join(value)
    return value.replace("[", " ").replace("]", " ").strip() if isinstance(value, str) else value


def _title(section: str) -> str:
    return _TITLES.get(section, section)
