# SPDX-License-Identifier: MIT
"""Square markers with a number (ArUco, AprilTag) in an image, and where they are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]

FAMILIES = (
    "4X4_50", "4X4_100", "4X4_250", "4X4_1000", "5X5_50", "5X5_100", "5X5_250", "5X5_1000", "6X6_50", "6X6_100", "6X6_250",
    "6X6_1000", "7X7_50", "7X7_100", "7X7_250", "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_16H5", "APRILTAG_25H9",
    "APRILTAG_36H10", "APRILTAG_36H11",
)  # fmt: skip
"""By OpenCV's number of the dictionary, which is RTAB-Map's too."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkerCorners:
    """A marker in an image."""

    number: int
    corners: Floats
    """float64 (4, 2), pixels: top left, top right, bottom right, bottom left of the marker as it is printed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkerPose:
    """Where a marker is."""

    T_camera_marker: Floats
    """float64 (4, 4): x to the right and y up on the marker, z out of it towards the camera; origin in its centre."""
    rms_px: float
    """Reprojection error."""
    ambiguous: bool
    """Whether the mirrored pose fits nearly as well: then the place holds, but not the direction."""


SQUARE = np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
LARGEST_RMS_PX = 3.0
FLOOR_PX = 0.05
"""Corners are not known better."""
AMBIGUOUS_RATIO = 2.0
"""Reprojection error of the mirrored pose over that of the pose, up to which both may be."""


def find_markers(image: NDArray[np.uint8], family: int) -> list[MarkerCorners]:
    """Return the markers of a family (row of `FAMILIES`) in an image (H, W) or (H, W, 3), red first, by increasing number.

    A number that is seen twice is left out: which of the two it is cannot be told.

    Raises
    ------
    ConfigError
        If there is no such family.
    """
    if not 0 <= family < len(FAMILIES):
        raise ConfigError(f"marker family {family}: there are 0 to {len(FAMILIES) - 1}")
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else np.ascontiguousarray(image)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{FAMILIES[family]}"))
    told = cv2.aruco.DetectorParameters()
    told.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary, told).detectMarkers(grey)
    if numbers is None or not len(numbers):
        return []
    names = np.asarray(numbers).ravel().tolist()
    found = [
        MarkerCorners(number=int(name), corners=np.asarray(quad, np.float64).reshape(4, 2))
        for name, quad in zip(names, corners, strict=True)
        if names.count(name) == 1
    ]
    return sorted(found, key=lambda marker: marker.number)


def marker_pose(corners: Floats, edge_m: float, camera: Pinhole) -> MarkerPose | None:
    """Return the pose of a marker of a known size, None if its corners fit no square.

    References
    ----------
    T. Collins, A. Bartoli, "Infinitesimal plane-based pose estimation", IJCV 109, 2014, doi:10.1007/s11263-014-0725-5.
    """
    poses: list[tuple[float, Floats]] = []
    for quarter in (0, 1):  # OpenCV loses turns by exactly half a turn: one of both is none
        turned = cv2.Rodrigues(np.array([0.0, 0.0, 0.5 * np.pi * quarter]))[0] @ np.diag([1.0, -1.0, -1.0])
        square = 0.5 * edge_m * SQUARE @ turned.T
        found, turns, places, errors = cv2.solvePnPGeneric(
            square, np.ascontiguousarray(corners), camera.matrix, np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
        if found:
            poses = [
                (float(error), _pose(turn, place, turned))
                for error, turn, place in zip(np.ravel(errors), turns, places, strict=True)
            ]
            poses.sort(key=lambda one: one[0])
        if poses and poses[0][0] < LARGEST_RMS_PX:
            break
    if not poses or not np.isfinite(poses[0][1]).all() or poses[0][1][2, 3] <= 0.0:
        return None
    rms, T = poses[0]
    other = poses[1][0] if len(poses) > 1 else np.inf
    return MarkerPose(T_camera_marker=T, rms_px=rms, ambiguous=other < AMBIGUOUS_RATIO * max(rms, FLOOR_PX))


def _pose(turn: Floats, place: Floats, turned: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(turn)[0] @ turned
    T[:3, 3] = np.ravel(place)
    return T
