# SPDX-License-Identifier: MIT
"""Maps that nothing tied while they were made, joined in the end by what many nodes say together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.node_rate import motion_size
from slamcli.rtabmap.registration import Registration

Floats = NDArray[np.float64]

_MOST_NODES = 200
"""Whose likeliest places in other maps are looked at, spread over the run."""
_PLACES = 2
"""Of each."""
_AGREE_M, _AGREE_RAD = 0.5, 0.15
"""Two registrations that put one map into the other no farther apart say the same."""
_SURELY = 60
"""Inliers with which one registration alone is believed."""

Alike = Callable[[int, Sequence[int]], Sequence[int]]
"""From a node and the nodes of other maps to those that look like it, the likeliest first."""
Register = Callable[[int, int], Registration]
"""From an old node a and a new one b to how b lies in a."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Join:
    """Registrations that agree how one map lies in another."""

    moved: tuple[int, ...]
    """Nodes of the map that is put into the other."""
    T_to_from: Floats
    """float64 (4, 4): what its poses are to be multiplied with, from the left."""
    pairs: tuple[tuple[int, int, Registration], ...]
    """Old node, new node, and how the new one lies in the old one."""


def find_join(graph: MapGraph, node_ids: Sequence[int], alike: Alike, register: Register) -> Join | None:
    """Return how the map of some nodes lies in another map, by the largest set of registrations that agree.

    Parameters
    ----------
    node_ids
        All of one map: the one that moves.

    Notes
    -----
    Two that agree are needed, or one with many inliers: a place that looks like another is one registration, not two from
    different nodes.
    """
    own = set(graph.component(node_ids[0]))
    others = [node_id for node_id in graph.nodes if node_id not in own]
    if not others:
        return None
    rows = np.unique(np.rint(np.linspace(0, len(node_ids) - 1, min(_MOST_NODES, len(node_ids)))).astype(np.int64))
    found: list[tuple[int, int, Registration, Floats]] = []
    for node_id in (node_ids[row] for row in rows.tolist()):
        for other in alike(node_id, others)[:_PLACES]:
            registration = register(other, node_id)
            if registration.T_a_b is not None:
                T = graph.T_map_base[other] @ registration.T_a_b @ se3.inverse(graph.T_map_base[node_id])
                found.append((other, node_id, registration, T))
    best = max((_agreeing(found, row) for row in range(len(found))), key=_worth, default=[])
    if len({node_id for _, node_id, _, _ in best}) < 2 and _worth(best) < _SURELY:
        return None
    moved = tuple(node_id for node_id in graph.nodes if node_id in own)
    pairs = tuple((other, node_id, registration) for other, node_id, registration, _ in best)
    return Join(moved=moved, T_to_from=best[0][3], pairs=pairs)


def _agreeing(
    found: Sequence[tuple[int, int, Registration, Floats]], row: int
) -> list[tuple[int, int, Registration, Floats]]:
    """Return a registration, and those of other nodes that put the one map where it does."""
    _, node_id, _, T = found[row]
    agreeing = [found[row]]
    for one in found:
        way, turn = motion_size(se3.inverse(T) @ one[3])
        if one[1] != node_id and way <= _AGREE_M and turn <= _AGREE_RAD:
            agreeing.append(one)
    return agreeing


def _worth(agreeing: Sequence[tuple[int, int, Registration, Floats]]) -> int:
    return sum(registration.num_inliers for _, _, registration, _ in agreeing)
