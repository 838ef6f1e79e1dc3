# SPDX-License-Identifier: MIT
"""From images to the strongest key points with depth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from slamcli.measurements import CameraModel, CameraRig
from slamcli.rtabmap.feature_extraction import FeatureExtractor
from slamcli.rtabmap.feature_settings import Detector, FeatureSettings
from slamcli.vision.features import Features
from slamcli.vision.preparation import Preparation, PreparedFrame
from slamcli.vision.row_matching import RowMatchSettings

WIDTH, HEIGHT, SHIFT = 240, 180, 12
DETECTORS = list(Detector)


def model(**changes: Any) -> CameraModel:
    K = np.array([[200.0, 0.0, 119.5], [0.0, 200.0, 89.5], [0.0, 0.0, 1.0]])
    values: dict[str, Any] = {
        "stamp_ns": 0, "frame_id": "camera", "width": WIDTH, "height": HEIGHT, "distortion_model": "", "distortion": np.zeros(0),
        "intrinsics": K, "rectification": np.eye(3), "projection": np.column_stack([K, np.zeros(3)]),
    }  # fmt: skip
    return CameraModel(**{**values, **changes})


def rgbd() -> Preparation:
    T_base_camera = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 1], [0, 0, 0, 1]])
    return Preparation(CameraRig(mode="rgbd", main=model(), T_base_main=T_base_camera))


def stereo() -> Preparation:
    right = model().projection.copy()
    right[0, 3] = -200.0 * 0.1
    return Preparation(CameraRig(mode="stereo", main=model(), right=model(projection=right)))


def image() -> np.ndarray:
    grey = np.full((HEIGHT, WIDTH), 60, dtype=np.uint8)
    rng = np.random.default_rng(7)
    for row in range(8, HEIGHT - 8, 18):
        for column in range(8, WIDTH - 8, 18):
            grey[row : row + 9, column : column + 9] = rng.integers(90, 250)
            grey[row + 2 : row + 5, column + 2 : column + 6] = rng.integers(0, 60)
    return np.asarray(np.clip(grey + rng.normal(0.0, 6.0, grey.shape), 0, 255), dtype=np.uint8)


def extract(preparation: Preparation, settings: FeatureSettings, depth: np.ndarray | None = None) -> Features:
    grey = image()
    right = np.roll(grey, -SHIFT, axis=1) if preparation.rig.mode == "stereo" else None
    return FeatureExtractor(settings, preparation).extract(
        PreparedFrame(stamp_ns=0, grey=grey, depth=depth, right=right)
    )


@pytest.mark.parametrize("detector", DETECTORS)
def test_key_points_come_strongest_first_with_their_depth(detector: Detector) -> None:
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    depth[:, : WIDTH // 2] = 0.0
    features = extract(rgbd(), FeatureSettings(detector=detector, max_features=60), depth)
    assert 20 <= len(features) <= 60
    assert (np.diff(features.responses) <= 0).all()
    assert features.descriptors.shape == (len(features), 32)
    np.testing.assert_allclose(features.depth, 2.0)
    np.testing.assert_allclose(features.pixels[:, 0] - features.right, 200.0 * 0.08 * 3.0 / 2.0)
    assert features.pixels[:, 0].min() > WIDTH // 2 - 2


@pytest.mark.parametrize("detector", DETECTORS)
def test_depth_is_measured_in_the_right_image(detector: Detector) -> None:
    settings = FeatureSettings(detector=detector, max_features=80, rows=RowMatchSettings(max_disparity=17.0))
    features = extract(stereo(), settings)
    known = np.isfinite(features.depth)
    assert known.mean() > 0.5
    disparities = (features.pixels[:, 0] - features.right)[known]
    assert np.median(np.abs(disparities - SHIFT)) < 0.1
    assert np.median(features.depth[known]) == pytest.approx(200.0 * 0.1 / SHIFT, rel=0.02)


def test_without_the_mask_key_points_without_depth_stay() -> None:
    depth = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
    features = extract(rgbd(), FeatureSettings(depth_as_mask=False), depth)
    assert len(features) > 30
    assert np.isnan(features.depth).all()


def test_what_is_too_near_or_too_far_is_dropped() -> None:
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    depth[:60], depth[120:] = 0.4, 9.0
    for masked in (True, False):
        features = extract(rgbd(), FeatureSettings(min_depth_m=0.5, max_depth_m=5.0, depth_as_mask=masked), depth)
        assert len(features) > 10
        np.testing.assert_allclose(features.depth, 2.0)


def test_the_floor_can_be_masked() -> None:
    """The camera looks ahead from 1 m above the floor: what lies 2 m away and lower than 0.5 m is below the middle row by 50 pixels."""
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    features = extract(rgbd(), FeatureSettings(floor_threshold_m=0.5), depth)
    assert len(features) > 20
    assert features.pixels[:, 1].max() <= 89.5 + 50.0 + 1.5


def test_the_region_of_interest_is_cut_out() -> None:
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    features = extract(rgbd(), FeatureSettings(roi_ratios=(0.25, 0.0, 0.0, 0.5)), depth)
    assert len(features) > 10
    assert features.pixels[:, 0].min() >= 59.0
    assert features.pixels[:, 1].max() <= 91.0


@pytest.mark.parametrize("spread", [False, True])
def test_each_cell_of_the_grid_gives_its_share(spread: bool) -> None:
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    settings = FeatureSettings(max_features=40, grid_rows=2, grid_columns=2, spread=spread, detector=Detector.GFTT_ORB)
    features = extract(rgbd(), settings, depth)
    quarter = (features.pixels[:, 0] > WIDTH / 2) * 2 + (features.pixels[:, 1] > HEIGHT / 2)
    assert np.bincount(quarter, minlength=4).max() <= 10
    assert len(features) >= 30
    assert (np.diff(features.responses) <= 0).all()


def test_a_decimated_image_gives_pixels_of_the_whole_one() -> None:
    depth = np.full((HEIGHT, WIDTH), 2.0, dtype=np.float32)
    full = extract(rgbd(), FeatureSettings(detector=Detector.GFTT_ORB, max_features=0), depth)
    half = extract(rgbd(), FeatureSettings(detector=Detector.GFTT_ORB, max_features=0, decimation=2), depth)
    assert len(half) > 20
    apart = np.linalg.norm(half.pixels[:, None] - full.pixels[None], axis=2).min(axis=1)
    assert np.median(apart) < 3.0
    assert half.sigmas[0] == 2.0 * full.sigmas[0]


def test_an_even_image_gives_none() -> None:
    even = PreparedFrame(
        stamp_ns=0, grey=np.full((HEIGHT, WIDTH), 90, dtype=np.uint8), depth=np.ones((HEIGHT, WIDTH), dtype=np.float32)
    )
    for detector in DETECTORS:
        assert len(FeatureExtractor(FeatureSettings(detector=detector), rgbd()).extract(even)) == 0
