# SPDX-License-Identifier: MIT
"""Maps become columns and maps again, without what was culled; other cameras are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamcli.errors import CalibrationError, DataError
from slamcli.orbslam3.atlas import sparse_maps, visual_atlas
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.features import Features
from slamcli.vision.matching import feature_grid
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.visual_atlas import COLUMNS, VisualMap

CAMERA = Pinhole(fx=300.0, fy=300.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)
SCALES = 1.2 ** np.arange(4.0)


def small_map(seed, keyframes=4):
    """A map whose keyframes see shifting ranges of 40 points."""
    rng = np.random.default_rng(seed)
    sparse_map = SparseMap(CAMERA, SCALES)
    ids = np.full(24, -1, dtype=np.int64)
    for k in range(keyframes):
        n = 20 + k
        features = Features(
            pixels=rng.uniform(0, 240, (n, 2)), raw_pixels=rng.uniform(0, 240, (n, 2)), octaves=rng.integers(0, 4, n),
            angles=rng.uniform(0, 6, n), responses=rng.random(n), descriptors=rng.integers(0, 256, (n, 32), np.uint8),
            sigmas=rng.uniform(1, 2, n), right=np.where(rng.random(n) < 0.5, np.nan, 3.0), depth=np.full(n, np.nan),
        )  # fmt: skip
        points = np.full(n, -1, dtype=np.int64)
        if k:
            known = rng.permutation(ids[ids >= 0])[: n // 2]
            points[: len(known)] = known
        T = np.eye(4)
        T[0, 3] = -0.2 * k
        frame = Frame(number=3 * k, stamp_ns=10 * k, features=features, grid=feature_grid(features, CAMERA), T_camera_map=T, points=points)  # fmt: skip
        sparse_map.add_keyframe(frame, k - 1)
        fresh = np.flatnonzero(points < 0)[:6]
        made = sparse_map.add_points(rng.normal(size=(len(fresh), 3)), k, fresh, rng.integers(0, 256, (len(fresh), 3), np.uint8))  # fmt: skip
        ids = np.concatenate([ids, made])
    sparse_map.refresh_points(np.arange(sparse_map.num_points))
    sparse_map.loop_edges.append((0, keyframes - 1))
    return sparse_map


def assert_same(one, other):
    for name in COLUMNS:
        if name == "counts":
            assert list(one.counts) == list(other.counts)
        elif name == "loop_edges":
            assert one.loop_edges == other.loop_edges
        else:
            a, b = getattr(one, name), getattr(other, name)
            if COLUMNS[name][0] == "features":
                a, b = (np.concatenate([column[k, :n] for k, n in enumerate(one.counts)]) for column in (a, b))
            assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name


def test_maps_come_back_as_they_were():
    maps = [small_map(1), small_map(2, 3)]
    atlas = visual_atlas([*maps, SparseMap(CAMERA, SCALES)])
    assert [saved.num_keyframes for saved in atlas.maps] == [4, 3]
    again = sparse_maps(atlas, CAMERA, SCALES)
    for one, other in zip(maps, again, strict=True):
        assert_same(one, other)
        assert other.keyframe_alive.all()
        assert np.array_equal(one.covisible(1, 1)[0], other.covisible(1, 1)[0])
        assert np.array_equal(one.count_observations(), other.count_observations())
    assert_same(again[0], sparse_maps(visual_atlas(again), CAMERA, SCALES)[0])


def test_what_was_culled_is_left_out():
    sparse_map = small_map(3)
    poses = sparse_map.T_camera_map.copy()
    sparse_map.remove_points(np.array([2, 5]))
    sparse_map.merge_points(np.array([7]), np.array([8]))
    sparse_map.remove_keyframe(1)
    (again,) = sparse_maps(visual_atlas([sparse_map]), CAMERA, SCALES)
    assert again.num_keyframes == 3
    assert again.num_points == int(sparse_map.point_alive.sum())
    assert np.array_equal(again.T_camera_map, poses[[0, 2, 3]])
    assert again.parent.tolist()[0] == -1
    assert (again.parent[1:] >= 0).all()
    assert (again.parent < 3).all()
    assert again.loop_edges == [(0, 2)]
    assert ((again.reference >= 0) & (again.reference < 3)).all()
    alive = np.flatnonzero(sparse_map.point_alive)
    seen = [{alive[p] for p in row[row >= 0]} for row in again.seen]
    assert seen == [set(row[row >= 0].tolist()) for row in sparse_map.seen[[0, 2, 3]]]


def test_a_map_that_goes_on_grows_as_any_other():
    (again,) = sparse_maps(visual_atlas([small_map(4)]), CAMERA, SCALES)
    before = again.num_points
    features = again.features(2)
    frame = Frame(number=99, stamp_ns=99, features=features, grid=again.grids[2], points=again.seen[2, : len(features)].copy())  # fmt: skip
    keyframe = again.add_keyframe(frame, 3)
    made = again.add_points(np.zeros((2, 3)), keyframe, np.array([0, 1]))
    assert keyframe == 4
    assert made.tolist() == [before, before + 1]
    assert again.num_keyframes == 5


def test_another_camera_or_pyramid_is_refused():
    atlas = visual_atlas([small_map(5)])
    with pytest.raises(CalibrationError, match=r"another camera: fx, fy, cx, cy, baseline 300, .* here 301, "):
        sparse_maps(atlas, replace(CAMERA, fx=301.0), SCALES)
    with pytest.raises(CalibrationError, match=r"here 300, 300, 160, 120 px, 0 m"):
        sparse_maps(atlas, replace(CAMERA, baseline_m=0.0), SCALES)
    with pytest.raises(CalibrationError, match=r"nLevels 4 and scaleFactor 1\.2, here 8 and 1\.2"):
        sparse_maps(atlas, CAMERA, 1.2 ** np.arange(8.0))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("seen", lambda c: c + 1000, "seen refers to points that are not there"),
        ("parent", lambda c: c - 5, "parent refers to keyframes"),
        ("parent", lambda c: np.array([1, 0, 1, 2]), "the spanning tree has a cycle"),
        ("positions", lambda c: c * np.nan, "positions is not finite"),
        ("pixels", lambda c: c[:-1], r"pixels is float64 \(85, 2\), not float64 \(86, 2\)"),
        ("descriptors", lambda c: c.astype(np.int64), "descriptors is int64"),
        ("counts", lambda c: -c, "the numbers of features are none"),
        ("sigmas", None, "sigmas missing"),
    ],
)
def test_columns_that_do_not_fit_are_refused(name, change, message):
    columns = dict(visual_atlas([small_map(6)]).maps[0].columns)
    if change is None:
        del columns[name]
    else:
        columns[name] = change(columns[name])
    with pytest.raises(DataError, match=message):
        VisualMap(columns=columns)
