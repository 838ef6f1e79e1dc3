# SPDX-License-Identifier: MIT
"""Which loops batch work believes: what is searched, what needs a witness, what the graph contradicts."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planar_graphs import PER_SUBMAP, TrueSearch, circle, drifted, errors, graph_of, members_of
from ring_world import errors as errors_of
from ring_world import mapped, parameters, recorded, wheels

from slamcli.cartographer import closing_2d
from slamcli.cartographer.closing_2d import BatchClosing2d, spread_out
from slamcli.cartographer.parameters import ConstraintBuilder, OptimizationProblem, PoseGraph
from slamcli.cartographer.parameters.pose_graph import BatchSearch
from slamcli.runtime import RunLog

TRUSTING = PoseGraph(optimization_problem=OptimizationProblem(huber_scale=1e6))
PATH = circle(turns=1.4)
LOCAL = drifted(PATH, turn=0.002)


def close(monkeypatch, graph, search):
    monkeypatch.setattr(closing_2d, "search", search)
    with ThreadPoolExecutor(1) as executor:
        closing = BatchClosing2d(graph, executor, RunLog())
        closing.run()
    return closing


def test_the_second_time_around_is_tied_to_the_first(monkeypatch):
    graph, search = graph_of(LOCAL, TRUSTING), TrueSearch(PATH, LOCAL)
    before = errors(graph, PATH).max()
    closing = close(monkeypatch, graph, search)
    graph.optimise(50)
    assert before > 0.8
    assert errors(graph, PATH).max() < 0.5 * before
    assert closing.rejected == []
    assert closing.num_trials == sum(len(nodes) for call in search.calls for nodes in call.values())
    members = members_of(len(LOCAL))
    told = [(submap, node) for call in search.calls for submap, nodes in call.items() for node in nodes]
    assert not any(submap in members[node] for submap, node in told)
    around = [loop for loop in graph.loops if loop.node - PER_SUBMAP * loop.submap > 60]
    assert len(around) > 10
    pairs = [(loop.submap, loop.node) for loop in graph.loops]
    assert len(pairs) == len(set(pairs))


def wide(graph, closing, loops):
    """What is alone among loops from windows of 5 metres."""
    return closing._without_witness(loops, {(loop.submap, loop.node): 5.0 for loop in loops})


@pytest.mark.parametrize("off", [(0.0, 1.5, 0.0), (0.0, 0.0, 0.3)])
def test_a_match_from_a_wide_window_needs_a_witness(off):
    graph, search = graph_of(PATH), TrueSearch(PATH, PATH)
    closing = BatchClosing2d(graph, None, RunLog())
    trials = {
        0: [SimpleNamespace(node=node) for node in (88, 90)],
        1: [SimpleNamespace(node=92)],
        5: [SimpleNamespace(node=20)],
    }
    true = [found.loop for found in search(graph, trials, None, 1)]
    assert {(loop.submap, loop.node) for loop in true} == {(0, 88), (0, 90), (1, 92)}
    assert wide(graph, closing, true) == set()
    wrong = replace(true[1], relative=true[1].relative + np.array(off))
    assert wide(graph, closing, [true[0], wrong, true[2]]) == {1}
    assert wide(graph, closing, [wrong]) == {0}
    # A narrow window needs none, and loops that are there already bear witness.
    assert closing._without_witness([wrong], {(0, 90): 0.5}) == set()
    graph.loops = [true[0]]
    assert wide(graph, closing, [true[1], wrong]) == {1}
    # Where a match does not tell the position, a difference of positions is none.
    if off[1]:
        blurred = replace(wrong, covariance=4.0 * np.eye(2))
        assert wide(graph, closing, [true[0], blurred]) == set()


def test_what_the_graph_contradicts_is_taken_out_again(monkeypatch):
    local = drifted(PATH, turn=0.0005)
    wrong = {(0, node): np.array([2.0, 1.0, 0.0]) for node in (45, 46)}  # the far side, where nothing is seen
    graph, search = graph_of(local), TrueSearch(PATH, local)
    closing = close(monkeypatch, graph, search)
    good = list(graph.loops)
    search = TrueSearch(PATH, local, wrong)
    graph.loops = [
        *good,
        *(f.loop for f in search(graph, {0: [SimpleNamespace(node=45), SimpleNamespace(node=46)]}, None, 9)),
    ]
    graph.optimise(50)
    closing._drop_strained()
    assert [(item.loop.node, item.rejected) for item in closing.rejected] == [
        (45, "contradicts the graph"), (46, "contradicts the graph"),
    ]  # fmt: skip
    assert graph.loops == good


def test_windows_are_no_wider_than_the_drift(monkeypatch):
    widths = {}
    for drift in (0.02, 0.2):
        p = PoseGraph(batch_search=BatchSearch(drift_translation=drift))
        graph, seen = graph_of(LOCAL, p), []

        def never(graph, trials, executor, round_, seen=seen):
            seen += [trial.linear_m for part in trials.values() for trial in part]
            return []

        close(monkeypatch, graph, never)
        widths[drift] = max(seen)
    assert widths[0.02] < 6.0 < widths[0.2] <= p.batch_search.widest_window


def test_no_sampling_leaves_the_scouts(monkeypatch):
    p = PoseGraph(constraint_builder=ConstraintBuilder(sampling_ratio=0.0))
    graph, search = graph_of(LOCAL, p), TrueSearch(PATH, LOCAL)
    close(monkeypatch, graph, search)
    per_pair = np.bincount([loop.submap * 1000 + int(graph.home[loop.node]) for loop in graph.loops])
    assert per_pair.max() <= 3


def test_spread_out():
    points = np.array([(0.0, 0.0), (0.5, 0.0), (1.2, 0.0), (2.0, 0.0), (5.0, 0.0)])
    assert spread_out(points, 1.0, 3) == [0, 2, 4]
    assert spread_out(points, 1.0, 2) == [0, 2]
    assert spread_out(points[:0], 1.0, 3) == []


def test_a_corridor_of_equal_doors_is_not_folded():
    # Every 3 m the walls look the same; the robot never comes back. A wrong match would shorten the corridor.
    doors = [(x, y, x + 0.6, y + 0.5) for x in np.arange(-1.0, 28.0, 3.0) for y in (1.0, -1.5)]
    boxes = np.array([(-30.0, -1.5, 60.0, 1.5), *doors])
    count = 200
    speed = np.minimum(np.arange(count) / 30.0, 1.0)
    way = 24.0 * np.cumsum(speed) / speed.sum()
    path = np.column_stack([way, 0.1 * np.sin(way), np.arctan(0.1 * np.cos(way))])
    result = mapped(recorded(path, told=wheels(path, 1.01, 1.01, seed=4), boxes=boxes), parameters())
    distance, turn = errors_of(result, path)
    assert distance.max() < 0.3
    assert turn.max() < 0.02
    truth = path[result.steps["inserted"] == 1]
    folded = [
        search
        for search in result.loop_searches
        if search.accepted
        and abs(truth[search.node.number, 0] - truth[min(20 * search.submap.number, len(truth) - 1), 0]) > 12
    ]
    assert folded == []
