# SPDX-License-Identifier: MIT
"""Talk goes to stderr, data to stdout; a progress bar shows on a terminal and nowhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Self

import click

from slamcli.runtime import RunLog


class Console:
    """What a command says to a person; a context manager that clears its progress line.

    Also a `slamcli.runtime.Progress`: `stage` and `update` draw one line with stage, share, speed and time left, at
    most ten times a second, and only if stderr is a terminal.
    """

    def __init__(self, verbosity: int = 0) -> None:
        self.verbosity = verbosity
        self._interactive = verbosity >= 0 and sys.stderr.isatty()
        self._stage = ""
        self._total: float | None = None
        self._began = 0.0
        self._drawn = 0.0
        self._shown = False

    def say(self, message: str) -> None:
        """Say something worth knowing, unless --quiet."""
        if self.verbosity >= 0:
            self.clear()
            click.echo(message, err=True)

    def detail(self, message: str) -> None:
        """Say something that only --verbose wants to hear."""
        if self.verbosity > 0:
            self.say(message)

    def warn(self, message: str) -> None:
        """Warn; --quiet does not silence warnings."""
        self.clear()
        click.echo(f"warning: {message}", err=True)

    def tell(self, log: RunLog) -> None:
        """Say the notes and warnings that a run collected."""
        for note in log.notes:
            self.say(note)
        for warning in log.warnings:
            self.warn(warning)

    def stage(self, name: str, total: float | None = None) -> None:
        """Begin a stage of long work (see `slamcli.runtime.Progress`)."""
        self._stage, self._total, self._began = name, total, time.monotonic()
        self.detail(name)
        self._draw(0.0)

    def update(self, done: float) -> None:
        """Redraw the progress line if it is due."""
        if self._interactive and time.monotonic() - self._drawn > 0.1:
            self._draw(done)

    def clear(self) -> None:
        """Remove the progress line."""
        if self._shown:
            click.echo("\r\x1b[K", nl=False, err=True)
            self._shown = False

    def _draw(self, done: float) -> None:
        if not self._interactive:
            return
        now = time.monotonic()
        elapsed = now - self._began
        line = self._stage
        if self._total and done > 0:
            speed = done / max(elapsed, 1e-9)
            left = max(self._total - done, 0.0) / speed
            line += f"  {min(100.0, 100 * done / self._total):3.0f} %  {speed:.1f} x real time  {left:.0f} s left"
        click.echo(f"\r\x1b[K{line}", nl=False, err=True)
        self._drawn, self._shown = now, True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.clear()


def print_json(document: Mapping[str, Any], name: str = "") -> None:
    """Print one JSON document to stdout; NaN and infinity become null.

    Parameters
    ----------
    document
        What to print.
    name
        Of its schema (``configs/schemas``), which becomes its first key; left out for a document that bears one already.
    """
    from slamcli.pipelines.json_text import json_text
    from slamcli.pipelines.schemas import stamped

    click.echo(json_text(stamped(name, document) if name else document))
