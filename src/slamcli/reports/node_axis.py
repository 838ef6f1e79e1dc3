# SPDX-License-Identifier: MIT
"""The axis along which a memory of places is drawn: time, or nodes where there are recordings of several days."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.reports.step_charts import time_axis


class NodeAxis:
    """Places of nodes on the axis.

    Parameters
    ----------
    steps
        Columns (N,) with ``node`` and ``stamp_ns``, a row for each node of the run.
    began_ns
        When time begins; None: with the first node.
    """

    def __init__(self, steps: Mapping[str, NDArray[Any]], began_ns: int | None) -> None:
        nodes, stamps = (np.asarray(steps.get(name, ()), dtype=np.int64) for name in ("node", "stamp_ns"))
        by_time = not _is_broken(stamps)
        self.x: NDArray[np.float64]
        """float64 (N,), not decreasing."""
        self.x, self.label = (
            time_axis(stamps, began_ns) if by_time and len(stamps) else (nodes.astype(np.float64), "node")
        )
        began = int(stamps[0]) if began_ns is None and len(stamps) else began_ns or 0
        self._x_of = dict(zip(nodes.tolist(), self.x.tolist(), strict=True))
        self._seconds = (
            {node: (stamp - began) / 1e9 for node, stamp in zip(nodes.tolist(), stamps.tolist(), strict=True)}
            if by_time
            else {}
        )

    def of_nodes(self, nodes: Sequence[int]) -> NDArray[np.float64]:
        """Return where nodes lie (M,); NaN for those of other runs."""
        return np.array([self._x_of.get(node, np.nan) for node in nodes], dtype=np.float64)

    def named(self, node: int) -> str:
        """Return a node's number with its time."""
        if node < 0:
            return f"landmark {-node}"
        seconds = self._seconds.get(node)
        if seconds is None:
            return f"{node}" if node in self._x_of else f"{node} (earlier)"
        return f"{node} at {seconds:.1f} s".replace(" ", "\N{NO-BREAK SPACE}")


def _is_broken(stamps_ns: NDArray[np.int64]) -> bool:
    """Return whether most of the time nothing was recorded, or time runs backwards."""
    steps = np.diff(stamps_ns)
    return len(steps) > 0 and bool(steps.min() < 0 or (steps.max() > 600e9 and 2 * steps.max() > steps.sum()))
