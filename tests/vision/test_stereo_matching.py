# SPDX-License-Identifier: MIT
"""Stereo matching against naive twins, smooth pictures of known shift, and a street."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _stereo_kernels as kernels
from slamcli.vision.matching import feature_grid, search_by_projection
from slamcli.vision.orb import OrbSettings, extract_orb
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.stereo_matching import match_stereo

DATA = (
    Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
    / "visual/kitti06"
)
WAVES = np.random.default_rng(0).uniform([0.15, -0.5, 0.0, 5.0], [0.6, 0.5, 6.3, 14.0], (12, 4))


def smooth(height: int, width: int, shift: float, gain: float = 1.0, offset: float = 0.0) -> NDArray[np.uint8]:
    """A picture of waves, moved to the left by `shift` pixels."""
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    x += shift
    total = sum(a * np.sin(fx * x + fy * y + phase) for fx, fy, phase, a in WAVES)
    return np.clip(np.rint(128.0 + gain * total + offset), 0, 255).astype(np.uint8)


def blocks(height: int, width: int, seed: int = 0) -> NDArray[np.uint8]:
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 128, dtype=np.uint8)
    for _ in range(height * width // 150):
        x, y = rng.integers(0, width), rng.integers(0, height)
        w, h = rng.integers(3, 30, 2)
        image[y : y + h, x : x + w] = rng.integers(0, 256)
    return cv2.GaussianBlur(image, (0, 0), 0.7)


@pytest.mark.kernels
def test_row_bands_equal_their_naive_twin() -> None:
    rng = np.random.default_rng(1)
    pixels, pixels_right = (rng.uniform(0.0, 60.0, (50, 2)) for _ in range(2))
    octaves, octaves_right = (rng.integers(0, 4, 50) for _ in range(2))
    bits, bits_right = (rng.integers(0, 256, (50, 32), dtype=np.uint8) for _ in range(2))
    sigmas = 1.2**octaves_right
    found = kernels.in_row_bands(
        pixels,
        octaves,
        bits.view(np.uint64),
        pixels_right,
        octaves_right,
        sigmas,
        bits_right.view(np.uint64),
        60,
        2.0,
        30.0,
        125,
    )
    distances = np.unpackbits(bits[:, None] ^ bits_right[None], axis=2).sum(axis=2).astype(np.int64)
    disparity = pixels[:, None, 0] - pixels_right[None, :, 0]
    bad = (
        (np.abs(pixels[:, None, 1] - pixels_right[None, :, 1]) > 2.0 * sigmas) | (disparity < 0.0) | (disparity > 30.0)
    )
    bad |= (np.abs(octaves[:, None] - octaves_right) > 1) | (distances > 125)
    distances[bad] = 999
    least = distances.min(axis=1)
    np.testing.assert_array_equal(found >= 0, least < 999)
    assert (found >= 0).sum() > 10
    assert (distances[np.arange(50), found][found >= 0] == least[found >= 0]).all()
    none = kernels.in_row_bands(
        pixels,
        octaves,
        bits.view(np.uint64),
        pixels[:0],
        octaves[:0],
        sigmas[:0],
        bits[:0].view(np.uint64),
        60,
        2.0,
        30.0,
        125,
    )
    assert (none == -1).all()


def naive_window(left: NDArray[np.uint8], right: NDArray[np.uint8], x: int, y: int, start: int) -> float:
    one = left[y - 5 : y + 6, x - 5 : x + 6].astype(np.int64)
    sums = []
    for place in range(start - 4, start + 5):
        two = right[y - 5 : y + 6, place - 5 : place + 6].astype(np.int64)
        sums.append(int(np.abs(one - two - round((one - two).sum() / 121)).sum()))
    least = int(np.argmin(sums))
    if least in (0, 8):
        return float("nan")
    before, here, after = sums[least - 1 : least + 2]
    return start + least - 4 + 0.5 * (before - after) / (before + after - 2 * here)


@pytest.mark.kernels
def test_the_window_search_equals_its_naive_twin() -> None:
    left, right = smooth(40, 60, 0.0), smooth(40, 60, 3.3, offset=9.0)
    columns, rows = np.array([20, 25, 30, 35, 2, 30, 30, 50]), np.array([20, 8, 31, 15, 20, 3, 20, 20])
    starts = np.array([16, 23, 25, 26, 10, 26, 5, 51])
    found = kernels.window_search(left, right, columns, rows, starts, 5, 4)
    expected = [naive_window(left, right, x, y, s) for x, y, s in zip(columns[:4], rows[:4], starts[:4], strict=True)]
    np.testing.assert_allclose(found[:4], expected, rtol=0.0, atol=1e-12)
    assert abs(found[0] - 16.7) < 0.4
    assert np.isnan(found[4:]).all()


@pytest.mark.kernels
@pytest.mark.parametrize("shift", [0.1, 0.5, 0.8, 2.0, 3.37])
def test_the_refined_place_is_that_of_the_shift(shift: float) -> None:
    left, right = smooth(40, 70, 0.0), smooth(40, 70, shift, gain=0.7, offset=-20.0)
    columns, rows = np.array([25, 30, 40, 45]), np.array([20, 12, 25, 20])
    places = columns - shift + np.array([0.0, 0.7, -0.8, 1.4])
    halves, reaches = np.array([5, 6, 7, 5]), np.full(4, 1.5)
    found, correlations = kernels.refine(left, right, columns, rows, places, halves, reaches)
    np.testing.assert_allclose(found, columns - shift, rtol=0.0, atol=0.03)
    assert correlations.min() > 0.995
    far, _ = kernels.refine(left, right, columns, rows, places + 1.6, halves, np.full(4, 0.1))
    assert np.isnan(far).all()


@pytest.mark.kernels
def test_nothing_to_hold_on_to_gives_nothing() -> None:
    flat, one, five = np.full((40, 60), 90, np.uint8), np.array([30]), np.array([5])
    found, _ = kernels.refine(flat, flat, one, np.array([20]), np.array([25.0]), five, np.ones(1))
    assert np.isnan(found).all()
    picture = smooth(40, 60, 0.0)
    for column, row, place in [(30, 3, 25.0), (3, 20, 2.0), (30, 20, 3.0), (30, 20, 57.0), (30, 20, np.nan)]:
        found, _ = kernels.refine(
            picture, picture, np.array([column]), np.array([row]), np.array([place]), five, np.ones(1)
        )
        assert np.isnan(found).all()


CAMERA = Pinhole(fx=400.0, fy=400.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)


def test_a_fronto_parallel_plane_has_one_depth() -> None:
    texture = blocks(240, 360)
    left, right = (np.ascontiguousarray(texture[:, start : start + 320]) for start in (0, 8))
    settings = OrbSettings(num_features=400, num_levels=4)
    one, two = extract_orb(left, settings), extract_orb(right, settings)
    columns, depth = match_stereo(one, two, CAMERA)
    known = np.isfinite(depth)
    assert known.mean() > 0.7
    np.testing.assert_array_equal(known, np.isfinite(columns))
    disparity = one.features.pixels[known, 0] - columns[known]
    assert np.abs(disparity - 8.0).max() < 0.05
    np.testing.assert_allclose(depth[known], 40.0 / disparity)
    # Seen the other way round, the plane would lie behind the cameras.
    assert np.isfinite(match_stereo(two, one, CAMERA)[1]).mean() < 0.05


def test_images_without_corners_have_no_depth() -> None:
    blank = extract_orb(np.zeros((240, 320), np.uint8))
    full = extract_orb(blocks(240, 320))
    assert len(match_stereo(blank, full, CAMERA)[0]) == 0
    assert np.isnan(match_stereo(full, blank, CAMERA)[1]).all()


def test_wrong_pairs_are_refused() -> None:
    one = extract_orb(blocks(120, 160))
    with pytest.raises(DataError, match="baseline"):
        match_stereo(one, one, replace(CAMERA, baseline_m=0.0))
    with pytest.raises(DataError, match="one size"):
        match_stereo(one, extract_orb(blocks(100, 160)), CAMERA)


@pytest.mark.real_data
@pytest.mark.skipif(not DATA.exists(), reason=f"no {DATA}: set SLAMCLI_TEST_DATA")
def test_depths_of_a_street_agree_with_the_next_frame() -> None:
    projection = np.array((DATA / "calib.txt").read_text().splitlines()[1].split()[1:], dtype=np.float64).reshape(3, 4)
    f = float(projection[0, 0])
    camera = Pinhole(
        fx=f, fy=f, cx=float(projection[0, 2]), cy=float(projection[1, 2]), width=1226, height=370,
        baseline_m=float(-projection[0, 3] / f),
    )  # fmt: skip
    poses = np.loadtxt(DATA / "poses.txt").reshape(-1, 3, 4)
    frames = []
    for k in (10, 11):
        names = (str(DATA / f"image_{side}" / f"{k:06d}.png") for side in (0, 1))
        left, right = (extract_orb(cv2.imread(n, cv2.IMREAD_GRAYSCALE), OrbSettings(num_features=2000)) for n in names)
        columns, depth = match_stereo(left, right, camera)
        frames.append(replace(left.features, right=columns, depth=depth))
    one, two = frames
    assert min(np.isfinite(frame.depth).sum() for frame in frames) > 850
    seen = np.flatnonzero(one.depth < 60.0)
    points = camera.back_project(one.pixels[seen], one.depth[seen]) @ poses[10][:, :3].T + poses[10][:, 3]
    points = (points - poses[11][:, 3]) @ poses[11][:, :3]
    seen, points = seen[points[:, 2] > 1.0], points[points[:, 2] > 1.0]
    octaves = one.octaves[seen]
    found = search_by_projection(
        camera.project(points), 4.0 * one.sigmas[seen], octaves - 1, octaves + 1, one.descriptors[seen], two,
        feature_grid(two, camera), np.isfinite(two.depth), max_distance=50, angles=one.angles[seen],
    )  # fmt: skip
    errors = (two.pixels[found, 0] - two.right[found] - camera.bf / points[:, 2])[found >= 0]
    assert len(errors) > 180
    assert np.median(np.abs(errors)) < 0.15
