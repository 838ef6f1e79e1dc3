# SPDX-License-Identifier: MIT
"""ROS 2 bag folders: which files belong to them, and how they are compressed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from slamcli.errors import RecordingError
from slamcli.recordings.containers.damage import Damage

_MAX_METADATA_BYTES = 64 << 20
STORAGE_SUFFIXES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Folder(NamedTuple):
    """What a bag folder says of itself."""

    files: tuple[Path, ...]
    compressed_messages: bool
    compression: str


def read_folder(folder: Path, damage: Damage) -> Folder:
    """Return the storage files of a ROS 2 bag folder, by its ``metadata.yaml`` or, without one, by their names.

    Raises
    ------
    RecordingError
        If there is no storage file in it.
    """
    metadata = _read_metadata(folder, damage)
    files: list[Path] = []
    for name in _strings(metadata.get("relative_file_paths")):
        path = next((p for p in _candidates(folder, name) if p.is_file()), None)
        if path is None:
            damage.add(f"{folder}: the file {name!r} that its metadata.yaml names is missing")
        else:
            files.append(path)
    if not files:
        files = sorted((p for p in folder.iterdir() if p.name.endswith(STORAGE_SUFFIXES) and p.is_file()), key=_natural)
        if not files:
            raise RecordingError(_nothing_in(folder))
    mode = str(metadata.get("compression_mode") or "").lower()
    compression = str(metadata.get("compression_format") or "").lower()
    return Folder(tuple(files), mode == "message" and bool(compression), compression if mode else "")


def _read_metadata(folder: Path, damage: Damage) -> dict[str, Any]:
    path = folder / "metadata.yaml"
    if not path.is_file():
        return {}
    try:
        if path.stat().st_size > _MAX_METADATA_BYTES:
            raise ValueError("it is too large")  # noqa: TRY301
        document = yaml.load(path.read_bytes(), Loader=_LOADER)  # noqa: S506 (a safe loader)
        information = document["rosbag2_bagfile_information"]
        if not isinstance(information, dict):
            raise TypeError("rosbag2_bagfile_information is no mapping")  # noqa: TRY301
    except (OSError, yaml.YAMLError, ValueError, TypeError, KeyError, RecursionError, AttributeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        damage.add(f"{path}: cannot be understood ({reason}); the files beside it are read as they are")
        return {}
    return information


def _candidates(folder: Path, name: str) -> tuple[Path, ...]:
    # Early versions wrote the folder's name in front.
    plain = folder / Path(name).name
    return (folder / name, plain, plain.with_name(plain.name + ".zstd"))


def _strings(value: Any) -> list[str]:
    return [item for item in value if isinstance(item, str)] if isinstance(value, list) else []


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", path.name)]


def _nothing_in(folder: Path) -> str:
    bags = sorted(p.name for p in folder.iterdir() if p.suffix in (".bag", ".mcap", ".db3", ".clf", ".log"))
    near = f"; name one of its files: {', '.join(bags[:4])}" if bags else ""
    return f"{folder}: no ROS 2 bag folder: neither .db3 nor .mcap files lie in it{near}"
