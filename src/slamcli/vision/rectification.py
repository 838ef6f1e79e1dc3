# SPDX-License-Identifier: MIT
"""Two cameras turned so that their rows agree: the ideal pair of cameras, and where its pixels lie in the raw images.

References
----------
Fusiello, Trucco and Verri, "A compact algorithm for rectification of stereo pairs", Machine Vision and Applications 12,
2000, doi:10.1007/s001380050120. Here the common optical axis is the mean of the two, as Bouguet takes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.measurements import CameraModel, CameraRig
from slamcli.vision.lens import Lens, lens_of
from slamcli.vision.pinhole import Pinhole

_SAME_PX = 0.01
_SAME_ROTATION = 1e-5
_BORDER_STEPS = 65
Maps = tuple[NDArray[np.int16], NDArray[np.uint16]]
"""Where each pixel comes from, in the fixed-point form that cv2.remap reads fastest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rectification:
    """The ideal pair."""

    camera: Pinhole
    """The left camera, with the baseline."""
    R_rectified_main: NDArray[np.float64]
    """float64 (3, 3), turns the main camera's frame into the ideal camera's."""
    left: Maps | None
    """None: the images are rectified as they come."""
    right: Maps | None


def rectify(rig: CameraRig, *, width: int, height: int, view_angle_rad: float) -> Rectification:
    """Return the ideal pair of a stereo rig.

    Parameters
    ----------
    rig
        With both models; ``T_main_right`` None: the models' own R and P say how the images are rectified.
    width, height
        Size of the ideal images, pixels.
    view_angle_rad
        Half the angle of view that the ideal images show at most, horizontally and vertically: a wide lens has no
        pinhole image, and its rim would cost most of the pixels.

    Raises
    ------
    CalibrationError
        If there is no right camera, no baseline, or the two cameras do not sit side by side.
    """
    if rig.right is None:
        raise CalibrationError(
            "a stereo rig needs the calibration of its right camera (CameraInfo topic, or --camera FILE)"
        )
    if rig.T_main_right is None:
        return _by_projection(rig.main, rig.right, width, height)
    left, right, T = lens_of(rig.main), lens_of(rig.right), np.asarray(rig.T_main_right, dtype=np.float64)
    R_left, R_right, baseline_m = _common_rotation(T)
    ideal = left.ideal and right.ideal and np.abs(left.matrix - right.matrix).max() < _SAME_PX
    if ideal and _same_turn(R_left, np.eye(3)) and _same_turn(R_right, np.eye(3)):
        return _as_it_is(rig.main, left.matrix, baseline_m, width, height)
    rim = _shared_view(((rig.main, left, R_left), (rig.right, right, R_right)), float(np.tan(view_angle_rad)))
    camera = _fitted(rim, baseline_m, width, height)
    K = camera.matrix
    return Rectification(
        camera=camera, R_rectified_main=R_left, left=_maps(left, R_left, K, width, height),
        right=_maps(right, R_right, K, width, height),
    )  # fmt: skip


def _by_projection(main: CameraModel, right: CameraModel, width: int, height: int) -> Rectification:
    """Return the pair that the calibrations' own R and P describe, as ROS rectifies."""
    P, P_right = main.projection, right.projection
    baseline_m = 0.0 - float(P_right[0, 3]) / float(P_right[0, 0]) if P_right[0, 0] > 0.0 else 0.0
    if P[0, 0] <= 0.0 or not baseline_m > 0.0:
        raise CalibrationError(
            f"stereo baseline {baseline_m:g} m from P of {right.topic or 'the right camera'}: P[0, 3] must be"
            " -fx * baseline there; are left and right exchanged, or give the rig with --camera FILE (Kalibr or ORB-SLAM)"
        )
    if np.abs(P[:, :3] - P_right[:, :3]).max() > _SAME_PX * 100:
        raise CalibrationError(
            f"the rectified cameras {main.topic or 'left'} and {right.topic or 'right'} differ in P: not one stereo pair"
        )
    lenses = ((main, lens_of(main)), (right, lens_of(right)))
    if all(
        lens.ideal
        and np.abs(lens.matrix - model.projection[:, :3]).max() < _SAME_PX
        and _same_turn(model.rectification, np.eye(3))
        for model, lens in lenses
    ):
        return _as_it_is(main, P[:, :3], baseline_m, width, height)
    K = _scaled(P[:, :3], width / main.width, height / main.height)
    left_maps, right_maps = (_maps(lens, model.rectification, K, width, height) for model, lens in lenses)
    return Rectification(
        camera=_pinhole(K, baseline_m, width, height),
        R_rectified_main=main.rectification,
        left=left_maps,
        right=right_maps,
    )


def _as_it_is(main: CameraModel, K: NDArray[np.float64], baseline_m: float, width: int, height: int) -> Rectification:
    scaled = _scaled(K, width / main.width, height / main.height)
    return Rectification(
        camera=_pinhole(scaled, baseline_m, width, height), R_rectified_main=np.eye(3), left=None, right=None
    )


def _common_rotation(T_main_right: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the rotations into the ideal cameras' common axes (left, right) and the baseline, metres."""
    offset = T_main_right[:3, 3]
    baseline_m = float(np.linalg.norm(offset))
    if not baseline_m > 1e-6:
        raise CalibrationError("the two cameras of the stereo rig sit at one place: T_c1_c2 has no translation")
    if offset[0] < 0.7 * baseline_m:
        where = "left of" if offset[0] < -0.7 * baseline_m else "above, below, ahead of or behind"
        hint = (
            ": exchange --left-topic and --right-topic"
            if where == "left of"
            else ": only cameras side by side are read"
        )
        raise CalibrationError(
            f"the right camera sits {where} the left one (at {offset[0]:.3f}, {offset[1]:.3f}, {offset[2]:.3f} m){hint}"
        )
    x = offset / baseline_m
    axis = np.array([0.0, 0.0, 1.0]) + T_main_right[:3, 2]
    y = np.cross(axis, x)
    y /= np.linalg.norm(y)
    R_left = np.stack([x, y, np.cross(x, y)])
    return R_left, R_left @ T_main_right[:3, :3], baseline_m


def _shared_view(
    cameras: tuple[tuple[CameraModel, Lens, NDArray[np.float64]], ...], furthest: float
) -> tuple[float, float, float, float]:
    """Return the rectangle of rays (x_min, y_min, x_max, y_max) that every camera sees as a whole."""
    low, high = np.full(2, -furthest), np.full(2, furthest)
    for model, lens, turn in cameras:
        u = np.linspace(0.0, model.width - 1.0, _BORDER_STEPS)
        v = np.linspace(0.0, model.height - 1.0, _BORDER_STEPS)
        for axis, end, at in ((0, 0, 0.0), (0, 1, model.width - 1.0), (1, 0, 0.0), (1, 1, model.height - 1.0)):
            side = np.column_stack([np.full_like(v, at), v] if axis == 0 else [u, np.full_like(u, at)])
            rays = lens.undistort(side).rays
            turned = np.column_stack([rays, np.ones(len(rays))]) @ turn.T
            seen = turned[:, axis] / np.where(turned[:, 2] > 0.0, turned[:, 2], np.nan)
            seen = seen[np.isfinite(seen)]
            if len(seen) and end == 0:
                low[axis] = max(low[axis], seen.max())
            elif len(seen):
                high[axis] = min(high[axis], seen.min())
    if not (low < high).all():
        raise CalibrationError(
            "the two cameras of the stereo rig have no view in common: check the pose of the right one"
        )
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _fitted(rim: tuple[float, float, float, float], baseline_m: float, width: int, height: int) -> Pinhole:
    """Return the camera of that size whose image lies in the rectangle of rays, centred."""
    focal = max((width - 1.0) / (rim[2] - rim[0]), (height - 1.0) / (rim[3] - rim[1]))
    cx = (width - 1.0) / 2.0 - focal * (rim[0] + rim[2]) / 2.0
    cy = (height - 1.0) / 2.0 - focal * (rim[1] + rim[3]) / 2.0
    return Pinhole(fx=focal, fy=focal, cx=cx, cy=cy, width=width, height=height, baseline_m=baseline_m)


def _maps(lens: Lens, turn: NDArray[np.float64], K: NDArray[np.float64], width: int, height: int) -> Maps:
    """Return where the pixels of the ideal image lie in the raw one; `turn` goes from the raw camera's frame."""
    v, u = np.mgrid[0:height, 0:width].astype(np.float64)
    rays = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)]) @ np.linalg.inv(K).T @ turn
    raw = lens.project(rays).reshape(height, width, 2)
    raw = np.where(np.isfinite(raw), raw, -1e4).astype(np.float32)
    fixed, fraction = cv2.convertMaps(raw[..., 0].copy(), raw[..., 1].copy(), cv2.CV_16SC2)
    return fixed.astype(np.int16, copy=False), fraction.astype(np.uint16, copy=False)


def _scaled(K: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    return np.array(
        [[K[0, 0] * x, 0.0, (K[0, 2] + 0.5) * x - 0.5], [0.0, K[1, 1] * y, (K[1, 2] + 0.5) * y - 0.5], [0.0, 0.0, 1.0]]
    )


def _pinhole(K: NDArray[np.float64], baseline_m: float, width: int, height: int) -> Pinhole:
    return Pinhole(
        fx=float(K[0, 0]), fy=float(K[1, 1]), cx=float(K[0, 2]), cy=float(K[1, 2]), width=width, height=height,
        baseline_m=baseline_m,
    )  # fmt: skip


def _same_turn(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    return bool(np.abs(a - b).max() < _SAME_ROTATION)
