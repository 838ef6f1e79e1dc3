# SPDX-License-Identifier: MIT
"""Sessions that lose the track: found again, other maps, one map in the end; and sessions that begin with given maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from loop_world import SCALES, World, true_pose

from slamcli.geometry import se3
from slamcli.orbslam3.atlas import sparse_maps, visual_atlas
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.frame_track import final_pose
from slamcli.orbslam3.keyframe_rules import KeyframeSettings
from slamcli.orbslam3.local_mapping import MappingSettings
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.session import Session, SessionSettings
from slamcli.orbslam3.tracking import TrackingSettings
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary

STEP = 2 * np.pi / 120
SETTINGS = SessionSettings(
    tracking=TrackingSettings(motion_radius=15.0, local_radius=3.0), keyframes=KeyframeSettings(share=0.75, close_m=6.0),
    mapping=MappingSettings(num_neighbours=10, close_m=6.0, least_observations=3), close_m=6.0, farthest_m=float("inf"),
    least_start=100, places=PlaceSettings(), patience_ns=300_000_000,
)  # fmt: skip
NOTHING = Features(
    pixels=np.zeros((0, 2)), raw_pixels=np.zeros((0, 2)), octaves=np.zeros(0, np.int64), angles=np.zeros(0), responses=np.zeros(0),
    descriptors=np.zeros((0, 32), np.uint8), sigmas=np.zeros(0), right=np.zeros(0), depth=np.zeros(0),
)  # fmt: skip


def frame(number, world, turn):
    """What a camera sees in a world at an angle; nothing without a world."""
    features = NOTHING if world is None else world.look(true_pose(turn))[0]
    camera = World(count=1).camera
    return Frame(
        number=number, stamp_ns=number * 33_000_000, features=features, grid=feature_grid(features, camera),
        points=np.full(len(features), -1),
    )  # fmt: skip


def run(views, *, settings=SETTINGS, vocabulary=None, given=()):
    """A session of views (world, number of steps along the circle)."""
    session = Session(World(count=1).camera, SCALES, settings, vocabulary=vocabulary, given=given)
    for number, (world, step) in enumerate(views):
        session.take(frame(number, world, STEP * step))
    session.finish()
    return session


def views(world, steps):
    return [(world, step) for step in steps]


def worst(session, views, number):
    """The largest error of a position in a map, metres, once the first pose lies on the true one; and which frames are there."""
    sparse_map = session.maps[number]
    poses = sparse_map.poses_of_all()
    tracked = [one for one in session.tracked if one.map_number == number]
    found = [final_pose(sparse_map, poses, one, refine=True) for one in tracked]
    true = [true_pose(STEP * views[one.number][1]) for one in tracked]
    to_map = se3.inverse(found[0]) @ true[0]
    errors = [np.linalg.norm((se3.inverse(T) - to_map @ se3.inverse(t))[:3, 3]) for T, t in zip(found, true, strict=True)]  # fmt: skip
    return max(errors), [one.number for one in tracked]


def words_of(*worlds):
    images = [world.look(true_pose(0.3 * k))[0].descriptors for world in worlds for k in range(20)]
    return train_vocabulary(images, TrainingSettings(depth=3))


@pytest.mark.parametrize("with_words", [True, False])
def test_a_lost_track_is_found_again_in_the_map(with_words):
    world = World(count=2500, focal_error=0.0)
    seen = views(world, range(50)) + views(None, [0] * 4) + views(world, range(3, 20))
    session = run(seen, vocabulary=words_of(world) if with_words else None)
    assert session.counts["frames relocalised"] == 1
    assert session.counts["maps begun after the track was lost"] == 0
    error, numbers = worst(session, seen, 0)
    assert numbers == [*range(50), *range(54, 71)]
    assert error < 0.05
    assert sorted(session.untracked) == [50, 51, 52, 53]
    assert len(session.maps) == 1


def test_what_cannot_be_found_becomes_another_map_from_where_the_track_was_lost():
    world, other = World(count=2500, focal_error=0.0), World(seed=9, count=2500, focal_error=0.0)
    seen = views(world, range(20)) + views(other, range(16)) + views(world, range(15, 30))
    session = run(seen)
    assert session.counts["maps begun after the track was lost"] == 1
    maps = {one.number: one.map_number for one in session.tracked}
    assert sorted(maps) == list(range(len(seen)))
    here, there = maps[0], maps[25]
    assert here != there
    assert {number for number, where in maps.items() if where == there} == set(range(20, 36))
    for number in (here, there):
        assert worst(session, seen, number)[0] < 0.05
    assert session.counts["frames relocalised"] == 1


def test_maps_of_one_place_are_one_in_the_end():
    world = World(count=2500, focal_error=0.0)
    never = replace(SETTINGS, lost=replace(SETTINGS.lost, least_held=10_000))  # so that only place recognition can
    seen = views(world, range(30)) + views(None, [0] * 12) + views(world, range(32, 2, -1))
    session = run(seen, settings=never)
    assert session.counts["maps begun after the track was lost"] == 1
    assert session.counts["maps merged"] == 1
    (number,) = {one.map_number for one in session.tracked}
    error, numbers = worst(session, seen, number)
    assert numbers == [*range(30), *range(42, 72)]
    assert error < 0.06
    assert [len(sparse_map.living_keyframes) > 0 for sparse_map in session.maps].count(True) == 1


def test_frames_before_the_map_began_are_found_at_a_second_look():
    world = World(count=2500, focal_error=0.0)
    session = Session(world.camera, SCALES, SETTINGS)
    for number in range(16):
        made = frame(number, world, STEP * number)
        if number < 4:  # too few features to begin with
            kept = np.arange(len(made.features))[:90]
            columns = {name: getattr(made.features, name)[kept] for name in Features.__slots__}
            features = Features(**columns)
            made = replace(made, features=features, grid=feature_grid(features, world.camera), points=made.points[kept])
        session.take(made)
    session.finish()
    assert session.counts["frames found at a second look"] == 4
    assert [one.number for one in session.tracked] == list(range(16))
    assert worst(session, views(world, range(16)), 0)[0] < 0.05
    assert session.untracked == {}


def columns_of(sparse_map):
    return {name: column.tobytes() for name, column in visual_atlas([sparse_map]).maps[0].columns.items()}


def test_localising_leaves_the_given_map_as_it_is():
    world, other = World(count=2500, focal_error=0.0), World(seed=9, count=2500, focal_error=0.0)
    first = run(views(world, range(30)))
    atlas = visual_atlas(first.maps)
    only = replace(SETTINGS, localise_only=True)
    seen = views(other, range(3)) + views(world, range(10, 28)) + views(other, range(12)) + views(world, range(12, 20))
    session = run(seen, settings=only, vocabulary=words_of(world), given=sparse_maps(atlas, world.camera, SCALES))
    number = session.tracked[0].map_number
    error, numbers = worst(session, seen, number)
    assert numbers == [*range(3, 21), *range(33, 41)]
    assert error < 0.05
    assert columns_of(session.maps[number]) == {k: v.tobytes() for k, v in atlas.maps[0].columns.items()}
    assert sum(len(sparse_map.living_keyframes) > 0 for sparse_map in session.maps) == 1


def test_mapping_goes_on_in_the_given_map():
    world = World(count=2500, focal_error=0.0)
    first = run(views(world, range(24)))
    before = len(first.map.living_keyframes)
    given = sparse_maps(visual_atlas(first.maps), world.camera, SCALES)
    seen = views(world, range(15, 50))
    session = run(seen, given=given)
    (number,) = {one.map_number for one in session.tracked}
    assert len(session.maps[number].living_keyframes) > before
    error, numbers = worst(session, seen, number)
    assert numbers == list(range(35))
    assert error < 0.05


def test_the_same_frames_give_the_same_bytes():
    world, other = World(count=2500, focal_error=0.0), World(seed=9, count=2500, focal_error=0.0)
    results = []
    for _ in range(2):
        for one in (world, other):
            one.rng = np.random.default_rng(3)
        seen = views(world, range(14)) + views(other, range(14)) + views(world, range(10, 20))
        session = run(seen)
        results.append([columns_of(sparse_map) for sparse_map in session.maps if len(sparse_map.living_keyframes)])
    assert len(results[0]) == 2
    assert results[0] == results[1]
