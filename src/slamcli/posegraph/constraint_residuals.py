# SPDX-License-Identifier: MIT
"""How far the poses of a finished map are from what each constraint says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.posegraph.map_state import Constraint, MapState


def constraint_residuals(
    state: MapState, constraints: Sequence[Constraint] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the residuals of `constraints` (of the state's own by default): float64 (N,) metres, float64 (N,) radians.

    The residual is ``T_submap_node^-1 @ T_map_submap^-1 @ T_map_node``, in the plane too with the node's whole
    orientation (as in a ``.pbstream``). NaN where the submap or the node is no longer part of the map.
    """
    chosen = state.constraints if constraints is None else constraints
    submaps = {submap.id: i for i, submap in enumerate(state.submaps)}
    nodes = {node.id: i for i, node in enumerate(state.nodes)}
    translation, rotation = np.full(len(chosen), np.nan), np.full(len(chosen), np.nan)
    known = [i for i, c in enumerate(chosen) if c.submap in submaps and c.node in nodes]
    if not known:
        return translation, rotation
    s = np.array([submaps[chosen[i].submap] for i in known])
    n = np.array([nodes[chosen[i].node] for i in known])
    T_map_submap = np.array([submap.T_map_submap for submap in state.submaps])[s]
    T_map_node = np.array([node.T_map_node for node in state.nodes])[n]
    T_submap_node = np.array([chosen[i].T_submap_node for i in known])
    residual = se3.inverse(T_submap_node) @ se3.inverse(T_map_submap) @ T_map_node
    translation[known] = np.linalg.norm(residual[:, :3, 3], axis=1)
    rotation[known] = rotation_angle(residual[:, :3, :3])
    return translation, rotation


def rotation_angle(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles (N,), 0 to pi, of rotation matrices (N, 3, 3); exact for small ones too."""
    quats = quaternion.from_matrix(rotation)
    return 2.0 * np.arctan2(np.linalg.norm(quats[:, :3], axis=1), np.abs(quats[:, 3]))
