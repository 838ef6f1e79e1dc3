# SPDX-License-Identifier: MIT
"""Lenses: where each pixel of a simulated camera looks, and the calibration that its driver tells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.measurements import CameraModel
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.render import Optics

Array = NDArray[np.float64]

_TYPICAL = {"radtan": (-0.283, 0.074, 0.0002, 0.00002), "fisheye": (-0.012, 0.009, -0.006, 0.0013)}
_COUNTS = {"radtan": (4, 5), "fisheye": (4,)}
_NAMES = {"pinhole": "plumb_bob", "radtan": "plumb_bob", "fisheye": "equidistant"}
_ROUNDS = 60
_PRECISION = 1e-10


def intrinsics(p: SimulationParameters, width: int, height: int) -> Array:
    """Return K (3, 3) of an image of this size; (0, 0) is the middle of the first pixel."""
    half = np.radians(p.camera_fov) / 2
    if p.camera_lens != "fisheye" and p.camera_fov > 170.0:
        raise ConfigError(f"camera.fov {p.camera_fov:g}: more than 170 degrees need camera.lens=fisheye")
    focal = width / 2 / (half if p.camera_lens == "fisheye" else np.tan(half))
    return np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


def distortion(p: SimulationParameters) -> Array:
    """Return the coefficients of the lens in the order of its model, five zeros for none.

    Raises
    ------
    ConfigError
        If `camera.distortion` is not what the lens takes.
    """
    if p.camera_lens == "pinhole":
        if p.camera_distortion.strip():
            raise ConfigError("camera.distortion needs camera.lens=radtan or fisheye")
        return np.zeros(5)
    if not p.camera_distortion.strip():
        return np.array(_TYPICAL[p.camera_lens])
    try:
        values = np.array([float(v) for v in p.camera_distortion.replace(",", " ").split()])
    except ValueError as error:
        raise ConfigError(
            f"camera.distortion: {p.camera_distortion[:60]!r} is not numbers with commas between"
        ) from error
    if len(values) not in _COUNTS[p.camera_lens] or not np.isfinite(values).all():
        raise ConfigError(f"camera.distortion: {p.camera_lens} takes {_COUNTS[p.camera_lens][0]} finite coefficients")
    return values


def optics(p: SimulationParameters, width: int, height: int) -> Optics:
    """Return where the pixels of an image look.

    Raises
    ------
    ConfigError
        If the lens folds the image over itself: no direction belongs to some pixels.
    """
    k = intrinsics(p, width, height)
    # One pixel more on every side, so that the steps are central differences everywhere
    u, v = np.meshgrid(np.arange(-1.0, width + 1.0), np.arange(-1.0, height + 1.0))
    seen = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]], axis=-1)
    coefficients = distortion(p)
    if p.camera_lens == "fisheye":
        ahead = _fisheye_rays(seen, coefficients)
    else:
        ideal = _undistorted(seen, coefficients) if coefficients.any() else seen
        ahead = np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1)
    return Optics(
        directions=np.ascontiguousarray(ahead[1:-1, 1:-1]),
        right=np.ascontiguousarray(ahead[1:-1, 2:] - ahead[1:-1, :-2]) / 2,
        down=np.ascontiguousarray(ahead[2:, 1:-1] - ahead[:-2, 1:-1]) / 2,
    )


def camera_model(
    p: SimulationParameters, width: int, height: int, *, rectification: Array | None = None, baseline_m: float = 0.0
) -> CameraModel:
    """Return the calibration as its driver tells it, without stamp, frame and topic.

    `rectification` is the turn (3, 3) into the rectified pair, `baseline_m` that of a right camera.
    """
    k = intrinsics(p, width, height)
    if p.camera_lens == "fisheye":  # a rectified image keeps the scale in its middle
        k = k.copy()
    projection = np.column_stack([k, np.zeros(3)])
    projection[0, 3] = -k[0, 0] * baseline_m
    return CameraModel(
        stamp_ns=0, frame_id="", width=width, height=height, distortion_model=_NAMES[p.camera_lens],
        distortion=distortion(p), intrinsics=k, rectification=np.eye(3) if rectification is None else rectification,
        projection=projection,
    )  # fmt: skip


def rectifying_turns(rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return the turns (3, 3) of the left and the right camera into a common frame with x along the baseline.

    Parameters
    ----------
    rotation, position
        (3, 3) and (3,), pose of the right camera in the left one's optical frame.

    References
    ----------
    A. Fusiello, E. Trucco, A. Verri, "A compact algorithm for rectification of stereo pairs", MVA 12 (2000).
    """
    x = position / np.linalg.norm(position)
    ahead = np.array([0.0, 0.0, 1.0]) + rotation[:, 2]
    y = np.cross(ahead, x)
    y /= np.linalg.norm(y)
    left = np.stack([x, y, np.cross(x, y)])
    return left, left @ rotation


def _undistorted(seen: Array, coefficients: Array) -> Array:
    """Return ideal points (..., 2) that radial-tangential distortion moves to `seen`, by Newton's method from the middle out."""
    k1, k2, p1, p2, k3 = np.append(coefficients, np.zeros(5 - len(coefficients)))
    points = seen / (1.0 + np.maximum(k1, 0.0) * (seen**2).sum(axis=-1, keepdims=True))
    error = np.full_like(seen, np.inf)
    for _ in range(_ROUNDS):
        x, y = points[..., 0], points[..., 1]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2))
        error = np.stack([
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        ], axis=-1) - seen  # fmt: skip
        if np.abs(error).max() < _PRECISION:
            return points
        a = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        b = slope * x * y + 2 * p1 * x + 2 * p2 * y
        d = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        scale = a * d - b * b
        if scale.min() <= 1e-3:
            break
        step = np.stack([d * error[..., 0] - b * error[..., 1], a * error[..., 1] - b * error[..., 0]], axis=-1)
        points = points - step / scale[..., None]
    raise ConfigError(
        "camera.distortion: this lens folds the image over itself before its corners: give smaller coefficients or camera.fov"
    )


def _fisheye_rays(seen: Array, coefficients: Array) -> Array:
    """Return unit directions (..., 3) of points (..., 2) of the Kannala-Brandt model (PAMI 2006): r = t + k1 t^3 + k2 t^5 ..."""
    radius = np.hypot(seen[..., 0], seen[..., 1])
    angle = radius.copy()
    powers = np.array([3, 5, 7, 9])
    error = np.full_like(radius, np.inf)
    for _ in range(_ROUNDS):
        terms = coefficients * angle[..., None] ** (powers - 1)
        slope = 1.0 + (terms * powers).sum(axis=-1)
        error = angle * (1.0 + terms.sum(axis=-1)) - radius
        if np.abs(error).max() < _PRECISION or slope.min() <= 1e-3:
            break
        angle = angle - error / slope
    if np.abs(error).max() >= _PRECISION or angle.max() > np.pi:
        raise ConfigError("camera.distortion: this fisheye has no direction for its corners: give a smaller camera.fov")
    share = np.where(radius > 1e-12, np.sin(angle) / np.maximum(radius, 1e-12), 1.0)
    return np.concatenate([seen * share[..., None], np.cos(angle)[..., None]], axis=-1)
