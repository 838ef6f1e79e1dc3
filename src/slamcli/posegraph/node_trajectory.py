# SPDX-License-Identifier: MIT
"""The trajectories that are in a state."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.posegraph.map_state import MapState
from slamcli.trajectory import Trajectory


def state_trajectory(
    state: MapState,
    trajectories: Collection[int] | None = None,
    frame_id: str = "map",
    child_frame_id: str = "base_link",
) -> Trajectory:
    """Return the optimised poses of the nodes, trajectory after trajectory, each in the order of its nodes.

    Parameters
    ----------
    state
        The state.
    trajectories
        Which to take; None for all.
    frame_id, child_frame_id
        Names for the map's frame and the tracking frame.

    Raises
    ------
    EstimationError
        If there is no node.
    """
    nodes = sorted(
        (node for node in state.nodes if trajectories is None or node.id.trajectory in trajectories),
        key=lambda node: node.id,
    )
    if not nodes:
        raise EstimationError("the state has no node: there is no trajectory in it")
    positions, quats = se3.to_position_quaternion(np.array([node.T_map_node for node in nodes]))
    stamps = np.array([node.stamp_ns for node in nodes], np.int64)
    return Trajectory(stamps, positions, quats, frame_id, child_frame_id)
