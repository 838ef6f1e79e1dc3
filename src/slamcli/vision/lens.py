# SPDX-License-Identifier: MIT
"""What a lens does to a ray: pixels of the raw image from rays, and rays from pixels.

A ray is (x/z, y/z) in the camera's frame. Three models, as OpenCV and Kalibr write them:

- radial-tangential (``plumb_bob``, ``radtan``): k1, k2, p1, p2 [, k3];
- rational (``rational_polynomial``): k1, k2, p1, p2, k3, k4, k5, k6;
- fisheye (``equidistant``, ``KannalaBrandt8``): k1, k2, k3, k4 over the angle to the optical axis.

References
----------
Brown, "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971; Kannala and Brandt, "A generic camera
model and calibration method", PAMI 2006, doi:10.1109/TPAMI.2006.153.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.measurements import CameraModel
from slamcli.vision._lens_kernels import straighten_fisheye, straighten_radial

LensKind = Literal["radial", "fisheye"]
MODELS: dict[str, tuple[LensKind, int]] = {
    "": ("radial", 5), "none": ("radial", 5), "plumb_bob": ("radial", 5), "radtan": ("radial", 5),
    "radial-tangential": ("radial", 5), "pinhole": ("radial", 5), "rational_polynomial": ("radial", 8),
    "equidistant": ("fisheye", 4), "fisheye": ("fisheye", 4), "kannala_brandt": ("fisheye", 4),
}  # fmt: skip
"""What the names of distortion models mean, and how many coefficients each has at most."""


class Undistorted(NamedTuple):
    """Rays of pixels."""

    rays: NDArray[np.float64]
    """(N, 2), x/z and y/z; NaN where no ray in front of the camera meets the pixel, or the model does not hold."""
    stretch: NDArray[np.float64]
    """(N,), how far the ray moves for one pixel: square root of the local change of area; NaN as above."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lens:
    """Intrinsics of the raw image and its distortion."""

    kind: LensKind
    fx: float
    """Pixels, as the next three."""
    fy: float
    cx: float
    cy: float
    coefficients: NDArray[np.float64]
    """float64 (8,) k1 k2 p1 p2 k3 k4 k5 k6, or (4,) of the fisheye."""
    limit: float = field(init=False)
    """Squared radius of a ray (its angle, for a fisheye) up to which the model holds: farther rays come back inwards."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", self._limit())

    @property
    def ideal(self) -> bool:
        """Whether nothing is distorted."""
        return self.kind == "radial" and not self.coefficients.any()

    @property
    def matrix(self) -> NDArray[np.float64]:
        """float64 (3, 3), K of the raw image."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def scaled(self, x: float, y: float) -> Lens:
        """Return the lens of the image resized by these factors (pixel centres at whole numbers, as OpenCV resizes)."""
        return Lens(
            kind=self.kind, fx=self.fx * x, fy=self.fy * y, coefficients=self.coefficients,
            cx=(self.cx + 0.5) * x - 0.5, cy=(self.cy + 0.5) * y - 0.5,
        )  # fmt: skip

    def project(self, points_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return raw pixels (N, 2) of points (N, 3) in the camera's frame; NaN where the lens shows none of them.

        A fisheye lens also shows what lies behind its image plane.
        """
        if self.kind == "fisheye":
            across = np.hypot(points_camera[:, 0], points_camera[:, 1])
            angle = np.arctan2(across, points_camera[:, 2])
            seen = angle < self.limit
            with np.errstate(divide="ignore", invalid="ignore"):
                factor = np.where(across > 0, self._bent(angle) / across, 1.0)
            return np.where(seen[:, None], self._pixels(points_camera[:, :2] * factor[:, None]), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            rays = np.where(points_camera[:, 2:] > 0, points_camera[:, :2] / points_camera[:, 2:], np.nan)
        return self.distort(rays)

    def distort(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return raw pixels (N, 2) of rays (N, 2); NaN beyond where the model's image ends."""
        square = (rays**2).sum(axis=1)
        if self.kind == "fisheye":
            radius = np.sqrt(square)
            angle = np.arctan(radius)
            with np.errstate(invalid="ignore", divide="ignore"):
                factor = np.where(radius > 1e-12, self._bent(angle) / radius, 1.0)
            bent = rays * factor[:, None]
            beyond = angle >= self.limit
        else:
            bent = self._bend(rays)
            beyond = square >= self.limit
        return np.where(beyond[:, None], np.nan, self._pixels(bent))

    def undistort(self, pixels: NDArray[np.float64]) -> Undistorted:
        """Return the rays of raw pixels (N, 2), to 1e-9, by Newton's method."""
        bent = np.ascontiguousarray((np.asarray(pixels, dtype=np.float64) - (self.cx, self.cy)) / (self.fx, self.fy))
        pixel = 1.0 / np.sqrt(self.fx * self.fy)
        if self.ideal:
            return Undistorted(bent, np.full(len(bent), pixel))
        rays, area = np.empty_like(bent), np.empty(len(bent))
        straighten = straighten_fisheye if self.kind == "fisheye" else straighten_radial
        straighten(bent, self.coefficients, self.limit, rays, area)
        return Undistorted(rays, np.sqrt(area) * pixel)

    def _pixels(self, bent: NDArray[np.float64]) -> NDArray[np.float64]:
        return bent * (self.fx, self.fy) + (self.cx, self.cy)

    def _ratio(self) -> tuple[Polynomial, Polynomial]:
        """Return numerator and denominator of the radial factor, polynomials of the squared radius."""
        k1, k2, _, _, k3, k4, k5, k6 = self.coefficients
        return Polynomial([1.0, k1, k2, k3]), Polynomial([1.0, k4, k5, k6])

    def _bent(self, angle: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distorted angle of a fisheye, radians."""
        k1, k2, k3, k4 = self.coefficients
        square = angle * angle
        bent: NDArray[np.float64] = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        return bent

    def _limit(self) -> float:
        """Return the squared radius (the angle of a fisheye) up to which a larger one lies farther out in the image."""
        if self.kind == "fisheye":
            k1, k2, k3, k4 = self.coefficients
            slope = Polynomial([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4])
            return min(float(np.sqrt(_first_root(slope))), float(np.pi))
        above, below = self._ratio()
        s = Polynomial([0.0, 2.0])
        slope = (above + s * above.deriv()) * below - s * above * below.deriv()
        return min(_first_root(slope), _first_root(below))

    def _bend(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return distorted coordinates (N, 2) of rays."""
        p1, p2 = self.coefficients[2:4]
        x, y = rays.T
        square = x * x + y * y
        above, below = self._ratio()
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            factor = above(square) / below(square)
            return np.column_stack(
                [
                    x * factor + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                    y * factor + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
                ]
            )


def lens_of(camera: CameraModel) -> Lens:
    """Return the lens that a calibration describes.

    Raises
    ------
    CalibrationError
        If the distortion model is unknown, has coefficients that are not covered, or the focal length is not positive.
    """
    where = f"camera {camera.topic or camera.frame_id or 'calibration'}"
    name = camera.distortion_model.strip().lower()
    if name not in MODELS:
        raise CalibrationError(
            f"{where}: distortion model {camera.distortion_model!r} is unknown;"
            " plumb_bob, rational_polynomial and equidistant are read"
        )
    kind, most = MODELS[name]
    given = np.asarray(camera.distortion, dtype=np.float64)
    if not np.isfinite(given).all() or (kind == "fisheye" and 0 < len(given) < most):
        raise CalibrationError(f"{where}: {name} needs finite coefficients ({most} of them), found {given.tolist()}")
    if given[8 if kind == "radial" else 4 :].any():
        raise CalibrationError(f"{where}: thin-prism and tilted-sensor coefficients are not covered: {given.tolist()}")
    coefficients = np.zeros(8 if kind == "radial" else 4)
    coefficients[: min(len(given), len(coefficients))] = given[: len(coefficients)]
    K = camera.intrinsics
    if not np.isfinite(K).all() or K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
        raise CalibrationError(
            f"{where}: focal lengths {K[0, 0]:g}, {K[1, 1]:g} px: an uncalibrated camera; give its calibration with --camera"
        )
    return Lens(
        kind=kind, fx=float(K[0, 0]), fy=float(K[1, 1]), cx=float(K[0, 2]), cy=float(K[1, 2]), coefficients=coefficients
    )


def _first_root(slope: Polynomial) -> float:
    """Return the smallest positive root of a polynomial that is 1 at 0; infinity without one."""
    roots = slope.trim().roots() if slope.trim().degree() > 0 else np.array([])
    real = roots[np.abs(np.imag(roots)) < 1e-9].real
    positive = real[real > 0.0]
    return float(positive.min()) if len(positive) else float("inf")


def warm() -> None:
    """Compile the kernels on tiny input."""
    for kind, count in (("radial", 8), ("fisheye", 4)):
        lens = Lens(kind=kind, fx=100.0, fy=100.0, cx=50.0, cy=50.0, coefficients=np.full(count, 1e-3))  # type: ignore[arg-type]
        lens.undistort(np.array([[20.0, 30.0]]))
