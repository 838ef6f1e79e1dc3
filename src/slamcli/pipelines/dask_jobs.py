# SPDX-License-Identifier: MIT
"""Jobs on a Dask cluster: each runs on a worker, as a process of its own in that machine's environment.

Files are not sent: the workers see the same ones, at the same paths. A worker that is lost takes its jobs with it; Dask gives
them to another, once.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import signal
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from slamcli import __version__
from slamcli.errors import DependencyError, UsageError
from slamcli.pipelines.job_process import Job, JobOutcome, JobsStopped, run_job
from slamcli.pipelines.process_tree import physical_memory_bytes

_ADDRESS = re.compile(r"(\w+://)?[^/:\s]+:\d+/?|(\w+://)?\[[0-9a-fA-F:]+\]:\d+/?")
_CONNECT_S = 10.0
_FIRST_WORKER_S = 30.0
_NO_WORKER_S = 60.0
"""So long may a cluster be without any worker (a nanny is starting one) before its jobs are given up."""
_LOOK_S = 1.0
_SEEN_S = 10.0
"""So long may a shared file system take to show here what a worker wrote."""
_MOST_TRIES = 2
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Dask's nannies set these to 1; a job has what it would have here, so that its sums are the same to the last digit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Order:
    """What a worker is asked to do."""

    version: str
    job: Job
    folder: Path
    """Where the job runs: where it would here."""
    seen: tuple[Path, ...]
    """Inputs that are there, seen from here."""
    tries: Path
    """File with a line for each worker that began this job."""
    memory_limit_bytes: int | None
    threads: Mapping[str, str | None]


class DaskCluster:
    """A connection to a scheduler; `run` may be called from many threads at once."""

    def __init__(self, address: str, stop: threading.Event, memory_limit_bytes: int | None, tries: Path) -> None:
        self._address = address
        self._stop = stop
        self._memory_limit_bytes = memory_limit_bytes
        self._tries = tries
        self._call = uuid.uuid4().hex[:12]
        self._client = _connect(address)
        self._alone_since: float | None = None

    @property
    def capacity(self) -> int:
        """How many jobs to hand out at once: two for each thread, so that none waits, and room for workers that come later."""
        return max(8, 2 * sum(worker["nthreads"] for worker in self._workers().values()))

    def run(self, job: Job) -> JobOutcome:
        """Run a job on some worker, and wait for it.

        Raises
        ------
        JobsStopped
            If the jobs were stopped.
        """
        from distributed import CancelledError, KilledWorker

        if self._stop.is_set():
            raise JobsStopped
        folder = Path.cwd() if job.folder is None else job.folder.absolute()
        tries = self._tries / f"{job.name}.{self._call}.tries"
        order = _Order(
            version=__version__, job=job, folder=folder, seen=tuple(path for path in job.inputs if path.exists()),
            tries=tries.absolute(), memory_limit_bytes=self._memory_limit_bytes,
            threads={name: os.environ.get(name) for name in _THREADS},
        )  # fmt: skip
        future = self._client.submit(run_order, order, key=f"slamcli-{self._call}-{job.name}", pure=False)
        try:
            return self._checked(job, self._waited(future, job))
        except KilledWorker:
            return _failed(job, f"{_MOST_TRIES} workers were lost while they ran it")
        except (CancelledError, OSError) as error:
            if self._stop.is_set():
                raise JobsStopped from error
            return _failed(job, f"--scheduler {self._address}: the scheduler was lost")
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                future.cancel(force=True)
            tries.unlink(missing_ok=True)

    def close(self) -> None:
        """Leave the cluster; what still runs there for this client is ended."""
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)

    def _waited(self, future: Any, job: Job) -> JobOutcome:
        from distributed import TimeoutError as NotYet

        while True:
            try:
                return future.result(timeout=_LOOK_S)
            except NotYet:
                if self._stop.is_set():
                    raise JobsStopped from None
                if not self._is_staffed():
                    return _failed(job, f"--scheduler {self._address}: all workers are gone")

    def _is_staffed(self) -> bool:
        """Return whether there are workers, or were until a moment ago."""
        if self._workers():
            self._alone_since = None
            return True
        self._alone_since = self._alone_since or time.monotonic()
        return time.monotonic() - self._alone_since < _NO_WORKER_S

    def _workers(self) -> Mapping[str, Any]:
        return dict(self._client.scheduler_info(n_workers=-1)["workers"])

    def _checked(self, job: Job, outcome: JobOutcome) -> JobOutcome:
        """Return the outcome, as a failure if what the worker wrote is not to be seen here."""
        until = time.monotonic() + _SEEN_S
        made = job.makes or job.output
        while outcome.done and not made.exists():
            if time.monotonic() > until:
                return _failed(job, f"the worker wrote {made}, and it is not there: {_SHARED}")
            time.sleep(0.1)
        return outcome


_SHARED = "inputs and output must lie on a file system that all machines see at the same path (inputs may be URLs)"


def run_order(order: _Order) -> JobOutcome:
    """Run a job in a worker; the rest of this file runs where slamcli was called."""
    from distributed import get_worker

    worker, job = get_worker(), order.job
    where = f"worker {worker.address}"
    if order.version != __version__:
        return _failed(job, _mismatch(where, __version__, order.version), 2)
    missing = [path for path in (order.folder, *order.seen) if not (order.folder / path).exists()]
    if missing:
        return _failed(job, f"{where} does not see {order.folder / missing[0]}: {_SHARED}", 2)
    if not _may_try(order.tries):
        return _failed(job, f"{_MOST_TRIES} workers were lost while they ran it")
    limit = order.memory_limit_bytes or _share_bytes(worker)
    placed = replace(
        job, folder=order.folder, output=order.folder / job.output,
        remote=tuple((url, order.folder / place) for url, place in job.remote),
    )  # fmt: skip
    key = worker.get_current_task()
    try:
        return run_job(
            placed, memory_limit_bytes=limit, is_stopped=lambda: not _is_wanted(worker, key), changes=order.threads
        )
    except JobsStopped:  # nobody waits for it any more
        return _failed(job, "stopped", -signal.SIGINT)


def worker_version() -> str:
    """Return the version of slamcli, where it is called."""
    return __version__


def _connect(address: str) -> Any:
    if not _ADDRESS.fullmatch(address):
        raise UsageError(f"--scheduler {address}: not an address of a Dask scheduler: write it as tcp://HOST:8786")
    try:
        import distributed
    except ImportError as error:
        raise DependencyError("--scheduler needs Dask: pip install 'slamcli[fleet]'") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is to be known of it is said here
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, ImportError) as error:
        raise UsageError(f"--scheduler {address}: no Dask scheduler answers there (tcp://HOST:8786)") from error
    try:
        _check_workers(client, address)
    except BaseException:
        client.close(timeout=5)
        raise
    return client


def _check_workers(client: Any, address: str) -> None:
    """Raise unless there are workers, and all have this version of slamcli."""
    from distributed import TimeoutError as NotYet

    try:
        client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
    except NotYet as error:
        raise UsageError(f"--scheduler {address}: it has no workers; start some: dask worker {address}") from error
    for worker, version in client.run(worker_version, on_error="return").items():
        if isinstance(version, ImportError):
            raise UsageError(f"worker {worker} has no slamcli: install slamcli=={__version__} where it runs")
        if version != __version__:
            raise UsageError(_mismatch(f"worker {worker}", str(version), __version__))


def _mismatch(where: str, there: str, here: str) -> str:
    return f"{where} has slamcli {there}, and this is {here}: results could differ; install the same version"


def _may_try(tries: Path) -> bool:
    """Note that a worker begins the job; return False if too many have begun it before."""
    try:
        tries.parent.mkdir(parents=True, exist_ok=True)
        with tries.open("a", encoding="ascii") as stream:
            stream.write("begun\n")
        return len(tries.read_text(encoding="ascii").splitlines()) <= _MOST_TRIES
    except OSError:
        return True  # what cannot be written is told by the job itself


def _share_bytes(worker: Any) -> int:
    """Return how much memory one of a worker's threads may use."""
    limit = worker.memory_manager.memory_limit or physical_memory_bytes()
    return int(limit // max(1, worker.state.nthreads))


def _is_wanted(worker: Any, key: str) -> bool:
    """Return whether anybody still waits for a task: not once its client has gone or has cancelled it."""
    task = worker.state.tasks.get(key)
    return task is not None and task.state not in ("cancelled", "released", "forgotten")


def _failed(job: Job, message: str, exit_code: int = 1) -> JobOutcome:
    return JobOutcome(
        name=job.name, exit_code=exit_code, message=message, stdout="", wall_s=0.0, cpu_s=0.0, peak_memory_bytes=0
    )


@contextlib.contextmanager
def dask_cluster(
    address: str, stop: threading.Event, memory_limit_bytes: int | None, tries: Path
) -> Iterator[tuple[Callable[[Job], JobOutcome], int]]:
    """Give what runs one job on a cluster, and how many at once it is good for.

    Parameters
    ----------
    tries
        Folder that the workers see too, for a small file per job while it runs.

    Raises
    ------
    UsageError
        If no scheduler answers, it has no workers, or they have another version of slamcli.
    DependencyError
        If Dask is not installed.
    """
    cluster = DaskCluster(address, stop, memory_limit_bytes, tries)
    try:
        yield cluster.run, cluster.capacity
    finally:
        cluster.close()
