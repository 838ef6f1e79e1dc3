# SPDX-License-Identifier: MIT
"""Whether what a pose graph is made of can be used: the same in the plane and in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError


def check_graph(poses: NDArray[np.float64], groups: Sequence[Any]) -> None:
    """Refuse poses (N, D) and groups of edges (`PlanarEdges` or `SpatialEdges`) that cannot be adjusted.

    Raises
    ------
    EstimationError
        If a number is not finite or an index names no pose; the message names the edge.
    """
    if not np.all(np.isfinite(poses)):
        bad = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise EstimationError(f"pose {bad} of the graph is not finite: {poses[bad].tolist()}")
    for edges in groups:
        for name in ("measured", "translation_weight", "rotation_weight", "information", "ratio"):
            values = getattr(edges, name)
            if values is not None and not np.all(np.isfinite(values)):
                bad = int(np.argmin(np.isfinite(values).reshape(len(edges), -1).all(axis=1)))
                raise EstimationError(f"edge {_name(edges, bad)} of the graph: {name} is not finite")
        for indices in (edges.first, edges.second, edges.until):
            if indices is not None and len(indices) and not (indices.min() >= 0 and indices.max() < len(poses)):
                bad = int(np.argmax((indices < 0) | (indices >= len(poses))))
                raise EstimationError(f"edge {_name(edges, bad)} of the graph names no pose: there are {len(poses)}")


def _name(edges: Any, index: int) -> str:
    return f"{index} (from pose {int(edges.first[index])} to {int(edges.second[index])})"
