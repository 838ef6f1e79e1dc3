# SPDX-License-Identifier: MIT
"""The graph of submaps and nodes: rows, what is fixed, where nodes are believed to be, adjustment and residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_graphs import PER_SUBMAP, circle, drifted, errors, graph_of, members_of, part_of

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d
from slamcli.cartographer.parameters import ConstraintBuilder, OptimizationProblem, PoseGraph
from slamcli.geometry import se2

TRUSTING = PoseGraph(
    matcher_translation_weight=1e4,
    matcher_rotation_weight=1e4,
    optimization_problem=OptimizationProblem(huber_scale=1e9),
    constraint_builder=ConstraintBuilder(loop_closure_translation_weight=1e6, loop_closure_rotation_weight=1e7),
)
"""Few loops must bend the whole graph, and not only its first submap."""


def true_loop(graph, path, submap, node, covariance=None, off=(0.0, 0.0, 0.0)):
    """A loop that says where the node truly is, seen from a submap that has not drifted."""
    relative = se2.between(graph.submap_local[submap], path[node]) + np.array(off)
    return Loop(submap, node, relative, np.zeros((2, 2)) if covariance is None else covariance, 0.8, 1)


def test_rows_go_through_the_parts():
    path = circle(60)
    graph = PoseGraph2d(PoseGraph(), [part_of(path, 0, frozen=True), part_of(path[:30], 1)])
    assert graph.submap_part.tolist() == [0] * 6 + [1] * 3
    assert np.bincount(graph.node_part).tolist() == [60, 30]
    held = members_of(60)
    expected = [(s, n) for n in range(60) for s in held[n]] + [(s + 6, n + 60) for n in range(30) for s in held[n]]
    assert list(map(tuple, graph.membership.tolist())) == expected
    assert graph.home[:12].tolist() == [0] * 12
    assert graph.home[60:].tolist() == [members[0] + 6 for members in held[:30]]
    assert graph.fixed.tolist() == [True] * 6 + [False] * 3 + [True] * 60 + [False] * 30
    assert np.flatnonzero(graph_of(path).fixed).tolist() == [0]


def test_where_a_node_is_believed_to_be_in_a_submap():
    path = circle(60)
    graph = graph_of(path)
    nodes = np.array([3, 55])
    np.testing.assert_allclose(graph.prior(2, nodes)[:, :2], path[nodes, :2], atol=1e-12)
    graph.submap[2] = se2.compose(np.array([1.0, -2.0, 0.4]), graph.submap[2])
    moved = se2.compose(se2.inverse(np.array([1.0, -2.0, 0.4])), path[nodes])
    np.testing.assert_allclose(graph.prior(2, nodes)[:, :2], moved[:, :2], atol=1e-12)


def test_without_loops_nothing_moves():
    path = circle()
    graph = graph_of(drifted(path))
    before = graph.node.copy()
    solution = graph.optimise(50)
    np.testing.assert_allclose(graph.node, before, atol=1e-9)
    assert solution.cost_after == pytest.approx(0.0, abs=1e-9)


def test_a_loop_takes_the_drift_out():
    path = circle()
    local = drifted(path)
    graph = graph_of(local, TRUSTING)
    graph.loops = [true_loop(graph, path, 0, node) for node in range(100, 106)]
    assert errors(graph, path).max() > 1.5
    graph.optimise(50)
    assert errors(graph, path).max() < 0.6
    distance, turn = graph.residuals()
    assert distance.max() < 0.05
    assert turn.max() < 0.02
    np.testing.assert_array_equal(graph.submap[0], graph.submap_local[0])


def test_an_ambiguous_direction_holds_nothing():
    # A straight drive that is too long; a match along a plain wall is only sure across it.
    path = np.column_stack([np.arange(60) * 0.5, np.zeros(60), np.zeros(60)])
    covariance = np.diag([9.0, 0.0])
    for blurred, expected in ((None, 0.3), (covariance, 0.0)):
        graph = graph_of(path, PoseGraph(optimization_problem=OptimizationProblem(huber_scale=1e6)))
        loop = true_loop(graph, path, 0, 59, blurred, off=(0.3, 0.2, 0.0))
        graph.loops = [loop]
        distance, _ = graph.residuals()
        assert distance[0] == pytest.approx(np.hypot(0.3 if blurred is None else 0.3 * 0.05 / 3.0, 0.2), rel=0.01)
        graph.optimise(50)
        assert graph.node[59, 0] - path[59, 0] == pytest.approx(expected, abs=0.02)
        assert graph.node[59, 1] - path[59, 1] == pytest.approx(0.2, abs=0.02)


def test_slack_gives_way_first():
    path = circle(60, turns=0.5)
    part = part_of(path)
    members = [(k // PER_SUBMAP,) for k in range(60)]  # no submap spans the gap
    firm = PoseGraph(
        matcher_translation_weight=1e4,
        matcher_rotation_weight=1e4,
        optimization_problem=OptimizationProblem(huber_scale=1e9),
    )
    slack = np.zeros(60)
    slack[30] = 5.0
    graph = PoseGraph2d(firm, [replace(part, members=members, slack_m=slack)])
    graph.loops = [true_loop(graph, path, 0, node, off=(0.4, 0.0, 0.0)) for node in range(50, 60)]
    graph.optimise(50)
    step = np.hypot(*(se2.between(graph.node[:-1], graph.node[1:]) - se2.between(path[:-1], path[1:]))[:, :2].T)
    assert step[29] == pytest.approx(0.4, abs=0.05)
    assert np.delete(step, 29).max() < 0.005


def test_of_a_part_only_what_is_known_is_adjusted():
    path = circle()
    local = drifted(path)
    graph = graph_of(local, TRUSTING)
    graph.loops = [true_loop(graph, path, 0, node) for node in range(98, 120)]
    known = np.concatenate([np.arange(12) < 10, np.arange(120) < 100])
    before = graph.node.copy()
    graph.optimise(50, known)
    np.testing.assert_array_equal(graph.node[100:], before[100:])
    assert np.hypot(*(graph.node[:100, :2] - path[:100, :2]).T).max() < 0.6
    # As if the graph had ended there.
    shorter = PoseGraph2d(TRUSTING, [part_of(local[:100])])
    shorter.loops = graph.loops[:2]
    shorter.optimise(50)
    np.testing.assert_allclose(graph.node[:100], shorter.node, atol=1e-5)


def test_a_frozen_trajectory_stays():
    path = circle(60)
    moved = se2.compose(np.array([0.3, -0.2, 0.05]), path)
    graph = PoseGraph2d(TRUSTING, [part_of(path, 0, frozen=True), replace(part_of(path, 1), node_map=moved)])
    graph.loops = [
        Loop(0, node, se2.between(graph.submap[0], path[node - 60]), np.zeros((2, 2)), 0.8, 1) for node in (65, 118)
    ]
    graph.optimise(50)
    np.testing.assert_array_equal(graph.node[:60], path)
    assert np.hypot(*(graph.node[60:, :2] - path[:, :2]).T).max() < 0.02
