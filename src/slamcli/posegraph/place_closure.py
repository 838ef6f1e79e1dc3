# SPDX-License-Identifier: MIT
"""Places that were compared with each other, and what came of it."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceClosure:
    """A closure that a tier with a memory of places tried."""

    stamp_ns: int
    """Of the newer node."""
    older_stamp_ns: int | None
    """Of the older node; None where it is a landmark."""
    node: int
    """The newer node, in the tier's own numbers."""
    older_node: int
    """The older one; of a landmark minus its number."""
    kind: str
    """How it was found, in words: ``loop``, ``near in space`` and so on."""
    accepted: bool
    reason: str = ""
    """Why it was refused, a sentence; empty where it was accepted."""
    posterior: float = 0.0
    """Probability of the hypothesis that led there, 0 to 1; 0: it was found otherwise."""
    num_matches: int = 0
    """Features that look alike, or points that lie near each other, before the motion was known."""
    num_inliers: int = 0
    """Matches that the motion explains."""
    strain: float = 0.0
    """Largest error of a link over its standard deviation with this closure in the graph; 0: it did not come to that."""


def without_figures(reason: str) -> str:
    """Return a reason without the figures in it, which differ from time to time."""
    return re.sub(r"\d+(\.\d+)?", "…", reason)
