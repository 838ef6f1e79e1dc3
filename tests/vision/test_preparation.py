# SPDX-License-Identifier: MIT
"""Images on their way into a tier: sizes, colours, rectification, and points moved to the ideal camera."""

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import CalibrationError, DataError
from slamcli.measurements import CameraModel, CameraRig, Image, RgbdFrame, StereoPair
from slamcli.vision.features import Features
from slamcli.vision.lens import lens_of
from slamcli.vision.preparation import Preparation, PreparationSettings

FISHEYE = [0.0034823894, 0.00071503, -0.0020532, 0.00020293]


def camera(
    fx: float = 300.0, distortion: tuple[float, ...] = (), model: str = "plumb_bob", **changes: object
) -> CameraModel:
    K = np.array([[fx, 0.0, 159.5], [0.0, fx, 119.5], [0.0, 0.0, 1.0]])
    facts: dict[str, object] = dict(
        stamp_ns=0, frame_id="cam", width=320, height=240, distortion_model=model, distortion=np.array(distortion),
        intrinsics=K, rectification=np.eye(3), projection=np.hstack([K, np.zeros((3, 1))]), topic="/left/camera_info",
    )  # fmt: skip
    return CameraModel(**{**facts, **changes})  # type: ignore[arg-type]


def image(pixels: NDArray[np.uint8], encoding: str = "mono8", stamp_ns: int = 5) -> Image:
    return Image(stamp_ns=stamp_ns, frame_id="cam", encoding=encoding, pixels=pixels, topic="/left/image")


def depth_image(pixels: NDArray[np.float32]) -> Image:
    return Image(stamp_ns=5, frame_id="cam", encoding="depth", pixels=pixels, topic="/depth/image")


def pose(rotation_vector: tuple[float, float, float], position: tuple[float, float, float]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array(rotation_vector, dtype=np.float64))[0]
    T[:3, 3] = position
    return T


def test_rgbd_keeps_its_pixels_and_turns_them_grey() -> None:
    colour = np.random.default_rng(1).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    depth = np.full((240, 320), 2.0, dtype=np.float32)
    ready = Preparation(CameraRig(mode="rgbd", main=camera(), baseline_m=0.1))
    frame = ready.prepare(RgbdFrame(colour=image(colour, "bgr8"), depth=depth_image(depth)))
    np.testing.assert_array_equal(frame.grey, cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY))
    assert frame.colour is not None
    assert frame.depth is not None
    np.testing.assert_array_equal(frame.colour, colour[..., ::-1])
    np.testing.assert_array_equal(frame.depth, depth)
    assert (ready.camera.fx, ready.camera.bf, ready.camera.limits) == (
        300.0,
        pytest.approx(30.0),
        (0.0, 0.0, 320.0, 240.0),
    )
    moved = ready.to_pinhole(np.array([[3.0, 4.0]]))
    np.testing.assert_array_equal(moved.pixels, [[3.0, 4.0]])
    assert moved.inside.all()


def test_virtual_baseline_has_a_default() -> None:
    assert Preparation(CameraRig(mode="rgbd", main=camera())).camera.baseline_m == 0.08


def test_distorted_points_move_and_bounds_grow() -> None:
    model = camera(distortion=(-0.28, 0.07, 0.0002, 0.0001))
    ready = Preparation(CameraRig(mode="mono", main=model))
    raw = np.array([[0.0, 0.0], [319.0, 239.0], [159.5, 119.5]])
    K = model.intrinsics
    expected = cv2.undistortPoints(
        raw[:, None], K, model.distortion, P=K, criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    )[:, 0]
    moved = ready.to_pinhole(raw)
    np.testing.assert_allclose(moved.pixels, expected, atol=1e-6)
    assert moved.stretch[0] > 1.1
    assert moved.stretch[2] == pytest.approx(1.0, abs=1e-3)
    x_min, y_min, x_max, y_max = ready.camera.limits
    assert x_min == pytest.approx(expected[0, 0], abs=0.1)
    assert y_max == pytest.approx(expected[1, 1], abs=0.1)
    assert x_max > 330.0
    assert y_min < -10.0


def test_features_outside_of_the_view_are_dropped_and_sigmas_stretched() -> None:
    model = camera(fx=110.0, distortion=tuple(FISHEYE), model="equidistant")
    ready = Preparation(CameraRig(mode="mono", main=model), PreparationSettings(view_angle_rad=math.radians(60.0)))
    raw = np.array([[159.5, 119.5], [159.5 + 100.0, 119.5], [2.0, 2.0]])  # 0, 52 and about 95 degrees off the axis
    n = len(raw)
    nothing = np.full(n, np.nan)
    features = Features(
        pixels=raw, octaves=np.zeros(n, np.int64), angles=np.zeros(n), responses=np.ones(n),
        descriptors=np.arange(n * 32, dtype=np.uint8).reshape(n, 32), sigmas=np.full(n, 1.2), right=nothing, depth=nothing,
        raw_pixels=raw,
    )  # fmt: skip
    moved = ready.undistorted(features)
    assert len(moved) == 2
    np.testing.assert_array_equal(moved.raw_pixels, raw[:2])
    np.testing.assert_array_equal(moved.descriptors, features.descriptors[:2])
    assert moved.sigmas[0] == pytest.approx(1.2, rel=1e-3)
    assert moved.sigmas[1] > 1.2 * 1.8
    reach = 110.0 * math.tan(math.radians(60.0))
    assert ready.camera.limits[2] <= 159.5 + reach + 1e-6
    assert ready.camera.limits[2] > 159.5 + 0.95 * reach


def test_resizing_scales_the_calibration_and_takes_the_nearest_depth() -> None:
    depth = np.zeros((240, 320), dtype=np.float32)
    depth[::2, ::2] = 3.0
    settings = PreparationSettings(width=160)
    ready = Preparation(CameraRig(mode="rgbd", main=camera()), settings)
    frame = ready.prepare(RgbdFrame(colour=image(np.zeros((240, 320, 3), np.uint8), "rgb8"), depth=depth_image(depth)))
    assert frame.grey.shape == (120, 160)
    assert frame.depth is not None
    assert set(np.unique(frame.depth)) <= {0.0, 3.0}
    assert (ready.camera.fx, ready.camera.cx, ready.camera.cy) == (150.0, 79.5, 59.5)


def test_rectified_pairs_stay_as_they_are() -> None:
    left = camera()
    P = left.projection.copy()
    P[0, 3] = -300.0 * 0.5
    ready = Preparation(CameraRig(mode="stereo", main=left, right=camera(projection=P)))
    pixels = np.random.default_rng(2).integers(0, 255, (240, 320), dtype=np.uint8)
    frame = ready.prepare(StereoPair(left=image(pixels), right=image(pixels)))
    assert not ready.resampled
    assert ready.camera.baseline_m == pytest.approx(0.5)
    np.testing.assert_array_equal(frame.grey, pixels)
    np.testing.assert_array_equal(ready.T_base_camera, np.eye(4))


@pytest.mark.parametrize(
    ("model", "distortion", "fx"),
    [("plumb_bob", (-0.28, 0.07, 0.0002, 0.0001), 300.0), ("equidistant", tuple(FISHEYE), 120.0)],
)
def test_a_pair_is_rectified(model: str, distortion: tuple[float, ...], fx: float) -> None:
    """A point lies on one row of both ideal images, where the ideal camera says, with the disparity bf / z."""
    main = camera(fx, distortion, model)
    right = camera(fx * 1.02, distortion, model)
    T_main_right = pose((0.02, -0.03, 0.05), (0.11, 0.004, -0.006))
    ready = Preparation(
        CameraRig(
            mode="stereo", main=main, right=right, T_main_right=T_main_right, T_base_main=pose((0, 1, 0), (1, 2, 3))
        )
    )
    camera_ideal = ready.camera
    assert ready.resampled
    assert camera_ideal.baseline_m == pytest.approx(np.linalg.norm(T_main_right[:3, 3]))
    T_main_ideal = np.linalg.inv(pose((0, 1, 0), (1, 2, 3))) @ ready.T_base_camera
    np.testing.assert_allclose(T_main_ideal[:3, 3], 0.0, atol=1e-12)
    for point_ideal in ([0.2, -0.1, 1.5], [-0.3, 0.25, 2.0]):
        point_main = T_main_ideal[:3, :3] @ point_ideal
        raw = lens_of(main).project(point_main[None])[0]
        raw_right = lens_of(right).project((np.linalg.inv(T_main_right) @ np.append(point_main, 1.0))[None, :3])[0]
        frame = ready.prepare(StereoPair(left=image(blob(raw)), right=image(blob(raw_right))))
        assert frame.right is not None
        u, v = centre(frame.grey)
        u_right, v_right = centre(frame.right)
        expected = camera_ideal.project(np.array([point_ideal]))[0]
        np.testing.assert_allclose([u, v], expected, atol=0.15)
        assert abs(v - v_right) < 0.15
        assert u - u_right == pytest.approx(camera_ideal.bf / point_ideal[2], abs=0.2)
    white = np.full((240, 320), 255, np.uint8)
    frame = ready.prepare(StereoPair(left=image(white), right=image(white)))
    assert frame.grey.min() == 255  # no black rim that would give corners
    assert frame.right is not None
    assert frame.right.min() == 255


def test_rectification_agrees_with_opencv() -> None:
    main, right = camera(distortion=(-0.2, 0.05, 0.0, 0.0)), camera(distortion=(-0.2, 0.05, 0.0, 0.0))
    T = pose((0.01, 0.02, -0.03), (0.2, 0.003, 0.001))
    ready = Preparation(CameraRig(mode="stereo", main=main, right=right, T_main_right=T))
    back = np.linalg.inv(T)
    R1 = cv2.stereoRectify(
        main.intrinsics, main.distortion, right.intrinsics, right.distortion, (320, 240), back[:3, :3].copy(), back[:3, 3:].copy(),
        flags=cv2.CALIB_ZERO_DISPARITY, alpha=0,
    )[0]  # fmt: skip
    # OpenCV halves the rotation between the cameras, we take the mean of their axes: the same to second order.
    np.testing.assert_allclose(ready.T_base_camera[:3, :3].T, R1, atol=1e-3)


def test_models_own_rectification_is_followed() -> None:
    R = pose((0.0, 0.01, 0.02), (0, 0, 0))[:3, :3]
    P = np.array([[280.0, 0, 155.0, 0], [0, 280.0, 118.0, 0], [0, 0, 1, 0]])
    P_right = P.copy()
    P_right[0, 3] = -28.0
    main, right = (camera(distortion=(-0.1, 0.0, 0.0, 0.0), rectification=R, projection=p) for p in (P, P_right))
    ready = Preparation(CameraRig(mode="stereo", main=main, right=right))
    assert ready.resampled
    assert (ready.camera.fx, ready.camera.cx, ready.camera.baseline_m) == (280.0, 155.0, pytest.approx(0.1))
    np.testing.assert_allclose(ready.T_base_camera[:3, :3], R.T)


def test_wide_fisheye_is_cut_at_the_angle_of_view() -> None:
    main = camera(110.0, tuple(FISHEYE), "equidistant")
    rig = CameraRig(mode="stereo", main=main, right=main, T_main_right=pose((0, 0, 0), (0.1, 0, 0)))
    wide = Preparation(rig, PreparationSettings(rectified_view_angle_rad=math.radians(50.0))).camera
    assert wide.fx == pytest.approx(319.0 / 2.0 / math.tan(math.radians(50.0)), rel=1e-9)


def test_what_does_not_fit_is_refused() -> None:
    ready = Preparation(CameraRig(mode="mono", main=camera()))
    with pytest.raises(DataError, match="is 10 x 20 pixels, and the calibration is for 320 x 240"):
        ready.prepare(image(np.zeros((20, 10), np.uint8)))
    with pytest.raises(DataError, match="no frame of a mono camera"):
        ready.prepare(
            StereoPair(left=image(np.zeros((240, 320), np.uint8)), right=image(np.zeros((240, 320), np.uint8)))
        )
    rgbd = Preparation(CameraRig(mode="rgbd", main=camera()))
    with pytest.raises(DataError, match="registered to the colour camera"):
        rgbd.prepare(
            RgbdFrame(colour=image(np.zeros((240, 320), np.uint8)), depth=depth_image(np.zeros((240, 240), np.float32)))
        )
    with pytest.raises(CalibrationError, match="needs the calibration of its right camera"):
        Preparation(CameraRig(mode="stereo", main=camera()))
    with pytest.raises(CalibrationError, match="exchange --left-topic"):
        Preparation(CameraRig(mode="stereo", main=camera(), right=camera(), T_main_right=pose((0, 0, 0), (-0.1, 0, 0))))
    with pytest.raises(CalibrationError, match="baseline 0 m"):
        Preparation(CameraRig(mode="stereo", main=camera(), right=camera()))


def test_contrast_is_equalised_on_request() -> None:
    dull = (np.random.default_rng(3).integers(100, 110, (240, 320))).astype(np.uint8)
    rig = CameraRig(mode="mono", main=camera())
    plain = Preparation(rig).prepare(image(dull))
    strong = Preparation(rig, PreparationSettings(equalise=True)).prepare(image(dull))
    assert strong.grey.std() > 2.0 * plain.grey.std()


def blob(at: NDArray[np.float64]) -> NDArray[np.uint8]:
    v, u = np.mgrid[0:240, 0:320]
    return np.asarray(250.0 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 2.0**2)), dtype=np.uint8)


def centre(grey: NDArray[np.uint8]) -> tuple[float, float]:
    v, u = np.mgrid[0 : grey.shape[0], 0 : grey.shape[1]]
    weight = grey.astype(float)
    return float((u * weight).sum() / weight.sum()), float((v * weight).sum() / weight.sum())
