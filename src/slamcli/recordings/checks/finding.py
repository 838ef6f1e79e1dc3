# SPDX-License-Identifier: MIT
"""One thing that a check found."""

from __future__ import annotations

from dataclasses import dataclass

SEVERITIES = ("error", "warning", "note")
"""error: results will be wrong or a run will fail; warning: results may suffer; note: handled, good to know."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is wrong with a recording."""

    severity: str
    message: str
    """In plain words, without the topic."""
    topic: str = ""
    stamp_ns: int | None = None
    """First stamp at which it shows."""
    count: int | None = None
    """How many messages show it."""
    mend: str = ""
    """Option (of every command that reads a recording) that mends it, or what to do."""
    check: str = ""
    """Name of the check; filled in by the diagnosis."""
