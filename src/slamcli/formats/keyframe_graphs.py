# SPDX-License-Identifier: MIT
"""Graphs of keyframes in files: all edges as CSV, the tree and the loops as a g2o graph."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from slamcli.formats.g2o import G2oGraph
from slamcli.geometry import se3
from slamcli.posegraph.keyframe_graph import EDGE_KINDS, KeyframeGraph


def write_covisibility(path: str | os.PathLike[str], graph: KeyframeGraph) -> None:
    """Write one line per edge: both keyframes (rows of ``keyframes.tum``, from 0), their stamps, shared points, and the kind."""
    stamps = [f"{ns // 1_000_000_000}.{ns % 1_000_000_000:09d}" for ns in graph.stamps_ns.tolist()]
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("keyframe_a", "keyframe_b", "stamp_a_s", "stamp_b_s", "shared_points", "kind"))
        for (a, b), shared, kind in zip(graph.pairs.tolist(), graph.shared.tolist(), graph.kinds.tolist(), strict=True):
            writer.writerow((a, b, stamps[a], stamps[b], shared, EDGE_KINDS[kind]))


def g2o_of_keyframes(graph: KeyframeGraph) -> G2oGraph:
    """Return keyframes as vertices, numbered as in ``keyframes.tum`` from 0, and tree and loop edges; the first keyframe is fixed.

    Where the tier measured no poses between keyframes, edges hold those of the final map, with the identity as information.
    """
    edges = graph.of_kind("tree", "loop")
    first, second = graph.pairs[edges].T
    T = graph.T_map_base
    measured = se3.inverse(T[first]) @ T[second] if graph.T_first_second is None else graph.T_first_second[edges]
    information = np.tile(np.eye(6), (len(edges), 1, 1)) if graph.information is None else graph.information[edges]
    kinds = [EDGE_KINDS[kind] for kind in graph.kinds[edges].tolist()]
    loops = [f"edge {i}: loop" for i, kind in enumerate(kinds) if kind == "loop"]
    return G2oGraph(
        dimension=3, ids=np.arange(len(T)), poses=np.concatenate(se3.to_position_quaternion(T), axis=1), first=first.copy(),
        second=second.copy(), measured=np.concatenate(se3.to_position_quaternion(measured), axis=1), information=information,
        fixed=np.arange(min(1, len(T))), comments=("vertices are the keyframes", *loops),
    )  # fmt: skip
