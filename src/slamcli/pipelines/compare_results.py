# SPDX-License-Identifier: MIT
"""What is compared, once it is there: runs as jobs in processes of their own, and folders that are there already."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import SlamcliError
from slamcli.formats.maps import read_map
from slamcli.grids import OccupancyGrid
from slamcli.mapper import find_tier
from slamcli.pipelines.compare_request import CompareRequest, Entrant
from slamcli.pipelines.consistency import read_run, result_trajectory
from slamcli.pipelines.jobs import Job, JobOutcome, run_jobs
from slamcli.recordings.tier_fit import TierFit
from slamcli.trajectory import Trajectory

RAN, GIVEN, FAILED, CANNOT = "ran", "given", "failed", "cannot run"
_OWN_BYTES = 1e6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Compared:
    """One entrant and what came of it."""

    entrant: Entrant
    state: str
    """``ran``, ``given`` (a finished result), ``failed`` or ``cannot run``."""
    message: str = ""
    """Why it failed or cannot run."""
    folder: Path | None = None
    """Where its result lies."""
    run: Mapping[str, Any] = field(default_factory=dict)
    """Its ``run.json``."""
    trajectory: Trajectory | None = None
    grid: OccupancyGrid | None = None
    outcome: JobOutcome | None = None

    @property
    def name(self) -> str:
        """The entrant's name."""
        return self.entrant.name

    @property
    def there(self) -> bool:
        """Whether there is a result."""
        return self.trajectory is not None

    def costs(self) -> dict[str, float]:
        """Return time, memory and sizes, as far as they are known."""
        timing = self.run.get("timing") or {}
        found: dict[str, float | None] = {
            "realtime_factor": timing.get("realtime_factor"),
            "cpu_s": None if self.outcome is None else self.outcome.cpu_s,
            "peak_memory_mb": (self.run.get("peak_memory_bytes") or 0) / _OWN_BYTES or None,
        }
        if self.outcome is not None:
            found["peak_memory_mb"] = self.outcome.peak_memory_bytes / _OWN_BYTES
        return {key: float(value) for key, value in found.items() if value is not None}


def run_entrants(
    request: CompareRequest,
    entrants: Sequence[Entrant],
    output: Path,
    fits: Mapping[str, TierFit],
    told: Callable[[JobOutcome], None],
) -> list[Compared]:
    """Run every entrant that can run, and return what became of each, in their order.

    Parameters
    ----------
    output
        Folder of the comparison: each run gets a folder in it, and a record in ``jobs``.
    fits
        Which system the recording allows, by name; one that is not in it is tried.
    """
    jobs: list[Job] = []
    for entrant in entrants:
        fit = fits.get(entrant.algo)
        if entrant.result is None and (fit is None or fit.runs):
            jobs.append(_job(request, entrant, output))
    ended = run_jobs(
        jobs, workers=request.workers, records=output / "jobs", told=told, scheduler=request.scheduler,
        memory_limit_bytes=request.memory_limit_bytes,
    )  # fmt: skip
    outcomes = {outcome.name: outcome for outcome in ended}
    return [_compared(entrant, output, outcomes.get(entrant.name), fits.get(entrant.algo)) for entrant in entrants]


def _job(request: CompareRequest, entrant: Entrant, output: Path) -> Job:
    """Return the run of ``slamcli map``; topics go to systems that have a use for them."""
    roles = find_tier(entrant.algo).roles
    words = ["map", *map(str, request.inputs), "--algo", entrant.algo, "-o", str(output / entrant.name)]
    words += ["--seed", str(request.seed), "--jobs", str(request.jobs)]
    for path in entrant.config_files:
        words += ["--config", str(path)]
    for setting in entrant.sets:
        words += ["--set", setting]
    topics: list[tuple[str, str, str]] = [("scans", "--scan-topic", t) for t in request.scan_topics]
    topics += [("points", "--points-topic", t) for t in request.points_topics]
    topics += [("odometry", "--odom-topic", request.odom_topic)] if request.odom_topic else []
    topics += [("imu", "--imu-topic", request.imu_topic)] if request.imu_topic else []
    topics += [("images", flag, topic) for flag, topic in request.cameras.named().items()]
    topics += [("images", "--camera", str(path)) for path in request.camera_files]
    for role, flag, value in topics:
        if role in roles:
            words += [flag, value]
    for flag, given in (
        ("--mode", entrant.mode), ("--base-frame", request.base_frame), ("--start", request.start_s), ("--duration", request.duration_s),
    ):  # fmt: skip
        if given is not None:
            words += [flag, str(given)]
    inputs = (*request.inputs, *entrant.config_files, *request.camera_files)
    return Job(
        name=entrant.name, arguments=(*words, *request.mend_words), output=output / entrant.name,
        inputs=tuple(Path(path) for path in inputs),
    )  # fmt: skip


def _compared(entrant: Entrant, output: Path, outcome: JobOutcome | None, fit: TierFit | None) -> Compared:
    if entrant.result is None and outcome is None:
        return Compared(entrant=entrant, state=CANNOT, message="" if fit is None else fit.mode)
    if outcome is not None and not outcome.done:
        how = (
            f"ended by signal {-outcome.exit_code}"
            if outcome.exit_code < 0
            else f"ended with exit code {outcome.exit_code}"
        )
        message = outcome.message.removeprefix("slamcli: ") or how
        return Compared(entrant=entrant, state=FAILED, message=message, outcome=outcome)
    folder = entrant.result if entrant.result is not None else output / entrant.name
    try:
        run = read_run(folder)
        trajectory = result_trajectory(folder)
        grid = read_map(folder / "map.yaml").grid if (folder / "map.yaml").exists() else None
    except SlamcliError as error:
        return Compared(entrant=entrant, state=FAILED, message=str(error), outcome=outcome)
    if not len(trajectory):
        return Compared(
            entrant=entrant, state=FAILED, message="no pose at all", folder=folder, run=run, outcome=outcome
        )
    return Compared(
        entrant=entrant, state=RAN if outcome is not None else GIVEN, folder=folder, run=run, trajectory=trajectory, grid=grid,
        outcome=outcome,
    )  # fmt: skip


def all_failed(compared: Sequence[Compared]) -> str:
    """Return why there is nothing to compare, for a message; empty if there is something."""
    if any(found.there for found in compared):
        return ""
    return "; ".join(f"{found.name}: {found.message}" for found in compared)
