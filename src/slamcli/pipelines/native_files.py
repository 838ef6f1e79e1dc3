# SPDX-License-Identifier: MIT
"""Reads a system's own files for one tier: launch files, parameter YAML, Lua."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native import Launch, LaunchNode, Setting, is_preset, read_cartographer_lua, read_launch, read_ros_yaml
from slamcli.native.cartographer_launch import find_configuration
from slamcli.native.opencv_yaml import read_opencv_yaml
from slamcli.native.orbslam_launch import find_settings
from slamcli.native.orbslam_names import NODE_PACKAGES, NODES, renamed
from slamcli.native.settings import shipped_folders
from slamcli.parameters import Declaration
from slamcli.pipelines.rtabmap_files import read_rtabmap
from slamcli.runtime import RunLog

CARTOGRAPHER = "cartographer"
ORBSLAM3 = "orbslam3"
RTABMAP = "rtabmap"
AMCL = "amcl"
# Nodes of a launch file that a tier stands for, by their type.
_NODES = {
    "gmapping": ("slam_gmapping",),
    CARTOGRAPHER: ("cartographer_node", "cartographer_offline_node"),
    ORBSLAM3: (*NODES, *NODE_PACKAGES),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeFile:
    """What one file says to one tier."""

    settings: Sequence[Setting]
    remaps: Mapping[str, str] = field(default_factory=dict)
    """Topics by the names that the node gives them."""


def read_native(
    algo: str, path: Path, log: RunLog, arguments: Mapping[str, str], known: Mapping[str, Declaration]
) -> NativeFile:
    """Return what a native file says to a tier.

    Parameters
    ----------
    algo
        Name of the tier.
    path
        The file; its suffix says what it is.
    log
        Gets a note for what was skipped, and a warning for what does not do what it seems to.
    arguments
        Values for the arguments of a launch file.
    known
        The tier's declarations by native name.

    Raises
    ------
    ConfigError
        If the file cannot be read or holds nothing for this tier.
    """
    suffix = path.suffix.lower()
    if algo == RTABMAP:
        settings, remaps = read_rtabmap(path, log, arguments, known)
        return NativeFile(settings=settings, remaps=remaps)
    if suffix in (".launch", ".xml"):
        return _read_launch(algo, path, log, arguments, known)
    if algo == CARTOGRAPHER:
        if suffix == ".lua":
            return NativeFile(settings=_read_lua(path, (), log, known))
        raise ConfigError(f"{path}: {algo} reads Lua files (.lua) and launch files (.launch, .xml)")
    if algo == ORBSLAM3:
        if suffix in (".yaml", ".yml"):
            return NativeFile(settings=_read_settings(path, log))
        raise ConfigError(f"{path}: {algo} reads settings (.yaml) and launch files (.launch, .xml)")
    if suffix in (".yaml", ".yml"):
        return NativeFile(settings=[_own(setting, algo) for setting in _read_yaml(algo, path, log)])
    hint = f"; Lua files are for --algo {CARTOGRAPHER}" if suffix == ".lua" else ""
    raise ConfigError(f"{path}: {algo} reads launch files (.launch, .xml) and parameter files (.yaml){hint}")


def _read_launch(
    algo: str, path: Path, log: RunLog, arguments: Mapping[str, str], known: Mapping[str, Declaration]
) -> NativeFile:
    launch = read_launch(path, arguments)
    for note in launch.notes:
        log.note(note)
    nodes = _nodes_of(algo, launch)
    if not nodes:
        there = ", ".join(f"{node.package}/{node.type}" for node in launch.nodes) or "none"
        raise ConfigError(f"{path}: starts no node of {algo} (nodes: {there})")
    if len(nodes) > 1:
        log.warn(f"{path}: starts {len(nodes)} nodes of {algo}: {nodes[0].name} at line {nodes[0].line} is taken")
    node = nodes[0]
    settings = tuple(node.params.values())
    if algo == CARTOGRAPHER:
        settings = _launched_lua(node, log, known)
    elif algo == ORBSLAM3:
        settings = _launched_settings(node, log)
    return NativeFile(settings=settings, remaps={name.strip("/"): topic for name, topic in node.remaps.items()})


def starts_node(algo: str, launch: Launch) -> bool:
    """Whether a launch file starts a node that a tier stands for."""
    return bool(_nodes_of(algo, launch))


def _nodes_of(algo: str, launch: Launch) -> list[LaunchNode]:
    own = _NODES.get(algo, (algo,))
    return [node for node in launch.nodes if node.type in own or node.package in own]


def _launched_lua(node: LaunchNode, log: RunLog, known: Mapping[str, Declaration]) -> tuple[Setting, ...]:
    """Return what the Lua file sets that a launch file names in the arguments of a node."""
    found = find_configuration(node, shipped_folders())
    for note in found.notes:
        log.note(note)
    for name in node.params:
        log.note(f"{node.file}:{node.line}: {node.type} reads no parameter {name!r}")
    return _read_lua(found.path, found.folders, log, known)


def _launched_settings(node: LaunchNode, log: RunLog) -> tuple[Setting, ...]:
    """Return what the settings file says that a launch file names, and the node's own parameters."""
    found = find_settings(node, shipped_folders())
    for note in found.notes:
        log.note(note)
    return (*(_read_settings(found.path, log) if found.path is not None else ()), *found.settings)


def _read_settings(path: Path, log: RunLog) -> tuple[Setting, ...]:
    """Return the entries of ORB-SLAM's settings under their names in schema 1.0."""
    settings = [renamed(setting) for setting in read_opencv_yaml(path)]
    for i, setting in enumerate(settings):
        # What the original does with it, instead of dividing by 0.
        if setting.name == "RGBD.DepthMapFactor" and setting.value == 0:
            log.warn(f"{setting.source}: DepthMapFactor 0 is taken as 1, as ORB-SLAM3 does")
            settings[i] = dataclasses.replace(setting, value=1.0)
    return tuple(settings)


def _read_lua(
    path: Path, folders: Sequence[Path], log: RunLog, known: Mapping[str, Declaration]
) -> tuple[Setting, ...]:
    """Return what a Lua file sets, without the defaults that it includes."""
    found = read_cartographer_lua(path, (*folders, *shipped_folders()))
    for misfit in found.misfits:
        log.warn(f"{path}: {misfit.message}")
    for setting in found.settings:
        entry = known.get(setting.name)
        if entry is not None and entry.kind is bool and not isinstance(setting.value, bool):
            raise ConfigError(
                f"{setting.source}: {setting.name}={setting.value!r}: write true or false, without quotes"
            )
    return tuple(
        setting
        for setting in found.settings
        if not (is_preset(setting.file) and setting.name in known and setting.value == known[setting.name].default)
    )


def _read_yaml(algo: str, path: Path, log: RunLog) -> Sequence[Setting]:
    """Return the parameters of a YAML file; of one of nav2's those of amcl, for amcl."""
    settings = read_ros_yaml(path)
    if algo != AMCL:
        return settings
    from slamcli.native.nav2_yaml import is_nav2, translate_nav2  # what it knows of planners takes long to import

    if not is_nav2(settings):
        return settings
    translated = translate_nav2(setting for setting in settings if setting.name.startswith(f"{AMCL}/"))
    for note in translated.notes:
        log.note(f"{path}: {note}")
    if not translated.settings:
        raise ConfigError(f"{path}: says nothing to amcl")
    return translated.settings


def _own(setting: Setting, algo: str) -> Setting:
    """Strip the node's name that a YAML file may put before its parameters."""
    parts = setting.name.split("/")
    while len(parts) > 1 and parts[0] in (*_NODES.get(algo, ()), algo, "ros__parameters"):
        parts = parts[1:]
    return dataclasses.replace(setting, name="/".join(parts))
