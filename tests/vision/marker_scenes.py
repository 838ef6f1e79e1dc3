# SPDX-License-Identifier: MIT
"""Pictures with markers."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.vision.markers import FAMILIES
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=525.0, fy=525.0, cx=319.5, cy=239.5, width=640, height=480)


def facing(x, y, z, *, turn):
    """A marker's pose in the camera's frame: towards the camera, turned about the vertical."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", turn).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = x, y, z
    return T


def picture(T_camera_marker, family, *, edge_m, camera=CAMERA, side=160):
    """Grey image of markers, by number, on white sheets before a grey wall."""
    image = np.full((camera.height, camera.width), 120, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{FAMILIES[family]}"))
    for number, T in T_camera_marker.items():
        sheet = np.full((2 * side, 2 * side), 255, np.uint8)
        sheet[side // 2 : side // 2 + side, side // 2 : side // 2 + side] = cv2.aruco.generateImageMarker(
            dictionary, number, side
        )
        scale = edge_m / side  # pixel centres of the sheet to metres on the marker
        to_marker = np.array([[scale, 0, -(side - 0.5) * scale], [0, -scale, (side - 0.5) * scale], [0, 0, 1]])
        H = camera.matrix @ T[:3, [0, 1, 3]] @ to_marker
        drawn = cv2.warpPerspective(sheet, H, (camera.width, camera.height), flags=cv2.INTER_AREA)
        mask = cv2.warpPerspective(np.ones_like(sheet), H, (camera.width, camera.height), flags=cv2.INTER_NEAREST)
        image = np.where(mask > 0, drawn, image)
    return image
