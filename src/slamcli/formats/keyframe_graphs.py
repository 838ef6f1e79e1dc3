# SPDX-License-Identifier: MIT
"""Graphs of keyframes and nodes in files: all edges as CSV, the tree, odometry and closures as a g2o graph."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from slamcli.formats.g2o import G2oGraph
from slamcli.formats.text_tables import format_stamp_s
from slamcli.geometry import se3
from slamcli.posegraph.keyframe_graph import EDGE_KINDS, KeyframeGraph

LINK_COLUMNS = (
    "node_a", "node_b", "stamp_a_s", "stamp_b_s", "kind", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw",
    "translation_residual_m", "rotation_residual_rad",
)  # fmt: skip


def write_covisibility(path: str | os.PathLike[str], graph: KeyframeGraph) -> None:
    """Write one line per edge: both keyframes (rows of ``keyframes.tum``, from 0), their stamps, shared points, and the kind."""
    stamps = [format_stamp_s(ns) for ns in graph.stamps_ns.tolist()]
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("keyframe_a", "keyframe_b", "stamp_a_s", "stamp_b_s", "shared_points", "kind"))
        for (a, b), shared, kind in zip(graph.pairs.tolist(), graph.shared.tolist(), graph.kinds.tolist(), strict=True):
            writer.writerow((a, b, stamps[a], stamps[b], shared, EDGE_KINDS[kind]))


def write_links(path: str | os.PathLike[str], graph: KeyframeGraph) -> None:
    """Write one line per measured edge: both nodes, their stamps, the kind, the motion between them, and what the map is off by.

    Nodes are numbered as in the database of the tier; their stamps find them in ``keyframes.tum``. The motion is the pose of node b
    in node a, in metres and a unit quaternion; residuals are in metres and radians. ``graph.g2o`` holds the information matrices.
    """
    stamps = [format_stamp_s(ns) for ns in graph.stamps_ns.tolist()]
    ids = np.arange(len(stamps)) if graph.ids is None else graph.ids
    measured = np.tile(np.eye(4), (len(graph.pairs), 1, 1)) if graph.T_first_second is None else graph.T_first_second
    motions = np.concatenate(se3.to_position_quaternion(measured), axis=1).tolist()
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(LINK_COLUMNS)
        rows = zip(graph.pairs.tolist(), graph.kinds.tolist(), motions, *graph.residuals(), strict=True)
        for (a, b), kind, motion, metres, radians in rows:
            values = [f"{value:.9g}" for value in (*motion, metres, radians)]
            writer.writerow((int(ids[a]), int(ids[b]), stamps[a], stamps[b], EDGE_KINDS[kind], *values))


def g2o_of_keyframes(graph: KeyframeGraph) -> G2oGraph:
    """Return keyframes as vertices, numbered as in ``keyframes.tum`` from 0, and all edges but covisibility; the first is fixed.

    Where the tier measured no poses between keyframes, edges hold those of the final map, with the identity as information.
    """
    edges = graph.of_kind("tree", "loop", "odometry", "proximity")
    first, second = graph.pairs[edges].T
    T = graph.T_map_base
    measured = se3.inverse(T[first]) @ T[second] if graph.T_first_second is None else graph.T_first_second[edges]
    information = np.tile(np.eye(6), (len(edges), 1, 1)) if graph.information is None else graph.information[edges]
    kinds = [EDGE_KINDS[kind] for kind in graph.kinds[edges].tolist()]
    loops = [f"edge {i}: {kind}" for i, kind in enumerate(kinds) if kind in ("loop", "proximity")]
    return G2oGraph(
        dimension=3, ids=np.arange(len(T)), poses=np.concatenate(se3.to_position_quaternion(T), axis=1), first=first.copy(),
        second=second.copy(), measured=np.concatenate(se3.to_position_quaternion(measured), axis=1), information=information,
        fixed=np.arange(min(1, len(T))), comments=("vertices are the keyframes", *loops),
    )  # fmt: skip
