# SPDX-License-Identifier: MIT
"""Depth of every pixel of a rectified stereo pair (OpenCV).

H. Hirschmüller, "Stereo processing by semiglobal matching and mutual information", PAMI 30(2), 2008, doi:10.1109/TPAMI.2007.1166;
block matching after K. Konolige, "Small vision systems", 1998, with the numbers of RTAB-Map's ``StereoBM/``.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.vision.pinhole import Pinhole

_DISPARITIES, _BLOCK, _CAP = 128, 15, 31
_SMALL_BLOCK = 7
"""Of semi-global matching, with the smoothness that OpenCV recommends for it: with RTAB-Map's (2 and 5) roads stay empty."""
_SPECKLE_WINDOW, _SPECKLE_RANGE = 100, 4


def stereo_depth(
    left: NDArray[np.uint8], right: NDArray[np.uint8], camera: Pinhole, *, semi_global: bool
) -> NDArray[np.float32]:
    """Return float32 (H, W): metres along the left camera's z, 0 where the images do not tell.

    Parameters
    ----------
    left, right
        uint8 (H, W) or (H, W, 3), red first: rectified.
    camera
        The left camera, with the baseline.
    semi_global
        Whether to match along paths through the image, which is slower and fills more; else block by block.

    Notes
    -----
    Depths of less than focal length times baseline over 128 pixels are not found.
    """
    pair = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image for image in (left, right)]
    disparity = (
        _matcher(semi_global).compute(*(np.ascontiguousarray(image) for image in pair)).astype(np.float32) / 16.0
    )
    known = disparity > 0.0
    depth = np.zeros(disparity.shape, dtype=np.float32)
    depth[known] = np.float32(camera.fx * camera.baseline_m) / disparity[known]
    return depth


def _matcher(semi_global: bool) -> Any:
    opencv: Any = cv2  # its stubs lack these
    if semi_global:
        return opencv.StereoSGBM_create(
            minDisparity=0, numDisparities=_DISPARITIES, blockSize=_SMALL_BLOCK, P1=8 * _SMALL_BLOCK**2, P2=32 * _SMALL_BLOCK**2,
            disp12MaxDiff=1, preFilterCap=_CAP, uniquenessRatio=15, speckleWindowSize=_SPECKLE_WINDOW, speckleRange=_SPECKLE_RANGE, mode=opencv.STEREO_SGBM_MODE_SGBM_3WAY,
        )  # fmt: skip
    matcher = opencv.StereoBM_create(numDisparities=_DISPARITIES, blockSize=_BLOCK)
    matcher.setMinDisparity(0)
    matcher.setPreFilterSize(9)
    matcher.setPreFilterCap(_CAP)
    matcher.setUniquenessRatio(15)
    matcher.setTextureThreshold(10)
    matcher.setSpeckleWindowSize(_SPECKLE_WINDOW)
    matcher.setSpeckleRange(_SPECKLE_RANGE)
    matcher.setDisp12MaxDiff(-1)
    return matcher
