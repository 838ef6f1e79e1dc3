# SPDX-License-Identifier: MIT
"""A tier's parameters from its native files and from the command line; a lint of those files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.mapper import find_tier
from slamcli.native import Setting, merge, read_launch, read_ros_yaml
from slamcli.native.checks import Finding
from slamcli.native.checks.files import check_file
from slamcli.native.settings import read_text
from slamcli.parameters import Declaration, convert, declarations, resolve, unknown_name
from slamcli.runtime import RunLog

FROM_COMMAND_LINE = "--set"

# Nodes of a launch file that a tier stands for, by their type.
_NODES = {"gmapping": ("slam_gmapping",)}


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeConfig:
    """What native files and the command line say to one tier."""

    algo: str
    parameters: Any
    """The tier's parameter dataclass, resolved: defaults, then files in their order, then ``--set``."""
    sources: Mapping[str, str]
    """Where each value that was given stands: ``file:line`` or ``--set``; defaults are not in it."""
    remaps: Mapping[str, str]
    """Topics as the files remap them: ``{"scan": "/base_scan"}``."""

    @property
    def scan_topic(self) -> str | None:
        """The topic that the files name for the scans; None if they name none."""
        return self.remaps.get("scan")


def load_native(
    algo: str,
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> NativeConfig:
    """Return a tier's parameters: defaults, overridden by files (later wins), overridden by `sets`.

    Parameters
    ----------
    algo
        Name of the tier.
    files
        Native files of the system: for gmapping launch files (``.launch``, ``.xml``) and ROS parameter YAML.
    sets
        ``KEY=VALUE`` with native keys.
    log
        Gets a note for each parameter that has no effect here, and for what was skipped in a file.
    arguments
        Values for the arguments of launch files.

    Raises
    ------
    ConfigError
        If a file cannot be read or holds nothing for this tier, or a name is unknown, or a value has the wrong type or
        range. The message has the place.
    UsageError
        If there is no such tier.
    """
    log = log or RunLog()
    tier = find_tier(algo)
    known = {entry.name: entry for entry in declarations(tier.parameters)}
    settings: list[Setting] = []
    remaps: dict[str, str] = {}
    for file in files:
        found, topics = _read(algo, Path(file), log, arguments or {})
        settings.extend(found)
        remaps.update(topics)
    settings.extend(parse_set(text) for text in sets)
    merged = merge(settings)
    for setting in merged.values():
        _check(setting, known, log)
    parameters: Any = resolve(tier.parameters, {name: setting.value for name, setting in merged.items()})
    sources = {name: setting.source for name, setting in merged.items()}
    return NativeConfig(algo=algo, parameters=parameters, sources=sources, remaps=remaps)


def check(files: Iterable[Path], beams: int | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with native files: unknown names, types, ranges, values that do not do what they seem to.

    Raises
    ------
    ConfigError
        If a file does not exist or is not text.
    """
    table = declarations(find_tier("gmapping").parameters)
    files = [Path(file) for file in files]
    for file in files:
        read_text(file)  # what cannot be read at all is wrong usage, not a finding
    return tuple(finding for file in files for finding in check_file(file, table, beams))


def _read(
    algo: str, path: Path, log: RunLog, arguments: Mapping[str, str]
) -> tuple[tuple[Setting, ...], Mapping[str, str]]:
    suffix = path.suffix.lower()
    if suffix in (".launch", ".xml"):
        return _read_launch(algo, path, log, arguments)
    if suffix in (".yaml", ".yml"):
        return tuple(_own(setting, algo) for setting in read_ros_yaml(path)), {}
    raise ConfigError(f"{path}: {algo} reads launch files (.launch, .xml) and parameter files (.yaml)")


def _read_launch(
    algo: str, path: Path, log: RunLog, arguments: Mapping[str, str]
) -> tuple[tuple[Setting, ...], Mapping[str, str]]:
    launch = read_launch(path, arguments)
    for note in launch.notes:
        log.note(note)
    nodes = [node for node in launch.nodes if node.type in _NODES.get(algo, (algo,))]
    if not nodes:
        there = ", ".join(f"{node.package}/{node.type}" for node in launch.nodes) or "none"
        raise ConfigError(f"{path}: starts no node of {algo} (nodes: {there})")
    if len(nodes) > 1:
        log.warn(f"{path}: starts {len(nodes)} nodes of {algo}: {nodes[0].name} at line {nodes[0].line} is taken")
    return tuple(nodes[0].params.values()), {name.strip("/"): topic for name, topic in nodes[0].remaps.items()}


def _own(setting: Setting, algo: str) -> Setting:
    """Strip the node's name that a YAML file may put before its parameters."""
    parts = setting.name.split("/")
    while len(parts) > 1 and parts[0] in (*_NODES.get(algo, ()), algo, "ros__parameters"):
        parts = parts[1:]
    return Setting("/".join(parts), setting.value, setting.file, setting.line)


def parse_set(text: str) -> Setting:
    """Return what ``KEY=VALUE`` sets."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise ConfigError(f"--set {text!r}: write KEY=VALUE")
    return Setting(name.strip(), value.strip(), FROM_COMMAND_LINE, 0)


def _check(setting: Setting, known: Mapping[str, Declaration], log: RunLog) -> None:
    if setting.name not in known:
        raise ConfigError(unknown_name(setting.name, known, setting.source))
    entry = known[setting.name]
    try:
        convert(entry, setting.value)
    except ConfigError as error:
        raise ConfigError(f"{setting.source}: {error}") from error
    if not entry.effective:
        log.note(f"{setting.name} ({setting.source}) has no effect here: {entry.help}")
