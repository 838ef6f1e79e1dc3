# SPDX-License-Identifier: MIT
"""What a report shows of a memory of places: hypotheses, closures with why they were refused, sizes, times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from test_html_report import parse

from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.posegraph.place_closure import PlaceClosure
from slamcli.reports.html import report
from slamcli.reports.node_axis import NodeAxis
from slamcli.vision.pictures import KeyframeView, PlaceView
from slamcli.vision.reduction import reduced_picture

SECOND = 1_000_000_000
COUNT = 40


def steps(**changed):
    nodes = np.arange(1, COUNT + 1)
    found = {
        "stamp_ns": nodes * SECOND, "node": nodes, "map_id": 0 * nodes, "num_features": 500 + nodes,
        "hypothesis": np.maximum(nodes - 20, 0), "posterior": np.where(nodes > 20, 0.5, 0.0), "working": np.maximum(nodes - 10, 0),
        "short_term": np.minimum(nodes, 10), "long_term": 0 * nodes, "words": 100 * nodes, "retrieved": 0 * nodes,
        "transferred": 0 * nodes, "similarity": np.full(COUNT, 0.25), "optimised": 0 * nodes, "loop_inliers": 0 * nodes,
    }  # fmt: skip
    return found | changed


def closure(node, older, **changed):
    given = PlaceClosure(
        stamp_ns=node * SECOND, older_stamp_ns=older * SECOND, node=node, older_node=older, kind="loop", accepted=True,
        posterior=0.5, num_matches=100, num_inliers=40,
    )  # fmt: skip
    return replace(given, **changed)


CLOSURES = [
    closure(30, 10),
    closure(31, 11, kind="near in space", posterior=0.0),
    closure(32, 12, accepted=False, num_inliers=9, reason="PnP: 9 inliers, fewer than 20"),
    closure(33, 12, accepted=False, num_inliers=8, reason="PnP: 8 inliers, fewer than 20"),
    closure(34, 2, accepted=False, strain=4.0, reason="<strained> 4.0"),
]


def graph():
    T = np.tile(np.eye(4), (COUNT, 1, 1))
    T[:, 0, 3] = np.arange(COUNT)
    pairs = np.array([*((i, i + 1) for i in range(COUNT - 1)), (9, 29), (10, 30)])
    kinds = np.array([3] * (COUNT - 1) + [2, 4])
    return KeyframeGraph(
        stamps_ns=np.arange(1, COUNT + 1) * SECOND, T_map_base=T, pairs=pairs, shared=np.zeros(len(pairs), int), kinds=kinds,
        T_first_second=np.tile(np.eye(4), (len(pairs), 1, 1)), information=np.tile(np.eye(6), (len(pairs), 1, 1)),
        ids=np.arange(1, COUNT + 1),
    )  # fmt: skip


def told(markup):
    return " ".join(parse(markup).text)


def test_closures_hypotheses_and_sizes_are_shown():
    run = {"parameters": {"Rtabmap/LoopThr": 0.11}, "timing": {"total_s": 2.0, "laps_s": {"update": [0.01] * COUNT}}}
    markup = report(run, steps=steps(), closures=CLOSURES, keyframes=graph())
    assert markup == report(run, steps=steps(), closures=CLOSURES, keyframes=graph())
    text = told(markup)
    assert "Rtabmap/LoopThr 0.11" in text
    assert "loops closed by looks" in text
    assert "ties to places near by" in text
    assert "loops (1)" in text
    assert "near (1)" in text
    assert "odometry (39)" in text
    assert "refused closures (3)" in text
    assert "PnP: … inliers, fewer than … loop 2" in " ".join(text.split())
    assert "<strained> 4.0" in text
    assert "short-term" in text
    assert "Nodes moved by the optimisation" not in text  # zero all along
    assert "median 10.0 ms" in text
    assert "Steps" not in text
    assert "keyframes" not in text


def test_the_refused_that_came_nearest_stand_first_and_are_bounded():
    many = [closure(1 + i % COUNT, 1, accepted=False, reason=f"reason {chr(97 + i % 26)} {i}") for i in range(5000)]
    text = told(report({}, steps=steps(), closures=[*many, CLOSURES[-1]]))
    assert text.index("<strained> 4.0") < text.index("reason a 0")
    assert 'class="wordy"' in report({}, steps=steps(), closures=CLOSURES)
    assert "4,976 more stand in closures.csv" in text
    assert len(report({}, steps=steps(), closures=many, keyframes=graph())) < 300_000


def test_nothing_without_a_memory_and_no_times_that_are_of_other_updates():
    assert "Memory over time" not in report({}, steps={"stamp_ns": np.arange(3)})
    assert "Time of each update" not in report({"timing": {"laps_s": {"update": [0.1]}}}, steps=steps())
    assert "No place was known again" in report({}, steps=steps())


def test_recordings_of_several_days_are_drawn_by_nodes():
    stamps = np.arange(1, COUNT + 1) * SECOND
    stamps[20:] += 86_400 * SECOND
    axis = NodeAxis(steps(stamp_ns=stamps), None)
    assert axis.label == "node"
    assert axis.named(3) == "3"
    assert axis.named(400) == "400 (earlier)"
    assert axis.named(-2) == "landmark 2"
    usual = NodeAxis(steps(), 0)
    assert usual.label == "time in s"
    assert usual.named(3) == "3 at 3.0 s".replace(" ", "\N{NO-BREAK SPACE}")
    np.testing.assert_array_equal(usual.of_nodes([3, 400]), [3.0, np.nan])


def test_both_sides_of_closures_and_why_one_was_refused():
    image = reduced_picture(np.zeros((480, 640, 3), np.uint8))
    sides = [
        KeyframeView(stamp_ns=s * SECOND, picture=image, places=np.full((3, 2), 9.0), num_features=9, name=f"node {s}")
        for s in (1, 30)
    ]
    none = replace(sides[1], places=np.zeros((0, 2)))
    places = [
        PlaceView(older=sides[0], newer=sides[1], kind="near"),
        PlaceView(older=replace(sides[0], places=none.places), newer=none, kind="refused", reason="too few"),
    ]
    text = told(report({}, keyframes=graph(), place_views=places, keyframe_views=sides))
    assert "node 1 (0.0 s) and node 30 (29.0 s)" in text
    assert "Here a place near by was known again: 3 common points." in text
    assert "Refused: too few. " in text
    assert "node 30 (29.0 s) · 3 of 9 key points" in text
    earlier = replace(sides[0], of_this_run=False)
    assert "node 1 (an earlier session)" in told(report({}, keyframes=graph(), keyframe_views=[earlier]))
