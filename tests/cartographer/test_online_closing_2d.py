# SPDX-License-Identifier: MIT
"""Loops in the original's order: who is searched when, what is adjusted when, and what moves along."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planar_graphs import PER_SUBMAP, TrueSearch, circle, drifted, errors, graph_of, members_of, part_of

from slamcli.cartographer import online_closing_2d
from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.online_closing_2d import FixedRatioSampler, OnlineClosing2d
from slamcli.cartographer.parameters import ConstraintBuilder, OptimizationProblem, PoseGraph
from slamcli.geometry import se2
from slamcli.runtime import RunLog

TRUSTING = OptimizationProblem(huber_scale=1e6)
"""The loops are true: few of them must be enough to bend a stiff graph."""
EVERY = PoseGraph(
    optimize_every_n_nodes=0, constraint_builder=ConstraintBuilder(sampling_ratio=1.0), optimization_problem=TRUSTING
)


def close(monkeypatch, graph, search):
    monkeypatch.setattr(online_closing_2d, "search", search)
    with ThreadPoolExecutor(1) as executor:
        closing = OnlineClosing2d(graph, executor, RunLog())
        closing.run()
    return closing


@pytest.mark.parametrize("ratio", [0.0, 0.003, 0.3, 0.5, 1.0])
def test_the_sampler_lets_a_fixed_share_pass(ratio):
    sampler = FixedRatioSampler(ratio)
    passed = np.array([sampler.pulse() for _ in range(1000)])
    assert abs(passed.sum() - 1000 * ratio) < 1.0 + 1e-9
    assert np.all(np.abs(np.cumsum(passed) - ratio * np.arange(1, 1001)) < 1.0 + 1e-9)  # spread evenly


def test_each_pair_is_searched_once_and_members_never(monkeypatch):
    path = circle()
    local = drifted(path)
    search = TrueSearch(path, local)
    closing = close(monkeypatch, graph_of(local, EVERY), search)
    assert len(search.calls) == 1  # no adjustment in between: all at once
    members = members_of(120)
    expected = {
        (submap, node)
        for submap in range(10)  # the last node found two of the twelve open: they are not finished
        for node in range(120)
        if submap not in members[node] and np.hypot(*(local[node] - local[PER_SUBMAP * submap])[:2]) <= 15.0
    }
    told = [(submap, node) for submap, nodes in search.calls[0].items() for node in nodes]
    assert len(told) == len(set(told)) == closing.num_trials
    assert set(told) == expected


def test_what_has_come_by_then_is_adjusted_and_the_rest_moves_along(monkeypatch):
    path = circle()
    local = drifted(path)
    graph = graph_of(local, replace(EVERY, optimize_every_n_nodes=104))
    search, seen = TrueSearch(path, local), []
    optimise = PoseGraph2d.optimise

    def watched(graph, iterations, known=None):
        solution = optimise(graph, iterations, known)
        seen.append((known, graph.node.copy()))
        return solution

    monkeypatch.setattr(PoseGraph2d, "optimise", watched)
    close(monkeypatch, graph, search)
    (known, nodes), *more = seen
    assert not more  # the last adjustment is the mapper's
    assert known[len(graph.submap) :].sum() == 105  # once more than 104 nodes have come
    assert known[: len(graph.submap)].sum() == 11
    assert all(node <= 104 for nodes_ in search.calls[0].values() for node in nodes_)
    assert all(node >= 105 for submap, nodes_ in search.calls[1].items() for node in nodes_ if submap < 9)
    before, after = errors(graph_of(local), path), np.hypot(*(nodes[:105, :2] - path[:105, :2]).T)
    assert before[:105].max() > 1.5
    assert after.max() < 0.5
    # What came later keeps its shape, and follows the newest submap that was adjusted.
    moved = se2.between(graph.submap[10], graph.node[105:])
    np.testing.assert_allclose(moved, se2.between(graph.submap_local[10], graph.node_local[105:]), atol=1e-9)
    np.testing.assert_array_equal(graph.node[:105], nodes[:105])


def test_a_graph_that_is_adjusted_on_the_way_ends_where_the_truth_is(monkeypatch):
    path = circle()
    local = drifted(path)
    p = PoseGraph(optimize_every_n_nodes=20, optimization_problem=TRUSTING)
    graph = graph_of(local, p)
    search = TrueSearch(path, local)
    closing = close(monkeypatch, graph, search)
    graph.optimise(p.max_num_final_iterations)
    assert len(search.calls) >= 5
    assert errors(graph, path).max() < 0.5 < errors(graph_of(local), path).max()
    share = closing.num_trials / sum(len(nodes) for nodes in _everything(monkeypatch, path, local).values())
    assert 0.2 < share < 0.4  # sampling_ratio 0.3
    assert closing.rejected == []
    assert [loop.round for loop in graph.loops] == sorted(loop.round for loop in graph.loops)
    assert all(not loop.covariance.any() for loop in graph.loops)


def _everything(monkeypatch, path, local):
    search = TrueSearch(path, local)
    close(monkeypatch, graph_of(local, EVERY), search)
    return search.calls[0]


def test_another_trajectory_is_searched_only_when_something_ties_it(monkeypatch):
    path = circle(60, turns=0.5)
    parts = [part_of(path, 0, frozen=False), part_of(path, 1)]
    graph = PoseGraph2d(EVERY, parts)
    search = TrueSearch(np.vstack([path, path]), np.vstack([path, path]))
    close(monkeypatch, graph, search)
    assert all(submap >= 6 and min(nodes) >= 60 for submap, nodes in search.calls[0].items())
    graph = PoseGraph2d(EVERY, [part_of(path, 0, frozen=True), part_of(path, 1)])
    graph.loops = [found.loop for found in search(graph, {0: [SimpleNamespace(node=60)]}, None, 0)]
    search.calls.clear()
    close(monkeypatch, graph, search)
    assert min(search.calls[0]) == 0  # new nodes in loaded submaps
    assert min(min(nodes) for submap, nodes in search.calls[0].items() if submap >= 6) < 60  # and the other way
    assert all(min(nodes) >= 60 for submap, nodes in search.calls[0].items() if submap < 6)
