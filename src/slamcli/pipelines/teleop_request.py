# SPDX-License-Identifier: MIT
"""What a drive by hand is asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.native.settings import find_native
from slamcli.outputs import check_file
from slamcli.pipelines.generate import check_outputs, record_beside
from slamcli.pipelines.live_slam import files_of_tier
from slamcli.recordings.containers import create_raw
from slamcli.simulation.builtin import find_world

_LONGEST_S = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class TeleopRequest:
    """Where to drive, with what, and what to leave behind."""

    world: str
    """A world file, a map.yaml or the name of a built-in world."""
    path: Path
    """The recording: its suffix says the format."""
    start: tuple[float, float, float] | None = None
    """x, y (metres) and yaw (radians) in the map; None: the world's own."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Values of `SimulationParameters` by native name; they win over the world's."""
    seed: int = 0
    max_time_s: float | None = None
    """Simulated seconds after which the drive ends by itself; None: never."""
    truth: Path | None = None
    """TUM file for the true pose at every scan."""
    map_path: Path | None = None
    """map.yaml for the map: the one that `slam` made, or the true one."""
    slam: str | None = None
    """The tier that makes a map while the robot is driven."""
    slam_files: tuple[Path, ...] = ()
    slam_sets: tuple[str, ...] = ()
    """``KEY=VALUE`` with native keys of that tier."""
    script: Path | None = None
    """The file of velocities, for the record."""
    command: str = "teleop"
    """The command line that asks for this, for the record."""

    @property
    def record(self) -> Path:
        """The run's record, the recording's name with ``.run.json``."""
        return record_beside(self.path)

    @property
    def native_files(self) -> tuple[Path, ...]:
        """`slam_files` where they lie: a name that is no file means one that slamcli brings along."""
        return tuple(find_native(file) for file in self.slam_files)


def check_request(request: TeleopRequest) -> None:
    """Refuse what could not be done or written, before anybody drives.

    Raises
    ------
    UsageError
        With the reason.
    """
    limit = request.max_time_s
    if request.slam is not None:
        for file in request.native_files:
            if not files_of_tier(request.slam, [file]):
                raise UsageError(f"--config {file}: says nothing to {request.slam}")
    if limit is not None and not 0.0 < limit <= _LONGEST_S:
        raise UsageError(f"--max-time {limit:g} s: give seconds above 0 and up to {_LONGEST_S:g}")
    if request.start is not None and not all(map(math.isfinite, request.start)):
        raise UsageError(f"start {request.start}: not finite")
    if request.slam is None and (request.slam_files or request.slam_sets):
        raise UsageError("--config and --slam-set are about the system that maps: give --slam too")
    image = None if request.map_path is None else request.map_path.with_suffix(".pgm")
    outputs = (request.path, request.record, request.truth, request.map_path, image)
    check_outputs(find_world(request.world), *outputs)
    inputs = {p.resolve() for p in (request.script, *request.native_files) if p is not None}
    for target in outputs:
        if target is not None and target.resolve() in inputs:
            raise UsageError(f"{target} is read: name another file for the output")
    create_raw(request.path)
    for target in outputs[1:] if not request.path.suffix else outputs:
        if target is not None:
            check_file(target)
