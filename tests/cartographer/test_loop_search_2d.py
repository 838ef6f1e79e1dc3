# SPDX-License-Identifier: MIT
"""Nodes looked for in submaps of an exact corridor: windows, scores, ambiguity, order and threads."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from planar_graphs import part_of
from ring_world import BOXES, drive, ranges

from slamcli.cartographer.graph_2d import PoseGraph2d
from slamcli.cartographer.loop_search_2d import Trial, search
from slamcli.cartographer.parameters import PoseGraph
from slamcli.geometry import se2
from slamcli.grids.probability_grid import OddsInserter, ProbabilityGrid

COUNT = 40
POSES = drive(COUNT, turns=0.45)
ANGLES = np.linspace(-math.pi, math.pi, 240, endpoint=False)
CORRIDOR = np.array([(-50.0, -1.5, 50.0, 1.5)])


def returns(pose, boxes=BOXES):
    r = ranges(pose, ANGLES, boxes)
    return (r[:, None] * np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]))[r < 8.0]


def graph_of(poses, boxes=BOXES):
    """Submaps of the first nodes of ten, drawn at their true places."""
    part, grids = part_of(poses), []
    for first in range(0, len(poses), 10):
        grid = ProbabilityGrid.empty(0.05, tuple(poses[first, :2]))
        for pose in poses[first : first + 10]:
            grid = OddsInserter().insert(grid, pose, np.zeros(2), returns(pose, boxes), np.empty((0, 2)))
        grids.append(grid.cropped())
    return PoseGraph2d(PoseGraph(), [replace(part, grids=grids, points=[returns(pose, boxes) for pose in poses])])


@pytest.fixture(scope="module")
def graph():
    return graph_of(POSES)


def look(graph, trials, jobs=1, **more):
    with ThreadPoolExecutor(jobs) as executor:
        return search(graph, trials, executor, 3, **more)


def off(graph, found):
    """How far what was found is from the truth: metres and radians."""
    error = se2.between(se2.between(graph.submap_local[found.loop.submap], POSES[found.loop.node]), found.loop.relative)
    return math.hypot(error[0], error[1]), abs(error[2])


@pytest.mark.parametrize(
    ("shift", "linear", "angular"),
    [((0.03, -0.02, 0.01), 0.2, 0.04), ((0.8, -0.6, 0.2), 1.5, 0.3), ((-2.0, 1.5, -0.4), 3.0, 0.5)],
    ids=["least squares alone", "window", "wide window"],
)
def test_a_node_is_found_where_it_truly_is(graph, shift, linear, angular):
    moved = replace_nodes(graph, np.array(shift))
    (found,) = look(moved, {0: [Trial(5, linear, angular, 0.5)]})
    assert found.rejected == ""
    assert (found.loop.submap, found.loop.node, found.loop.round) == (0, 5, 3)
    assert found.loop.score > 0.6
    distance, turn = off(graph, found)
    assert distance < 0.03
    assert turn < 0.01
    assert math.sqrt(np.linalg.eigvalsh(found.loop.covariance)[1]) < 0.3


def replace_nodes(graph, shift):
    """The same graph whose nodes are believed to be elsewhere; the search starts where truth is shifted to."""
    moved = PoseGraph2d(graph.parameters, graph.parts)
    moved.node = se2.compose(np.zeros(3), graph.node + shift)
    return moved


def test_what_is_outside_the_window_or_too_little_is_not_found(graph):
    moved = replace_nodes(graph, np.array([2.5, 0.0, 0.0]))
    assert look(moved, {0: [Trial(5, 0.5, 0.1, 0.6)]}) == []
    part = graph.parts[0]
    few = PoseGraph2d(graph.parameters, [replace(part, points=[points[:9] for points in part.points])])
    assert look(few, {0: [Trial(5, 1.0, 0.3, 0.1)]}) == []
    assert look(graph, {0: [Trial(5, 0.2, 0.04, 0.89)]}) == []


def test_the_whole_submap_is_searched_without_a_prior(graph):
    lost = replace_nodes(graph, np.array([40.0, -30.0, 2.0]))
    (found,) = look(lost, {0: [Trial(5, math.inf, math.pi, 0.5)]})
    assert off(graph, found)[0] < 0.05


def test_a_plain_corridor_is_ambiguous_along_itself():
    poses = np.column_stack([np.arange(20) * 0.2, np.zeros(20), np.zeros(20)])
    graph = graph_of(poses, CORRIDOR)
    (found,) = look(graph, {0: [Trial(5, 1.0, 0.3, 0.5)]})
    along, across = found.loop.covariance[0, 0], found.loop.covariance[1, 1]
    assert math.sqrt(along) > 0.5
    assert math.sqrt(across) < 0.1
    assert found.rejected == ""  # it still says how far the walls are


def test_without_ambiguity_all_directions_count_alike(graph):
    trials = {0: [Trial(5, 1.0, 0.3, 0.5), Trial(7, 1.0, 0.3, 0.5)], 2: [Trial(22, 1.0, 0.3, 0.5)]}
    with_it, without = look(graph, trials), look(graph, trials, ambiguity=False)
    assert len(with_it) == len(without) == 3
    for one, other in zip(with_it, without, strict=True):
        np.testing.assert_array_equal(one.loop.relative, other.loop.relative)
        assert one.loop.covariance.any()
        assert not other.loop.covariance.any()


def test_order_is_that_of_submaps_and_trials_for_any_number_of_threads(graph):
    trials = {
        submap: [Trial(node, 1.0, 0.3, 0.5) for node in (10 * submap + 7, 10 * submap + 2)] for submap in (3, 1, 0, 2)
    }
    one, two = look(graph, trials), look(graph, trials, jobs=2)
    assert [(f.loop.submap, f.loop.node) for f in one] == [(s, 10 * s + k) for s in range(4) for k in (7, 2)]
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.loop.relative, b.loop.relative)
        np.testing.assert_array_equal(a.loop.covariance, b.loop.covariance)
        assert a.loop.score == b.loop.score
