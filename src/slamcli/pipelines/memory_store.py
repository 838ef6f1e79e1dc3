# SPDX-License-Identifier: MIT
"""What working memory asks of long-term memory."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.rtabmap.signature import Signature


class LongTermStore(Protocol):
    """Where nodes and words are written when they are made; the database is one."""

    def read_signature(self, node_id: int) -> Signature:
        """Return a node that was written."""
        ...

    def read_words(self, ids: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
        """Return those of some words that were written, by number: numbers (W,), and descriptors uint8 (W, 32)."""
        ...
