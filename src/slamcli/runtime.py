# SPDX-License-Identifier: MIT
"""What long work tells whoever waits for it: progress, warnings and timing, without printing anything."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import Protocol

LIFELINE = "SLAMCLI_LIFELINE"
"""Environment variable with the number of a pipe's end: whoever holds the other one wants this process only while it is there."""
_GRACE_S = 5.0


class Progress(Protocol):
    """Where long work reports how far it is; the command line draws it, the library stays silent."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Begin a stage; `total` is its size in seconds of recording (or another unit), None if unknown."""

    def update(self, done: float) -> None:
        """Report how much of the stage's total is done."""


class SilentProgress:
    """A Progress that nobody watches."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Ignore the stage."""

    def update(self, done: float) -> None:
        """Ignore the progress."""


class RunLog:
    """Warnings, counts and time per stage of one run; becomes part of ``run.json``.

    Warnings keep their order and are told once each; `counts` counts what was mended or skipped.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self.progress: Progress = progress or SilentProgress()
        self.warnings: list[str] = []
        self.notes: list[str] = []
        self.counts: Counter[str] = Counter()
        self.seconds: dict[str, float] = {}
        self.laps: dict[str, list[float]] = {}
        """Seconds of each of many like pieces of work, in their order."""

    def warn(self, message: str) -> None:
        """Keep a warning unless it was already given."""
        if message not in self.warnings:
            self.warnings.append(message)

    def note(self, message: str) -> None:
        """Keep a remark (what was chosen and how to choose otherwise) unless it was already given."""
        if message not in self.notes:
            self.notes.append(message)

    @contextlib.contextmanager
    def stage(self, name: str, total: float | None = None) -> Iterator[None]:
        """Time a stage; stages of the same name add up."""
        self.progress.stage(name, total)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def lap(self, name: str, seconds: float) -> None:
        """Keep how long one of many like pieces of work took."""
        self.laps.setdefault(name, []).append(seconds)


def peak_memory_bytes() -> int:
    """Return the peak resident memory of this process so far, in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def hold_lifeline() -> None:
    """End this process (as Ctrl-C does, five seconds later by force) once the one that started it has gone, if it asked for that."""
    end = os.environ.pop(LIFELINE, "")
    if not end.isdecimal():
        return

    def wait() -> None:
        with contextlib.suppress(OSError):
            os.read(int(end), 1)  # nothing is ever written: it returns when the other end is closed
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(_GRACE_S)
        os.kill(os.getpid(), signal.SIGKILL)

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background processes ignore it
    threading.Thread(target=wait, name="lifeline", daemon=True).start()
