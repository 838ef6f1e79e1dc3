# SPDX-License-Identifier: MIT
"""Odometry between consecutive nodes as a term of its own in a graph in the plane, as Cartographer has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.geometry import se2
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges


def odometry_term(graph: PoseGraph2d, wheels: NDArray[np.float64]) -> tuple[PlanarEdges, Loss]:
    """Return the edges between consecutive nodes of the graph's last part, where the odometry has them at `wheels` (N, 3)."""
    o = graph.parameters.optimization_problem
    rows = len(graph.submap) + np.flatnonzero(graph.node_part == len(graph.parts) - 1)
    count = len(rows) - 1
    edges = PlanarEdges(
        first=rows[:-1],
        second=rows[1:],
        measured=se2.between(wheels[:-1], wheels[1:]),
        translation_weight=np.full(count, o.odometry_translation_weight),
        rotation_weight=np.full(count, o.odometry_rotation_weight),
        robust=np.zeros(count, np.bool_),
    )
    return edges, Loss()
