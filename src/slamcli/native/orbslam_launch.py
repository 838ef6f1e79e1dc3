# SPDX-License-Identifier: MIT
"""Which settings file and vocabulary a launch file gives to ORB-SLAM's node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native.launch import LaunchNode
from slamcli.native.orbslam_names import NODE_PACKAGES, NODES
from slamcli.native.settings import Setting

_SETTINGS = ("settings_path", "settings_file", "settings_file_path", "load_settings_file")
_VOCABULARY = ("voc_path", "voc_file", "vocabulary_path", "vocabulary_file", "voc_file_path")
MAP_FRAME = "world_frame_id"
_MAP_FRAMES = (MAP_FRAME, "map_frame_id", "map_frame")


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchedSettings:
    """What a node is given."""

    path: Path | None
    """The settings file; None where none is named."""
    settings: tuple[Setting, ...]
    """Vocabulary and frame, by slamcli's names."""
    notes: tuple[str, ...]
    """What was not followed."""


def is_orbslam(node: LaunchNode) -> bool:
    """Return whether a node of a launch file is one of ORB-SLAM's."""
    return node.type in NODES or node.package in NODE_PACKAGES


def find_settings(node: LaunchNode, shipped: Sequence[Path]) -> LaunchedSettings:
    """Return the settings file, the vocabulary and the map's frame of a node, by its parameters or its arguments.

    Parameters
    ----------
    node
        The node: parameters as those of the ROS wrappers, or the vocabulary and the settings as its two arguments.
    shipped
        Folders in which files are looked for after their place and the launch file's: a ROS package is seldom here.

    Raises
    ------
    ConfigError
        If the settings file that is named is nowhere.
    """
    place = f"{node.file}:{node.line}"
    params = dict(node.params)
    words = [word for word in node.args.split() if not word.startswith(("-", "__"))]
    wanted = _named(params, _SETTINGS) or (words[1] if len(words) > 1 else None)
    vocabulary = _named(params, _VOCABULARY) or (words[0] if words else None)
    frame = _named(params, _MAP_FRAMES)
    notes, settings = [], []
    path = None
    if wanted is not None:
        path = _find(wanted, node, shipped)
        if path is None:
            raise ConfigError(
                f"{place}: settings {wanted} are not here, nor is there a {Path(wanted).name} in {Path(node.file).parent}"
            )
        if path != Path(wanted):
            notes.append(f"{place}: {wanted} is not here: {path} is taken")
    if vocabulary is not None:
        found = _find(vocabulary, node, ())
        if found is None:
            notes.append(
                f"{place}: vocabulary {vocabulary} is not here: slamcli's own is used (--set slamcli.vocabulary=FILE)"
            )
        else:
            settings.append(Setting("slamcli.vocabulary", str(found), node.file, node.line))
    if frame is not None:
        settings.append(Setting(MAP_FRAME, frame, node.file, node.line))
    known = {*_SETTINGS, *_VOCABULARY, *_MAP_FRAMES}
    notes += [
        f"{setting.source}: {name} of {node.type} has no effect here"
        for name, setting in params.items()
        if name not in known
    ]
    return LaunchedSettings(path=path, settings=tuple(settings), notes=tuple(notes))


def _named(params: dict[str, Setting], names: Sequence[str]) -> str | None:
    return next((str(params[name].value) for name in names if name in params and str(params[name].value)), None)


def _find(wanted: str, node: LaunchNode, shipped: Sequence[Path]) -> Path | None:
    path, beside = Path(wanted), Path(node.file).parent
    places = (path, beside / path.name, *(folder / path.name for folder in shipped))
    return next((found for found in places if found.is_file()), None)
