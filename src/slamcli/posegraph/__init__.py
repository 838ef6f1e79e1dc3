# SPDX-License-Identifier: MIT
"""Nodes, edges and their robust optimisation; the state of a mapping run that can be saved and gone on with."""

from slamcli.posegraph.map_state import Constraint, Id, LoopSearch, MapState, Node, Submap, TrajectoryData
from slamcli.posegraph.merging import freeze, merge_states

__all__ = [
    "Constraint",
    "Id",
    "LoopSearch",
    "MapState",
    "Node",
    "Submap",
    "TrajectoryData",
    "freeze",
    "merge_states",
]
