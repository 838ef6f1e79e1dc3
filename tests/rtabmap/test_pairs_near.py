# SPDX-License-Identifier: MIT
"""Which nodes of a finished map are compared once more, against every pair tried by hand."""

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.pairs_near import pairs_near


def _graph(places: list[tuple[float, float, float]], *, cut: int = 0) -> MapGraph:
    """A chain of nodes at x, y, yaw; no link leads to node `cut`."""
    graph = MapGraph()
    for k, place in enumerate(places, start=1):
        T = se3.from_se2(np.array(place))
        graph.add_node(GraphNode(id=k, map_id=0, stamp_ns=k, T_odom_base=T), T)
    for k in range(1, len(places)):
        if cut != k + 1:
            graph.add_link(_link(k, k + 1))
    return graph


def _link(a: int, b: int) -> Link:
    return Link(from_id=a, to_id=b, kind=LinkKind.NEIGHBOR, T_from_to=np.eye(4), information=np.eye(6))


def test_near_pairs_that_nothing_ties_the_nearest_first() -> None:
    graph = _graph([(0, 0, 0), (1, 0, 0), (1.5, 0, 0), (1.6, 0.0, 0.3), (30, 0, 0)])
    assert pairs_near(graph, [1, 2, 3, 4, 5]) == [(1, 3), (2, 4), (1, 4)]
    assert pairs_near(graph, [3]) == [(1, 3)]


def test_nodes_that_look_elsewhere_or_lie_in_another_map_are_left_out() -> None:
    assert pairs_near(_graph([(0, 0, 0), (5, 0, 0), (0.1, 0, 1.5)]), [1, 2, 3]) == []
    assert pairs_near(_graph([(0, 0, 0), (5, 0, 0), (0.1, 0, 0.0)]), [1, 2, 3]) == [(1, 3)]
    assert pairs_near(_graph([(0, 0, 0), (5, 0, 0), (0.1, 0, 0.0)], cut=3), [1, 2, 3]) == []
    assert pairs_near(_graph([(0, 0, 0)]), [1]) == []


def test_at_most_eight_for_a_node() -> None:
    graph = _graph([(0.01 * k, 0.0, 0.0) for k in range(20)])
    pairs = pairs_near(graph, [20])
    assert len(pairs) == 8
    assert [older for older, _ in pairs] == list(range(18, 10, -1))
