# SPDX-License-Identifier: MIT
"""From what the cameras gave to what the front end works on: grey images, and the ideal camera behind them.

Stereo pairs are rectified (resampled) unless they come so. Mono and RGB-D images are not: key points are found on the
image as it is, and moved to the ideal camera afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError, DataError
from slamcli.measurements import CameraRig, Image, Measurement, RgbdFrame, StereoPair
from slamcli.vision.features import Features
from slamcli.vision.lens import Lens, lens_of
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.rectification import Maps, Rectification, rectify

_BORDER_STEPS = 129


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparationSettings:
    """How images are prepared."""

    width: int | None = None
    """Resize to this many columns, pixels; None: from `height` at the same shape, or as they are. The calibration is scaled along."""
    height: int | None = None
    """As `width`, for rows."""
    equalise: bool = False
    """Whether local contrast is equalised (CLAHE) before key points are found."""
    virtual_baseline_m: float = 0.08
    """Of RGB-D, where neither the calibration nor the rig gives one: about that of a Kinect's own projector and camera."""
    view_angle_rad: float = math.radians(70.0)
    """Key points farther than this from the optical axis are dropped (mono and RGB-D with wide lenses)."""
    rectified_view_angle_rad: float = math.radians(50.0)
    """Half the angle of view that rectified stereo images show at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedFrame:
    """Images of one moment, all of the size that `Preparation.width` and `height` say."""

    stamp_ns: int
    grey: NDArray[np.uint8]
    """(H, W)."""
    right: NDArray[np.uint8] | None = None
    """(H, W), of a rectified pair."""
    depth: NDArray[np.float32] | None = None
    """(H, W), metres along z; 0 and NaN where unknown."""
    colour: NDArray[np.uint8] | None = None
    """(H, W, 3), red first, where the camera sees colours."""


class PinholePixels(NamedTuple):
    """Raw pixels moved to the ideal camera."""

    pixels: NDArray[np.float64]
    """(N, 2); NaN outside."""
    stretch: NDArray[np.float64]
    """(N,), ideal pixels per raw pixel: standard deviations grow by it."""
    inside: NDArray[np.bool_]
    """(N,), whether the ideal camera sees the point within the angle of view."""


class Preparation:
    """The way of images into a tier.

    Parameters
    ----------
    rig
        The cameras.
    settings
        How to prepare.

    Raises
    ------
    CalibrationError
        If a model is missing, unknown or contradicts itself.
    """

    def __init__(self, rig: CameraRig, settings: PreparationSettings | None = None) -> None:
        self._settings = settings or PreparationSettings()
        self.rig = rig
        self.width, self.height = _size(rig, self._settings)
        self._maps: tuple[Maps, Maps] | None = None
        self._lens: Lens | None = None
        self._unbent: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        T_main_camera = np.eye(4)
        if rig.mode == "stereo":
            pair = rectify(
                rig, width=self.width, height=self.height, view_angle_rad=self._settings.rectified_view_angle_rad
            )
            self.camera = self._take_pair(pair)
            T_main_camera[:3, :3] = pair.R_rectified_main.T
        else:
            self.camera = self._take_lens(rig)
        self.T_base_camera: NDArray[np.float64] = rig.T_base_main @ T_main_camera
        """Pose of the ideal camera in the base frame, float64 (4, 4)."""
        self.T_camera_imu: NDArray[np.float64] | None = (
            None if rig.T_main_imu is None else T_main_camera.T @ rig.T_main_imu
        )
        """Pose of the IMU in the ideal camera's frame, float64 (4, 4)."""
        self._equaliser = cv2.createCLAHE(3.0, (8, 8)) if self._settings.equalise else None

    @property
    def resampled(self) -> bool:
        """Whether stereo images are rectified here."""
        return self._maps is not None

    def prepare(self, measurement: Measurement) -> PreparedFrame:
        """Return the images of a measurement, ready for key points.

        Raises
        ------
        DataError
            If it is not what the rig gives, or an image has another size than the calibration.
        """
        if isinstance(measurement, StereoPair) and self.rig.mode == "stereo":
            colour = self._turned(self._checked(measurement.left), 0)
            right = self._turned(self._checked(measurement.right), 1)
            return PreparedFrame(
                stamp_ns=measurement.stamp_ns, grey=self._grey(colour, measurement.left),
                right=self._grey(right, measurement.right), colour=_red_first(colour, measurement.left),
            )  # fmt: skip
        if isinstance(measurement, RgbdFrame) and self.rig.mode == "rgbd":
            colour = self._resized(self._checked(measurement.colour))
            return PreparedFrame(
                stamp_ns=measurement.stamp_ns, grey=self._grey(colour, measurement.colour),
                depth=self._depth(measurement.depth), colour=_red_first(colour, measurement.colour),
            )  # fmt: skip
        if isinstance(measurement, Image) and self.rig.mode == "mono" and measurement.encoding != "depth":
            colour = self._resized(self._checked(measurement))
            return PreparedFrame(
                stamp_ns=measurement.stamp_ns, grey=self._grey(colour, measurement),
                colour=_red_first(colour, measurement),
            )  # fmt: skip
        raise DataError(f"{type(measurement).__name__} is no frame of a {self.rig.mode} camera")

    def to_pinhole(self, raw_pixels: NDArray[np.float64]) -> PinholePixels:
        """Return where pixels (N, 2) of the prepared image lie in the ideal camera."""
        if self._lens is None:
            n = len(raw_pixels)
            return PinholePixels(np.asarray(raw_pixels, dtype=np.float64), np.ones(n), np.ones(n, dtype=np.bool_))
        rays, stretch = self._lens.undistort(raw_pixels)
        furthest = math.tan(self._settings.view_angle_rad)
        inside = np.isfinite(stretch) & ((rays**2).sum(axis=1) <= furthest**2)
        pixels = rays * (self.camera.fx, self.camera.fy) + (self.camera.cx, self.camera.cy)
        pixels[~inside] = np.nan
        return PinholePixels(pixels, stretch * math.sqrt(self.camera.fx * self.camera.fy), inside)

    def undistorted(self, features: Features) -> Features:
        """Return features with `pixels` in the ideal camera and `sigmas` stretched; those outside are dropped."""
        if self._lens is None:
            return features
        moved = self.to_pinhole(features.raw_pixels)
        keep = np.flatnonzero(moved.inside)
        return Features(
            pixels=moved.pixels[keep], sigmas=features.sigmas[keep] * moved.stretch[keep],
            octaves=features.octaves[keep], angles=features.angles[keep], responses=features.responses[keep],
            descriptors=features.descriptors[keep], right=features.right[keep], depth=features.depth[keep],
            raw_pixels=features.raw_pixels[keep],
        )  # fmt: skip

    def through_pinhole(self, frame: PreparedFrame) -> PreparedFrame:
        """Return a prepared frame as the ideal camera sees it: its lens bends nothing (depth: the nearest pixel's).

        Pixels that the lens does not see are black, and of unknown depth. Stereo images are rectified already.
        """
        if self._lens is None:
            return frame
        if self._unbent is None:
            self._unbent = _bent_places(self._lens, self.width, self.height)
        u, v = self._unbent

        def moved(image: NDArray[Any] | None, how: int) -> Any:
            return None if image is None else cv2.remap(image, u, v, how)

        return replace(
            frame, grey=moved(frame.grey, cv2.INTER_LINEAR), colour=moved(frame.colour, cv2.INTER_LINEAR),
            depth=moved(frame.depth, cv2.INTER_NEAREST),
        )  # fmt: skip

    def _take_pair(self, pair: Rectification) -> Pinhole:
        if pair.left is not None and pair.right is not None:
            self._maps = (pair.left, pair.right)
        return pair.camera

    def _take_lens(self, rig: CameraRig) -> Pinhole:
        lens = lens_of(rig.main).scaled(self.width / rig.main.width, self.height / rig.main.height)
        baseline_m = 0.0
        if rig.mode == "rgbd":
            baseline_m = self._settings.virtual_baseline_m if rig.baseline_m is None else rig.baseline_m
            if not baseline_m > 0.0:
                raise CalibrationError(f"virtual baseline of RGB-D {baseline_m:g} m: must be more than 0 (about 0.08)")
        camera = Pinhole(
            fx=lens.fx, fy=lens.fy, cx=lens.cx, cy=lens.cy, width=self.width, height=self.height, baseline_m=baseline_m
        )
        if lens.ideal:
            return camera
        self._lens, self.camera = lens, camera
        border = self.to_pinhole(_border(self.width, self.height))
        if not border.inside.any():  # the image ends beyond the angle of view all round
            reach = math.tan(self._settings.view_angle_rad)
            low, high = np.full(2, -reach), np.full(2, reach)
            f, c = np.array([lens.fx, lens.fy]), np.array([lens.cx, lens.cy])
            return replace(camera, bounds=(*(low * f + c).tolist(), *(high * f + c).tolist()))
        seen = border.pixels[border.inside]
        return replace(camera, bounds=(*seen.min(axis=0).tolist(), *seen.max(axis=0).tolist()))

    def _checked(self, image: Image) -> NDArray[np.uint8]:
        height, width = image.pixels.shape[:2]
        if (width, height) != (self.rig.main.width, self.rig.main.height):
            raise DataError(
                f"image on {image.topic or 'a camera'} at {image.stamp_ns} ns is {width} x {height} pixels,"
                f" and the calibration is for {self.rig.main.width} x {self.rig.main.height}"
            )
        if image.pixels.dtype != np.uint8:
            raise DataError(f"image on {image.topic} at {image.stamp_ns} ns holds {image.encoding}, not grey or colour")
        return image.pixels.astype(np.uint8, copy=False)

    def _resized(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if pixels.shape[:2] == (self.height, self.width):
            return pixels
        smaller = self.width < pixels.shape[1]
        how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(pixels, (self.width, self.height), interpolation=how), dtype=np.uint8)

    def _turned(self, pixels: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
        if self._maps is None:
            return self._resized(pixels)
        return np.asarray(cv2.remap(pixels, *self._maps[side], cv2.INTER_LINEAR), dtype=np.uint8)

    def _grey(self, pixels: NDArray[np.uint8], image: Image) -> NDArray[np.uint8]:
        if pixels.ndim == 3:
            code = cv2.COLOR_RGB2GRAY if image.encoding == "rgb8" else cv2.COLOR_BGR2GRAY
            pixels = np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)
        if self._equaliser is not None:
            pixels = np.asarray(self._equaliser.apply(pixels), dtype=np.uint8)
        return np.ascontiguousarray(pixels)

    def _depth(self, image: Image) -> NDArray[np.float32]:
        """Return the depth, at the image's size: the nearest value where the depth has fewer or more pixels of the same view."""
        depth = np.asarray(image.pixels, dtype=np.float32)
        if depth.shape != (self.height, self.width):
            shape = depth.shape[1] * self.height, depth.shape[0] * self.width
            if abs(shape[0] - shape[1]) > 0.01 * shape[0]:
                raise DataError(
                    f"depth on {image.topic} at {image.stamp_ns} ns is {depth.shape[1]} x {depth.shape[0]} pixels and the"
                    f" colour image {self.rig.main.width} x {self.rig.main.height}: another view; give depth that is"
                    " registered to the colour camera"
                )
            depth = cv2.resize(depth, (self.width, self.height), interpolation=cv2.INTER_NEAREST).astype(np.float32)
        return np.ascontiguousarray(depth)


def _size(rig: CameraRig, settings: PreparationSettings) -> tuple[int, int]:
    """Return width and height of the prepared images."""
    width, height = rig.main.width, rig.main.height
    if width <= 0 or height <= 0:
        raise CalibrationError(f"camera {rig.main.topic or rig.main.frame_id}: image size {width} x {height}")
    if rig.right is not None and (rig.right.width, rig.right.height) != (width, height):
        raise CalibrationError(
            f"the left camera's images have {width} x {height} pixels, the right one's {rig.right.width} x {rig.right.height}"
        )
    if settings.width is None and settings.height is None:
        return width, height
    new_width = settings.width or max(1, round(width * (settings.height or height) / height))
    new_height = settings.height or max(1, round(height * new_width / width))
    return new_width, new_height


def _border(width: int, height: int) -> NDArray[np.float64]:
    """Return pixels (N, 2) along the border of an image, corners included."""
    u = np.linspace(0.0, width - 1.0, _BORDER_STEPS)
    v = np.linspace(0.0, height - 1.0, _BORDER_STEPS)
    sides = [np.column_stack([u, np.full_like(u, at)]) for at in (0.0, height - 1.0)]
    sides += [np.column_stack([np.full_like(v, at), v]) for at in (0.0, width - 1.0)]
    return np.vstack(sides)


def _bent_places(lens: Lens, width: int, height: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where each pixel of the ideal camera lies in the image of the lens, two float32 (H, W) maps."""
    v, u = np.mgrid[0:height, 0:width]
    rays = np.column_stack([(u.ravel() - lens.cx) / lens.fx, (v.ravel() - lens.cy) / lens.fy])
    places = lens.distort(rays).astype(np.float32).reshape(height, width, 2)
    places[~np.isfinite(places)] = -1e6
    return np.ascontiguousarray(places[..., 0]), np.ascontiguousarray(places[..., 1])


def _red_first(pixels: NDArray[np.uint8], image: Image) -> NDArray[np.uint8] | None:
    if pixels.ndim != 3:
        return None
    return pixels if image.encoding == "rgb8" else pixels[..., ::-1]
