# SPDX-License-Identifier: MIT
"""How far a fleet is: one line that changes on a terminal, else a line for each run that ended."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from slamcli.cli.console import Console

if TYPE_CHECKING:
    from slamcli.pipelines.jobs import JobOutcome


class FleetProgress:
    """What is told of a fleet while it runs, on stderr."""

    def __init__(self, console: Console, total: int) -> None:
        self._console = console
        self._total = total
        self._done = self._missed = self._failed = self._reused = 0
        self._began = time.monotonic()
        self._shows = console.verbosity >= 0 and sys.stderr.isatty()
        self._draw()

    def told(self, outcome: JobOutcome) -> None:
        """Take notice of a run that ended; a failure gets a line of its own everywhere."""
        from slamcli.pipelines.fleet_summary import reason

        self._done += outcome.done
        self._missed += outcome.missed
        self._failed += not (outcome.done or outcome.missed)
        self._reused += outcome.reused
        ended = self._done + self._missed + self._failed
        if not outcome.done:
            how = "missed a threshold" if outcome.missed else "failed"
            self.clear()
            self._console.warn(f"[{ended}/{self._total}] {outcome.name} {how}: {reason(outcome)}")
        elif not self._shows:
            how = "was done before" if outcome.reused else f"done in {outcome.wall_s:.1f} s"
            self._console.say(f"[{ended}/{self._total}] {outcome.name} {how}")
        self._draw()

    def interrupted(self) -> None:
        """Say where it stopped."""
        self.clear()
        ended = self._done + self._missed + self._failed
        self._console.warn(f"interrupted: {ended} of {self._total} ended; the same command goes on from there")

    def ended(self, output: Path) -> None:
        """Say what came of it."""
        self.clear()
        parts = [f"{self._done} of {self._total} done"]
        parts += [f"{self._reused} of them before"] if self._reused else []
        parts += [f"{self._missed} missed a threshold"] if self._missed else []
        parts += [f"{self._failed} failed"] if self._failed else []
        self._console.say(f"{output}: {', '.join(parts)}, {time.monotonic() - self._began:.1f} s")

    def _draw(self) -> None:
        if not self._shows:
            return
        ended = self._done + self._missed + self._failed
        ran, left = ended - self._reused, self._total - ended
        line = f"{self._done} done  {self._missed + self._failed} failed  {left} left"
        if ran and left:
            line += f"  {_time_text((time.monotonic() - self._began) / ran * left)} to go"
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)

    def clear(self) -> None:
        """Remove the line."""
        if self._shows:
            click.echo("\r\x1b[K", nl=False, err=True)


def _time_text(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
