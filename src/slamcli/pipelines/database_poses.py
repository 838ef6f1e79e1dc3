# SPDX-License-Identifier: MIT
"""The trajectories and the graph in a database of RTAB-Map."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.formats.g2o import G2oGraph
from slamcli.geometry import se3
from slamcli.rtabmap.database import Database, NodeTable
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

PARTS = ("optimised", "odometry", "truth")
_OF_ONE = (LinkKind.POSE_PRIOR, LinkKind.GRAVITY, LinkKind.LANDMARK)
_UNUSED = -9


def read_database_poses(path: str | os.PathLike[str], part: str = "", *, log: RunLog | None = None) -> Trajectory:
    """Return poses of the nodes of a database, by id.

    Parameters
    ----------
    part
        ``optimised`` (nothing: the same, or odometry where nothing was optimised), ``odometry`` or ``truth``.

    Raises
    ------
    FormatError
        If the file is no database of RTAB-Map, or has no such poses.
    UsageError
        If there is no such part.
    """
    if part and part not in PARTS:
        raise UsageError(
            f"{path}: no part {part!r} in a database; give {', '.join(f'{path}:{name}' for name in PARTS)}"
        )
    with Database.read(Path(path)) as database:
        ids, T = _poses(database, part, log)
        table = database.nodes()
    rows = np.searchsorted(table.ids, ids)
    position, quat = se3.to_position_quaternion(T)
    frame = "odom" if part == "odometry" else "map"
    source = f"{path}:{part}" if part else str(path)
    return Trajectory(table.stamps_ns[rows].copy(), position, quat, frame, "base_link", source=source)


def read_database_graph(path: str | os.PathLike[str], log: RunLog) -> G2oGraph:
    """Return the optimised poses of a database and the links between them; what ties a node to no other is left out with a note.

    Nodes that were not optimised, as those in between, have the pose that odometry tells from the last one that was.

    Raises
    ------
    FormatError
        If the file is no database of RTAB-Map, or has no poses.
    """
    with Database.read(Path(path)) as database:
        ids, T = _with_others(database.nodes(), *_poses(database, "", log))
        known = set(ids.tolist())
        links = [link for link in database.links() if link.kind not in _OF_ONE]
        alone = sum(link.kind in _OF_ONE for link in database.links())
    kept = [link for link in links if link.from_id in known and link.to_id in known]
    if alone:
        log.note(f"{path}: {alone} priors, gravity links and sightings of landmarks are left out")
    if len(kept) < len(links):
        log.note(f"{path}: {len(links) - len(kept)} links of nodes without an optimised pose are left out")
    position, quat = se3.to_position_quaternion(T)
    return G2oGraph(
        dimension=3, ids=ids, poses=np.hstack([position, quat]), fixed=ids[:1].copy(),
        first=np.array([link.from_id for link in kept], dtype=np.int64),
        second=np.array([link.to_id for link in kept], dtype=np.int64),
        measured=_measured(kept), information=np.array([_symmetric(link) for link in kept]).reshape(-1, 6, 6),
        comments=(f"nodes and links of {Path(path).name}",),
    )  # fmt: skip


def _poses(database: Database, part: str, log: RunLog | None) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return ids (N,) and poses (N, 4, 4)."""
    table, optimised = database.nodes(), database.optimised()
    if part in ("", "optimised") and optimised is not None:
        there = np.isin(optimised.ids, table.ids)
        order = np.argsort(optimised.ids[there], kind="stable")
        return optimised.ids[there][order], optimised.T_map_base[there][order]
    if part == "optimised":
        raise FormatError(f"{database.path}: no optimised poses in it; give {database.path}:odometry")
    if part == "" and log is not None:
        log.note(f"{database.path}: nothing in it was optimised: the poses are those of odometry")
    return _of_nodes(database.path, table, part)


def _with_others(
    table: NodeTable, ids: NDArray[np.int64], T_map_base: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return all nodes with a pose: those that were not optimised follow the last one of their session that was."""
    optimised = dict(zip(ids.tolist(), T_map_base, strict=True))
    found: dict[int, NDArray[np.float64]] = {}
    corrections: dict[int, NDArray[np.float64]] = {}
    for node_id, map_id, weight, T_odom in zip(
        table.ids.tolist(), table.map_ids.tolist(), table.weights.tolist(), table.T_odom_base, strict=True
    ):
        T = optimised.get(node_id)
        if T is not None:
            found[node_id] = T
            if np.isfinite(T_odom).all():
                corrections[map_id] = T @ se3.inverse(T_odom)
        elif np.isfinite(T_odom).all() and weight != _UNUSED and map_id in corrections:
            found[node_id] = corrections[map_id] @ T_odom
    return np.array(list(found), dtype=np.int64), np.array(list(found.values())).reshape(-1, 4, 4)


def _of_nodes(path: Path, table: NodeTable, part: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    T = table.ground_truth if part == "truth" else table.T_odom_base
    known = np.isfinite(T).all(axis=(1, 2)) & (table.weights != _UNUSED)
    if not known.any():
        raise FormatError(f"{path}: no node has a pose by {'ground truth' if part == 'truth' else 'odometry'}")
    return table.ids[known], T[known]


def _measured(links: Sequence[Link]) -> NDArray[np.float64]:
    if not links:
        return np.zeros((0, 7))
    position, quat = se3.to_position_quaternion(np.array([link.T_from_to for link in links]))
    return np.hstack([position, quat])


def _symmetric(link: Link) -> NDArray[np.float64]:
    return (link.information + link.information.T) / 2
