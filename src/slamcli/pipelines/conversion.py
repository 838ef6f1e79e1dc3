# SPDX-License-Identifier: MIT
"""What a conversion takes of a recording, and what came of it."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.recordings.raw import Topic


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Which part of a recording to convert."""

    start_s: float | None = None
    """Seconds of log time from the recording's start."""
    duration_s: float | None = None
    topics: tuple[str, ...] = ()
    """Only these topics; all if empty."""
    exclude_topics: tuple[str, ...] = ()

    def chooses(self, topic: str) -> bool:
        """Return whether a topic is to be converted."""
        return (not self.topics or topic in self.topics) and topic not in self.exclude_topics

    def check(self, known: Collection[str]) -> None:
        """Raise UsageError if a topic is named that the recording has not, or no topic is left."""
        for name in (*self.topics, *self.exclude_topics):
            if name not in known:
                near = difflib.get_close_matches(name, known, n=3, cutoff=0.4) or sorted(known)[:8]
                raise UsageError(f"no topic {name!r} in the recording; it has {', '.join(near) or 'none'}")
        if known and not any(map(self.chooses, known)):
            raise UsageError("no topic is left to convert")

    def window_ns(self, start_ns: int, length_s: float | None = None) -> tuple[int | None, int | None]:
        """Return the log times (from, before) for a recording that starts at `start_ns`.

        Raises
        ------
        UsageError
            If the part is empty or begins after the recording's end.
        """
        start_s = self.start_s or 0.0
        if not 0 <= start_s < 1e9 or (length_s is not None and start_s > length_s):
            lasts = "" if length_s is None else f": the recording lasts {length_s:.1f} s"
            raise UsageError(f"--start {start_s:g} lies outside of the recording{lasts}")
        if self.duration_s is not None and not 0 < self.duration_s < 1e9:
            raise UsageError(f"--duration {self.duration_s:g} must be more than 0 s")
        first = start_ns + round(start_s * 1e9)
        stop = None if self.duration_s is None else first + round(self.duration_s * 1e9)
        return (None if self.start_s is None else first), stop


@dataclass(frozen=True, slots=True, kw_only=True)
class Conversion:
    """What was converted."""

    sources: tuple[Path, ...]
    source_format: str
    target: Path
    format: str
    compression: str
    size_bytes: int
    topics: tuple[Topic, ...]
    """The target's topics with the number of messages written."""
    num_messages: int
    start_ns: int | None
    end_ns: int | None
    record: Path
    """The run's record, beside the target."""
    num_lost: int
    """Messages that could not be converted (their bytes were not what their type says)."""
    damage: tuple[str, ...]
