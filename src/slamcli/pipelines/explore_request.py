# SPDX-License-Identifier: MIT
"""What an exploration is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError, UsageError
from slamcli.native import Setting, read_launch
from slamcli.native.settings import find_native
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.parameters import convert_at, declarations, resolve, unknown_name
from slamcli.pipelines.config import parse_set
from slamcli.pipelines.navigate_request import NavigateRequest

SECTION = "explore"
_KNOWN = {entry.name: entry for entry in declarations(ExploreParameters)}
_MAP_UPDATE = "map_update_interval"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExploreRequest:
    """Where to explore, with what, and what to leave behind."""

    drive: NavigateRequest
    """Robot, world, SLAM and outputs; it has no waypoints."""
    parameters: ExploreParameters = field(default_factory=ExploreParameters)
    given: Mapping[str, Any] = field(default_factory=dict)
    """Those of them that were set, by name."""


def explore_request(drive: NavigateRequest, arguments: Mapping[str, str] | None = None) -> ExploreRequest:
    """Take out of a request what is said to the exploration, and leave the rest to navigation and SLAM.

    Launch files may start explore_lite's node ``explore``; ``--set explore/NAME=VALUE`` goes over them. Gmapping draws
    its map every second unless its settings (``slam_sets``) say otherwise: a frontier is not gone before it is off the map.

    Raises
    ------
    UsageError
        If there is no world or no SLAM.
    ConfigError
        If a file cannot be read, or a parameter of the exploration is unknown or has a wrong value.
    """
    if drive.slam is None or drive.world is None:
        raise UsageError("exploring needs a world and SLAM: slamcli explore WORLD --slam gmapping|cartographer")
    files, settings = _split_files(drive.config_files, arguments or {})
    sets = [text for text in drive.sets if not _is_mine(text)]
    settings += [_without_section(parse_set(text)) for text in drive.sets if _is_mine(text)]
    given = {setting.name: _value(setting) for setting in settings}
    slam_sets = drive.slam_sets
    if drive.slam == "gmapping" and not any(text.partition("=")[0].strip() == _MAP_UPDATE for text in slam_sets):
        slam_sets = (f"{_MAP_UPDATE}=1", *slam_sets)
    return ExploreRequest(
        drive=replace(drive, config_files=files, sets=tuple(sets), slam_sets=slam_sets),
        parameters=resolve(ExploreParameters, given),
        given=given,
    )


def _is_mine(text: str) -> bool:
    return text.strip().startswith((f"{SECTION}/", f"{SECTION}."))


def _without_section(setting: Setting) -> Setting:
    return replace(setting, name=setting.name[len(SECTION) + 1 :])


def _split_files(files: Sequence[Path], arguments: Mapping[str, str]) -> tuple[tuple[Path, ...], list[Setting]]:
    """Return the files that say something to others, and what they say to explore_lite's node."""
    rest: list[Path] = []
    found: list[Setting] = []
    for file in files:
        path = find_native(file)
        if path.suffix.lower() not in (".launch", ".xml"):
            rest.append(file)
            continue
        nodes = read_launch(path, arguments).nodes
        mine = [node for node in nodes if node.type == SECTION]
        found += [setting for node in mine for setting in _of_node(node.params.items())]
        if len(mine) < len(nodes) or not mine:
            rest.append(file)
    return tuple(rest), found


def _of_node(params: Iterable[tuple[str, Setting]]) -> list[Setting]:
    return [replace(setting, name=name) for name, setting in params]


def _value(setting: Setting) -> Any:
    if setting.name not in _KNOWN:
        raise ConfigError(unknown_name(setting.name, _KNOWN, setting.source))
    return convert_at(_KNOWN[setting.name], setting.value, setting.source)
