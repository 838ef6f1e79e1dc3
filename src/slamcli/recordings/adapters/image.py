# SPDX-License-Identifier: MIT
"""sensor_msgs/Image: grey, colour, Bayer, YUV and depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import Image
from slamcli.recordings.adapters.adapter import Adapter
from slamcli.recordings.adapters.context import DecodeContext
from slamcli.recordings.adapters.messages import MessageFactory

MILLIMETRES_PER_M = 1000.0

# Encoding -> dtype, channels, what the pixels are.
_LAYOUTS: dict[str, tuple[str, int, str]] = {
    "mono8": ("u1", 1, "mono8"),
    "8UC1": ("u1", 1, "mono8"),
    "rgb8": ("u1", 3, "rgb8"),
    "bgr8": ("u1", 3, "bgr8"),
    "8UC3": ("u1", 3, "bgr8"),
    "rgba8": ("u1", 4, "rgb8"),
    "bgra8": ("u1", 4, "bgr8"),
    "8UC4": ("u1", 4, "bgr8"),
    "rgb16": ("u2", 3, "rgb8"),
    "bgr16": ("u2", 3, "bgr8"),
    "mono16": ("u2", 1, "mono16"),
    "16UC1": ("u2", 1, "depth"),
    "32FC1": ("f4", 1, "depth"),
    "yuv422": ("u1", 2, "uyvy"),
    "uyvy": ("u1", 2, "uyvy"),
    "yuv422_yuy2": ("u1", 2, "yuyv"),
    "yuyv": ("u1", 2, "yuyv"),
    **{f"bayer_{pattern}{bits}": (kind, 1, pattern) for pattern in ("rggb", "bggr", "gbrg", "grbg")
       for bits, kind in (("8", "u1"), ("16", "u2"))},
}  # fmt: skip
# OpenCV names a Bayer pattern after the second row's second and third pixel, ROS after the first row's first two.
_CV_BAYER = {"rggb": "BayerBG", "bggr": "BayerRG", "gbrg": "BayerGR", "grbg": "BayerGB"}


def _decode(message: Any, stamp_ns: int, context: DecodeContext) -> tuple[Image]:
    encoding = "8UC1" if message.encoding == "" else message.encoding
    if encoding not in _LAYOUTS:
        raise DataError(f"image encoding {encoding!r} is not decoded (known: {', '.join(_LAYOUTS)})")
    kind, channels, meaning = _LAYOUTS[encoding]
    pixels = _pixels(message, np.dtype((">" if message.is_bigendian else "<") + kind), channels)
    is_depth = meaning == "depth" or (meaning == "mono16" and "depth" in context.topic)
    encoding, converted = ("depth", to_metres(pixels, context)) if is_depth else _to_8_bit(pixels, meaning)
    image = Image(
        stamp_ns=stamp_ns,
        frame_id=context.frame(message.header.frame_id),
        encoding=encoding,
        pixels=converted,
        topic=context.topic,
    )
    return (image,)


def _pixels(message: Any, dtype: np.dtype, channels: int) -> NDArray[Any]:
    """Return a view of a message's pixels, (H, W) or (H, W, C)."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    row = width * channels * dtype.itemsize
    step = step or row
    if height * width == 0 or step < row or len(data) < (height - 1) * step + row:
        raise DataError(f"image of {width} x {height} ({message.encoding}, step {step}) in {len(data)} bytes of data")
    shape = (height, width) if channels == 1 else (height, width, channels)
    strides = (step, dtype.itemsize * channels, dtype.itemsize)[: len(shape)]
    return np.ndarray(shape, dtype=dtype, buffer=data, strides=strides)


def to_metres(pixels: NDArray[Any], context: DecodeContext) -> NDArray[np.float32]:
    """Return depth in metres, float32 (H, W): whole numbers are millimetres, fractions metres (REP 118).

    The mends' units per metre go before both, those of settings before millimetres.
    """
    units = context.mends.depth_units_per_m
    if units is None:
        by_settings = context.mends.settings_depth_units_per_m
        whole = np.issubdtype(pixels.dtype, np.integer)
        units = (by_settings or MILLIMETRES_PER_M) if whole else 1.0
        if not whole and by_settings not in (None, 1.0):
            context.log.note(
                f"{context.topic}: depth is in metres (32FC1) already: DepthMapFactor {by_settings:g} is for whole numbers and "
                "not applied; --depth-scale is applied to either"
            )
    depth = pixels.astype(np.float32)
    if units != 1.0:
        depth /= np.float32(units)
    return depth


def _to_8_bit(pixels: NDArray[Any], meaning: str) -> tuple[str, NDArray[np.uint8]]:
    """Return the encoding and the pixels of a camera image, uint8 (H, W) or (H, W, 3)."""
    if pixels.dtype.itemsize == 2:
        pixels = (pixels >> 8).astype(np.uint8)
    if meaning in ("mono8", "mono16"):
        return "mono8", np.array(pixels)
    if meaning in ("rgb8", "bgr8"):
        return meaning, np.ascontiguousarray(pixels[..., :3]) if pixels.shape[2] == 4 else np.array(pixels)
    import cv2

    pixels = np.ascontiguousarray(pixels)
    if meaning in _CV_BAYER:
        return "bgr8", np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{_CV_BAYER[meaning]}2BGR")))
    code = cv2.COLOR_YUV2BGR_UYVY if meaning == "uyvy" else cv2.COLOR_YUV2BGR_YUY2
    if pixels.shape[1] % 2:
        raise DataError(f"image encoding yuv422 with an odd width of {pixels.shape[1]}")
    return "bgr8", np.asarray(cv2.cvtColor(pixels, code))


def _encode(image: Image, messages: MessageFactory) -> Any:
    pixels = np.ascontiguousarray(image.pixels)
    encoding = image.encoding
    if encoding == "depth":
        encoding = "16UC1" if pixels.dtype == np.uint16 else "32FC1"
    return messages.make(
        "sensor_msgs/msg/Image",
        messages.header(image.stamp_ns, image.frame_id),
        pixels.shape[0],
        pixels.shape[1],
        encoding,
        0,
        pixels.nbytes // max(pixels.shape[0], 1),
        pixels.reshape(-1).view(np.uint8),
    )


ADAPTER = Adapter(msgtypes=("sensor_msgs/msg/Image",), produces=Image, decode=_decode, encode=_encode)
