# SPDX-License-Identifier: MIT
"""What RTAB-Map's ROS nodes are given: by a launch file, its arguments, or parameter YAML."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from slamcli.native.launch import Launch, LaunchNode
from slamcli.native.rtabmap_names import NODES, ODOMETRY_NODES, type_of
from slamcli.native.settings import Setting, merge

MAPPING_GROUPS = ("Rtabmap", "Mem", "Kp", "RGBD", "Bayes", "VhEp", "Grid", "GridGlobal", "Marker", "DbSqlite3")
"""Groups that odometry nodes do not read."""
CONFIG_PATH = "config_path"
_FRESH = {"-d", "--delete_db_on_start"}
_TOPICS = {
    "rgb/image": "subscribe_rgb",
    "depth/image": "subscribe_depth",
    "left/image_rect": "subscribe_stereo",
    "right/image_rect": "subscribe_stereo",
    "scan": "subscribe_scan",
    "scan_cloud": "subscribe_scan_cloud",
    "odom": "subscribe_odom",
}
"""What switches a topic of the node on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeGiven:
    """What one node is given."""

    type: str
    """``rtabmap`` or one of `ODOMETRY_NODES`."""
    settings: Mapping[str, Setting]
    """Parameters by name: RTAB-Map's own (``Kp/MaxFeatures``) and the node's."""
    remaps: Mapping[str, str] = field(default_factory=dict)
    file: str = ""
    line: int = 0
    deletes_database: bool = False
    """Whether its arguments say so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Combined:
    """What the nodes of one system say together."""

    settings: tuple[Setting, ...]
    """Later ones win."""
    remaps: Mapping[str, str]
    """Of topics that are subscribed to."""
    notes: tuple[str, ...]


def launched_nodes(launch: Launch) -> tuple[NodeGiven, ...]:
    """Return RTAB-Map's nodes of a launch file with their parameters, those of their arguments included."""
    return tuple(
        NodeGiven(
            type=type_of(node),
            settings=merge([*node.params.values(), *_arguments(node)]),
            remaps={name.strip("/"): topic for name, topic in node.remaps.items()},
            file=node.file,
            line=node.line,
            deletes_database=not _FRESH.isdisjoint(node.args.split()),
        )
        for node in launch.nodes
        if type_of(node)
    )


def yaml_nodes(settings: Iterable[Setting]) -> tuple[NodeGiven, ...]:
    """Return the nodes that parameter YAML is for: by ROS 2's ``node: ros__parameters:``, by name, else ``rtabmap``."""
    found: dict[str, list[Setting]] = {}
    for setting in settings:
        node, name = _addressed(setting.name)
        found.setdefault(node, []).append(dataclasses.replace(setting, name=name))
    return tuple(
        NodeGiven(type=node, settings=merge(own), file=own[0].file, line=own[0].line) for node, own in found.items()
    )


def combine(nodes: Sequence[NodeGiven]) -> Combined:
    """Return what the nodes say together: the mapping node's values over those of the odometry node.

    The odometry node's own groups are taken from it, and of the groups that both read what the mapping node leaves open.
    A launch file that starts an odometry node wants odometry computed, not read from the recording.
    """
    mapping = [node for node in nodes if node.type in NODES]
    odometry = [node for node in nodes if node.type in ODOMETRY_NODES]
    notes = [
        f"{extra.file}:{extra.line}: another {extra.type} node is left out, one is taken"
        for extra in (*mapping[1:], *odometry[1:])
    ]
    settings: list[Setting] = []
    for node in odometry[:1]:
        settings += _of_odometry(node, mapping[:1], notes)
    if mapping:
        settings += mapping[0].settings.values()
    if mapping and odometry:
        own = odometry[0]
        settings.append(Setting("subscribe_odom", False, own.file, own.line))
        by_scans = own.type == "icp_odometry"
        settings += [Setting("slamcli.odometry", "scan", own.file, own.line)] if by_scans else []
        way = "computed from scans" if by_scans else "computed (--odom-topic takes the recording's)"
        notes.append(f"{own.file}:{own.line}: {own.type} is started: odometry is {way}")
    settings += _of_bundled_images(settings)
    remaps = {name: topic for node in (*odometry[:1], *mapping[:1]) for name, topic in node.remaps.items()}
    values = {setting.name: setting.value for setting in settings}
    return Combined(
        settings=tuple(settings),
        remaps={
            name: topic for name, topic in remaps.items() if name not in _TOPICS or _subscribed(_TOPICS[name], values)
        },
        notes=tuple(notes),
    )


def _of_odometry(node: NodeGiven, mapping: Sequence[NodeGiven], notes: list[str]) -> Iterator[Setting]:
    """Yield what the odometry node says that has a meaning here."""
    theirs = mapping[0].settings if mapping else {}
    unread, shared = [], []
    for name, setting in node.settings.items():
        group, slash, _ = name.partition("/")
        if group in MAPPING_GROUPS:
            unread += [] if name in theirs else [name]
        elif slash and name not in theirs:
            shared += [name] if mapping and not group.startswith("Odom") else []
            yield setting
        elif name in ("frame_id", "approx_sync_max_interval") and name not in theirs:
            yield setting
    if unread:
        notes.append(f"{node.file}:{node.line}: {node.type} does not read {', '.join(unread)}: left out")
    if shared:
        notes.append(f"{node.file}:{node.line}: {', '.join(shared)} of {node.type}: for loop closures too")


def _of_bundled_images(settings: Sequence[Setting]) -> Iterator[Setting]:
    """Yield that colour and depth are taken where the node takes both in one message; recordings hold them apart."""
    for setting in settings:
        if setting.name == "subscribe_rgbd" and _true(setting.value):
            yield from (
                dataclasses.replace(setting, name=name, value=True) for name in ("subscribe_depth", "subscribe_rgb")
            )


def _subscribed(switch: str, values: Mapping[str, Any]) -> bool:
    """Return whether the mapping node takes a kind of topic; it takes odometry from transforms if their frame is named."""
    if switch == "subscribe_odom":
        return values.get(switch) is not False and not values.get("odom_frame_id")
    depth = _true(values.get("subscribe_depth", not _true(values.get("subscribe_stereo", False))))
    defaults = {"subscribe_depth": depth, "subscribe_rgb": depth or _true(values.get("subscribe_scan_cloud", False))}
    return _true(values.get(switch, defaults.get(switch, False)))


def _true(value: Any) -> bool:
    return str(value).strip().lower() in ("true", "1")


def _arguments(node: LaunchNode) -> Iterator[Setting]:
    """Yield the parameters among a node's arguments: ``--Kp/MaxFeatures 500``."""
    words = node.args.split()
    for word, value in itertools.pairwise(words):
        if word.startswith("--") and "/" in word:
            text = value.strip("\"'")
            yield Setting(word[2:], text.replace(",", " ") if word.endswith("Ratios") else text, node.file, node.line)


def _addressed(name: str) -> tuple[str, str]:
    """Return the type of the node that a name in YAML is for, and its name there."""
    before, ros2, after = name.partition("ros__parameters/")
    parts = before.strip("/").split("/") if ros2 else name.split("/")
    known = (*NODES, *ODOMETRY_NODES)
    node = next((part for part in parts if part in known), "rtabmap")
    if ros2:
        return node, after
    while len(parts) > 1 and parts[0] in (*known, "**"):
        parts = parts[1:]
    return node, "/".join(parts)
