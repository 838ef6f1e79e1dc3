# SPDX-License-Identifier: MIT
"""The pose graph in the report: the right numbers, well-formed, everything escaped, and whatever a state lacks."""

from __future__ import annotations

import re
from dataclasses import replace

import graph_states
import numpy as np
import pytest
from test_html_report import parse

from slamcli.geometry import se3
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.posegraph import LoopSearch, MapState
from slamcli.posegraph.constraint_residuals import constraint_residuals
from slamcli.reports.graph_arrays import graph_arrays
from slamcli.reports.graph_map import graph_map, residual_classes
from slamcli.reports.html import report
from slamcli.reports.submap_matrix import constraint_counts, untied

RUN = {"algo": "cartographer", "parameters": {"POSE_GRAPH.constraint_builder.min_score": 0.6}}


@pytest.fixture(scope="module")
def made():
    return graph_states.state_and_searches()


@pytest.fixture(scope="module")
def graph(made):
    return graph_arrays(*made)


def page(state, searches=(), **more):
    return report(RUN, trajectory=graph_states.trajectory(), state=state, loop_searches=searches, **more)


def test_every_node_has_its_submap_and_every_submap_its_middle(graph):
    np.testing.assert_array_equal(graph.owners, np.arange(graph_states.NODES) // graph_states.PER_SUBMAP)
    np.testing.assert_allclose(graph.centres_m, graph_states.true_poses()[10 :: graph_states.PER_SUBMAP, :2])
    assert graph.middles[3] == 70
    assert graph.elapsed_s[70] == 35.0


def test_the_correction_is_the_drift_that_was_taken_out(graph):
    assert np.degrees(graph.correction_rad[-1]) == pytest.approx(0.1 * (graph_states.NODES - 1))
    alone = graph_states.local_poses(graph_states.true_poses())[:, :3, 3]
    np.testing.assert_allclose(graph.local_positions_m, alone, atol=1e-9)


def test_an_outline_goes_with_its_submap(made, graph):
    state, _ = made
    np.testing.assert_allclose(graph.outlines_m[0, 2] - graph.outlines_m[0, 0], [11.9, 3.2], atol=0.9)
    moved = se3.from_se2([4.0, -3.0, np.pi / 2])
    submaps = tuple(replace(s, T_map_submap=moved @ s.T_map_submap) for s in state.submaps)
    outlines = graph_arrays(replace(state, submaps=submaps)).outlines_m
    x, y = np.moveaxis(graph.outlines_m, -1, 0)
    np.testing.assert_allclose(outlines, np.stack([4.0 - y, -3.0 + x], axis=-1), atol=1e-9)


def test_outlines_of_other_grids(made):
    grid = TsdfGrid(np.zeros((5, 8), dtype=np.uint16), np.zeros((5, 8), dtype=np.uint16), 0.5, (0.0, 0.0), 0.3, 10.0)
    grid.tsd[1:3, 2:7] = 9
    state = made[0]
    first = replace(state.submaps[0], T_local_submap=np.eye(4), T_map_submap=np.eye(4), grid=grid)
    outlines = graph_arrays(replace(state, submaps=(first,))).outlines_m
    np.testing.assert_allclose(outlines[0], [(1.0, 0.5), (3.5, 0.5), (3.5, 1.5), (1.0, 1.5)])
    deep = graph_arrays(graph_states.state_and_searches(three_d=True)[0])
    np.testing.assert_allclose(deep.outlines_m[0], [(-2.05, -2.05), (1.95, -2.05), (1.95, 1.95), (-2.05, 1.95)])


def test_what_a_search_tells_of_its_residual_counts(made):
    state, _ = made
    k = next(i for i, c in enumerate(state.constraints) if c.kind == "inter")
    constraint = state.constraints[k]
    blind = LoopSearch(
        submap=constraint.submap, node=constraint.node, score=0.7, accepted=True, reason="",
        translation_residual_m=0.002, rotation_residual_rad=0.0003,
    )  # fmt: skip
    assert graph_arrays(state, (blind,)).residuals_m[k] == 0.002
    assert graph_arrays(state, (blind,)).residuals_rad[k] == 0.0003
    assert graph_arrays(state, (replace(blind, accepted=False),)).residuals_m[k] > 0.003
    assert graph_arrays(state).residuals_m[k] == pytest.approx(constraint_residuals(state)[0][k])


def test_the_worse_residual_names_the_class():
    metres = np.array([0.01, 0.01, 0.2, 3.0, np.nan])
    degrees = np.array([0.1, 0.8, 0.1, 0.1, 0.1])
    assert residual_classes(metres, np.radians(degrees)).tolist() == [0, 1, 2, 3, 3]


def test_what_is_tied_is_counted_and_what_is_near_and_not_tied_found(graph):
    counts = constraint_counts(graph)
    assert counts.sum() == graph.inter.sum() > 5
    assert (np.argwhere(counts)[:, 1] - np.argwhere(counts)[:, 0] > 6).all()
    pairs = untied(graph)
    assert not (pairs & ((counts + counts.T) > 0)).any()
    np.testing.assert_array_equal(pairs, pairs.T)
    assert pairs[0, 6] == (counts[0, 6] + counts[6, 0] == 0)  # the second round over the first, side by side
    assert not pairs[1, 4]  # the far sides of the corridor
    assert not pairs[0, 1]
    assert not pairs[0, 2]


def test_the_drawing_has_a_layer_for_each_switch(graph):
    markup = graph_map(graph, graph_states.occupancy(graph_states.true_poses()))
    labels = [text for text in parse(markup).text if "(" in text or text == "map"]
    assert (
        f"loop constraints to 5 cm, 0.5° ({(residual_classes(graph.residuals_m, graph.residuals_rad)[graph.inter] == 0).sum()})"
        in labels
    )
    assert markup.count('type="checkbox"') == markup.count('<g class="l')
    assert len(re.findall(r'class="outline" stroke-opacity="0.60" d="M[^"]*Z"', markup)) == 12
    assert "0, 6" in parse(markup).text


def test_the_page_tells_numbers_and_loads_nothing(made):
    state, searches = made
    markup = page(state, searches, grid=graph_states.occupancy(graph_states.true_poses()))
    parser = parse(markup)
    told = " ".join(parser.text)
    accepted = sum(s.accepted for s in searches)
    for words in (
        "min_score 0.6",
        f"{accepted} ({100 * accepted / len(searches):.0f}\N{NO-BREAK SPACE}%)",
        "no match <above> the bound",
        "Worst loop constraints",
        "Rounds of searching",
        "0: 20 scans, 5 s",
        "11: 20 scans, 115 s, not finished",
    ):
        assert words in told, words
    assert all(link.startswith("data:") for link in parser.links)
    assert markup == page(state, searches, grid=graph_states.occupancy(graph_states.true_poses()))


def test_several_trajectories_name_their_submaps():
    state, searches = graph_states.state_and_searches(trajectories=2)
    told = parse(page(state, searches)).text
    assert "1.5: 20 scans, 55 s, not finished" in told
    assert "trajectories (2)" in told


@pytest.mark.parametrize(
    "kind", ["empty", "no nodes", "no constraints", "no submaps", "trimmed", "one node", "no grids"]
)
def test_whatever_a_state_lacks(made, kind):
    state, searches = made
    state = {
        "empty": MapState(nodes=(), submaps=(), constraints=()),
        "no nodes": replace(state, nodes=()),
        "no constraints": replace(state, constraints=()),
        "no submaps": replace(state, submaps=()),
        "trimmed": replace(state, submaps=state.submaps[-2:]),
        "one node": replace(state, nodes=state.nodes[:1]),
        "no grids": replace(state, submaps=tuple(replace(s, grid=None) for s in state.submaps)),
    }[kind]
    markup = page(state, searches)
    parse(markup)
    assert "nan" not in re.sub(r"base64,[^\"]*", "", markup).split("</style>")[1].replace("none", "")
    assert ("Pose graph" in markup) == (kind != "empty")


def test_searches_that_were_only_counted_count(made):
    state, searches = made
    markup = report(RUN | {"summary": {"loop_trials": 1000}}, state=state, loop_searches=searches)
    told = parse(markup).text
    assert "1,000" in told
    assert f'found nothing</td><td class="n">{1000 - len(searches):,}</td>' in markup
    nothing = 1000 - sum(s.score > 0 for s in searches)
    assert f"{nothing:,} more searches found nothing above their bound." in told
