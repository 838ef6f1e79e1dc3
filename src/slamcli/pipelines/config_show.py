# SPDX-License-Identifier: MIT
"""Every parameter of a tier, of the navigation stack, of `plan` or of the simulator, with its value and where that comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.native import Setting, read_ros_yaml
from slamcli.navigation.costmap_files import read_settings
from slamcli.parameters import Declaration, as_dict, declarations
from slamcli.pipelines.config import load_native, parse_set
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.runtime import RunLog
from slamcli.simulation.parameters import resolve_settings

NAVIGATION = "navigation"
PLAN = "plan"
SIMULATION = "simulation"


@dataclass(frozen=True, slots=True, kw_only=True)
class ResolvedParameter:
    """One parameter with its value and where that comes from."""

    declaration: Declaration
    value: Any
    source: str
    """``default``, ``file:line`` or ``--set``."""

    @property
    def changed(self) -> bool:
        """Whether the value differs from the default."""
        return bool(self.value != self.declaration.default)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What ``config show`` shows."""

    algo: str
    parameters: tuple[ResolvedParameter, ...]
    """In the order of their declaration."""
    remaps: Mapping[str, str]
    """Topics as the files remap them."""


def show(
    algo: str,
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> Shown:
    """Return every parameter of `algo`: a tier, ``navigation`` (the whole stack), ``plan`` (costmap and planners) or ``simulation``.

    Names of the navigation stack have the section that they are set by: ``amcl/min_particles``,
    ``local_costmap/obstacle_layer/raytrace_range``. Without files they are those of slamcli's own move_base.launch.

    Raises
    ------
    ConfigError, UsageError
        As `slamcli.pipelines.config.load_native`.
    """
    log = log or RunLog()
    if algo == NAVIGATION:
        return Shown(algo=algo, parameters=_navigation(files, sets, log, arguments), remaps={})
    if algo == PLAN:
        return Shown(algo=algo, parameters=_plan(files, sets, log), remaps={})
    if algo == SIMULATION:
        return Shown(algo=algo, parameters=_simulation(files, sets), remaps={})
    config = load_native(algo, files, sets, log, arguments)
    return Shown(algo=algo, parameters=_rows(config.parameters, config.sources), remaps=config.remaps)


def _rows(parameters: Any, sources: Mapping[str, str]) -> tuple[ResolvedParameter, ...]:
    values = as_dict(parameters)
    return tuple(
        ResolvedParameter(declaration=entry, value=values[entry.name], source=sources.get(entry.name, "default"))
        for entry in declarations(type(parameters))
    )


def _navigation(
    files: Sequence[Path], sets: Sequence[str], log: RunLog, arguments: Mapping[str, str] | None
) -> tuple[ResolvedParameter, ...]:
    config = load_navigation(files, sets, log=log, arguments=arguments)
    return tuple(
        ResolvedParameter(
            declaration=replace(value.declaration, name=f"{value.section.replace('.', '/')}/{value.name}"),
            value=value.value,
            source=config.sources.get(value.key, "default"),
        )
        for value in config.values()
    )


def _plan(files: Sequence[Path], sets: Sequence[str], log: RunLog) -> tuple[ResolvedParameter, ...]:
    settings: list[Setting] = [setting for path in files for setting in read_ros_yaml(Path(path))]
    settings += [parse_set(text) for text in sets]
    entries = [(setting.name, setting.value, setting.source) for setting in settings]
    sources: dict[str, str] = {}
    before: dict[str, Any] = {}
    for count in range(1, len(entries) + 1):  # names have several spellings: what changes shows which one was meant
        found = read_settings(entries[:count])
        after = found.costmap | found.planner
        changed = [name for name in after if name not in before or before[name] != after[name]]
        sources |= dict.fromkeys(changed, settings[count - 1].source)
        before = after
    resolved = read_settings(entries)
    for note in resolved.notes:
        log.note(note)
    costmap, planner = resolved.build()
    return (*_rows(costmap, sources), *_rows(planner, sources))


def _simulation(files: Sequence[Path], sets: Sequence[str]) -> tuple[ResolvedParameter, ...]:
    if files:
        raise UsageError("the simulation takes its settings from the world file: give them here by --set")
    given = {setting.name: setting.value for setting in map(parse_set, sets)}
    return _rows(resolve_settings(given), dict.fromkeys(given, "--set"))
