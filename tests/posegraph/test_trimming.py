# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import replace

import numpy as np

from slamcli.geometry import se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap
from slamcli.posegraph.trimming import keep_newest, trim_overlapping, without_submaps


def a_state(places: list[float], trajectory: int = 0) -> MapState:
    """Submaps of 2 x 2 m at places along x; node k is in submaps k and k - 1; the last node is found in the first submap."""
    grid = ProbabilityGrid(np.ones((20, 20), np.uint16), 0.1, (0.0, 0.0))
    submaps = tuple(
        Submap(id=Id(trajectory, k), T_local_submap=np.eye(4), T_map_submap=se3.from_se2([x, 0.0, 0.0]), num_range_data=2,
               finished=True, grid=grid)
        for k, x in enumerate(places)
    )  # fmt: skip
    nodes = tuple(
        Node(id=Id(trajectory, k), stamp_ns=k, T_local_node=np.eye(4), T_map_node=np.eye(4), points_m=np.zeros((0, 3), np.float32),
             gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]))
        for k in range(len(places))
    )  # fmt: skip

    def constraint(submap: int, node: int, kind) -> Constraint:
        return Constraint(submap=Id(trajectory, submap), node=Id(trajectory, node), T_submap_node=np.eye(4), kind=kind,
                          translation_weight=1.0, rotation_weight=1.0)  # fmt: skip

    constraints = [constraint(s, k, "intra") for k in range(len(places)) for s in (k - 1, k) if s >= 0]
    constraints.append(constraint(0, len(places) - 1, "inter"))
    return MapState(nodes=nodes, submaps=submaps, constraints=tuple(constraints))


def numbers(state: MapState) -> list[int]:
    return [submap.id.number for submap in state.submaps]


def test_nodes_go_with_the_last_submap_that_holds_them() -> None:
    left = without_submaps(a_state([0.0, 3.0, 6.0, 9.0]), [Id(0, 0), Id(0, 1)])
    assert numbers(left) == [2, 3]
    assert [node.id.number for node in left.nodes] == [2, 3]
    assert {(c.submap.number, c.node.number) for c in left.constraints} == {(2, 2), (2, 3), (3, 3)}


def test_the_newest_submaps_of_one_trajectory_are_kept() -> None:
    one, other = a_state([0.0, 3.0, 6.0]), a_state([0.0, 3.0, 6.0], trajectory=1)
    both = MapState(nodes=one.nodes + other.nodes, submaps=one.submaps + other.submaps,
                    constraints=one.constraints + other.constraints)  # fmt: skip
    left = keep_newest(both, 1, 2)
    assert [tuple(submap.id) for submap in left.submaps] == [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2)]
    assert numbers(keep_newest(one, 0, 5)) == [0, 1, 2]


def test_submaps_that_newer_ones_cover_are_dropped() -> None:
    state = a_state([0.0, 3.0, 0.0, 1.0])
    # 0 lies under 2; half of 2 lies under 3: 2 m^2 of it are fresh.
    assert numbers(trim_overlapping(state, 1, 1.9, 1)) == [1, 2, 3]
    assert numbers(trim_overlapping(state, 1, 2.1, 1)) == [1, 3]
    assert numbers(trim_overlapping(state, 2, 1.9, 1)) == [0, 1, 2, 3]
    assert numbers(trim_overlapping(state, 1, 1.9, 4)) == [0, 1, 2, 3]


def test_frozen_and_unfinished_submaps_stay() -> None:
    state = a_state([0.0, 3.0, 0.0, 1.0])
    assert numbers(trim_overlapping(replace(state, frozen=frozenset({0})), 1, 1.9, 1)) == [0, 1, 2, 3]
    unfinished = replace(state, submaps=tuple(replace(submap, finished=False) for submap in state.submaps))
    assert numbers(trim_overlapping(unfinished, 1, 1.9, 1)) == [0, 1, 2, 3]
