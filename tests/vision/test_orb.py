# SPDX-License-Identifier: MIT
"""ORB against a naive FAST, OpenCV's descriptors, and moved images."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _corner_kernels, _orb_kernels
from slamcli.vision.orb import OrbSettings, extract_orb

CIRCLE = [(0, 3), (1, 3), (2, 2), (3, 1), (3, 0), (3, -1), (2, -2), (1, -3)]
CIRCLE += [(-x, -y) for x, y in CIRCLE]


def texture(height: int, width: int, seed: int = 0) -> NDArray[np.uint8]:
    """Bright and dark rectangles of all sizes, with a little noise."""
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 128, dtype=np.uint8)
    for _ in range(height * width // 150):
        x, y = rng.integers(0, width), rng.integers(0, height)
        w, h = rng.integers(3, 30, 2)
        image[y : y + h, x : x + w] = rng.integers(0, 256)
    noise = rng.integers(-4, 5, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def naive_scores(image: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The least threshold at which a pixel is no FAST-9 corner, 0 within 3 pixels of the edge."""
    grey = image.astype(np.int64)
    scores = np.zeros(image.shape, dtype=np.int64)
    for y in range(3, image.shape[0] - 3):
        for x in range(3, image.shape[1] - 3):
            ring = np.array([grey[y + dy, x + dx] - grey[y, x] for dx, dy in CIRCLE * 2])
            arcs = [ring[start : start + 9] for start in range(16)]
            scores[y, x] = max(0, *(arc.min() for arc in arcs), *(-arc.max() for arc in arcs))
    return scores


@pytest.mark.kernels
def test_corners_are_the_maxima_of_the_naive_scores() -> None:
    image = texture(34, 41)
    scores = naive_scores(image)
    expected = [
        (x, y, scores[y, x])
        for y in range(5, 29)
        for x in range(5, 36)
        if scores[y, x] > 7 and (np.delete(scores[y - 1 : y + 2, x - 1 : x + 2].ravel(), 4) < scores[y, x]).all()
    ]
    assert len(expected) > 10
    columns, rows, found, peaks = _corner_kernels.corners(image, 5, np.uint8(7))
    assert list(zip(columns, rows, found, strict=True)) == expected
    y, x = np.mgrid[-1:2, -1:2].reshape(2, 9).astype(np.float64)
    design = np.column_stack([np.ones(9), x, y, x * x, y * y, x * y])
    for (column, row, _), peak in zip(expected, peaks, strict=True):
        fit = np.linalg.lstsq(design, scores[row - 1 : row + 2, column - 1 : column + 2].ravel().astype(float))[0]
        hessian = np.array([[2.0 * fit[3], fit[5]], [fit[5], 2.0 * fit[4]]])
        best = -np.linalg.solve(hessian, fit[1:3]) if np.linalg.eigvalsh(hessian).max() < -1e-9 else np.zeros(2)
        np.testing.assert_allclose(peak, np.clip(best, -0.7, 0.7), atol=1e-9)
    assert (np.abs(peaks) > 0.05).any(axis=1).mean() > 0.5


@pytest.mark.kernels
@pytest.mark.parametrize("shape", [(0, 0), (8, 8), (9, 9), (8, 40), (40, 8)])
def test_tiny_images_have_no_corners(shape: tuple[int, int]) -> None:
    columns, rows, found, peaks = _corner_kernels.corners(np.zeros(shape, np.uint8), 4, np.uint8(7))
    assert len(columns) == len(rows) == len(found) == len(peaks) == 0


@pytest.mark.kernels
def test_weak_corners_count_only_in_cells_without_a_strong_one() -> None:
    columns, rows = np.array([20, 30, 60, 61]), np.array([20, 21, 20, 30])
    scores = np.array([30, 10, 10, 20], dtype=np.uint8)
    kept = _corner_kernels.strong_in_cells(columns, rows, scores, 19, 108, 73, 35, np.uint8(20))
    assert kept.tolist() == [True, False, True, True]


@pytest.mark.kernels
@pytest.mark.parametrize("quota", [0, 1, 2, 7, 30, 60, 99, 100, 500])
def test_the_quad_tree_gives_as_many_as_asked_for(quota: int) -> None:
    rng = np.random.default_rng(1)
    places = rng.choice(90 * 40, 100, replace=False)
    columns, rows = places % 90 + 5, places // 90 + 3
    scores = rng.integers(1, 255, 100).astype(np.uint8)
    kept = _corner_kernels.distribute(columns, rows, scores, 5, 3, 95, 43, quota)
    assert len(kept) == min(quota, 100)
    assert (np.diff(kept) > 0).all()
    if quota == 1:
        assert scores[kept[0]] == max(scores[columns < 50].max(), scores[columns >= 50].max())


@pytest.mark.kernels
def test_the_quad_tree_spreads_corners() -> None:
    # 60 strong corners crowd a corner of the image, one weak one stands in each other quarter.
    crowd = np.arange(60)
    columns = np.concatenate([crowd % 10, [60, 10, 60]])
    rows = np.concatenate([crowd // 10, [10, 60, 60]])
    scores = np.concatenate([np.full(60, 200), [10, 10, 10]]).astype(np.uint8)
    scores[33] = 250
    kept = _corner_kernels.distribute(columns, rows, scores, 0, 0, 80, 80, 4)
    assert kept.tolist() == [33, 60, 61, 62]


@pytest.mark.kernels
def test_angles_point_to_the_bright_side() -> None:
    image = np.zeros((41, 41), dtype=np.uint8)
    image[20:, :] = 200
    half_widths = np.array([3, 3, 2, 1])
    image[20, :] = 0
    angles = _orb_kernels.centroid_angles(image, np.array([20, 20]), np.array([20, 4]), half_widths)
    assert angles == pytest.approx([math.pi / 2, 0.0], abs=1e-12)


@pytest.mark.kernels
def test_angles_agree_with_moments() -> None:
    image = texture(30, 30)
    half_widths = np.array([4, 4, 3, 2, 1])
    v, u = np.mgrid[-4:5, -4:5]
    disc = np.abs(u) <= half_widths[np.abs(v)]
    patch = image[11:20, 8:17].astype(np.float64)
    expected = math.atan2((patch * disc * v).sum(), (patch * disc * u).sum()) % (2 * math.pi)
    angles = _orb_kernels.centroid_angles(image, np.array([12]), np.array([15]), half_widths)
    assert angles[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.kernels
def test_descriptors_equal_those_of_opencv() -> None:
    image = texture(90, 110)
    features = extract_orb(image, OrbSettings(num_features=60, num_levels=1, subpixel=False)).features
    assert len(features) == 60
    degrees = np.degrees(features.angles)
    points = [
        cv2.KeyPoint(x, y, 31.0, angle, 1.0, 0) for (x, y), angle in zip(features.pixels, degrees.tolist(), strict=True)
    ]
    detector = cv2.ORB_create(nfeatures=100, nlevels=1, edgeThreshold=19, patchSize=31)
    kept, expected = detector.compute(image, points)
    assert len(kept) == 60
    np.testing.assert_array_equal(features.descriptors, expected)


def test_the_quota_is_filled_by_shares_of_the_levels() -> None:
    settings = OrbSettings(num_features=500)
    extraction = extract_orb(texture(480, 640), settings)
    features = extraction.features
    assert len(features) == 500
    assert len(extraction.pyramid) == 8
    assert extraction.pyramid[7].shape == (134, 179)
    counts = np.bincount(features.octaves)
    assert counts[:3].tolist() == [109, 90, 75]
    np.testing.assert_allclose(features.sigmas, 1.2**features.octaves)
    assert np.isnan(features.depth).all()
    assert np.isnan(features.right).all()
    quarters = np.bincount((features.pixels[:, 0] > 320) * 2 + (features.pixels[:, 1] > 240), minlength=4)
    assert quarters.min() > 90


def test_other_levels_give_what_one_lacks() -> None:
    image = texture(120, 120)
    available = extract_orb(image, OrbSettings(num_features=5000)).features
    assert len(available) < 5000
    number = len(available) - 1
    assert len(extract_orb(image, OrbSettings(num_features=number)).features) == number


def test_levels_agree_on_the_place_of_a_corner() -> None:
    image = np.full((400, 400), 40, dtype=np.uint8)
    for y in range(50, 350, 60):
        for x in range(50, 350, 60):
            image[y : y + 25, x : x + 25] = 220
    features = extract_orb(image, OrbSettings(num_features=2000)).features
    corner = np.abs(features.pixels - [50.0, 50.0]).max(axis=1) < 8.0
    assert features.octaves[corner].max() >= 4
    # The corner itself lies half a pixel before the first bright pixel; FAST fires inside it, by about a pixel of its level.
    assert np.abs(features.pixels[corner] - 50.0).max() < 1.5 * features.sigmas[corner].max()


def test_key_points_between_pixels_follow_a_moved_image() -> None:
    # The same scene, drawn four times as fine and averaged, once moved by half a pixel.
    fine = cv2.GaussianBlur(texture(480, 480, seed=5), (0, 0), 3.0)
    still, moved = (
        cv2.resize(fine[y : y + 400, y : y + 400], (100, 100), interpolation=cv2.INTER_AREA) for y in (20, 22)
    )
    errors = {}
    for subpixel in (False, True):
        settings = OrbSettings(num_features=80, num_levels=1, subpixel=subpixel)
        one, two = (extract_orb(image, settings).features.pixels for image in (still, moved))
        nearest = np.linalg.norm(one[:, None] - 0.5 - two[None], axis=2).min(axis=1)
        errors[subpixel] = np.median(nearest)
    assert errors[False] == pytest.approx(np.sqrt(0.5))
    assert errors[True] < 0.4


def test_a_mask_keeps_key_points_away() -> None:
    image = texture(200, 200)
    mask = np.zeros((200, 200), dtype=np.uint8)
    mask[:, 100:] = 1
    features = extract_orb(image, OrbSettings(num_features=100), mask).features
    assert len(features) == 100
    assert features.pixels[:, 0].max() < 101.0


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((120, 160), np.uint8),
        np.full((120, 160), 200, np.uint8),
        texture(30, 200),
        texture(5, 5),
        texture(0, 0),
    ],
)
def test_images_without_corners_give_nothing(image: NDArray[np.uint8]) -> None:
    features = extract_orb(image).features
    assert len(features) == 0
    assert features.descriptors.shape == (0, 32)
    assert features.pixels.shape == (0, 2)


def test_a_turned_image_keeps_its_descriptors() -> None:
    image = texture(161, 161, seed=3)
    settings = OrbSettings(num_features=100, num_levels=1, subpixel=False)
    one = extract_orb(image, settings).features
    two = extract_orb(np.ascontiguousarray(np.rot90(image)), settings).features
    places = {(x, y): row for row, (x, y) in enumerate(two.pixels.tolist())}
    pairs = [(i, places[y, 160.0 - x]) for i, (x, y) in enumerate(one.pixels.tolist()) if (y, 160.0 - x) in places]
    assert len(pairs) > 60
    first, second = np.array(pairs).T
    bits = np.unpackbits(one.descriptors[first] ^ two.descriptors[second], axis=1).sum(axis=1)
    assert bits.max() <= 12


def test_views_and_images_that_cannot_be_written_give_the_same() -> None:
    image = texture(150, 160)
    locked = image.copy()
    locked.flags.writeable = False
    settings = OrbSettings(num_features=100)
    expected = extract_orb(image, settings).features
    wide = np.repeat(image, 2, axis=1)
    compiled = len(_corner_kernels.corners.signatures) if hasattr(_corner_kernels.corners, "signatures") else 0
    for other in (locked, wide[:, ::2]):
        found = extract_orb(other, settings).features
        np.testing.assert_array_equal(found.descriptors, expected.descriptors)
        np.testing.assert_array_equal(found.pixels, expected.pixels)
    if compiled:
        assert len(_corner_kernels.corners.signatures) == compiled


def test_wrong_input_is_refused() -> None:
    with pytest.raises(DataError, match="not uint8"):
        extract_orb(np.zeros((50, 50, 3), np.uint8))
    with pytest.raises(DataError, match="mask"):
        extract_orb(np.zeros((50, 50), np.uint8), mask=np.zeros((5, 5)))
    with pytest.raises(DataError, match="scale above 1"):
        OrbSettings(scale_factor=1.0)
    with pytest.raises(DataError, match="thresholds"):
        OrbSettings(initial_threshold=5)
