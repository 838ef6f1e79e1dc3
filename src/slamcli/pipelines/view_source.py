# SPDX-License-Identifier: MIT
"""What a file or folder is that somebody wants to see, and where its picture goes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.formats.pbstream.container import is_pbstream
from slamcli.recordings.classic_log import has_classic_content
from slamcli.recordings.folders import find_layout
from slamcli.rtabmap.database.probing import is_database

_RECORDING_SUFFIXES = (".bag", ".mcap", ".db3")
_RECORDING_MAGIC = (b"#ROSBAG", b"\x89MCAP0", b"SQLite format 3")
_PICTURES = (".pgm", ".png", ".bmp")
_CLOUDS = (".ply", ".pcd")
OCTREES = (".bt", ".ot")


def find_kind(sources: Sequence[Path], *, several: bool = False) -> str:
    """Return what the sources are: result, map, cloud, state, database, trajectory or recording; `several` results may be.

    Raises
    ------
    UsageError
        If a source is missing, cannot be drawn, or they do not belong together.
    """
    if not sources:
        raise UsageError("nothing to draw: name a result folder, a map.yaml, a trajectory or a recording")
    kinds = [_kind(source) for source in sources]
    if len(set(kinds)) > 1:
        raise UsageError(f"{sources[0]} is a {kinds[0]} and {sources[1]} a {kinds[1]}: draw them one by one")
    if several and kinds[0] == "result":
        return kinds[0]
    if len(kinds) > 1 and kinds[0] in ("result", "map", "cloud", "state", "database"):
        together = "; -o FILE.pdf or .svg draws several results over each other" if kinds[0] == "result" else ""
        raise UsageError(f"one {kinds[0]} at a time; {len(kinds)} were given{together}")
    return kinds[0]


def default_output(source: Path, kind: str) -> Path:
    """Return where the picture goes if nobody says: ``view.png`` in a result folder, else ``NAME-view.png`` beside the source."""
    if kind == "result":
        return source / "view.png"
    resolved = source.resolve()
    return (
        resolved.parent / f"{resolved.stem}-view.png"
        if source.name in ("", ".", "..")
        else source.with_name(f"{source.stem}-view.png")
    )


def _kind(source: Path) -> str:
    if not source.exists():
        raise UsageError(f"{source}: no such file or folder")
    if source.is_dir():
        is_result = any((source / name).is_file() for name in ("run.json", "map.yaml", "trajectory.tum"))
        if (
            not is_result
            and not any(source.glob("*.db3*"))
            and not any(source.glob("*.mcap*"))
            and not any(source.glob("*.bag"))
            and find_layout(source) is None
        ):
            raise UsageError(
                f"{source}: neither a result (map.yaml, trajectory.tum) nor a recording lies in this folder"
            )
        return "result" if is_result else "recording"
    suffixes = [s.lower() for s in source.suffixes]
    last = suffixes[-1] if suffixes else ""
    if last in (".yaml", ".yml"):
        return "map"
    if is_pbstream(source):
        return "state"
    if is_database(source):
        return "database"
    if last in (*_CLOUDS, *OCTREES):
        return "cloud"
    if last in _PICTURES:
        raise UsageError(f"{source}: name the map's .yaml; the picture alone has no scale")
    if (
        last in _RECORDING_SUFFIXES
        or any(s in _RECORDING_SUFFIXES for s in suffixes[-2:])
        or _begins_as_recording(source)
        or has_classic_content(source)
    ):
        return "recording"
    return "trajectory"


def _begins_as_recording(source: Path) -> bool:
    try:
        with source.open("rb") as stream:
            return stream.read(16).startswith(_RECORDING_MAGIC)
    except OSError as error:
        raise UsageError(f"{source}: {error.strerror}") from error
