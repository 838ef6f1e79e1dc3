# SPDX-License-Identifier: MIT
"""ROS launch files: which nodes they would start, with which parameters and remappings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native._launch_walker import Walker
from slamcli.native.settings import Setting


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchNode:
    """A node that a launch file would start."""

    package: str
    type: str
    name: str
    namespace: str
    args: str
    params: Mapping[str, Setting]
    """Its private parameters by name without the node's own, later ones winning."""
    remaps: Mapping[str, str]
    file: str
    line: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Launch:
    """What a launch file says, its includes followed."""

    nodes: tuple[LaunchNode, ...]
    params: Mapping[str, Setting]
    """Parameters outside of nodes, by full name without the leading slash."""
    arguments: Mapping[str, str]
    """The file's own arguments with the values they got."""
    notes: tuple[str, ...]
    """What was skipped and why: includes that are not here, commands that are not run."""

    def find(self, *kinds: str) -> tuple[LaunchNode, ...]:
        """Return the nodes whose type or package is one of `kinds`."""
        return tuple(node for node in self.nodes if node.type in kinds or node.package in kinds)


def read_launch(
    path: Path, arguments: Mapping[str, str] | None = None, packages: Mapping[str, Path] | None = None
) -> Launch:
    """Return what a launch file says.

    Parameters
    ----------
    path
        The file. Includes and parameter files are followed; one in a package that is not found is looked for by its
        base name beside the file that names it, and skipped with a note if it is not there.
    arguments
        Values of its arguments, over their defaults (``name:=value`` of roslaunch).
    packages
        Folders of ROS packages for ``$(find pkg)``.

    Raises
    ------
    ConfigError
        If a file cannot be read or is not a launch file; the message has file and line.
    """
    walker = Walker(packages or {})
    own = walker.read(Path(path), dict(arguments or {}))
    unknown = sorted(set(arguments or {}) - set(own))
    if unknown:
        raise ConfigError(f"{path}: has no argument {unknown[0]!r}; it has {', '.join(sorted(own)) or 'none'}")
    nodes = tuple(
        LaunchNode(
            package=node.package,
            type=node.type,
            name=node.name,
            namespace=node.namespace,
            args=node.args,
            params=walker.private(node),
            remaps=dict(node.remaps),
            file=node.file,
            line=node.line,
        )
        for node in walker.nodes
    )
    inside = [node.full_name + "/" for node in walker.nodes]
    outside = {k: v for k, v in walker.params.items() if not any(k.startswith(prefix) for prefix in inside)}
    return Launch(nodes=nodes, params=outside, arguments=own, notes=tuple(walker.notes))


def plain(settings: Mapping[str, Setting]) -> dict[str, Any]:
    """Return the values of settings by name."""
    return {name: setting.value for name, setting in settings.items()}
