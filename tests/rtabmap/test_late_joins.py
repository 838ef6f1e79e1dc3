# SPDX-License-Identifier: MIT
"""Maps that nothing tied are joined in the end where many nodes say the same."""

from collections.abc import Sequence

import numpy as np

from slamcli.geometry import se3
from slamcli.rtabmap.late_joins import find_join
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.registration import Registration, refused

T_A_B = se3.from_se2(np.array([5.0, -2.0, 0.7]))
"""How the second map lies in the first."""


def _two_maps() -> MapGraph:
    """Nodes 1 to 5 and 6 to 9, a metre apart along x of the frame of each."""
    graph = MapGraph()
    for k in range(1, 10):
        T = se3.from_se2(np.array([float(k if k < 6 else k - 6), 0.0, 0.0]))
        graph.add_node(GraphNode(id=k, map_id=int(k > 5), stamp_ns=k, T_odom_base=T), T)
        if k not in (1, 6):
            link = Link(from_id=k - 1, to_id=k, kind=LinkKind.NEIGHBOR, T_from_to=np.eye(4), information=np.eye(6))
            graph.add_link(link)
    return graph


def _alike(node_id: int, others: Sequence[int]) -> list[int]:
    return [other for other in (node_id - 5, node_id - 4) if other in others]


def _registered(T: np.ndarray, inliers: int = 30) -> Registration:
    return Registration(
        T_a_b=T, covariance=np.eye(6), num_inliers=inliers, num_matches=inliers, matches=np.zeros((0, 2), np.int64)
    )


def _right(graph: MapGraph, old: int, new: int) -> np.ndarray:
    return se3.inverse(graph.T_map_base[old]) @ T_A_B @ graph.T_map_base[new]


def test_what_most_say_wins_over_a_place_that_only_looks_alike() -> None:
    graph = _two_maps()

    def register(old: int, new: int) -> Registration:
        if new == 7:
            return _registered(np.eye(4), inliers=50)
        return _registered(_right(graph, old, new)) if old == new - 5 else refused("nothing alike")

    join = find_join(graph, [6, 7, 8, 9], _alike, register)
    assert join is not None
    assert join.moved == (6, 7, 8, 9)
    np.testing.assert_allclose(join.T_to_from, T_A_B, atol=1e-9)
    assert {new for _, new, _ in join.pairs} == {6, 8, 9}


def test_one_that_stands_alone_is_believed_with_many_inliers_only() -> None:
    graph = _two_maps()

    def only(inliers: int):
        return lambda old, new: (
            _registered(_right(graph, old, new), inliers) if (old, new) == (1, 6) else refused("nothing alike")
        )

    assert find_join(graph, [6, 7, 8, 9], _alike, only(59)) is None
    join = find_join(graph, [6, 7, 8, 9], _alike, only(60))
    assert join is not None
    assert len(join.pairs) == 1


def test_there_is_nothing_to_join_in_one_map() -> None:
    graph = _two_maps()
    tie = Link(from_id=5, to_id=6, kind=LinkKind.NEIGHBOR, T_from_to=np.eye(4), information=np.eye(6))
    graph.add_link(tie)
    assert find_join(graph, sorted(graph.nodes), _alike, lambda old, new: _registered(_right(graph, old, new))) is None
