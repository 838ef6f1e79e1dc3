# SPDX-License-Identifier: MIT
"""What ``slamcli sweep`` is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.recordings import Mends

Keep = Literal["all", "best", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """One recording that sets are tried on."""

    name: str
    """Of its folder among the runs; empty where there is only one."""
    inputs: tuple[Path, ...]
    """The recording's files."""
    reference: str | None = None
    """What its runs are scored against: a trajectory, a relations file, a map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRequest:
    """Which parameters of which system are tried on what, and how runs are judged."""

    algo: str
    subjects: Sequence[Subject]
    output: Path
    sets: Sequence[str]
    """``KEY=...`` as `slamcli.pipelines.sweep_axes.parse_axis` takes them; one value alone holds for all runs."""
    config_files: Sequence[Path] = ()
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    map_options: Sequence[str] = ()
    """Words of the command line of ``slamcli map`` for every run: topics, mends, the part of the recording."""
    draws: int | None = None
    """Random sets instead of the whole grid."""
    num_seeds: int = 1
    first_seed: int = 0
    jobs: int = 1
    """Threads of each run."""
    workers: int = 1
    """Runs at once."""
    objective: str | None = None
    """Key of the figure that sets are ranked by; None for that of the kind of reference."""
    maximise: bool | None = None
    """Whether larger is better; None where the figure's name says it."""
    least_coverage: float = 0.8
    """A run that covers less than this share of what the best run covers has failed."""
    keep: Keep = "best"
    sensors: SensorRequest = field(default_factory=SensorRequest)
    """The same as in `map_options`, for figures that read the recording themselves."""
    mends: Mends = field(default_factory=Mends)
    """Likewise."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers run the runs."""
    memory_limit_bytes: int | None = None
    """Most memory of one run."""
    command: str = ""
    """The command line that asks for this, for the record."""

    @property
    def seeds(self) -> range:
        """The seeds that every set is run with."""
        return range(self.first_seed, self.first_seed + self.num_seeds)
