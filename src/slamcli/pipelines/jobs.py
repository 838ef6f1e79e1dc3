# SPDX-License-Identifier: MIT
"""Many runs of slamcli, each in a process of its own: what compare, sweep and fleets are made of.

A job is a command line, so that what a job gives is what the command gives by hand, to the byte. A process of its own gives each
job its own peak memory, and ends with the job whatever happens in it.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from slamcli import __version__
from slamcli.errors import UsageError
from slamcli.outputs import atomic_file
from slamcli.pipelines.run_record import describe_inputs

_LAST_LINES = 4000
"""Characters of a job's talk that are kept: the end, where the reason of a failure stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One run of slamcli."""

    name: str
    """Of this job among its fellows; also the name of its record's file."""
    arguments: tuple[str, ...]
    """Of slamcli, the command first; among them the output that `output` names."""
    output: Path
    """File or folder that the job leaves."""
    inputs: tuple[Path, ...] = ()
    """What it reads: it runs again where their content has changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOutcome:
    """What became of a job."""

    name: str
    exit_code: int
    """0 done, 1 failed or a threshold missed, 2 wrong usage or input; negative: ended by that signal."""
    message: str
    """The last line that it said to stderr; empty if it said nothing."""
    stdout: str
    wall_s: float
    cpu_s: float
    peak_memory_bytes: int
    reused: bool = False
    """Whether it was done by an earlier run, and nothing has changed since."""

    @property
    def done(self) -> bool:
        """Whether it did what it was to do."""
        return self.exit_code == 0


def run_jobs(
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    records: Path | None = None,
    told: Callable[[JobOutcome], None] = lambda _: None,
) -> list[JobOutcome]:
    """Run all jobs, several at once, and return what became of each, in their order.

    Parameters
    ----------
    jobs
        What to run; their names differ.
    workers
        How many at once.
    records
        Folder for one small file per finished job: a job that has one, whose inputs and arguments are the same and whose output
        is still there, is not run again. None: everything runs.
    told
        Is called with each outcome as it comes, from this thread.

    Raises
    ------
    UsageError
        If two jobs have one name, or a record cannot be written.
    """
    names = [job.name for job in jobs]
    if len(set(names)) != len(names):
        raise UsageError(f"two jobs are called {next(n for n in names if names.count(n) > 1)!r}")
    outcomes: dict[str, JobOutcome] = {}
    with ThreadPoolExecutor(max_workers=max(1, workers)) as pool:
        running = [pool.submit(_run_or_reuse, job, records) for job in jobs]
        try:
            for future in as_completed(running):
                outcome = future.result()
                outcomes[outcome.name] = outcome
                told(outcome)
        except BaseException:
            for future in running:
                future.cancel()
            raise
    return [outcomes[name] for name in names]


def _run_or_reuse(job: Job, records: Path | None) -> JobOutcome:
    if records is None:
        return run_job(job)
    key, record = _key(job), records / f"{job.name}.json"
    known = _read_record(record, key)
    if known is not None and job.output.exists():
        return known
    outcome = run_job(job)
    if outcome.done:
        with atomic_file(record) as stream:
            json.dump({"key": key, "outcome": asdict(outcome)}, stream, indent=2)
    return outcome


def run_job(job: Job) -> JobOutcome:
    """Run one job in a process of its own and wait for it."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "slamcli", *job.arguments], stdin=subprocess.DEVNULL, stdout=out, stderr=err
        )
        try:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        except BaseException:
            process.kill()
            process.wait()
            raise
        said = _text(err)[-_LAST_LINES:].strip().splitlines()
        return JobOutcome(
            name=job.name, exit_code=process.returncode, message=said[-1] if said else "", stdout=_text(out),
            wall_s=time.monotonic() - began, cpu_s=usage.ru_utime + usage.ru_stime,
            peak_memory_bytes=usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024),
        )  # fmt: skip


def _text(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode("utf-8", "replace")


def _key(job: Job) -> str:
    """Return what must be the same for a job to be the same: version, arguments, content of the inputs."""
    parts = [__version__, *job.arguments, *(json.dumps(part) for part in _contents(job.inputs))]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _contents(inputs: Sequence[Path]) -> Iterator[object]:
    for path in inputs:
        yield describe_inputs([path]) if path.exists() else f"{path} is not there"


def _read_record(record: Path, key: str) -> JobOutcome | None:
    try:
        document = json.loads(record.read_text(encoding="utf-8"))
        return JobOutcome(**{**document["outcome"], "reused": True}) if document["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
