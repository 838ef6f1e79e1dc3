# SPDX-License-Identifier: MIT
"""Loops and merges on maps built directly: drift goes, what was seen twice becomes one, places that only look alike stay two."""

from __future__ import annotations

import copy
from collections import Counter

import numpy as np
import pytest
from loop_world import World, position_error, true_pose
from scipy.spatial.transform import Rotation

from slamcli.geometry import se3
from slamcli.orbslam3 import _essential_kernels as kernels
from slamcli.orbslam3.essential_graph import essential_pairs, shared_points
from slamcli.orbslam3.gravity_bounds import upright_correction, upright_joint
from slamcli.orbslam3.loop_closing import LoopClosing
from slamcli.orbslam3.loop_correction import correct_loop
from slamcli.orbslam3.map_merging import merge_maps
from slamcli.orbslam3.map_snapshot import Costs, MapSnapshot, costs, observations_of
from slamcli.orbslam3.place_index import Place, PlaceIndex
from slamcli.orbslam3.place_recognition import PlaceRecognition
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.similarities import apply, inverse, rigid_of, scale_of
from slamcli.vision.bag_of_words import bag_of_words
from slamcli.vision.vocabulary_training import TrainingSettings, train_vocabulary

STEP = 2 * np.pi / 36
ROUND = [STEP * k for k in range(40)]


def recognise(maps, keyframe, settings, vocabulary=None):
    """The match of a keyframe, all others being known."""
    index, counts = PlaceIndex(vocabulary), Counter()
    for number, sparse_map in enumerate(maps):
        for k in range(sparse_map.num_keyframes):
            index.add(maps, Place(number, k))
    return PlaceRecognition(index, settings, counts).look(maps, keyframe)


def with_scale_drift(sparse_map, per_keyframe):
    """Let lengths grow by a factor from keyframe to keyframe, as they do in mono maps."""
    factors = per_keyframe ** np.arange(sparse_map.num_keyframes)
    before = sparse_map.T_camera_map.copy()
    after = before.copy()
    for k in range(1, len(before)):
        step = before[k] @ se3.inverse(before[k - 1])
        step[:3, 3] *= factors[k]
        after[k] = step @ after[k - 1]
    S = after.copy()
    S[:, :3] /= factors[:, None, None]  # what takes the new map's points to the old cameras
    reference = sparse_map.reference
    at_camera = apply(before[reference], sparse_map.positions)
    sparse_map.positions[...] = apply(inverse(S[reference]), at_camera)
    sparse_map.T_camera_map[...] = after
    sparse_map.refresh_points(np.flatnonzero(sparse_map.point_alive))


@pytest.fixture(scope="module")
def stereo_round():
    world = World(focal_error=0.01)
    sparse_map = world.build(ROUND)
    return world, sparse_map, list(world.truth)


def things_seen_twice(world, sparse_map):
    """How many things are two living points."""
    physical = [world.physical.get((id(sparse_map), p)) for p in np.flatnonzero(sparse_map.point_alive)]
    return sum(n - 1 for n in Counter(physical).values())


def test_a_stereo_loop_is_closed(stereo_round):
    world, original, truth = stereo_round
    sparse_map = copy.deepcopy(original)
    world.physical.update({(id(sparse_map), p): t for (_, p), t in list(world.physical.items())})
    settings, keyframe = PlaceSettings(fix_scale=True), sparse_map.num_keyframes - 1
    worst, typical = position_error(sparse_map, truth)
    twice = things_seen_twice(world, sparse_map)
    merge, loop = recognise([sparse_map], keyframe, settings)
    assert merge is None
    assert loop.place.keyframe in (2, 3, 4)
    assert loop.verified == 3
    outcome = correct_loop(sparse_map, loop, settings)
    assert outcome.closed
    assert outcome.length_factor == pytest.approx(1.0, abs=1e-9)
    assert outcome.num_fused > 250
    assert things_seen_twice(world, sparse_map) < 0.2 * twice
    closed_worst, closed_typical = position_error(sparse_map, truth)
    assert worst > 0.12
    assert closed_worst < 0.3 * worst
    assert closed_typical < 0.3 * typical
    assert sparse_map.loop_edges == [(loop.place.keyframe, keyframe)]
    assert {2, 3, 4} <= set(sparse_map.covisible(keyframe)[0].tolist())
    assert sparse_map.version == 1


def test_a_mono_loop_takes_the_drift_of_the_scale_back():
    world = World(stereo=False, focal_error=0.0)
    sparse_map = world.build(ROUND)
    with_scale_drift(sparse_map, 1.002)
    keyframe = sparse_map.num_keyframes - 2
    worst, _ = position_error(sparse_map, world.truth, with_scale=True)
    settings = PlaceSettings(fix_scale=False)
    _, loop = recognise([sparse_map], keyframe, settings)
    assert loop is not None
    drift = 1.002 ** (keyframe - loop.place.keyframe)
    assert scale_of(loop.S_camera_other) == pytest.approx(drift, rel=0.02)
    outcome = correct_loop(sparse_map, loop, settings)
    assert outcome.closed
    assert outcome.length_factor == pytest.approx(1 / drift, rel=0.03)
    closed, _ = position_error(sparse_map, world.truth, with_scale=True)
    assert closed < 0.3 * worst


def lookalike(stereo=True):
    """A room two of whose corners look the same, and a map that saw both."""
    world = World(stereo=stereo, focal_error=0.002)
    angle = np.arctan2(world.points[:, 1], world.points[:, 0]) % (2 * np.pi)
    kept, twin = (angle < np.pi) | (angle > np.pi + 1.3), angle < 1.3
    world.points = np.vstack([world.points[kept], world.points[twin] @ np.diag([-1.0, -1.0, 1.0])])
    world.descriptors = np.vstack([world.descriptors[kept], world.descriptors[twin]])
    return world, world.build([STEP * k for k in range(1, 26)])


@pytest.mark.parametrize("stereo", [True, False])
def test_a_place_that_only_looks_the_same_changes_nothing(stereo):
    _, sparse_map = lookalike(stereo)
    settings, counts = PlaceSettings(fix_scale=stereo), Counter()
    closing = LoopClosing(PlaceIndex(None), settings, counts)
    T, positions, seen = (getattr(sparse_map, name).copy() for name in ("T_camera_map", "positions", "seen"))
    closures = [closing.insert([sparse_map], k) for k in range(sparse_map.num_keyframes)]
    assert closures == [None] * len(closures)
    assert counts["loops undone"] >= 1
    assert np.array_equal(sparse_map.T_camera_map, T)
    assert np.array_equal(sparse_map.positions, positions)
    assert np.array_equal(sparse_map.seen, seen)
    assert sparse_map.loop_edges == []


def two_maps(stereo=True):
    world = World(stereo=stereo, focal_error=0.002)
    old = world.build([STEP * k for k in range(16)])
    truth = list(world.truth)
    start = se3.from_rotation_translation(Rotation.from_rotvec([0.3, 1.0, -0.2]).as_matrix(), [5.0, 1.0, -2.0])
    newer = world.build([STEP * k for k in range(26, 8, -1)], start=start)
    if not stereo:
        newer.positions[...] *= 0.5
        newer.T_camera_map[:, :3, 3] *= 0.5
        newer.refresh_points(np.flatnonzero(newer.point_alive))
    return world, old, newer, truth + list(world.truth)


@pytest.mark.parametrize("stereo", [True, False])
def test_maps_of_the_same_room_become_one(stereo):
    _, old, newer, truth = two_maps(stereo)
    settings, counts = PlaceSettings(fix_scale=stereo, least_keyframes=10), Counter()
    closing, maps = LoopClosing(PlaceIndex(None), settings, counts), [old]
    for k in range(old.num_keyframes):
        assert closing.insert(maps, k) is None
    maps.append(newer)
    closing.forget()
    closures = [c for k in range(newer.num_keyframes) if len(maps) == 2 and (c := closing.insert(maps, k)) is not None][
        :1
    ]
    (closure,) = closures
    merged = maps[-1]
    assert counts["maps merged"] == 1
    assert closure.merged_map == 0
    assert closure.keyframe_offset == 16
    assert closure.point_offset == old.num_points
    assert closure.length_factor == pytest.approx(1.0 if stereo else 2.0, rel=0.03)
    assert maps[0].num_keyframes == 0
    assert merged.num_keyframes == 34
    assert merged.covisible(16 + 17)[1][0] > 50
    assert np.count_nonzero(merged.parent < 0) == 1
    worst, _ = position_error(merged, truth, with_scale=not stereo)
    assert worst < 0.06
    assert old.num_keyframes == 16  # the maps that were given stay


def test_the_same_maps_give_the_same_bytes(stereo_round):
    _, original, _ = stereo_round
    results = []
    for _ in range(2):
        sparse_map = copy.deepcopy(original)
        settings = PlaceSettings(fix_scale=True)
        _, loop = recognise([sparse_map], 39, settings)
        correct_loop(sparse_map, loop, settings)
        results.append(sparse_map.T_camera_map.tobytes() + sparse_map.positions.tobytes() + sparse_map.seen.tobytes())
    assert results[0] == results[1]


def test_a_vocabulary_finds_the_same_loop(stereo_round):
    world, original, _ = stereo_round
    sparse_map = copy.deepcopy(original)
    vocabulary = train_vocabulary([world.descriptors[k::4] for k in range(4)], TrainingSettings(branching=8, depth=3))
    for k in range(sparse_map.num_keyframes):
        sparse_map.words[k] = bag_of_words(vocabulary, sparse_map.features(k).descriptors)
    _, loop = recognise([sparse_map], 39, PlaceSettings(fix_scale=True), vocabulary)
    assert loop is not None
    assert loop.place.keyframe in (2, 3, 4)


def test_a_loop_needs_more_keyframes(stereo_round):
    _, original, _ = stereo_round
    assert recognise([original], 39, PlaceSettings(fix_scale=True, least_keyframes=50)) == (None, None)


def test_gravity_refuses_what_it_rules_out():
    settings, up = PlaceSettings(), np.array([0.0, 0.0, 1.0])
    T = true_pose(0.3)
    for turn, fine in (([0, 0, 0.2], True), ([0, 0, 0.4], False), ([0.03, 0, 0.1], False), ([0.004, 0.003, 0.1], True)):
        correction = se3.from_rotation_translation(Rotation.from_rotvec(turn).as_matrix(), [0.2, 0.1, 0.3])
        got = upright_correction(T, T @ correction, up, settings)
        assert (got is not None) == fine
        if got is None:
            continue
        change = inverse(T) @ got
        assert np.allclose(change[:3, :3] @ up, up, atol=1e-12)
        assert Rotation.from_matrix(change[:3, :3]).magnitude() == pytest.approx(turn[2], abs=1e-4)
        assert np.allclose(inverse(got)[:3, 3], inverse(T @ correction)[:3, 3])
    tilted = Rotation.from_rotvec([0.005, 0, 0.7]).as_matrix()
    joint = se3.from_rotation_translation(1.05 * tilted, [1.0, 2, 3])
    righted = upright_joint(joint, up, up, settings)
    assert np.allclose(righted[:3, :3] @ up, 1.05 * up)
    assert np.allclose(righted[:3, 3], [1, 2, 3])
    joint[:3, :3] *= 1.2
    assert upright_joint(joint, up, up, settings) is None
    joint[:3, :3] = Rotation.from_rotvec([0.1, 0, 0]).as_matrix()
    assert upright_joint(joint, up, up, settings) is None


def test_an_inertial_loop_keeps_the_vertical(stereo_round):
    _, original, truth = stereo_round
    sparse_map = copy.deepcopy(original)
    settings = PlaceSettings(fix_scale=True, gravity_bound_rad=0.05)
    _, loop = recognise([sparse_map], 39, settings)
    up = truth[0][:3, 2]  # the first camera is the map
    assert correct_loop(sparse_map, loop, settings, up_map=up).closed
    other = copy.deepcopy(original)
    refused = correct_loop(other, loop, PlaceSettings(fix_scale=True, yaw_bound_rad=0.01), up_map=up)
    assert not refused.closed
    assert "IMU" in refused.reason
    assert np.array_equal(other.T_camera_map, original.T_camera_map)


def test_a_merge_that_gravity_rules_out_is_refused():
    _, old, newer, _ = two_maps()
    settings = PlaceSettings(fix_scale=True, least_keyframes=10)
    merge, _ = recognise([old, newer], newer.num_keyframes - 1, settings)
    up = np.array([0.0, 1.0, 0.0])
    outcome = merge_maps(old, newer, merge, settings, up_old=up, up_newer=up)
    assert outcome.sparse_map is None
    assert "gravity" in outcome.reason


def test_what_counts_as_worse():
    settings = PlaceSettings()
    quiet = Costs(0.02, np.array([0.02, 0.03, np.nan]))
    assert not settings.is_worse(quiet, Costs(0.08, np.array([0.1, 0.2, 0.9])))
    assert settings.is_worse(quiet, Costs(0.1, np.array([0.1, 0.1, 0.1])))
    assert settings.is_worse(quiet, Costs(0.05, np.array([0.02, 0.4, 0.1])))
    loud = Costs(0.3, np.array([0.3, 0.4, 0.2]))
    assert not settings.is_worse(loud, Costs(0.45, np.array([0.5, 0.6, 0.4])))


@pytest.mark.parametrize(("stereo", "focal_error"), [(True, 0.08), (False, -0.06)])
def test_a_poor_calibration_keeps_no_loop_open(stereo, focal_error):
    world = World(stereo=stereo, focal_error=focal_error)
    sparse_map = world.build(ROUND)
    worst, _ = position_error(sparse_map, world.truth, with_scale=not stereo)
    settings = PlaceSettings(fix_scale=stereo)
    _, loop = recognise([sparse_map], 38, settings)
    assert correct_loop(sparse_map, loop, settings).closed
    closed, _ = position_error(sparse_map, world.truth, with_scale=not stereo)
    assert closed < 0.3 * worst


def test_similarities_chain_and_invert():
    rng = np.random.default_rng(0)
    S = np.array(
        [
            se3.from_rotation_translation(s * Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))
            for s in (0.5, 1.0, 3.0)
        ]
    )
    points = rng.normal(size=(3, 3))
    assert np.allclose(apply(inverse(S), apply(S, points)), points)
    assert np.allclose(scale_of(S), [0.5, 1.0, 3.0])
    assert np.allclose(inverse(S) @ S, np.eye(4))
    T = rigid_of(S)
    assert np.allclose(np.linalg.det(T[:, :3, :3]), 1.0)
    one, other = apply(S, points), apply(T, points)
    assert np.allclose(one / one[:, 2:], other / other[:, 2:])  # the same images


@pytest.mark.kernels
def test_shared_points_are_counted_as_by_hand():
    rng = np.random.default_rng(1)
    seen = rng.integers(-1, 30, (6, 12))
    sets = [set(row.tolist()) - {-1} for row in seen]
    wanted = [[len(a & b) * (i != j) for j, b in enumerate(sets[:5])] for i, a in enumerate(sets[:5])]
    assert kernels.shared_points(seen, 5, 30).tolist() == wanted
    assert kernels.shared_points(np.full((2, 3), -1), 2, 0).tolist() == [[0, 0], [0, 0]]


def test_the_essential_graph_holds_together(stereo_round):
    _, original, _ = stereo_round
    sparse_map = copy.deepcopy(original)
    sparse_map.loop_edges.append((3, 30))
    pairs = {tuple(pair) for pair in essential_pairs(sparse_map, shared_points(sparse_map), 100).tolist()}
    assert {(k, k + 1) for k in range(39)} <= pairs
    assert (3, 30) in pairs
    assert (0, 20) not in pairs
    sparse_map.remove_keyframe(20)
    pairs = {tuple(pair) for pair in essential_pairs(sparse_map, shared_points(sparse_map), 10**6).tolist()}
    assert len(pairs) == 39  # a tree of the 39 that live, and the loop
    assert not any(20 in pair for pair in pairs)


def test_a_snapshot_puts_everything_back(stereo_round):
    _, original, _ = stereo_round
    sparse_map = copy.deepcopy(original)
    snapshot = MapSnapshot(sparse_map)
    everything = observations_of(sparse_map, sparse_map.living_keyframes)
    cost = costs(sparse_map, everything).mean
    assert 0.0 < cost < 0.2
    sparse_map.T_camera_map[5, 0, 3] += 0.5
    sparse_map.merge_points(np.array([3]), np.array([9]))
    sparse_map.remove_points(np.array([20, 21]))
    sparse_map.loop_edges.append((0, 1))
    changed = costs(sparse_map, everything)
    assert changed.mean > 1.1 * cost
    assert np.nanargmax(changed.by_keyframe) == 5
    snapshot.restore(sparse_map)
    assert costs(sparse_map, everything).mean == cost
    assert sparse_map.loop_edges == []
    for name in ("seen", "positions", "point_alive", "replaced_by", "found", "T_camera_map"):
        assert np.array_equal(getattr(sparse_map, name), getattr(original, name))
