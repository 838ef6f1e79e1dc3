# SPDX-License-Identifier: MIT
"""Rooms of straight walls, and what a planar scanner sees in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2, se3
from slamcli.measurements import LaserScan
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]
Walls = NDArray[np.float64]
"""(W, 4): x, y of both ends."""


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    """Four walls."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


def furnished_room() -> Walls:
    """8 m by 6 m, with furniture that makes every corner another one."""
    return np.array(
        [
            *box(0, 0, 8, 6),
            *box(1, 1, 1.6, 2.2),
            *box(5, 4, 6.5, 4.6),
            *box(6.6, 1.2, 7.2, 1.8),
            *box(2.6, 4.8, 2.9, 5.1),
        ]
    )


def corridor(length: float = 40.0) -> Walls:
    """Two parallel walls, 2 m apart, and nothing else within reach."""
    return np.array([(-length, -1.0, length, -1.0), (-length, 1.0, length, 1.0)])


def ranges_from(walls: Walls, pose: Floats, angles: Floats, reach: float = 20.0) -> Floats:
    """The range (N,) to the next wall along each beam; inf where there is none within reach."""
    directions = np.column_stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])])
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = start - pose[:2]
    cross = directions[:, None, 0] * along[None, :, 1] - directions[:, None, 1] * along[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (offset[None, :, 0] * along[None, :, 1] - offset[None, :, 1] * along[None, :, 0]) / cross
        u = (offset[None, :, 0] * directions[:, None, 1] - offset[None, :, 1] * directions[:, None, 0]) / cross
        hit = (t > 1e-9) & (u >= 0.0) & (u <= 1.0)
    nearest = np.where(hit, t, np.inf).min(axis=1)
    return np.where(nearest <= reach, nearest, np.inf)


def seen(
    walls: Walls, pose: Floats, rng: np.random.Generator | None = None, *, beams: int = 240, reach: float = 20.0
) -> NodeScan:
    """What a scanner that sees all around sees from a pose, with 1 cm of noise where there is a generator."""
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False)
    ranges = ranges_from(walls, pose, angles, reach)
    hit = np.isfinite(ranges)
    noisy = ranges[hit] + (0.0 if rng is None else rng.normal(0.0, 0.01, int(hit.sum())))
    points = np.column_stack([noisy * np.cos(angles[hit]), noisy * np.sin(angles[hit]), np.zeros(int(hit.sum()))])
    return NodeScan(points=points.astype(np.float32), planar=True, T_base_sensor=np.eye(4), range_max_m=reach)


def laser_scan(
    walls: Walls, pose: Floats, stamp_ns: int, rng: np.random.Generator, *, beams: int = 181, reach: float = 20.0
) -> LaserScan:
    """A scan of the 180 degrees ahead."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, beams)
    ranges = ranges_from(walls, pose, angles, reach) + rng.normal(0.0, 0.01, beams)
    return LaserScan(
        stamp_ns=stamp_ns, frame_id="laser", angle_min_rad=-np.pi / 2, angle_increment_rad=np.pi / (beams - 1),
        range_min_m=0.05, range_max_m=reach, ranges_m=ranges.astype(np.float32), topic="/scan",
    )  # fmt: skip


def driven(graph_poses: Floats, odometry: Floats, sigma_m: float = 0.02, sigma_rad: float = 0.01) -> MapGraph:
    """A graph of nodes 1 to N at poses (N, 3), tied by the motions of the odometry (N, 3)."""
    graph = MapGraph()
    information = np.diag([sigma_m**-2] * 2 + [1e6] * 3 + [sigma_rad**-2])
    for row, pose in enumerate(graph_poses):
        T_odom = se3.from_se2(odometry[row])
        graph.add_node(GraphNode(id=row + 1, map_id=0, stamp_ns=row, T_odom_base=T_odom), se3.from_se2(pose))
        if row:
            motion = se3.from_se2(se2.between(odometry[row - 1], odometry[row]))
            graph.add_link(
                Link(from_id=row, to_id=row + 1, kind=LinkKind.NEIGHBOR, T_from_to=motion, information=information)
            )
    return graph
