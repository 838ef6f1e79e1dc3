# SPDX-License-Identifier: MIT
"""Camera models as the calibration files of data sets give them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.measurements import CameraModel, FrameTransform


def pinhole(
    frame_id: str,
    size: tuple[int, int],
    focal_and_centre: Sequence[float],
    distortion: Sequence[float] = (),
    distortion_model: str = "plumb_bob",
    *,
    shift_px: float = 0.0,
) -> CameraModel:
    """Return a pinhole camera.

    Parameters
    ----------
    size
        Width and height, pixels.
    focal_and_centre
        fx, fy, cx, cy of the image as it is, pixels.
    distortion
        Coefficients in the order of `distortion_model` (ROS's names).
    shift_px
        ``P[0, 3]`` of a rectified right camera, ``-fx * baseline``, pixels.
    """
    fx, fy, cx, cy = focal_and_centre
    intrinsics = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    projection = np.hstack([intrinsics, np.array([[shift_px], [0.0], [0.0]])])
    return CameraModel(
        stamp_ns=0,
        frame_id=frame_id,
        width=size[0],
        height=size[1],
        distortion_model=distortion_model,
        distortion=np.array(distortion, dtype=np.float64),
        intrinsics=intrinsics,
        rectification=np.eye(3),
        projection=projection,
    )


def in_frame(model: CameraModel, frame_id: str) -> CameraModel:
    """Return the camera as one of that frame."""
    return replace(model, frame_id=frame_id)


def fixed_frame(parent: str, child: str, T_parent_child: NDArray[np.float64]) -> FrameTransform:
    """Return the static transform of float64 (4, 4)."""
    position, quat = se3.to_position_quaternion(T_parent_child)
    return FrameTransform(
        stamp_ns=0,
        parent_frame_id=parent,
        child_frame_id=child,
        position_m=position,
        quat_xyzw=quat,
        static=True,
    )
