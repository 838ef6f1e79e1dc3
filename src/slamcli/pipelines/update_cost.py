# SPDX-License-Identifier: MIT
"""How long an update takes, told from what it does: `Rtabmap/TimeThr` is held against it.

A clock would make the map depend on what else the computer does. The model counts instead, so that the same recording gives the
same map; its coefficients were measured (benchmarks/appearance_memory.py).
"""

from __future__ import annotations

from dataclasses import dataclass

_BASE_MS = 1.0
_MS_PER_WORD_SEARCH = 2.5e-7
"""For each key point and word of the dictionary."""
_MS_PER_KEY_POINT = 0.01
_MS_PER_NODE = 0.004
"""For each place in working memory: its links, its likelihood, its posterior."""
_MS_PER_READ = 2.0
_MS_PER_REGISTRATION = 5.0
_MS_PER_OPTIMISED = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateWork:
    """What was done from an image to its node in the optimised graph."""

    key_points: int = 0
    """Quantised."""
    words: int = 0
    """In the dictionary."""
    working: int = 0
    """Places in working memory."""
    retrieved: int = 0
    """Nodes read from long-term memory."""
    registrations: int = 0
    """Places compared by features or scans."""
    optimised: int = 0
    """Nodes in optimisations, each time counted."""


def modelled_ms(work: UpdateWork) -> float:
    """Return how long an update takes, in milliseconds."""
    return (
        _BASE_MS
        + work.key_points * (_MS_PER_KEY_POINT + _MS_PER_WORD_SEARCH * work.words)
        + _MS_PER_NODE * work.working
        + _MS_PER_READ * work.retrieved
        + _MS_PER_REGISTRATION * work.registrations
        + _MS_PER_OPTIMISED * work.optimised
    )
