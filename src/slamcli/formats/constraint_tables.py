# SPDX-License-Identifier: MIT
"""The constraints of a pose graph and the searches for loop closures as CSV, for spreadsheets and pandas; slamcli reads neither back."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from slamcli.posegraph import Id, LoopSearch, MapState, Node
from slamcli.posegraph.constraint_residuals import constraint_residuals

_IDS = ("submap_trajectory", "submap", "node_trajectory", "node", "node_stamp_s")
_RESIDUALS = ("translation_residual_m", "rotation_residual_rad")


def write_constraints(path: str | os.PathLike[str], state: MapState) -> None:
    """Write one line per constraint: kind, submap, node and its stamp, weights, and what the optimised poses are off by.

    Residuals are empty where the submap or the node was trimmed.
    """
    nodes = {node.id: node for node in state.nodes}
    residuals = zip(*(column.tolist() for column in constraint_residuals(state)), strict=True)
    rows = (
        [
            c.kind,
            *_ids(c.submap, c.node, nodes),
            repr(c.translation_weight),
            repr(c.rotation_weight),
            _number(metres),
            _number(radians),
        ]
        for c, (metres, radians) in zip(state.constraints, residuals, strict=True)
    )
    _write(path, ("kind", *_IDS, "translation_weight", "rotation_weight", *_RESIDUALS), rows)


def write_loop_searches(path: str | os.PathLike[str], searches: Sequence[LoopSearch], state: MapState | None) -> None:
    """Write one line per search for a loop closure, accepted or not, with its score and why it was rejected.

    Stamps and positions (the optimised node in the map) are empty where the node was trimmed.
    """
    nodes = {node.id: node for node in state.nodes} if state is not None else {}
    rows = (
        [
            str(s.round), *_ids(s.submap, s.node, nodes), *_position(nodes.get(s.node)), _number(s.score), str(int(s.accepted)),
            s.reason, _number(s.translation_residual_m), _number(s.rotation_residual_rad),
        ]
        for s in searches
    )  # fmt: skip
    _write(path, ("round", *_IDS, "x_m", "y_m", "z_m", "score", "accepted", "reason", *_RESIDUALS), rows)


def _write(path: str | os.PathLike[str], names: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(rows)


def _ids(submap: Id, node: Id, nodes: dict[Id, Node]) -> list[str]:
    known = nodes.get(node)
    stamp = ""
    if known is not None:
        seconds, rest = divmod(known.stamp_ns, 1_000_000_000)
        stamp = f"{seconds}.{rest:09d}"
    return [str(submap.trajectory), str(submap.number), str(node.trajectory), str(node.number), stamp]


def _position(node: Node | None) -> list[str]:
    return ["", "", ""] if node is None else [f"{v:.6f}" for v in node.T_map_node[:3, 3].tolist()]


def _number(value: float) -> str:
    return f"{value:.9g}" if math.isfinite(value) else ""
