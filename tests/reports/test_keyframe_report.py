# SPDX-License-Identifier: MIT
"""What a report shows of a system that sees: the graph in layers, pictures with dots, loops with lines, all within half a megabyte."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from test_html_report import parse

from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.reports.html import report
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, PlaceView
from slamcli.vision.reduction import reduced_picture


def graph(kinds=(1, 0, 2, 1, 1)):
    T = np.tile(np.eye(4), (4, 1, 1))
    T[:, 0, 3], T[:, 1, 3] = [0, 2, 2, 0], [0, 0, 2, 2]
    return KeyframeGraph(
        stamps_ns=np.arange(4) * 10**9, T_map_base=T, pairs=np.array([[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]),
        shared=np.array([90, 20, 40, 80, 70]), kinds=np.array(kinds),
    )  # fmt: skip


def view(stamp_s=0, count=5, noise=0):
    rng = np.random.default_rng(noise)
    picture = reduced_picture(rng.integers(0, 255 if noise else 2, (480, 640, 3), dtype=np.uint8))
    return KeyframeView(
        stamp_ns=stamp_s * 10**9, picture=picture, places=rng.uniform(0, 150, (count, 2)), num_features=1000
    )


def trajectory():
    quats = np.tile([0.0, 0, 0, 1], (4, 1))
    return Trajectory(
        np.arange(4) * 10**9, graph().T_map_base[:, :3, 3].copy(), quats, frame_id="map", child_frame_id="b"
    )


def test_pictures_are_a_whole_fraction_and_places_keep_to_it():
    image = np.zeros((480, 640, 3), np.uint8)
    image[240:243, 300:303] = 255  # one pixel of the picture
    picture = reduced_picture(image)
    assert (picture.width, picture.height, picture.factor) == (213, 160, 3)
    np.testing.assert_allclose(picture.places(np.array([[301.0, 241.0]])), [[100.0, 80.0]])
    assert reduced_picture(np.zeros((5, 7), np.uint8)).factor == 1
    assert len(picture.jpeg) < 5000


def test_the_page_shows_graph_pictures_and_loops():
    loop = PlaceView(older=view(0, 100), newer=view(3, 100))
    join = replace(loop, kind="join")
    given = {"keyframes": graph(), "keyframe_views": [view(s, 7) for s in range(3)], "place_views": [loop, join]}
    markup = report({}, trajectory=trajectory(), **given)
    assert markup == report({}, trajectory=trajectory(), **given)
    told = " ".join(parse(markup).text)
    assert "share 15 points or more (1)" in told
    assert "loops (1)" in told
    assert "3.0 s" in told
    assert "1.0 s · 7 of 1,000 key points" in told
    assert "a loop was closed: 100 common points, 50 of them drawn" in told
    assert "two maps were joined" in told
    assert markup.count('class="match') == 100
    assert markup.count("data:image/jpeg") == 3 + 4


def test_nothing_without_a_graph_and_no_loops_without_loops():
    assert "Keyframes" not in report({})
    markup = report({}, keyframes=graph(kinds=(1, 0, 0, 1, 1)))
    assert "Keyframes" in markup
    assert "Places seen again" not in markup
    assert "What the camera saw" not in markup


def test_pictures_stay_below_six_hundred_kilobytes():
    noisy = [view(s, 3, noise=s + 1) for s in range(12)]
    loops = [PlaceView(older=a, newer=b) for a, b in zip(noisy[:6], noisy[6:], strict=True)]
    plain = len(report({}, keyframes=graph()))
    full = len(report({}, keyframes=graph(), keyframe_views=noisy, place_views=loops))
    assert 150_000 < full - plain < 600_000


def test_time_begins_with_the_first_frame_even_where_it_has_no_pose():
    steps = {"stamp_ns": np.arange(-5, 4) * 10**9, "tracked": np.array([0] * 5 + [1] * 4)}
    told = " ".join(
        parse(report({}, steps=steps, trajectory=trajectory(), keyframes=graph(), keyframe_views=[view(3)])).text
    )
    assert "8.0 s · 5 of" in told


def test_frames_without_a_pose_are_ticks():
    steps = {
        "stamp_ns": np.arange(5) * 10**9, "tracked": np.array([1, 1, 0, 0, 1]), "points_held": np.array([90, 80, 0, 0, 70]),
        "keyframes": np.array([1, 1, 2, 2, 3]), "map_points": np.array([10, 20, 30, 40, 50]),
    }  # fmt: skip
    told = " ".join(parse(report({}, steps=steps)).text)
    assert "5 steps, 2 frames without a pose." in told
    assert "frame without a pose" in told
    assert "Keyframes of the map" in told
