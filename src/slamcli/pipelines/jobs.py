# SPDX-License-Identifier: MIT
"""Many runs of slamcli, each in a process of its own: what compare, sweep and fleets are made of.

A job is a command line, so that what a job gives is what the command gives by hand, to the byte. A process of its own gives each
job its own peak memory, and ends with the job whatever happens in it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.pipelines.job_process import Job, JobOutcome, run_job
from slamcli.pipelines.job_records import JobRecords

__all__ = ["Job", "JobOutcome", "run_job", "run_jobs"]

_ENDINGS = (signal.SIGTERM, signal.SIGHUP)
"""Besides Ctrl-C: what ends the jobs in good order."""


def run_jobs(
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    records: Path | None = None,
    told: Callable[[JobOutcome], None] = lambda _: None,
    memory_limit_bytes: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    keep_stdout: bool = True,
) -> list[JobOutcome]:
    """Run all jobs, several at once, and return what became of each, in their order.

    Interrupted (Ctrl-C, or ended by SIGTERM or SIGHUP), it ends all jobs and all that they started before it raises; what was done
    is in the records.

    Parameters
    ----------
    jobs
        What to run; their names differ.
    workers
        How many at once; 0: one for each core, or as many as the cluster takes.
    records
        Folder for one small file per finished job: a job that was done, whose inputs and arguments are the same and whose output is
        still there, is not run again. None: everything runs.
    told
        Is called with each outcome as it comes, from this thread.
    memory_limit_bytes
        Most memory of one job; one that needs more is ended, and is reported as failed. None: unlimited, on a cluster the share of
        each worker's memory that a thread of it has.
    scheduler
        Address of a Dask scheduler whose workers run the jobs; None for processes of this machine. Paths are as they are here: the
        workers must see the same files, and the records.
    fresh
        Run all, whatever the records say.
    keep_stdout
        Whether the outcomes hold what the jobs printed; False for very many jobs (the records hold it anyway).

    Raises
    ------
    UsageError
        If two jobs have one name, a record cannot be written, or the scheduler is not to be had.
    KeyboardInterrupt
        If it was interrupted.
    """
    names = [job.name for job in jobs]
    if len(set(names)) != len(names):
        raise UsageError(f"two jobs are called {next(n for n in names if names.count(n) > 1)!r}")
    outcomes: dict[str, JobOutcome] = {}
    stop = threading.Event()
    known = JobRecords(records) if records is not None else None
    with (
        _endings_interrupt(),
        _executor(scheduler, stop, memory_limit_bytes, records) as (run, capacity),
        ThreadPoolExecutor(workers or capacity) as pool,
    ):
        taken = partial(_run_or_reuse, records=known, run=run, fresh=fresh, keep_stdout=keep_stdout)
        running = [pool.submit(taken, job) for job in jobs]
        try:
            for future in as_completed(running):
                outcome = future.result()
                outcomes[outcome.name] = outcome
                told(outcome)
        except BaseException:
            stop.set()
            pool.shutdown(cancel_futures=True)
            raise
    return [outcomes[name] for name in names]


def _run_or_reuse(
    job: Job, *, records: JobRecords | None, run: Callable[[Job], JobOutcome], fresh: bool, keep_stdout: bool
) -> JobOutcome:
    outcome = None if records is None or fresh else records.find(job)
    if outcome is None:
        outcome = run(job)
        if records is not None:
            records.keep(job, outcome)
    return outcome if keep_stdout else replace(outcome, stdout="")


@contextlib.contextmanager
def _executor(
    scheduler: str | None, stop: threading.Event, memory_limit_bytes: int | None, records: Path | None
) -> Iterator[tuple[Callable[[Job], JobOutcome], int]]:
    """Give what runs one job and waits for it, from several threads at once, and how many of them make sense."""
    if scheduler is None:
        run = partial(run_job, memory_limit_bytes=memory_limit_bytes, is_stopped=stop.is_set)
        yield run, os.cpu_count() or 1
        return
    from slamcli.pipelines.dask_jobs import dask_cluster

    if records is None:
        raise UsageError("jobs on a cluster need a folder for their records that all machines see")
    with dask_cluster(scheduler, stop, memory_limit_bytes, records) as cluster:
        yield cluster


@contextlib.contextmanager
def _endings_interrupt() -> Iterator[None]:
    """Let SIGTERM and SIGHUP do what Ctrl-C does, where nobody else has a say in them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    ours = [ending for ending in _ENDINGS if signal.getsignal(ending) is signal.SIG_DFL]
    for ending in ours:
        signal.signal(ending, interrupt)
    try:
        yield
    finally:
        for ending in ours:
            signal.signal(ending, signal.SIG_DFL)
