# SPDX-License-Identifier: MIT
"""One run of slamcli in a process of its own: started, watched, ended, and what is to be known of it afterwards."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import IO

from slamcli.errors import InputError, SlamcliError
from slamcli.pipelines.process_tree import can_be_measured, end_tree, tree_memory_bytes
from slamcli.pipelines.remote_files import Remote, fetched
from slamcli.runtime import LIFELINE

_LAST_LINES = 4000
"""Characters of a job's talk that are kept: the end, where the reason of a failure stands."""
_MOST_STDOUT = 1 << 20
"""Characters of a job's output that are kept: its end; results are in files."""
_LONGEST_NAP_S = 0.1
_GRACE_S = 5.0
"""Time for a job that is interrupted to clean up after itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One run of slamcli."""

    name: str
    """Of this job among its fellows; also the name of its record's file."""
    arguments: tuple[str, ...]
    """Of slamcli, the command first; among them the output that `output` names."""
    output: Path
    """File or folder that the job leaves."""
    makes: Path | None = None
    """What its process itself leaves, where `output` is made of that by whoever is told of the outcome; None: `output`."""
    inputs: tuple[Path, ...] = ()
    """What it reads: it runs again where their content has changed."""
    remote: tuple[Remote, ...] = ()
    """What is fetched before it, and removed after it."""
    keeps_remote: bool = False
    """Whether what was fetched stays."""
    folder: Path | None = None
    """Where it runs; None for where this process is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOutcome:
    """What became of a job."""

    name: str
    exit_code: int
    """0 done, 1 failed or a threshold missed, 2 wrong usage or input; negative: ended by that signal."""
    message: str
    """The last line that it said to stderr, or why it was ended; empty if it said nothing."""
    stdout: str
    """What it printed; of more than a million characters the last."""
    wall_s: float
    cpu_s: float
    peak_memory_bytes: int
    reused: bool = False
    """Whether it was done by an earlier run, and nothing has changed since."""
    wrote: bool = False
    """Whether it left its output, be it that a threshold was missed."""

    @property
    def done(self) -> bool:
        """Whether it did what it was to do."""
        return self.exit_code == 0

    @property
    def missed(self) -> bool:
        """Whether it did it, and a threshold was missed."""
        return self.exit_code == 1 and self.wrote


class JobsStopped(BaseException):
    """The jobs were stopped before this one ended: no outcome, and no error of the job's."""


def run_job(
    job: Job,
    *,
    memory_limit_bytes: int | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
    changes: Mapping[str, str | None] = MappingProxyType({}),
) -> JobOutcome:
    """Run one job in a process of its own and wait for it.

    Parameters
    ----------
    memory_limit_bytes
        Most resident memory of the process and all that it starts, together; what exceeds it is ended. It is looked at ten times a
        second. None: unlimited, as it is where the system does not tell (see `can_be_measured`).
    is_stopped
        Is asked ten times a second: once it says True, the job is interrupted, and killed if it has not ended five seconds later.
    changes
        Variables of its environment that are not as here; None for one that it lacks.

    Raises
    ------
    JobsStopped
        If it was stopped.
    """
    began = time.monotonic()
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(fetched(job.remote, keep=job.keeps_remote, is_stopped=is_stopped))
        except InterruptedError as error:
            raise JobsStopped from error
        except SlamcliError as error:
            return _never_began(job, str(error), 2 if isinstance(error, InputError) else 1)
        environment = {**os.environ, **changes}
        known = {name: value for name, value in environment.items() if value is not None}
        try:
            return _run(job, known, _Watch(memory_limit_bytes, is_stopped), began)
        except OSError as error:
            return _never_began(job, f"it could not be started: {error}", 1)


def _never_began(job: Job, message: str, exit_code: int) -> JobOutcome:
    return JobOutcome(
        name=job.name, exit_code=exit_code, message=message, stdout="", wall_s=0.0, cpu_s=0.0, peak_memory_bytes=0
    )


def _run(job: Job, environment: Mapping[str, str], watch: _Watch, began: float) -> JobOutcome:
    there = _mark(job.output)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, _lifeline() as end:
        process = subprocess.Popen(
            [sys.executable, "-m", "slamcli", *job.arguments], stdin=subprocess.DEVNULL, stdout=out, stderr=err,
            cwd=job.folder, env={**environment, LIFELINE: str(end)}, pass_fds=(end,), start_new_session=True,
        )  # fmt: skip
        try:
            status, usage = watch.wait(process.pid)
        except BaseException:
            end_tree(process.pid)
            process.wait()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
        if watch.stopped:
            raise JobsStopped
        said = _text(err)[-_LAST_LINES:].strip().splitlines()
        return JobOutcome(
            name=job.name, exit_code=process.returncode,
            message=watch.reason or (said[-1] if said else _of_signal(process.returncode)),
            stdout=_text(out)[-_MOST_STDOUT:], wall_s=time.monotonic() - began, cpu_s=usage.ru_utime + usage.ru_stime,
            peak_memory_bytes=usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024),
            wrote=_mark(job.output) not in (None, there),
        )  # fmt: skip


class _Watch:
    """Waits for a process, and ends it where it must end."""

    def __init__(self, limit_bytes: int | None, is_stopped: Callable[[], bool]) -> None:
        self._limit_bytes = limit_bytes if can_be_measured() else None
        self._is_stopped = is_stopped
        self.reason = ""
        self.stopped = False

    def wait(self, process: int) -> tuple[int, resource.struct_rusage]:
        began, asked = time.monotonic(), 0.0
        while True:
            found, status, usage = os.wait4(process, os.WNOHANG)
            if found:
                return status, usage
            now = time.monotonic()
            if not self.stopped and self._is_stopped():
                self.stopped, asked = True, now
                with contextlib.suppress(OSError):
                    os.killpg(process, signal.SIGINT)
            if self.stopped and now - asked > _GRACE_S:
                end_tree(process)
            if self._limit_bytes is not None and not self.reason:
                self._look_at_memory(process, self._limit_bytes)
            time.sleep(min(_LONGEST_NAP_S, max(0.002, (now - began) / 20)))

    def _look_at_memory(self, process: int, limit_bytes: int) -> None:
        if tree_memory_bytes(process) > limit_bytes:
            end_tree(process)
            self.reason = f"needed more than {size_text(limit_bytes)} of memory (--max-memory)"


@contextlib.contextmanager
def _lifeline() -> Iterator[int]:
    """Give a pipe's end to hand to a process, which ends itself once this process has gone (`slamcli.runtime.hold_lifeline`)."""
    theirs, ours = os.pipe()
    try:
        yield theirs
    finally:
        os.close(theirs)
        os.close(ours)


def size_text(size_bytes: int) -> str:
    """Return a size as a person writes it: 1.5 GB."""
    value, unit = next(
        (
            (size_bytes / factor, unit)
            for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB"))
            if size_bytes >= factor
        ),
        (float(size_bytes), "bytes"),
    )
    return f"{value:.4g} {unit}"


def _mark(output: Path) -> tuple[int, int] | None:
    """Return what changes when an output is written anew; None if there is none."""
    try:
        stat = output.stat()
    except OSError:
        return None
    return stat.st_ino, stat.st_mtime_ns


def _of_signal(exit_code: int) -> str:
    return f"ended by {signal.Signals(-exit_code).name}" if exit_code < 0 else ""


def _text(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode("utf-8", "replace")
