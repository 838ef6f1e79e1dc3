# SPDX-License-Identifier: MIT
"""What the memory tells about an update."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class MemorySizes:
    """How many of what there are."""

    short_term: int
    working: int
    long_term: int
    """Nodes in the database only."""
    words: int
    """In the dictionary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """What became of a new node."""

    kept_id: int
    """The node that stands for the place: the new one, or the one that it was merged into."""
    merged_id: int | None = None
    """The node that was merged into `kept_id` and is no longer there."""
    similarity: float = 0.0
    """To the node before."""
    reduced: tuple[tuple[int, int], ...] = ()
    """Nodes that `Mem/ReduceGraph` took out when they left short-term memory, and the nodes that hold their places."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Likelihood:
    """How much the places in working memory look like a new node."""

    ids: Ids
    """int64 (M,), increasing."""
    scores: Floats
    """float64 (M,)."""
    values: Floats
    """float64 (M + 1,), the virtual place first: as the Bayes filter takes them."""
