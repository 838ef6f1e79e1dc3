# SPDX-License-Identifier: MIT
"""What local SLAM built, as a part of the pose graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_2d import TrajectoryPart
from slamcli.cartographer.local_slam_2d import LocalSlam2d
from slamcli.posegraph import Id


def trajectory_part(local: LocalSlam2d, slack_m: NDArray[np.float64], number: int) -> TrajectoryPart:
    """Return the submaps and nodes so far as trajectory `number`, in the map as in the local frame.

    `slack_m` (N,) is how uncertain the motion to each scan is where scans did not tell it, else 0.
    """
    submaps, nodes = local.submaps.all, local.nodes
    submap_local = np.array([submap.local_pose for submap in submaps])
    node_local = np.array([node.pose for node in nodes])
    scans = np.array([node.scan for node in nodes])
    variance = np.concatenate([[0.0], np.cumsum(slack_m**2)])
    slack = np.sqrt(np.diff(variance[np.concatenate([[0], scans + 1])]))
    return TrajectoryPart(
        trajectory=number, frozen=False, submap_ids=[Id(number, submap.number) for submap in submaps],
        submap_local=submap_local, submap_map=submap_local.copy(), grids=[submap.grid for submap in submaps],
        finished=[submap.finished for submap in submaps], node_ids=[Id(number, k) for k in range(len(nodes))],
        node_local=node_local, node_map=node_local.copy(), points=[node.points for node in nodes],
        members=[node.submaps for node in nodes], slack_m=slack,
    )  # fmt: skip
