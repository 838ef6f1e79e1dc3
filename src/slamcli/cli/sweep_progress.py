# SPDX-License-Identifier: MIT
"""The progress of a sweep: one line over all its runs."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

import click

from slamcli.cli.console import Console

if TYPE_CHECKING:
    from slamcli.pipelines.sweep_runs import RunResult


class SweepProgress:
    """Counts runs on a terminal, with the time left; with --verbose each run has a line."""

    def __init__(self, console: Console) -> None:
        self.done = 0
        self._console = console
        self._interactive = console.verbosity >= 0 and sys.stderr.isatty()
        self._began = time.monotonic()
        self._new = 0
        self._failed = 0
        self._shown = False

    def told(self, result: RunResult, done: int, total: int) -> None:
        """Take note of one more run."""
        self.done = done
        self._failed += bool(result.failure)
        self._new += not result.reused
        self.clear()
        outcome = result.failure or f"{result.wall_s:.1f} s"
        self._console.detail(f"{done}/{total}  {result.run.one.label}, seed {result.run.seed}: {outcome}")
        if not self._interactive or done == total:
            return
        line = f"{done}/{total} runs"
        if self._failed:
            line += f", {self._failed} failed"
        if self._new:
            left = (time.monotonic() - self._began) / self._new * (total - done)
            line += f"  {_span(left)} left"
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)
        self._shown = True

    def clear(self) -> None:
        """Remove the line."""
        if self._shown:
            click.echo("\r\x1b[K", nl=False, err=True)
            self._shown = False


def _span(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
