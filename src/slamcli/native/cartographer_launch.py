# SPDX-License-Identifier: MIT
"""Which Lua file a launch file gives to Cartographer's node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native.launch import LaunchNode

_DIRECTORY, _BASENAME, _BASENAMES = "configuration_directory", "configuration_basename", "configuration_basenames"
_OTHER = {
    "load_state_filename": "give the state by --load-state",
    "load_frozen_state": "give the state by --load-state",
    "save_state_filename": "write the state by --save-state",
    "bag_filenames": "name the recordings on the command line",
    "urdf_filenames": "mounts come from the recording's transforms",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchedConfiguration:
    """The Lua file of a node and where its includes are looked for."""

    path: Path
    folders: tuple[Path, ...]
    notes: tuple[str, ...]
    """What of the node's arguments was not followed."""


def find_configuration(node: LaunchNode, shipped: Sequence[Path]) -> LaunchedConfiguration:
    """Return the configuration of a ``cartographer_node`` from its arguments.

    Parameters
    ----------
    node
        The node of a launch file.
    shipped
        Folders in which the file is looked for after its directory and the launch file's: a ROS package is seldom here.

    Raises
    ------
    ConfigError
        If the arguments name no file, or it is nowhere.
    """
    flags = _flags(node.args)
    place = f"{node.file}:{node.line}"
    basename = flags.get(_BASENAME) or flags.get(_BASENAMES, "").split(",")[0]
    if not basename:
        raise ConfigError(f"{place}: {node.type} has no argument -{_BASENAME}: which Lua file is it?")
    directory = Path(flags.get(_DIRECTORY, ""))
    beside = Path(node.file).parent
    wanted = directory / basename
    notes = [f"{place}: -{name} is not followed: {what}" for name, what in _OTHER.items() if name in flags]
    if "," in flags.get(_BASENAMES, ""):
        notes.append(f"{place}: of -{_BASENAMES} the first is taken: {basename}")
    folders = [folder for folder in (directory, beside / directory, beside, *shipped) if str(folder) != "."]
    for folder in folders:
        if (folder / basename).is_file():
            if folder != directory:
                notes.append(f"{place}: {wanted} is not here: {folder / basename} is taken")
            return LaunchedConfiguration(path=folder / basename, folders=(folder,), notes=tuple(notes))
    raise ConfigError(f"{place}: {wanted} is not here, nor is there a {basename} in {beside}")


def _flags(arguments: str) -> dict[str, str]:
    """Return the values of command line flags: ``-name value``, ``--name value``, ``-name=value``."""
    words = arguments.split()
    flags: dict[str, str] = {}
    for i, word in enumerate(words):
        if not word.startswith("-"):
            continue
        name, equals, value = word.lstrip("-").partition("=")
        follows = words[i + 1] if i + 1 < len(words) and not words[i + 1].startswith("-") else ""
        flags[name] = value if equals else follows
    return flags
