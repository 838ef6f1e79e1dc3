# SPDX-License-Identifier: MIT
"""A whole session of a camera that goes round a room: its loop is closed, once, and the drift goes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from loop_world import SCALES, World, position_error, true_pose

from slamcli.geometry import se3
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.frame_track import TrackedFrame, after_merge
from slamcli.orbslam3.keyframe_edges import keyframe_graph
from slamcli.orbslam3.keyframe_rules import KeyframeSettings
from slamcli.orbslam3.keyframe_views import keyframe_views, place_views
from slamcli.orbslam3.local_mapping import MappingSettings
from slamcli.orbslam3.loop_closing import Closure
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.session import Session
from slamcli.orbslam3.session_settings import SessionSettings
from slamcli.orbslam3.tracking import TrackingSettings
from slamcli.vision.matching import feature_grid
from slamcli.vision.reduction import reduced_picture

PICTURE = reduced_picture(np.zeros((480, 640), np.uint8))


def settings(stereo, *, loops=True):
    close_m = 6.0 if stereo else math.inf
    return SessionSettings(
        tracking=TrackingSettings(motion_radius=15.0, local_radius=3.0),
        keyframes=KeyframeSettings(share=0.75 if stereo else 0.9, close_m=close_m),
        mapping=MappingSettings(
            num_neighbours=10 if stereo else 20, close_m=close_m, least_observations=3 if stereo else 2
        ),
        close_m=close_m, farthest_m=math.inf, least_start=100,
        places=PlaceSettings(fix_scale=stereo) if loops else None,
    )  # fmt: skip


def go_round(world, chosen, frames=135):
    session, truth = Session(world.camera, SCALES, chosen), []
    world.rng = np.random.default_rng(5)
    for number in range(frames):
        T = true_pose(2 * np.pi / 108 * number)
        features, _ = world.look(T)
        session.take(
            Frame(
                number=number, stamp_ns=number * 33_000_000, features=features, grid=feature_grid(features, world.camera),
                T_camera_map=np.eye(4), points=np.full(len(features), -1),
                picture=PICTURE,
            )
        )  # fmt: skip
        truth.append(T)
    session.finish()
    return session, [truth[number] for number in session.map.frame_number]


@pytest.mark.parametrize("stereo", [True, False])
def test_a_round_is_closed(stereo):
    world = World(stereo=stereo, focal_error=0.01, count=2500)
    opened, truth = go_round(world, settings(stereo, loops=False))
    before, _ = position_error(opened.map, truth, with_scale=not stereo)
    session, truth = go_round(world, settings(stereo))
    after, _ = position_error(session.map, truth, with_scale=not stereo)
    assert session.counts["loops closed"] == len(session.closures) == 1
    assert session.counts["loops undone"] == 0
    assert session.closures[0].other_stamp_ns < 10 * 33_000_000
    assert session.closures[0].num_matches >= 80
    assert len(session.tracked) >= 133
    graph = keyframe_graph(session.map, se3.inverse(session.map.poses_of_all()[session.map.living_keyframes]))
    assert len(graph.of_kind("loop")) == 1
    assert len(graph.of_kind("tree", "loop")) == len(graph.stamps_ns)  # a tree, and one edge that closes it
    assert graph.shared[graph.of_kind("covisible")].min() >= 15
    assert len(keyframe_views(session.map)) == 12
    (view,) = place_views(session.map, set())
    assert view.kind == "loop"
    assert len(view.older.places) == len(view.newer.places) >= 8
    assert view.older.stamp_ns < 10 * 33_000_000
    assert before > 0.07
    assert after < 0.6 * before
    again, _ = go_round(world, settings(stereo))
    assert again.map.T_camera_map.tobytes() == session.map.T_camera_map.tobytes()


def test_frames_get_the_numbers_of_the_joined_map():
    def frame(map_number):
        none = np.empty(0)
        T = np.eye(4)
        T[0, 3] = 2.0
        return TrackedFrame(
            number=7, stamp_ns=7, map_number=map_number, reference=3, T_frame_reference=T, points=np.array([4, 5]),
            pixels=np.zeros((2, 2)), right=none, sigmas=none,
        )  # fmt: skip

    closure = Closure(
        stamp_ns=0, other_stamp_ns=0, num_matches=100, num_fused=50, cost_before=0.1, cost_after=0.1, length_factor=1.5,
        merged_map=0, keyframe_offset=10, point_offset=100,
    )  # fmt: skip
    old, other, newest = (after_merge(frame(number), closure, 2) for number in (0, 1, 2))
    assert (old.map_number, old.reference, old.points.tolist()) == (2, 3, [4, 5])
    assert (other.map_number, other.reference, other.points.tolist()) == (1, 3, [4, 5])
    assert (newest.map_number, newest.reference, newest.points.tolist()) == (2, 13, [104, 105])
    assert newest.T_frame_reference[0, 3] == 3.0
    assert old.T_frame_reference[0, 3] == 2.0
