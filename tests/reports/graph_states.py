# SPDX-License-Identifier: MIT
"""A hand-made state: a robot that drives twice around a corridor of 20 x 10 m, with drift that loop constraints took out."""

from __future__ import annotations

import numpy as np

from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Constraint, Id, LoopSearch, MapState, Node, Submap
from slamcli.trajectory import Trajectory

NODES, PER_SUBMAP = 240, 20
RESOLUTION = 0.1


def true_poses():
    """Poses (NODES, 3) along the corridor, two rounds of 60 m."""
    corners = np.array([(0, 0), (20, 0), (20, 10), (0, 10), (0, 0)], dtype=float)
    along = (np.arange(NODES) * 0.5) % 60.0
    ends = np.array([0.0, 20.0, 30.0, 50.0, 60.0])
    x, y = (np.interp(along, ends, corners[:, i]) for i in (0, 1))
    yaw = np.array([0, np.pi / 2, np.pi, -np.pi / 2])[np.searchsorted(ends, along, side="right") - 1]
    return np.column_stack([x, y, yaw])


def local_poses(poses):
    """The same with a drift in heading of 0.1 degrees a node."""
    motions = np.linalg.inv(se3.from_se2(poses)[:-1]) @ se3.from_se2(poses)[1:]
    turn = se3.from_se2([0.0, 0.0, np.radians(0.1)])
    found = [np.eye(4)]
    for motion in motions:
        found.append(found[-1] @ motion @ turn)
    return np.array(found)


def occupancy(poses):
    """The corridor as a map: walls 1 m beside the robot's path."""
    cells = np.full((150, 250), -1, dtype=np.int8)
    grid = OccupancyGrid(cells, RESOLUTION, (-2.0, -2.0, 0.0))
    x = -2.0 + (np.arange(250) + 0.5) * RESOLUTION
    y = -2.0 + (np.arange(150) + 0.5) * RESOLUTION
    gap = np.min([np.hypot(x[None] - px, y[:, None] - py) for px, py, _ in poses[::2]], axis=0)
    cells[gap < 1.0] = 0
    cells[(gap >= 1.0) & (gap < 1.15)] = 100
    return grid


def submap_grid(poses, T_local):
    """What one submap knows, in the local frame: walls 1 m beside the path."""
    at = T_local[:, :2, 3]
    low = at.min(axis=0) - 1.5
    height, width = (np.ceil((at.max(axis=0) + 1.5 - low) / RESOLUTION).astype(int))[::-1]
    x = low[0] + (np.arange(width) + 0.5) * RESOLUTION
    y = low[1] + (np.arange(height) + 0.5) * RESOLUTION
    gap = np.min([np.hypot(x[None] - px, y[:, None] - py) for px, py in at], axis=0)
    cells = np.zeros((height, width), dtype=np.uint16)
    cells[gap < 1.2] = 30000
    cells[(gap >= 1.0) & (gap < 1.2)] = 3000
    return ProbabilityGrid(cells, RESOLUTION, (float(low[0]), float(low[1])))


def state_and_searches(*, three_d=False, trajectories=1):
    poses = true_poses()
    T_map = se3.from_se2(poses)
    T_local = local_poses(poses)
    rng = np.random.default_rng(5)
    owner = np.arange(NODES) // PER_SUBMAP
    stamps = 1_600_000_000_000_000_000 + np.arange(NODES) * 500_000_000
    ids = [Id(int(k * trajectories // NODES), int(k % (NODES // trajectories))) for k in range(NODES)]
    nodes = tuple(
        Node(
            id=ids[k],
            stamp_ns=int(stamps[k]),
            T_local_node=T_local[k],
            T_map_node=T_map[k],
            gravity_alignment_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
            points_m=np.zeros((4, 3), dtype=np.float32),
        )
        for k in range(NODES)
    )
    count = NODES // PER_SUBMAP
    per_trajectory = count // trajectories
    submap_ids = [Id(i // per_trajectory, i % per_trajectory) for i in range(count)]
    submaps = []
    for i in range(count):
        its = slice(i * PER_SUBMAP, (i + 1) * PER_SUBMAP)
        first = i * PER_SUBMAP
        cloud = rng.integers(-20, 20, (500, 3)).astype(np.int32)
        submaps.append(
            Submap(
                id=submap_ids[i],
                T_local_submap=T_local[first],
                T_map_submap=T_map[first],
                num_range_data=PER_SUBMAP,
                finished=i < count - 1,
                grid=None if three_d else submap_grid(poses[its], T_local[its]),
                high_resolution=HybridGrid(
                    np.unique(cloud, axis=0), np.full(len(np.unique(cloud, axis=0)), 30000, np.uint16), 0.1
                )
                if three_d
                else None,
            )
        )
    constraints, searches = [], []
    for k in range(NODES):
        for i in range(count):
            T = np.linalg.inv(T_map[i * PER_SUBMAP]) @ T_map[k]
            if owner[k] == i:
                off = se3.from_se2([*rng.normal(0, 0.004, 2), rng.normal(0, 0.0005)])
                constraints.append(_constraint(submap_ids[i], ids[k], T @ off, "intra"))
            elif (
                owner[k] > i + 6
                and k % 3 == 0
                and np.linalg.norm(T_map[k, :2, 3] - T_map[i * PER_SUBMAP + 10, :2, 3]) < 6
            ):
                bad = k in (171, 174)
                off = se3.from_se2([*rng.normal(0, 0.4 if bad else 0.03, 2), rng.normal(0, 0.05 if bad else 0.004)])
                score = float(rng.uniform(0.5, 0.85))
                accepted = score > 0.6
                searches.append(
                    LoopSearch(
                        submap=submap_ids[i], node=ids[k], score=score, accepted=accepted, reason="" if accepted else "score",
                        translation_residual_m=float(np.linalg.norm(off[:2, 3])) if accepted else float("nan"),
                        rotation_residual_rad=0.004 if accepted else float("nan"), round=int(k > 200),
                    )
                )  # fmt: skip
                if accepted:
                    constraints.append(_constraint(submap_ids[i], ids[k], T @ off, "inter"))
            elif owner[k] > i + 6 and k % 15 == 0:
                searches.append(
                    LoopSearch(
                        submap=submap_ids[i],
                        node=ids[k],
                        score=0.0,
                        accepted=False,
                        reason="no match <above> the bound",
                    )
                )
    state = MapState(nodes=nodes, submaps=tuple(submaps), constraints=tuple(constraints))
    return state, tuple(searches)


def _constraint(submap, node, T, kind):
    return Constraint(
        submap=submap, node=node, T_submap_node=T, translation_weight=500.0, rotation_weight=1600.0, kind=kind
    )


def trajectory():
    stamps = 1_600_000_000_000_000_000 + np.arange(NODES) * 500_000_000
    return Trajectory.from_se2(stamps, true_poses())
