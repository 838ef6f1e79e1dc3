# SPDX-License-Identifier: MIT
"""The graph of keyframes or nodes that a tier ends with: who shares points with whom, what ties them, the loops."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import se3
from slamcli.posegraph.constraint_residuals import rotation_angle

EdgeKind = Literal["covisible", "tree", "loop", "odometry", "proximity"]
EDGE_KINDS: tuple[EdgeKind, ...] = get_args(EdgeKind)
"""In the order of the numbers in `KeyframeGraph.kinds`. Keyframes of bundle adjustment are covisible and hang in a spanning tree;
nodes of a graph of measured poses follow each other by odometry, and are tied by loops (by looks) and by being near."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeyframeGraph:
    """Keyframes and the edges between them, each pair once."""

    stamps_ns: NDArray[np.int64]
    """int64 (K,), increasing or not: the order is that of the keyframes' poses."""
    T_map_base: NDArray[np.float64]
    """float64 (K, 4, 4), final poses of the base frame, metres."""
    pairs: NDArray[np.int64]
    """int64 (E, 2), rows of the keyframes that an edge ties; the first is the smaller one."""
    shared: NDArray[np.int64]
    """int64 (E,), points that both see."""
    kinds: NDArray[np.int64]
    """int64 (E,), places in `EDGE_KINDS`: what an edge is besides sharing points."""
    T_first_second: NDArray[np.float64] | None = None
    """float64 (E, 4, 4), measured pose of the second keyframe in the first; None: the final poses say all there is."""
    information: NDArray[np.float64] | None = None
    """float64 (E, 6, 6) of the measured poses, translation before rotation; None: the identity."""
    ids: NDArray[np.int64] | None = None
    """int64 (K,), numbers of the nodes in the tier's database; None: it has none."""

    def __post_init__(self) -> None:
        num_keyframes, num_edges = len(self.stamps_ns), len(self.pairs)
        for name, shape in (
            ("T_map_base", (num_keyframes, 4, 4)), ("pairs", (num_edges, 2)), ("shared", (num_edges,)), ("kinds", (num_edges,)),
            ("T_first_second", (num_edges, 4, 4)), ("information", (num_edges, 6, 6)), ("ids", (num_keyframes,)),
        ):  # fmt: skip
            values = getattr(self, name)
            if values is not None and values.shape != shape:
                raise DataError(f"keyframe graph: {name} has shape {values.shape}, not {shape}")
        if num_edges and (self.pairs.min() < 0 or self.pairs.max() >= num_keyframes):
            raise DataError(f"keyframe graph: an edge names a keyframe that is not there ({num_keyframes} are)")

    def of_kind(self, *kinds: EdgeKind) -> NDArray[np.int64]:
        """Return the edges of some kinds, in their order."""
        return np.flatnonzero(np.isin(self.kinds, [EDGE_KINDS.index(kind) for kind in kinds]))

    def residuals(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what the final poses differ by from the measured ones: float64 (E,) metres, float64 (E,) radians.

        Zeros where nothing was measured.
        """
        if self.T_first_second is None:
            return np.zeros(len(self.pairs)), np.zeros(len(self.pairs))
        first, second = self.pairs.T
        off = se3.inverse(self.T_first_second) @ se3.inverse(self.T_map_base[first]) @ self.T_map_base[second]
        return np.linalg.norm(off[:, :3, 3], axis=1), rotation_angle(off[:, :3, :3])
