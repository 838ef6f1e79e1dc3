# SPDX-License-Identifier: MIT
"""What could not be read of a recording, told once each."""

from __future__ import annotations

from slamcli.runtime import RunLog

MAX_LINES = 20


class Damage:
    """Collects what is damaged; every line also becomes a warning of the run."""

    def __init__(self, log: RunLog) -> None:
        self._log = log
        self._lines: dict[str, None] = {}
        self._more = 0

    def add(self, line: str) -> None:
        """Keep a line unless it was already given; beyond `MAX_LINES` they are only counted."""
        if line in self._lines:
            return
        if len(self._lines) >= MAX_LINES:
            self._more += 1
            self._log.counts["further damaged places"] += 1
            return
        self._lines[line] = None
        self._log.warn(line)

    def lines(self) -> tuple[str, ...]:
        """Return all lines in the order they were found."""
        more = (f"and {self._more} further damaged places",) if self._more else ()
        return (*self._lines, *more)


def at_time(stamp_ns: int | None) -> str:
    """Describe the last message before damage."""
    if stamp_ns is None:
        return "no message lies before it"
    return f"the last message before it is of {stamp_ns // 10**9}.{stamp_ns % 10**9:09d} s"
