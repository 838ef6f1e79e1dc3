# SPDX-License-Identifier: MIT
"""Where the robot was between the nodes of a trajectory in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2

_LONGEST_GAP_NS = 6_000_000_000
"""Farther from the next scan nothing says where the robot was; a robot at rest makes a node every 5 s."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Timeline:
    """Local poses over time, and the nodes that they hang on."""

    rows: NDArray[np.int64]
    """int64 (K,), of the nodes in the graph, in the order of time."""
    node_local: NDArray[np.float64]
    """float64 (K, 3)."""
    node_stamps_ns: NDArray[np.int64]
    """int64 (K,), increasing."""
    stamps_ns: NDArray[np.int64]
    """int64 (N,), increasing."""
    poses: NDArray[np.float64]
    """float64 (N, 3), of the base in the local frame at these times."""

    @classmethod
    def of_nodes(
        cls, rows: NDArray[np.int64], node_local: NDArray[np.float64], stamps_ns: NDArray[np.int64]
    ) -> Timeline:
        """Return the timeline of a trajectory of which the nodes only are known."""
        order = np.argsort(stamps_ns, kind="stable")
        stamps = stamps_ns[order]
        return cls(
            rows=rows[order], node_local=node_local[order], node_stamps_ns=stamps, stamps_ns=stamps, poses=node_local[order]
        )  # fmt: skip

    @classmethod
    def of_scans(
        cls,
        rows: NDArray[np.int64],
        node_local: NDArray[np.float64],
        stamps_ns: NDArray[np.int64],
        poses: NDArray[np.float64],
        node_scans: NDArray[np.int64],
    ) -> Timeline:
        """Return the timeline of a trajectory all of whose scans (N,) have poses; nodes were made of `node_scans` (K,)."""
        return cls(
            rows=rows, node_local=node_local, node_stamps_ns=stamps_ns[node_scans], stamps_ns=stamps_ns, poses=poses
        )

    def seen_from_nodes(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return for each time (M,) the row of the nearest node, the base seen from it (M, 3), and whether that is known."""
        if len(self.rows) == 0:
            return np.zeros(len(stamps_ns), np.int64), np.zeros((len(stamps_ns), 3)), np.zeros(len(stamps_ns), np.bool_)
        base = self.stamps_ns[0]
        times, query = (self.stamps_ns - base).astype(np.float64), (stamps_ns - base).astype(np.float64)
        yaw = np.unwrap(self.poses[:, 2])
        there = np.column_stack([np.interp(query, times, column) for column in (*self.poses[:, :2].T, yaw)])
        nearest = _nearest(self.node_stamps_ns, stamps_ns)
        apart = np.abs(stamps_ns - self.stamps_ns[_nearest(self.stamps_ns, stamps_ns)])
        return self.rows[nearest], se2.between(self.node_local[nearest], there), apart <= _LONGEST_GAP_NS


def _nearest(stamps_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index of the stamp (of N >= 1, increasing) nearest to each wanted one."""
    after = np.clip(np.searchsorted(stamps_ns, wanted_ns), 1, max(len(stamps_ns) - 1, 1))
    if len(stamps_ns) == 1:
        return np.zeros(len(wanted_ns), dtype=np.int64)
    earlier = wanted_ns - stamps_ns[after - 1] <= stamps_ns[after] - wanted_ns
    return np.where(earlier, after - 1, after)
