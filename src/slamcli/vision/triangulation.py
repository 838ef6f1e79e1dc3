# SPDX-License-Identifier: MIT
"""Points from pixels that two posed cameras matched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.vision import _triangulation_kernels as kernels
from slamcli.vision.pinhole import Pinhole

ITERATIONS = 3
"""Gauss-Newton steps on the reprojection errors; from the linear solution two are enough."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangulation:
    """Points of matched pixels, and which of them pass all checks."""

    points: NDArray[np.float64]
    """(N, 3), metres, map frame; NaN where not `ok`."""
    ok: NDArray[np.bool_]
    """(N,)."""


def triangulate(
    T_a_map: NDArray[np.float64],
    T_b_map: NDArray[np.float64],
    pixels_a: NDArray[np.float64],
    pixels_b: NDArray[np.float64],
    camera: Pinhole,
    *,
    sigmas_a: NDArray[np.float64],
    sigmas_b: NDArray[np.float64],
    right_a: NDArray[np.float64] | None = None,
    right_b: NDArray[np.float64] | None = None,
    max_cos_parallax: float = 0.9998,
    scale_factor: float = 1.2,
) -> Triangulation:
    """Return the points that two cameras see, with the checks of ORB-SLAM.

    The start is the point on a's ray nearest to b's pixel, or the point of the stereo pair (real or virtual) whose rays
    spread wider; Gauss-Newton on all reprojection errors, right columns included, over (x/z, y/z, 1/z) in camera a makes
    it the most likely one. A point passes if

    - the rays spread enough (cosine below `max_cos_parallax`), or one of the two knows its depth;
    - it lies ahead of both cameras;
    - chi2 of its reprojection is at most 5.991 in a mono and 7.815 in a stereo image (95 %, 2 and 3 degrees of freedom);
    - its distances fit the octaves: d_b / d_a within a factor 1.5 `scale_factor` of sigma_a / sigma_b.

    Parameters
    ----------
    T_a_map, T_b_map
        float64 (4, 4), poses of the cameras.
    pixels_a, pixels_b
        float64 (N, 2), matched pixels of the ideal camera.
    camera
        The camera of both.
    sigmas_a, sigmas_b
        float64 (N,), standard deviations, pixels: scale of the octave.
    right_a, right_b
        float64 (N,), columns in the right images, NaN where unknown; None: a mono camera.
    max_cos_parallax
        Largest cosine of the angle between the rays of a point without depth.
    scale_factor
        Between the octaves.

    References
    ----------
    R. Mur-Artal, J. M. M. Montiel, J. D. Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system", IEEE T-RO 31(5),
    2015, doi:10.1109/TRO.2015.2463671, section VI-C.
    J. Civera, A. J. Davison, J. M. M. Montiel, "Inverse depth parametrization for monocular SLAM", IEEE T-RO 24(5), 2008,
    doi:10.1109/TRO.2008.2003276.
    """
    count = len(pixels_a)
    points, ok = np.empty((count, 3)), np.empty(count, np.bool_)
    T_map_a = se3.inverse(T_a_map)
    kernels.triangulate(
        np.ascontiguousarray(T_b_map @ T_map_a),
        camera.array,
        *_columns(pixels_a, right_a, sigmas_a),
        *_columns(pixels_b, right_b, sigmas_b),
        max_cos_parallax,
        1.5 * scale_factor,
        ITERATIONS,
        points,
        ok,
    )
    return Triangulation(points @ T_map_a[:3, :3].T + T_map_a[:3, 3], ok)


def _columns(
    pixels: NDArray[np.float64], right: NDArray[np.float64] | None, sigmas: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return contiguous columns as the kernel takes them."""
    if right is None:
        right = np.full(len(pixels), np.nan)
    return (
        np.ascontiguousarray(pixels, np.float64),
        np.ascontiguousarray(right, np.float64),
        np.ascontiguousarray(sigmas, np.float64),
    )


def warm() -> None:
    """Compile the kernels of this module."""
    camera = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=50.0, width=100, height=100)
    T_b_map = np.eye(4)
    T_b_map[0, 3] = -1.0
    one = np.ones(1)
    triangulate(np.eye(4), T_b_map, np.array([[50.0, 50]]), np.array([[40.0, 50]]), camera, sigmas_a=one, sigmas_b=one)
