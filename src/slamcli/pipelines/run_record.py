# SPDX-License-Identifier: MIT
"""``run.json``: what was run on what, what came of it, and how long it took."""

from __future__ import annotations

import hashlib
import json
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from slamcli import __version__
from slamcli.pipelines.json_text import json_text, plain
from slamcli.pipelines.schemas import stamped
from slamcli.runtime import RunLog, peak_memory_bytes

_BLOCK = 1 << 20
_MANY_FILES = 20
_LIBRARIES = ("numpy", "numba", "scipy", "rosbags", "mcap")


def describe_inputs(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Return name, size and SHA-256 of each file; a folder counts as its files, in the order of their names.

    A folder of many files (a data set) is one entry: the number of its files, and the digest over their names and digests.
    """
    described: list[dict[str, Any]] = []
    for path in paths:
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        if len(files) > _MANY_FILES:
            described.append(_describe_folder(path, files))
        else:
            described += [{"name": f.name, "size_bytes": f.stat().st_size, "sha256": _digest(f)} for f in files]
    return described


def _describe_folder(folder: Path, files: Sequence[Path]) -> dict[str, Any]:
    digest = hashlib.sha256()
    for file in files:
        digest.update(f"{file.relative_to(folder).as_posix()} {_digest(file)}\n".encode())
    return {
        "name": folder.resolve().name,
        "files": len(files),
        "size_bytes": sum(file.stat().st_size for file in files),
        "sha256": digest.hexdigest(),
    }


def run_document(
    *,
    command: str,
    algo: str,
    parameters: Mapping[str, Any],
    changed: Mapping[str, Any],
    seed: int,
    jobs: int,
    inputs: Sequence[Mapping[str, Any]],
    topics: Mapping[str, Any],
    frames: Mapping[str, Any],
    log: RunLog,
    total_s: float,
    duration_s: float,
    summary: Mapping[str, Any],
    outputs: Sequence[str],
) -> dict[str, Any]:
    """Return the document; everything under ``timing`` and ``peak_memory_bytes`` may differ from run to run, nothing else may."""
    document = {
        "slamcli": __version__,
        "command": command,
        "algo": algo,
        "seed": seed,
        "inputs": list(inputs),
        "topics": dict(topics),
        "frames": dict(frames),
        "parameters": dict(parameters),
        "changed": dict(changed),
        "summary": dict(summary),
        "counts": dict(sorted(log.counts.items())),
        "warnings": list(log.warnings),
        "notes": list(log.notes),
        "versions": {"python": platform.python_version()} | {name: metadata.version(name) for name in _LIBRARIES},
        "outputs": sorted(outputs),
        "timing": {
            "stages_s": {name: round(seconds, 3) for name, seconds in log.seconds.items()},
            **(
                {"laps_s": {name: [round(one, 5) for one in laps] for name, laps in log.laps.items()}}
                if log.laps
                else {}
            ),
            "total_s": round(total_s, 3),
            "recording_s": round(duration_s, 3),
            "realtime_factor": round(duration_s / total_s, 2) if total_s > 0 else None,
            "jobs": jobs,
        },
        "peak_memory_bytes": peak_memory_bytes(),
    }
    return stamped("run", document)


def step_columns(steps: Mapping[str, NDArray[Any]]) -> dict[str, list[Any]]:
    """Return per-step statistics as lists; what is not finite is None."""
    return {
        name: [None if isinstance(value, float) and not math.isfinite(value) else value for value in column.tolist()]
        for name, column in steps.items()
    }


def to_json(document: Mapping[str, Any]) -> str:
    """Return the document as `json_text` does, a column of steps on one line."""
    text = json_text({name: value for name, value in document.items() if name != "steps"})
    if document.get("steps"):
        columns = ",\n".join(
            f"    {json.dumps(name)}: {json.dumps(plain(column), allow_nan=False)}"
            for name, column in document["steps"].items()
        )
        text = f'{text[:-2]},\n  "steps": {{\n{columns}\n  }}\n}}'
    return text + "\n"


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()
