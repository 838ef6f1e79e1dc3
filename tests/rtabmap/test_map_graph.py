# SPDX-License-Identifier: MIT
"""The graph of sessions: what is tied to what, and nodes that are merged away."""

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph


def _pose(x: float, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    return se3.from_se2(np.array([x, y, yaw]))


def _link(a: int, b: int, kind: LinkKind, T: np.ndarray) -> Link:
    return Link(from_id=a, to_id=b, kind=kind, T_from_to=T, information=np.eye(6))


def _graph() -> MapGraph:
    graph = MapGraph()
    for k in range(1, 6):
        graph.add_node(GraphNode(id=k, map_id=0 if k < 5 else 1, stamp_ns=k, T_odom_base=_pose(k)), _pose(k))
    for k in range(1, 4):
        graph.add_link(_link(k, k + 1, LinkKind.NEIGHBOR, _pose(1.0)))
    return graph


def test_components_and_neighbours() -> None:
    graph = _graph()
    assert graph.component(2) == [1, 2, 3, 4]
    assert graph.component(5) == [5]
    closure = _link(1, 5, LinkKind.GLOBAL_CLOSURE, _pose(0.0, 1.0))
    graph.add_link(closure)
    assert graph.component(5) == [1, 2, 3, 4, 5]
    assert graph.neighbours(1) == [2, 5]
    assert graph.are_linked(5, 1)
    assert not graph.are_linked(5, 2)
    graph.remove_links([closure])
    assert graph.component(1) == [1, 2, 3, 4]
    assert len(graph.links) == 3


def test_a_merged_node_leaves_its_links_to_the_one_that_stays() -> None:
    graph = _graph()
    graph.add_link(_link(2, 5, LinkKind.GLOBAL_CLOSURE, _pose(0.0, 1.0)))
    graph.merge(2, 3)
    assert sorted(graph.nodes) == [1, 3, 4, 5]
    assert graph.component(1) == [1, 3, 4, 5]
    kinds = {(link.from_id, link.to_id): link for link in graph.links}
    merged = kinds[1, 3]
    assert merged.kind == LinkKind.NEIGHBOR_MERGED
    np.testing.assert_allclose(merged.T_from_to, _pose(2.0), atol=1e-12)
    closure = kinds[3, 5]
    assert closure.kind == LinkKind.GLOBAL_CLOSURE
    # node 5 was 1 m to the left of node 2, so it is 1 m behind and to the left of node 3
    np.testing.assert_allclose(closure.T_from_to, _pose(-1.0, 1.0), atol=1e-12)


def test_links_among_some_nodes_keep_their_order() -> None:
    graph = _graph()
    assert [(link.from_id, link.to_id) for link in graph.links_among([4, 3, 2])] == [(2, 3), (3, 4)]
    graph.place([2, 3], np.array([_pose(7.0), _pose(8.0)]))
    assert graph.T_map_base[3][0, 3] == 8.0
