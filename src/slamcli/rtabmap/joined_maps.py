# SPDX-License-Identifier: MIT
"""Which map a run ends with, and which sessions it joins."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from slamcli.errors import EstimationError
from slamcli.rtabmap.map_graph import MapGraph


def chosen_component(graph: MapGraph, own_nodes: Sequence[int], *, localising: bool = False) -> list[int]:
    """Return the ids, increasing, of the nodes of the map that holds most nodes of this run; the older of two equal ones.

    Parameters
    ----------
    localising
        Whether only maps count that were there before.

    Raises
    ------
    EstimationError
        If the run has no nodes, or none that was found in a map that was there before.
    """
    if not own_nodes:
        raise EstimationError(
            "rtabmap: no place of this recording became a node (with Rtabmap/StartNewMapOnLoopClosure: none was known again)"
        )
    own = set(own_nodes)
    component_of: dict[int, int] = {}
    members: dict[int, list[int]] = {}
    for node_id in own_nodes:
        if node_id not in component_of:
            found = [other for other in graph.component(node_id) if other in graph.nodes]
            members[found[0]] = found
            component_of.update(dict.fromkeys(found, found[0]))
    counts = Counter(component_of[node_id] for node_id in own_nodes)
    if localising:
        counts = Counter({first: count for first, count in counts.items() if not own.issuperset(members[first])})
    if not counts:
        raise EstimationError(
            f"rtabmap: not localised: none of the {len(own)} places of this recording was found in the database's map; "
            "without --localise-only it is mapped as a new session"
        )
    return members[min(counts, key=lambda first: (-counts[first], first))]


def what_joined(graph: MapGraph, ids: Sequence[int], own_nodes: Sequence[int]) -> str:
    """Return in words how the map of this run and those of other sessions hang together; empty where there are no others."""
    earlier = set(graph.nodes) - set(own_nodes)
    shown = set(ids)
    elsewhere = set(graph.nodes) - shown
    own_elsewhere = len(elsewhere - earlier)
    if not earlier and not elsewhere:
        return ""
    if not earlier:
        return (
            f"the recording falls into maps that nothing joined: the result shows the largest, {len(shown)} of "
            f"{len(graph.nodes)} nodes; the database holds the others too"
        )
    tail = f"; {own_elsewhere} nodes of this run hang on nothing of it" if own_elsewhere else ""
    if shown & earlier:
        left = len(earlier - shown)
        others = f", {left} nodes of maps elsewhere are in the database alone" if left else ""
        return f"joined the database's map: {len(shown - earlier)} new nodes and {len(shown & earlier)} earlier ones{others}{tail}"
    return (
        f"nothing tied this run to the database's {len(earlier)} earlier nodes: the result shows its own {len(shown)} nodes "
        f"alone; the database holds both maps, and a later session may join them{tail}"
    )
