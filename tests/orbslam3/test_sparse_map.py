# SPDX-License-Identifier: MIT
"""The map and its kernels against plain Python twins: who sees what, merging, culling, what points look like."""

import numpy as np
import pytest

from slamcli.orbslam3 import _map_kernels as kernels
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap, neighbours_in
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)
SCALES = 1.2 ** np.arange(8.0)


def features(rng, n):
    return Features(
        pixels=rng.uniform(0, 240, (n, 2)), raw_pixels=np.zeros((n, 2)), octaves=rng.integers(0, 8, n), angles=rng.uniform(0, 6, n),
        responses=np.ones(n), descriptors=rng.integers(0, 256, (n, 32), dtype=np.uint8), sigmas=np.ones(n), right=np.full(n, np.nan),
        depth=np.full(n, np.nan),
    )  # fmt: skip


def keyframe(sparse_map, rng, n, parent=-1, x=0.0, points=None):
    T = np.eye(4)
    T[0, 3] = -x
    points = np.full(n, -1, dtype=np.int64) if points is None else np.asarray(points, dtype=np.int64)
    frame = Frame(
        number=sparse_map.num_keyframes, stamp_ns=7, features=features(rng, n), grid=None, T_camera_map=T, points=points
    )
    return sparse_map.add_keyframe(frame, parent)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_what_keyframes_see_is_marked_as_by_hand(rng):
    seen = rng.integers(-1, 12, (6, 9))
    chosen = kernels.mark_seen(seen, np.array([1, 4]), 12)
    assert np.flatnonzero(chosen).tolist() == sorted({p for k in (1, 4) for p in seen[k].tolist()} - {-1})


def test_merging_follows_chains_and_frames_follow_merging(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    first = keyframe(sparse_map, rng, 5)
    ids = sparse_map.add_points(rng.normal(size=(4, 3)), first, np.arange(4))
    keyframe(sparse_map, rng, 7, parent=first, points=[-1, 3, 2, 1, 0, -1, -1])
    sparse_map.merge_points(ids[[0, 1]], ids[[1, 2]])
    assert sparse_map.point_alive.tolist() == [False, False, True, True]
    assert sparse_map.seen[0, :4].tolist().count(2) == 1
    assert sparse_map.resolved(np.array([0, 1, 2, 3, -1])).tolist() == [2, 2, 2, 3, -1]
    assert sparse_map.found[2] == 3
    sparse_map.remove_points(ids[2:3])
    assert sparse_map.resolved(np.array([0, 3])).tolist() == [-1, 3]
    sparse_map.merge_points(ids[[0, 3]], ids[[3, 2]])  # neither with a point that is gone
    assert sparse_map.point_alive.tolist() == [False, False, False, True]
    assert sparse_map.found[3] == 1


def test_covisibility_is_symmetric_and_sorted_by_weight(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    keyframe(sparse_map, rng, 60)
    ids = sparse_map.add_points(rng.normal(size=(50, 3)), 0, np.arange(50))
    keyframe(sparse_map, rng, 60, 0, points=np.r_[ids[:20], [-1] * 40])
    keyframe(sparse_map, rng, 60, 1, points=np.r_[ids[10:40], [-1] * 30])
    assert [part.tolist() for part in sparse_map.covisible(0)] == [[2, 1], [30, 20]]
    assert [part.tolist() for part in sparse_map.covisible(1)] == [[0], [20]]  # 10 shared with the other: too few
    shared = sparse_map.all_shared()
    assert shared.tolist() == [[0, 20, 30], [20, 0, 10], [30, 10, 0]]
    assert [neighbours_in(shared, k).tolist() for k in range(3)] == [
        sparse_map.covisible(k)[0].tolist() for k in range(3)
    ]
    assert [part.tolist() for part in sparse_map.covisible(1, 10)] == [[0, 2], [20, 10]]


def test_a_culled_keyframe_hangs_on_its_parent(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    for k in range(3):
        keyframe(sparse_map, rng, 4, k - 1, x=float(k))
    before = sparse_map.T_camera_map[1].copy()
    sparse_map.remove_keyframe(1)
    assert sparse_map.parent.tolist() == [-1, 0, 0]
    assert sparse_map.living_keyframes.tolist() == [0, 2]
    np.testing.assert_allclose(sparse_map.poses_of_all()[1], before)
    sparse_map.T_camera_map[0, 1, 3] = 5.0  # the parent moves, and takes it along
    assert sparse_map.pose_of(1)[1, 3] == 5.0


def test_points_know_from_where_they_can_be_seen(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    keyframe(sparse_map, rng, 3)
    ids = sparse_map.add_points(np.array([[0.0, 0.0, 2.0]]), 0, np.array([1]))
    keyframe(sparse_map, rng, 3, 0, x=2.0, points=[ids[0], -1, -1])
    sparse_map.refresh_points(ids)
    expected = np.array([0, 0, 1.0]) + np.array([-1, 0, 1]) / np.sqrt(2)
    np.testing.assert_allclose(sparse_map.normals[0], expected / np.linalg.norm(expected))
    octave = sparse_map.octaves[0, 1]
    assert sparse_map.far[0] == pytest.approx(2.0 * SCALES[octave])
    assert sparse_map.near[0] == pytest.approx(sparse_map.far[0] / SCALES[-1])


def test_the_descriptor_is_nearest_to_the_others(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    base = rng.integers(0, 256, 32, dtype=np.uint8)
    for k in range(5):
        keyframe(sparse_map, rng, 1, k - 1, points=[-1 if k == 0 else 0])
        noisy = base.copy()
        noisy[:k] ^= 0xFF
        sparse_map.key_descriptors[k, 0] = noisy
        if k == 0:
            sparse_map.add_points(np.array([[0, 0, 3.0]]), 0, np.array([0]))
    sparse_map.refresh_points(np.array([0]))
    bits = np.unpackbits(sparse_map.key_descriptors[:, 0], axis=1).astype(int)
    apart = np.abs(bits[:, None] - bits[None]).sum(axis=2)
    medians = [np.sort(row)[2] for row in apart]
    np.testing.assert_array_equal(sparse_map.descriptors[0], sparse_map.key_descriptors[int(np.argmin(medians)), 0])


def test_redundancy_counts_what_three_others_see_as_finely(rng):
    sparse_map = SparseMap(CAMERA, SCALES)
    keyframe(sparse_map, rng, 2)
    ids = sparse_map.add_points(rng.normal(size=(2, 3)), 0, np.arange(2))
    for k in range(1, 4):
        keyframe(sparse_map, rng, 2, k - 1, points=[ids[0], ids[1] if k < 3 else -1])
    sparse_map.octaves[:] = 2
    close = np.ones(2, dtype=bool)
    assert sparse_map.redundancy(0, close, sparse_map.count_observations(), 3, sparse_map.sightings(ids)) == 0.5
    sparse_map.octaves[2, 0] = 4  # seen too coarsely there
    assert sparse_map.redundancy(0, close, sparse_map.count_observations(), 3, sparse_map.sightings(ids)) == 0.0
