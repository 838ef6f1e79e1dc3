# SPDX-License-Identifier: MIT
"""Lens models against OpenCV, and there and back."""

import cv2
import numpy as np
import pytest

from slamcli.errors import CalibrationError
from slamcli.measurements import CameraModel
from slamcli.vision.lens import Lens, lens_of

K = np.array([[380.0, 0.0, 322.0], [0.0, 376.0, 241.0], [0.0, 0.0, 1.0]])
MODELS = {
    "none": [],
    "plumb_bob": [-0.2834, 0.0740, 0.00019, 1.76e-05],
    "plumb_bob5": [0.2624, -0.9531, -0.0054, 0.0026, 1.1633],
    "rational_polynomial": [0.5, -2.6, 0.0004, -0.0003, 1.5, 0.38, -2.43, 1.43],
    "equidistant": [0.0034823894, 0.00071503, -0.0020532, 0.00020293],
}


def camera(name: str, **changes: object) -> CameraModel:
    facts: dict[str, object] = dict(
        stamp_ns=0, frame_id="cam", width=640, height=480, distortion_model=name.rstrip("5"),
        distortion=np.array(MODELS.get(name, [])), intrinsics=K, rectification=np.eye(3),
        projection=np.hstack([K, np.zeros((3, 1))]),
    )  # fmt: skip
    return CameraModel(**{**facts, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", list(MODELS))
def test_distort_agrees_with_opencv(name: str) -> None:
    rays = np.random.default_rng(3).uniform(-0.6, 0.6, (200, 2))
    lens = lens_of(camera(name))
    coefficients = np.array(MODELS[name])
    if name == "equidistant":
        expected = cv2.fisheye.distortPoints(rays[:, None], K, coefficients)[:, 0]
    else:
        points = np.column_stack([rays, np.ones(200)])
        expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, coefficients)[0][:, 0]
    np.testing.assert_allclose(lens.distort(rays), expected, atol=1e-9)
    np.testing.assert_allclose(lens.project(np.column_stack([rays, np.ones(200)]) * 2.5), expected, atol=1e-9)


@pytest.mark.parametrize("name", list(MODELS))
def test_undistort_goes_back_and_its_stretch_is_the_derivative(name: str) -> None:
    lens = lens_of(camera(name))
    pixels = np.random.default_rng(4).uniform((0, 0), (640, 480), (500, 2))
    found = lens.undistort(pixels)
    assert np.isfinite(found.rays).all()
    np.testing.assert_allclose(lens.distort(found.rays), pixels, atol=1e-6)
    step = 1e-4
    across = (lens.undistort(pixels + np.array([step, 0.0])).rays - found.rays) / step
    down = (lens.undistort(pixels + np.array([0.0, step])).rays - found.rays) / step
    area = across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0]
    np.testing.assert_allclose(found.stretch, np.sqrt(area), rtol=1e-4)


def test_no_ray_beyond_where_a_model_folds_back() -> None:
    lens = lens_of(camera("plumb_bob", distortion=np.array([-0.4, 0.0, 0.0, 0.0])))
    # r (1 - 0.4 r^2) is largest at r = 0.9129, with 0.6086: no ray comes out farther than 231 px from the centre.
    found = lens.undistort(np.array([[322.0 + 0.60 * 380.0, 241.0], [322.0 + 0.62 * 380.0, 241.0]]))
    assert np.isfinite(found.rays[0]).all()
    assert np.isnan(found.rays[1]).all()
    assert np.isnan(found.stretch[1])
    assert np.isnan(lens.distort(np.array([[0.95, 0.0]]))).all()


def test_fisheye_shows_what_is_behind_the_image_plane() -> None:
    lens = Lens(kind="fisheye", fx=190.0, fy=190.0, cx=256.0, cy=256.0, coefficients=np.zeros(4))
    pixel = lens.project(np.array([[1.0, 0.0, -0.1]]))
    np.testing.assert_allclose(pixel, [[256.0 + 190.0 * np.arctan2(1.0, -0.1), 256.0]])
    assert np.isnan(lens.undistort(pixel).rays).all()
    assert np.isnan(lens_of(camera("none")).project(np.array([[1.0, 0.0, -0.1]]))).all()


def test_scaled_lens_sees_the_same_rays() -> None:
    lens = lens_of(camera("plumb_bob"))
    half = lens.scaled(0.5, 0.5)
    pixels = np.array([[10.0, 30.0], [600.5, 400.25]])
    np.testing.assert_allclose(half.undistort((pixels + 0.5) * 0.5 - 0.5).rays, lens.undistort(pixels).rays, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"distortion_model": "omni"}, "'omni' is unknown"),
        ({"distortion_model": "equidistant", "distortion": np.zeros(2)}, "needs finite coefficients"),
        ({"distortion": np.array([0.1] * 14), "distortion_model": "rational_polynomial"}, "thin-prism"),
        ({"intrinsics": np.zeros((3, 3))}, "uncalibrated"),
    ],
)
def test_wrong_calibrations_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        lens_of(camera("plumb_bob", **changes))


@pytest.mark.parametrize("name", list(MODELS))
def test_kernel_agrees_with_numpy(name: str) -> None:
    """The twin: Newton's method in NumPy with derivatives by differences, on the model that `distort` is."""
    lens = lens_of(camera(name))
    pixels = np.random.default_rng(5).uniform((100, 80), (540, 400), (60, 2))
    rays = (pixels - (322.0, 241.0)) / (380.0, 376.0)
    step = 1e-6
    for _ in range(12):
        miss = pixels - lens.distort(rays)
        across = (lens.distort(rays + np.array([step, 0.0])) - lens.distort(rays - np.array([step, 0.0]))) / (2 * step)
        down = (lens.distort(rays + np.array([0.0, step])) - lens.distort(rays - np.array([0.0, step]))) / (2 * step)
        rays = rays + np.linalg.solve(np.stack([across, down], axis=2), miss[..., None])[..., 0]
    np.testing.assert_allclose(lens.undistort(pixels).rays, rays, atol=1e-9)


@pytest.mark.parametrize("name", ["none", "plumb_bob", "equidistant"])
def test_no_points_and_no_numbers(name: str) -> None:
    lens = lens_of(camera(name))
    assert lens.undistort(np.empty((0, 2))).rays.shape == (0, 2)
    found = lens.undistort(np.array([[np.nan, 3.0], [322.0, 241.0]]))
    assert np.isnan(found.rays[0]).any()
    np.testing.assert_allclose(found.rays[1], 0.0, atol=1e-12)
