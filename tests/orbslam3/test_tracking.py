# SPDX-License-Identifier: MIT
"""Where a frame was taken, in a round room whose every match is known."""

import numpy as np
import pytest
from loop_world import SCALES, World, true_pose

from slamcli.geometry import se3
from slamcli.orbslam3.frame import Frame, repeats
from slamcli.orbslam3.keyframe_rules import KeyframeSettings, needs_keyframe
from slamcli.orbslam3.tracking import (
    TrackingSettings,
    count_sightings,
    local_keyframes,
    track_keyframe,
    track_local_map,
    track_motion,
)
from slamcli.vision.matching import feature_grid

TURNS = np.linspace(0.0, 0.6, 7)


@pytest.fixture(params=[True, False], ids=["stereo", "mono"])
def world(request):
    return World(stereo=request.param, focal_error=0.0, count=3000)


def frame_at(world, turn, number=100):
    features, things = world.look(true_pose(turn))
    grid = feature_grid(features, world.camera)
    frame = Frame(number=number, stamp_ns=number, features=features, grid=grid, points=np.full(len(features), -1))
    return frame, things


def in_map(world, sparse_map, turn):
    """Where a camera at a true turn is in the map, which begins at the first true pose."""
    return true_pose(turn) @ se3.inverse(world.truth[0]) @ sparse_map.T_camera_map[0]


def wrong_share(world, sparse_map, frame, things):
    seen = np.flatnonzero(frame.points >= 0)
    right = [world.physical[id(sparse_map), int(frame.points[i])] == things[i] for i in seen]
    return 1.0 - float(np.mean(right))


def last_frame(world, sparse_map):
    """The newest keyframe as the frame before."""
    k = sparse_map.num_keyframes - 1
    features = sparse_map.features(k)
    return Frame(
        number=k, stamp_ns=k, features=features, grid=sparse_map.grids[k], T_camera_map=sparse_map.T_camera_map[k].copy(),
        points=sparse_map.seen[k, : len(features)].copy(), reference=k,
    )  # fmt: skip


def apart(T, wanted):
    difference = T @ se3.inverse(wanted)
    return float(np.linalg.norm(difference[:3, 3])), float(np.arccos(min(1.0, (np.trace(difference[:3, :3]) - 1) / 2)))


def test_the_motion_model_leads_to_the_frame_and_the_local_map_to_more(world):
    sparse_map = world.build(TURNS)
    frame, things = frame_at(world, 0.62)
    guess = in_map(world, sparse_map, 0.615)
    assert track_motion(sparse_map, last_frame(world, sparse_map), frame, guess, TrackingSettings())
    first = frame.num_points
    track = track_local_map(sparse_map, frame, TrackingSettings())
    assert track.held == frame.num_points >= first
    assert wrong_share(world, sparse_map, frame, things) < 0.02
    metres, radians = apart(frame.T_camera_map, in_map(world, sparse_map, 0.62))
    assert metres < 0.03
    assert radians < 0.005
    assert frame.reference in (5, 6)


def test_a_wrong_guess_finds_nothing_and_descriptors_find_the_place(world):
    sparse_map = world.build(TURNS)
    frame, things = frame_at(world, 0.75)
    nowhere = in_map(world, sparse_map, -0.8)
    assert not track_motion(sparse_map, last_frame(world, sparse_map), frame, nowhere, TrackingSettings())
    assert track_keyframe(sparse_map, 6, nowhere, frame, TrackingSettings())
    assert wrong_share(world, sparse_map, frame, things) < 0.02
    assert apart(frame.T_camera_map, in_map(world, sparse_map, 0.75))[0] < 0.06
    stranger = World(seed=9, stereo=world.stereo)
    other, _ = frame_at(stranger, 0.6)
    assert not track_keyframe(sparse_map, 6, np.eye(4), other, TrackingSettings())


def test_the_local_map_begins_with_whom_most_is_shared(world):
    sparse_map = world.build(TURNS)
    frame = last_frame(world, sparse_map)
    keyframes = local_keyframes(sparse_map, frame)
    assert keyframes[0] in (5, 6)  # those may share as many
    assert sorted(keyframes.tolist()) == list(range(7))
    frame.points[:] = -1
    assert len(local_keyframes(sparse_map, frame)) == 0
    assert track_local_map(sparse_map, frame, TrackingSettings()).held == 0


def test_sightings_are_counted(world):
    sparse_map = world.build(TURNS)
    frame = last_frame(world, sparse_map)
    visible, found = sparse_map.visible.copy(), sparse_map.found.copy()
    seen = frame.points[frame.points >= 0]
    count_sightings(sparse_map, frame, np.concatenate([seen, [0]]) if 0 not in seen else seen)
    assert (sparse_map.found - found)[seen].tolist() == [1] * len(seen)
    assert (sparse_map.visible - visible).sum() == len(seen) + (0 not in seen)


def test_only_the_same_image_repeats_the_last():
    world = World()
    one, _ = frame_at(world, 0.0)
    again, _ = frame_at(world, 0.0)  # other noise
    same = Frame(number=101, stamp_ns=101, features=one.features, grid=one.grid, points=one.points.copy())
    assert repeats(one, same)
    assert not repeats(one, again)


@pytest.mark.parametrize(
    ("gap", "share_seen", "expected"), [(0, 0.2, False), (3, 0.5, False), (6, 0.5, True), (6, 0.95, False), (30, 0.95, True), (3, 0.1, True)]
)  # fmt: skip
def test_keyframes_come_when_the_view_has_changed(gap, share_seen, expected):
    """Early only where tracking is weak, late whenever anything has left the view."""
    world = World(stereo=False, focal_error=0.0, count=3000)
    sparse_map = world.build(TURNS)
    frame = last_frame(world, sparse_map)
    observed = sparse_map.count_observations()
    seen = sparse_map.seen[6]
    in_reference = int((observed[seen[seen >= 0]] >= 3).sum())
    frame.number = 50 + gap
    settings = KeyframeSettings(share=0.9, least_gap=5, most_gap=30)
    assert needs_keyframe(sparse_map, frame, 50, int(share_seen * in_reference), settings) is expected
    assert SCALES[0] == 1.0
