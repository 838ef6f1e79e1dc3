# SPDX-License-Identifier: MIT
"""What one update of the memory did: a row of the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateRecord:
    """One node that was added."""

    stamp_ns: int
    node: int
    map_id: int
    num_features: int
    hypothesis: int
    """Node with the highest posterior; 0: the virtual place, that it is a new one."""
    posterior: float
    """Of the hypothesis, 0 to 1."""
    loop_closure: int
    """Node that a closure by looks tied it to; 0: none."""
    loop_inliers: int
    proximity_closures: int
    refused: int
    """Closures that were found and refused."""
    short_term: int
    """Nodes in short-term memory."""
    working: int
    """In working memory."""
    long_term: int
    """In the database only."""
    words: int
    """In the dictionary."""
    retrieved: int
    transferred: int
    similarity: float
    """To the node before, 0 to 1 (rehearsal)."""
    optimised: int
    """Nodes that the optimisation moved; 0: none was needed."""


def columns(records: Sequence[UpdateRecord]) -> dict[str, NDArray[Any]]:
    """Return the records as columns of equal length."""
    return {
        entry.name: np.array(
            [getattr(record, entry.name) for record in records],
            dtype=np.float64 if entry.name in ("posterior", "similarity") else np.int64,
        )
        for entry in fields(UpdateRecord)
    }
