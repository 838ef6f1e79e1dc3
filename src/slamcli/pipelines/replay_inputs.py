# SPDX-License-Identifier: MIT
"""The record of a run, and where the recording of its result lies by it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli.runtime import RunLog

_NO_RECORDINGS = (".pbstream", ".npz", ".db")
"""What a run reads besides: saved states, atlases, memories."""
_CONTAINER = "metadata.yaml"
_MOST_FOLDERS = 1000
_MAX_RUN_JSON_BYTES = 64 << 20


def read_run(path: Path, log: RunLog) -> dict[str, Any]:
    """Return the record of a run, empty with a warning if it is none, and without one if it is not there."""
    if not path.is_file():
        return {}
    try:
        with path.open("rb") as stream:
            data = stream.read(_MAX_RUN_JSON_BYTES + 1)
        run = json.loads(data) if len(data) <= _MAX_RUN_JSON_BYTES else None
    except (OSError, ValueError, RecursionError) as error:
        log.warn(f"{path} cannot be read and is left out: {error}")
        return {}
    if not isinstance(run, dict):
        log.warn(f"{path} is not a run record and is left out")
        return {}
    return run


def find_recording(folder: Path, run: Mapping[str, Any]) -> tuple[Path, ...]:
    """Return the files or folders that a result was made of, empty where one is missing.

    They are looked for beside the result, in it, and in the current folder; a bag that is a folder also one level below. Names and
    sizes must be those of the record; contents are not compared.
    """
    wanted = _entries(run)
    if not wanted:
        return ()
    for place in _places(folder, wanted):
        found = [_fitting(place / entry["name"], entry) for entry in wanted]
        if all(found):
            is_folder = any(entry["name"] == _CONTAINER for entry in wanted)
            return (place,) if is_folder else tuple(place / entry["name"] for entry in wanted)
    return ()


def find_known_map(folder: Path, run: Mapping[str, Any]) -> Path | None:
    """Return the map.yaml that a run was given (``slamcli localize``), looked for as its recording is; None where there is none."""
    entries = run.get("inputs")
    for entry in entries if isinstance(entries, list) else ():
        if (
            isinstance(entry, dict)
            and isinstance(name := entry.get("name"), str)
            and _is_plain(name)
            and _is_map(entry)
        ):
            return next((place / name for place in _places(folder, [entry]) if _same(place / name, entry)), None)
    return None


def input_names(run: Mapping[str, Any]) -> list[str]:
    """Return the names of the files that a result was made of."""
    return [str(entry["name"]) for entry in _entries(run)]


def _entries(run: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    command = run.get("command")
    if isinstance(command, str) and command.split()[1:2] in (["navigate"], ["explore"]):
        return []  # what a simulated robot was given is no recording
    entries = run.get("inputs")
    found = [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []
    named = [entry for entry in found if isinstance(entry.get("name"), str) and _is_plain(entry["name"])]
    return [entry for entry in named if not entry["name"].endswith(_NO_RECORDINGS) and not _is_map(entry)]


def _is_map(entry: Mapping[str, Any]) -> bool:
    return bool(entry["name"].endswith(".yaml") and entry["name"] != _CONTAINER)


def _is_plain(name: str) -> bool:
    """Return whether a name is one and no path that leads elsewhere."""
    return bool(name) and Path(name).name == name


def _places(folder: Path, wanted: Sequence[Mapping[str, Any]]) -> Iterator[Path]:
    near = list(dict.fromkeys(path.resolve() for path in (folder.resolve().parent, folder, Path())))
    yield from near
    if any("files" in entry for entry in wanted):
        return
    for place in near:
        below = sorted(path for path in place.iterdir() if path.is_dir()) if place.is_dir() else []
        yield from below[:_MOST_FOLDERS]


def _same(path: Path, entry: Mapping[str, Any]) -> bool:
    """Return whether a file has size and content of the record: maps are often of one name and of one size."""
    return _fitting(path, entry) and hashlib.sha256(path.read_bytes()).hexdigest() == entry.get("sha256")


def _fitting(path: Path, entry: Mapping[str, Any]) -> bool:
    """Return whether a file, or a folder of many, has the size that is told of it."""
    if "files" in entry:
        if not path.is_dir():
            return False
        files = [file for file in path.rglob("*") if file.is_file()]
        return len(files) == entry["files"] and sum(file.stat().st_size for file in files) == entry.get("size_bytes")
    return path.is_file() and path.stat().st_size == entry.get("size_bytes")
