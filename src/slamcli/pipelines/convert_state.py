# SPDX-License-Identifier: MIT
"""A saved state to a trajectory file, or to a state of the newest version."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.formats.pbstream.node_poses import read_node_poses
from slamcli.formats.pbstream.reading import read_state
from slamcli.formats.pbstream.writing import write_state
from slamcli.formats.trajectories import WRITERS
from slamcli.pipelines.output_record import write_output_record
from slamcli.pipelines.trajectories import Source, parse_source
from slamcli.runtime import RunLog

_FORMATS = {".tum": "tum", ".txt": "tum", ".kitti": "kitti", ".csv": "euroc", ".pbstream": "pbstream"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StateConversion:
    """What was made of a state."""

    source: Path
    target: Path
    format: str
    """tum, kitti, euroc or pbstream."""
    poses: int
    """Number of nodes that were written."""
    size_bytes: int
    seconds: float


def convert_state(source: str, target: Path, log: RunLog) -> StateConversion:
    """Write the trajectory of a state, or the state anew, to a file that is named for its format.

    Parameters
    ----------
    source
        ``state.pbstream``, or ``state.pbstream:1`` for one of several trajectories.
    target
        ``.tum`` or ``.txt`` (TUM), ``.kitti``, ``.csv`` (EuRoC), or ``.pbstream`` (version 2, all trajectories).
    log
        Takes notes on what the state lacks.

    Raises
    ------
    FormatError
        If the source is no state, or a damaged one.
    UsageError
        If the target is named otherwise or is the source, or one of several trajectories must be chosen.
    """
    began = time.perf_counter()
    found = parse_source(source)
    kind = _FORMATS.get(target.suffix.lower())
    if kind is None:
        raise UsageError(f"{target}: a state becomes a trajectory (.tum, .kitti, .csv) or a state (.pbstream)")
    if target.resolve() == found.path.resolve():
        raise UsageError(f"{target}: source and target are the same")
    poses = (_rewrite if kind == "pbstream" else _write_poses(kind))(found.path, found.part, target, log)
    return recorded(found, target, kind, poses, began, log)


def recorded(found: Source, target: Path, kind: str, poses: int, began: float, log: RunLog) -> StateConversion:
    """Write the record of a conversion beside its target; return what was done. `began` is of `time.perf_counter`."""
    write_output_record(
        [target], command="convert", inputs=[found.path], parameters={"format": kind, "part": found.part or None},
        changed={}, summary={"poses": poses}, topics={}, duration_s=0.0, log=log,
    )  # fmt: skip
    return StateConversion(
        source=found.path, target=target, format=kind, poses=poses, size_bytes=target.stat().st_size,
        seconds=time.perf_counter() - began,
    )  # fmt: skip


def _rewrite(path: Path, part: str, target: Path, log: RunLog) -> int:
    if part:
        raise UsageError(f"{path}:{part}: a state is written with all its trajectories; name the file alone")
    state = read_state(path, log=log)
    write_state(target, state)
    return len(state.nodes)


def _write_poses(kind: str) -> Callable[[Path, str, Path, RunLog], int]:
    def write(path: Path, part: str, target: Path, log: RunLog) -> int:
        trajectory = read_node_poses(path, part, log=log)
        WRITERS[kind](target, trajectory)
        return len(trajectory)

    return write
