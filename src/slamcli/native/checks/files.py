# SPDX-License-Identifier: MIT
"""Finds out what a native file configures and runs the checks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native.cartographer_launch import find_configuration
from slamcli.native.cartographer_lua import read_cartographer_lua
from slamcli.native.checks.cartographer import check_cartographer
from slamcli.native.checks.cartographer_topics import check_topics
from slamcli.native.checks.costmap import check_costmap
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, below, check_declared
from slamcli.native.checks.gmapping import check_gmapping
from slamcli.native.checks.map_yaml import check_map_yaml
from slamcli.native.checks.nav2 import check_nav2
from slamcli.native.checks.navigation import PLANNERS, check_amcl, check_move_base
from slamcli.native.checks.orbslam import check_orbslam
from slamcli.native.checks.rtabmap import check_rtabmap_ini, check_rtabmap_nodes
from slamcli.native.launch import LaunchNode, read_launch
from slamcli.native.nav2_yaml import is_nav2
from slamcli.native.opencv_yaml import is_opencv_yaml, read_opencv_yaml
from slamcli.native.orbslam_launch import find_settings, is_orbslam
from slamcli.native.ros_parameters.costmap import COSTMAP, LAYERS, PRE_HYDRO
from slamcli.native.ros_parameters.move_base import RECOVERIES
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.native.rtabmap_names import NODES, ODOMETRY_NODES, PACKAGES, type_of
from slamcli.native.rtabmap_nodes import launched_nodes, yaml_nodes
from slamcli.native.settings import Setting, merge, read_text, shipped_folders
from slamcli.parameters import Declaration

Check = Callable[..., Iterator[Finding]]
"""Takes the settings of a node."""
Nodes = Mapping[str, Check]
"""Checks of nodes by their type."""

# Executables by the package that has them, where a wrong package is a known mistake.
_PACKAGES = {
    "slam_gmapping": "gmapping",
    "map_server": "map_server",
    "map_saver": "map_server",
    "amcl": "amcl",
    "move_base": "move_base",
    "cartographer_node": "cartographer_ros",
    "cartographer_occupancy_grid_node": "cartographer_ros",
}
_COSTMAP_KEYS = {e.name for e in (*COSTMAP, *PRE_HYDRO)} | set(LAYERS) | {"footprint", "plugins"}


_MOVE_BASE = {"global_costmap", "local_costmap", *PLANNERS, *RECOVERIES, "base_local_planner", "recovery_behaviors"}

Tables = Mapping[str, tuple[Declaration, ...]]


def check_file(
    path: Path, tables: Tables, beams: int | None = None, range_m: float | None = None
) -> tuple[Finding, ...]:
    """Return what is wrong with one native file, in the order of its lines.

    Parameters
    ----------
    path
        A launch file (``.launch``, ``.xml``) or ROS parameter YAML, or a map's YAML, or a Lua file of Cartographer, or
        settings of ORB-SLAM, or an ``.ini`` file of RTAB-Map.
    tables
        The declarations of the tiers ``gmapping``, ``cartographer``, ``orbslam3`` and ``rtabmap``.
    beams
        The number of beams of the scanner that will be used, if known.
    range_m
        How far it sees, in metres, if known.
    """
    nodes: dict[str, Check] = {
        "amcl": partial(check_amcl, range_m=range_m),
        "move_base": partial(check_move_base, range_m=range_m),
        "nav2": partial(check_nav2, file=str(path), range_m=range_m),
    }

    def check_node(settings: Mapping[str, Setting]) -> Iterator[Finding]:
        yield from check_declared(settings, tables["gmapping"], "slam_gmapping")
        yield from check_gmapping(settings, beams)

    try:
        found = list(_check(path, {"slam_gmapping": check_node, **nodes}, tables))
    except ConfigError as error:
        return (_from_error(path, error),)
    unique = dict.fromkeys(found)
    return tuple(sorted(unique, key=lambda finding: (finding.file != str(path), finding.file, finding.line)))


def _check(path: Path, nodes: Nodes, tables: Tables) -> Iterator[Finding]:
    suffix = path.suffix.lower()
    if suffix in (".launch", ".xml"):
        return _check_launch(path, nodes, tables)
    if suffix in (".yaml", ".yml") and is_opencv_yaml(read_text(path)):
        return check_orbslam(str(path), read_opencv_yaml(path), tables["orbslam3"])
    if suffix in (".yaml", ".yml"):
        settings = merge(read_ros_yaml(path))
        found = yaml_nodes(settings.values())
        if any(_is_of_rtabmap(name, tables) for node in found for name in node.settings):
            return check_rtabmap_nodes(found, tables["rtabmap"], ros2=is_nav2(settings.values()))
        if is_nav2(settings.values()):
            return nodes["nav2"](settings)
        return _check_yaml(settings, path, nodes)
    if suffix == ".lua":
        return check_cartographer(read_cartographer_lua(path, shipped_folders()), tables["cartographer"])
    if suffix == ".ini":
        return check_rtabmap_ini(path, tables["rtabmap"])
    raise ConfigError(
        f"{path}: launch files (.launch, .xml), .yaml, .lua and .ini are checked, not {suffix or 'files without suffix'}"
    )


def _is_of_rtabmap(name: str, tables: Tables) -> bool:
    group, slash, rest = name.partition("/")
    return bool(slash and rest) and group in {
        entry.name.partition("/")[0] for entry in tables["rtabmap"] if "/" in entry.name
    }


def _from_error(path: Path, error: ConfigError) -> Finding:
    text = str(error)
    head, _, message = text.partition(": ")
    file, _, line = head.rpartition(":")
    if line.isdigit():
        return Finding(ERROR, file, int(line), message)
    return Finding(ERROR, str(path), 0, message if head == str(path) else text)


def _check_launch(path: Path, nodes: Nodes, tables: Tables) -> Iterator[Finding]:
    launch = read_launch(path)
    checks: dict[str, Check] = {**nodes, "move_base": partial(nodes["move_base"], whole=True)}
    for node in launch.nodes:
        yield from _check_package(node)
        if node.type in checks:
            yield from checks[node.type](node.params)
        elif node.type in ("cartographer_node", "cartographer_offline_node"):
            yield from _check_cartographer_node(node, tables)
        elif is_orbslam(node):
            yield from _check_orbslam_node(node, tables)
        elif type_of(node):
            continue
        elif node.params:
            yield Finding(NOTE, node.file, node.line, f"the parameters of {node.package}/{node.type} are not checked")
    of_rtabmap = launched_nodes(launch)
    if of_rtabmap:
        yield from check_rtabmap_nodes(of_rtabmap, tables["rtabmap"])
    for note in launch.notes:
        place, _, message = note.partition(": ")
        file, _, line = place.rpartition(":")
        yield Finding(NOTE, file, int(line), message)


def _check_cartographer_node(node: LaunchNode, tables: Tables) -> Iterator[Finding]:
    found = find_configuration(node, shipped_folders())
    for note in found.notes:
        yield Finding(NOTE, node.file, node.line, note.partition(": ")[2])
    file = read_cartographer_lua(found.path, (*found.folders, *shipped_folders()))
    yield from check_topics(node, file)
    yield from check_cartographer(file, tables["cartographer"])


def _check_orbslam_node(node: LaunchNode, tables: Tables) -> Iterator[Finding]:
    found = find_settings(node, shipped_folders())
    for note in found.notes:
        yield Finding(NOTE, node.file, node.line, note.partition(": ")[2])
    if found.path is None:
        yield Finding(WARNING, node.file, node.line, f"{node.type} is given no settings file")
        return
    remapped = " ".join(node.remaps)
    if "rgbd" in found.path.name.lower() and "left" in remapped:
        message = f"topics are those of a stereo camera, and {found.path.name} is named as settings of RGB-D"
        yield Finding(WARNING, node.file, node.line, message)
    yield from check_orbslam(str(found.path), read_opencv_yaml(found.path), tables["orbslam3"])


def _check_package(node: LaunchNode) -> Iterator[Finding]:
    right = _PACKAGES.get(node.type)
    if node.type in (*NODES, *ODOMETRY_NODES) and node.package not in PACKAGES:
        message = (
            f"{node.type} is in rtabmap_ros (in newer versions rtabmap_slam and rtabmap_odom), not in {node.package!r}"
        )
        yield Finding(ERROR, node.file, node.line, message)
    if right is not None and node.package != right:
        message = f"{node.type} is in package {right!r}: with pkg={node.package!r} roslaunch does not start it"
        yield Finding(ERROR, node.file, node.line, message)


def _check_yaml(settings: Mapping[str, Setting], path: Path, nodes: Nodes) -> Iterator[Finding]:
    settings = {name.removeprefix("move_base/"): setting for name, setting in settings.items()}
    heads = {name.partition("/")[0] for name in settings}
    if "amcl" in heads and len(heads) > 1:
        yield from nodes["amcl"](below(settings, "amcl"))
        settings = {name: setting for name, setting in settings.items() if not name.startswith("amcl/")}
        heads.discard("amcl")
    if not settings:
        yield Finding(NOTE, str(path), 0, "holds no parameters")
    elif "image" in heads and ("resolution" in heads or "occupied_thresh" in heads or "origin" in heads):
        yield from check_map_yaml(settings)
    elif heads & _MOVE_BASE:
        yield from nodes["move_base"](settings)
    elif heads <= {"amcl"}:
        yield from nodes["amcl"](below(settings, "amcl"))
    elif heads <= {"slam_gmapping"}:
        yield from nodes["slam_gmapping"](below(settings, "slam_gmapping"))
    else:
        yield from _guess(settings, heads, nodes, path)


def _guess(settings: Mapping[str, Setting], heads: set[str], nodes: Nodes, path: Path) -> Iterator[Finding]:
    """Take the reader that knows most of the names, if it knows half of them."""
    candidates: dict[str, tuple[Check, list[Finding]]] = {
        "costmap_2d": (lambda s: check_costmap(s, partial=True), []),
        "slam_gmapping": (nodes["slam_gmapping"], []),
        "amcl": (nodes["amcl"], []),
        "move_base": (nodes["move_base"], []),
    }
    scores = {}
    for name, (check, found) in candidates.items():
        found.extend(check(settings))
        scores[name] = sum("unknown parameter" in finding.message for finding in found)
    best = min(scores, key=lambda name: scores[name])
    if scores[best] * 2 > len(settings):
        yield Finding(NOTE, str(path), 0, f"not checked: no known node reads {', '.join(sorted(heads)[:3])}")
        return
    yield at(next(iter(settings.values())), NOTE, f"checked as parameters of {best}")
    yield from candidates[best][1]
