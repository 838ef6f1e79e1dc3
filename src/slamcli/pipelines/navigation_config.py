# SPDX-License-Identifier: MIT
"""What launch files, parameter files and the command line say to the navigation stack."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native import Setting, read_launch, read_ros_yaml
from slamcli.native.nav2_yaml import is_nav2, translate_nav2
from slamcli.native.settings import find_native
from slamcli.navigation.collision_monitor import CollisionMonitorParameters
from slamcli.navigation.layered_files import read_costmaps
from slamcli.navigation.layered_parameters import LayeredParameters
from slamcli.navigation.local_planners import LOCAL_PLANNERS, LocalPlannerKind, find_local_planner
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.obstacle_parameters import SourceParameters
from slamcli.navigation.planner_methods import Method
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.planner_plugins import find_global_planner
from slamcli.parameters import Declaration, declarations
from slamcli.pipelines.config import parse_set
from slamcli.pipelines.navigation_sections import COSTMAPS, Sections
from slamcli.runtime import RunLog

DEFAULT_FILE = "move_base.launch"
"""The navigation set-up that slamcli brings along, and uses if no file is given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationConfig:
    """Every parameter of the navigation stack, resolved."""

    amcl: AmclParameters
    global_costmap: LayeredParameters
    local_costmap: LayeredParameters
    planner: PlannerParameters
    global_planner: Method
    """What `base_global_planner` means."""
    move_base: MoveBaseParameters
    recovery: RecoveryParameters
    """Of every recovery behaviour without values of its own."""
    behaviours: Mapping[str, RecoveryParameters] = field(default_factory=dict)
    """Of those with values in the namespace of their own name."""
    monitor: CollisionMonitorParameters
    local_planner: LocalPlannerKind
    local_parameters: Any
    """Parameters of the local planner that was chosen."""
    simulation: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the simulated robot and its surroundings by native name."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Where each value that was given stands, by section and name as `NavigationValue.key` has them."""
    files: tuple[Path, ...] = ()

    def values(self) -> Iterator[NavigationValue]:
        """Yield every parameter of every part in use."""
        yield from _values("amcl", self.amcl)
        for name, costmap in (("global_costmap", self.global_costmap), ("local_costmap", self.local_costmap)):
            called = {layer.kind: layer.name for layer in costmap.layers}
            for value in _values(name, costmap.costmap):
                kind, of_layer, rest = value.name.partition("_layer.")
                if not of_layer:
                    yield value
                elif kind in called:
                    yield replace(value, name=f"{called[kind]}.{rest}")
            for layer in costmap.layers:
                if layer.kind in ("obstacle", "voxel"):
                    yield from _values(f"{name}.{layer.name}", layer.obstacle)
                    for source in layer.sources:
                        yield from _values(f"{name}.{layer.name}.{source.name}", source, SourceParameters)
        for name in ("planner", "move_base", "recovery"):
            yield from _values(name, getattr(self, name))
        for name, own in self.behaviours.items():
            given = (value for value in _values("", own) if f"{name}.{_last(value.declaration.name)}" in self.sources)
            for value in given:
                yield NavigationValue(
                    section=name, name=_last(value.name), declaration=value.declaration, value=value.value
                )
        yield from _values("collision_monitor", self.monitor)
        yield from _values(LOCAL_PLANNERS[self.local_planner].section, self.local_parameters)


@dataclass(frozen=True, slots=True, kw_only=True)
class NavigationValue:
    """One parameter of one part."""

    section: str
    """``amcl``, ``global_costmap``, ``local_costmap.obstacle_layer``, ``DWAPlannerROS`` ..."""
    name: str
    """Within its section."""
    declaration: Declaration
    value: Any

    @property
    def key(self) -> str:
        """Section and name, joined by a dot."""
        return f"{self.section}.{self.name}"


def load_navigation(
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    *,
    local_planner: str | None = None,
    global_planner: str | None = None,
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> NavigationConfig:
    """Return the parameters of the whole stack: defaults, then files in their order, then `sets`.

    Parameters
    ----------
    files
        Launch files with nodes move_base and amcl, and parameter YAML as they load it, or as nav2's nodes do. A bare name
        that is not here means slamcli's own file of that name. None at all: slamcli's move_base.launch.
    sets
        ``KEY=VALUE``: ``DWAPlannerROS/max_vel_x=0.4``, ``amcl/min_particles=200``, ``local_costmap/width=6``,
        ``laser.beams=720``. A name without section goes where there is only one of that name, or to both costmaps.
    local_planner
        dwa, teb or pursuit; None: what base_local_planner says.
    global_planner
        Of `slamcli plan`; None: what base_global_planner says.
    log
        Gets a note for each parameter that has no effect here.
    arguments
        Values for the arguments of launch files.

    Raises
    ------
    ConfigError
        If a file cannot be read, a name is unknown, or a value has the wrong type or range. The message has the place.
    """
    log = (log if files or sets else None) or RunLog()  # of slamcli's own file there is nothing to remark
    paths = [find_native(Path(file)) for file in files] or [find_native(Path(DEFAULT_FILE))]
    settings = [setting for path in paths for setting in _read(path, log, arguments or {})]
    sections = Sections(log)
    given = [parse_set(text) for text in sets]
    sections.learn([*settings, *given])
    for setting in settings:
        sections.take(setting)
    if not sections.has_costmaps:  # as with no file at all: slamcli's own
        for setting in _read(find_native(Path(DEFAULT_FILE)), log, {}):
            if setting.name.partition("/")[0] in COSTMAPS:
                sections.take(setting)
    for setting in given:
        sections.take(setting, anywhere=True)
    return _built(sections, local_planner, global_planner, tuple(paths), log)


def _built(
    sections: Sections, local_planner: str | None, global_planner: str | None, files: tuple[Path, ...], log: RunLog
) -> NavigationConfig:
    costmaps = read_costmaps(sections.costmaps)
    for name, _, source in costmaps.rest:
        raise sections.unknown(name, source)
    move_base: MoveBaseParameters = sections.resolve("move_base")
    try:
        kind = find_local_planner(local_planner or move_base.base_local_planner)
        method = find_global_planner(global_planner or move_base.base_global_planner)
    except ConfigError as error:
        raise sections.placed("move_base", error) from error
    config = NavigationConfig(
        amcl=sections.resolve("amcl"),
        global_costmap=costmaps.global_costmap,
        local_costmap=costmaps.local_costmap,
        planner=sections.resolve("planner"),
        global_planner=method,
        move_base=move_base,
        recovery=sections.resolve("recovery"),
        behaviours=sections.behaviours(move_base),
        monitor=sections.resolve("monitor"),
        local_planner=kind,
        local_parameters=sections.resolve(kind, sections.borrowed(kind)),
        simulation=sections.values("simulation"),
        sources=sections.sources | dict(costmaps.sources),
        files=files,
    )
    for note in (*costmaps.notes, *sections.ignored()):
        log.note(note)
    return config


def _read(path: Path, log: RunLog, arguments: Mapping[str, str]) -> Iterable[Setting]:
    """Yield what a file sets, with the sections that move_base and amcl know it by."""
    suffix = path.suffix.lower()
    if suffix in (".yaml", ".yml"):
        settings = read_ros_yaml(path)
        if is_nav2(settings):
            translated = translate_nav2(settings)
            for note in translated.notes:
                log.note(f"{path}: {note}")
            settings = translated.settings
        yield from settings
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


def _values(section: str, parameters: Any, kind: type | None = None) -> Iterator[NavigationValue]:
    for entry in declarations(kind or type(parameters)):
        yield NavigationValue(
            section=section, name=entry.name.removeprefix(f"{section}."), declaration=entry,
            value=attrgetter(entry.field)(parameters),
        )  # fmt: skip


def _last(name: str) -> str:
    return name.rpartition(".")[2]
