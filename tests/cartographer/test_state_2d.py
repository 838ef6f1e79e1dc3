# SPDX-License-Identifier: MIT
"""A graph becomes a state and a state a graph again: rows, poses, constraints, and nodes whose submaps were dropped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_graphs import circle, drifted, members_of, part_of

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d, unit_weight
from slamcli.cartographer.parameters import PoseGraph
from slamcli.cartographer.state_2d import loops_of_state, parts_of_state, rows_of_ids, state_of_graph
from slamcli.errors import DataError
from slamcli.geometry import se2, se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Id

COUNT = 45
UNIT = unit_weight(PoseGraph())
STAMPS = list(range(1000, 1000 + COUNT))
MOVE = np.array([2.0, -1.0, 0.3])


def graph(trajectory=0):
    path = drifted(circle(COUNT))
    part = part_of(path, trajectory)
    points = [np.array([[k, 0.5], [1.0, -k]]) for k in range(COUNT)]
    grids = [ProbabilityGrid.empty(0.05, (x, y)) for x, y, _ in part.submap_local]
    part = replace(
        part, grids=grids, points=points, submap_map=se2.compose(MOVE, part.submap_local),
        node_map=se2.compose(MOVE, path),
    )  # fmt: skip
    made = PoseGraph2d(PoseGraph(), [part])
    made.loops = [Loop(0, 44, np.array([0.5, 0.2, -0.1]), np.zeros((2, 2)), 0.7, 2)]
    return made


def test_a_graph_comes_back_from_its_state():
    before = graph()
    state = state_of_graph(before, STAMPS, None)
    assert [node.stamp_ns for node in state.nodes] == STAMPS
    assert [submap.num_range_data for submap in state.submaps] == np.bincount(before.membership[:, 0]).tolist()
    (part,) = parts_of_state(state, UNIT)
    after = PoseGraph2d(PoseGraph(), [part])
    for name in ("submap", "node", "submap_local", "node_local"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=1e-12)
    np.testing.assert_array_equal(after.membership, before.membership)
    np.testing.assert_array_equal(after.home, before.home)
    for a, b in zip(after.points, before.points, strict=True):
        np.testing.assert_array_equal(a, b)
    assert [tuple(held) for held in part.members] == members_of(COUNT)
    (loop,) = loops_of_state(state, after)
    assert (loop.submap, loop.node, loop.round) == (0, 44, 0)
    np.testing.assert_allclose(loop.relative, before.loops[0].relative, atol=1e-12)
    assert not loop.covariance.any()  # saved loops count fully
    submaps, nodes = rows_of_ids(after)
    assert (submaps[Id(0, 3)], nodes[Id(0, 17)]) == (3, 17)


def test_a_direction_that_a_match_does_not_tell_is_saved_as_the_graph_has_it():
    before = graph()
    between = se2.between(before.submap[0], before.node[44])
    blurred = replace(before.loops[0], covariance=1e4 * np.eye(2))
    before.loops = [replace(blurred, relative=between + np.array([0.3, -0.4, 0.02]))]
    (loop,) = loops_of_state(state_of_graph(before, STAMPS, None), before)
    np.testing.assert_allclose(loop.relative[:2], between[:2], atol=1e-3)
    assert loop.relative[2] == pytest.approx(between[2] + 0.02)


def test_constraints_say_where_nodes_are_in_submaps():
    before = graph()
    state = state_of_graph(before, STAMPS, None)
    p = before.parameters
    intra = [c for c in state.constraints if c.kind == "intra"]
    assert [(c.submap.number, c.node.number) for c in intra] == list(map(tuple, before.membership.tolist()))
    c = intra[30]
    expected = se2.between(before.submap_local[c.submap.number], before.node_local[c.node.number])
    np.testing.assert_allclose(se3.to_se2(c.T_submap_node), expected, atol=1e-12)
    assert (c.translation_weight, c.rotation_weight) == (p.matcher_translation_weight, p.matcher_rotation_weight)
    (inter,) = [c for c in state.constraints if c.kind == "inter"]
    b = p.constraint_builder
    assert inter.translation_weight == b.loop_closure_translation_weight
    assert inter.rotation_weight == b.loop_closure_rotation_weight


def test_a_second_trajectory_keeps_what_the_first_one_was():
    first = state_of_graph(graph(), STAMPS, None)
    first = replace(first, frozen=frozenset({0}))
    parts = [*parts_of_state(first, UNIT), graph(1).parts[0]]
    assert parts[0].frozen
    both = PoseGraph2d(PoseGraph(), parts)
    both.loops = loops_of_state(first, both)
    state = state_of_graph(both, [stamp + 5000 for stamp in STAMPS], first)
    assert [node.stamp_ns for node in state.nodes] == STAMPS + [stamp + 5000 for stamp in STAMPS]
    assert state.frozen == {0}
    assert sorted(state.trajectories) == [0, 1]
    np.testing.assert_allclose(state.nodes[7].T_map_node, first.nodes[7].T_map_node, atol=1e-12)
    assert sum(c.kind == "inter" for c in state.constraints) == 1


def test_a_node_whose_submaps_were_dropped_goes_to_the_nearest():
    state = state_of_graph(graph(), STAMPS, None)
    kept = tuple(submap for submap in state.submaps if submap.id.number != 2)
    constraints = tuple(c for c in state.constraints if c.submap.number != 2)
    (part,) = parts_of_state(replace(state, submaps=kept, constraints=constraints), UNIT)
    rows = [submap.number for submap in part.submap_ids]
    assert rows == [0, 1, 3, 4]
    held = members_of(COUNT)
    for k, members in enumerate(part.members):
        left = tuple(s for s in held[k] if s != 2)
        assert tuple(rows[m] for m in members) == left
    alone = tuple(c for c in constraints if c.node.number != 25)
    (part,) = parts_of_state(replace(state, submaps=kept, constraints=alone), UNIT)
    places = part.submap_local[:, :2] - part.node_local[25, :2]
    assert list(part.members[25]) == [int(np.argmin(np.hypot(*places.T)))]


def test_a_state_in_space_is_refused():
    state = state_of_graph(graph(), STAMPS, None)
    broken = replace(state, submaps=(replace(state.submaps[0], grid=None), *state.submaps[1:]))
    with pytest.raises(DataError, match="submap 0 of trajectory 0 of the state has no planar grid"):
        parts_of_state(broken, UNIT)
