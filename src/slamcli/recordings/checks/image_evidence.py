# SPDX-License-Identifier: MIT
"""What the images of a topic showed: every message's size and bytes, and the pixels of a sample spread over the recording."""

from __future__ import annotations

import zlib
from array import array
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import Image
from slamcli.recordings.adapters.compressed_image import image_size
from slamcli.recordings.raw import RawMessage, Topic

_SAMPLE = 150
"""About so many images of a topic are decoded."""
_HEAD_BYTES = 1 << 16
_BEHIND_STAMP = 12
"""Bytes up to and with the header's stamp, in ROS 1 and in CDR."""


@dataclass(slots=True)
class ImageEvidence:
    """The images of one topic."""

    stride: int
    first: Image | None = None
    num: int = 0
    sizes: Counter[tuple[int, int]] = field(default_factory=Counter)
    """Width and height, as each message's head says it."""
    size_change_ns: int | None = None
    """Log time of the first image of another size than the first one's."""
    num_repeated: int = 0
    """Images with exactly the bytes of the one before."""
    repeated_ns: int | None = None
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    """Of the sample."""
    brightness: array[float] = field(default_factory=lambda: array("d"))
    """Mean grey value, 0 to 255."""
    contrast: array[float] = field(default_factory=lambda: array("d"))
    """Standard deviation of the grey values."""
    sharpness: array[float] = field(default_factory=lambda: array("d"))
    """Variance of the Laplacian over that of the grey values."""
    depth_m: array[float] = field(default_factory=lambda: array("d"))
    """Median of the depths of an image, NaN where it has none."""
    depth_share: array[float] = field(default_factory=lambda: array("d"))
    """Share of pixels with depth."""
    _digest: int = -1

    @classmethod
    def of(cls, topic: Topic) -> ImageEvidence:
        """Return the evidence of a topic that nothing was seen of yet."""
        return cls(stride=max(1, (topic.count or 10 * _SAMPLE) // _SAMPLE))

    @property
    def num_sampled(self) -> int:
        """Images that were decoded."""
        return len(self.stamps_ns)

    def glance(self, raw: RawMessage, message: Any) -> bool:
        """Take in what shows without decoding pixels; return whether to decode this image."""
        digest = zlib.crc32(memoryview(raw.data)[_BEHIND_STAMP:])
        if digest == self._digest:
            self.num_repeated += 1
            self.repeated_ns = raw.log_time_ns if self.repeated_ns is None else self.repeated_ns
        self._digest = digest
        size = _size(message)
        if size[0] * size[1]:
            if self.sizes and size not in self.sizes and self.size_change_ns is None:
                self.size_change_ns = raw.log_time_ns
            self.sizes[size] += 1
        self.num += 1
        return (self.num - 1) % self.stride == 0 or self.first is None

    def see(self, _message: Any, image: Image) -> None:
        """Take in the pixels of an image."""
        self.first = self.first if self.first is not None else image
        self.stamps_ns.append(image.stamp_ns)
        if image.encoding == "depth":
            self._see_depth(np.asarray(image.pixels, dtype=np.float32))
        else:
            self._see_grey(image)

    def _see_depth(self, depth: NDArray[np.float32]) -> None:
        some = depth[::4, ::4].ravel()
        known = some[np.isfinite(some) & (some > 0)]
        self.depth_m.append(float(np.median(known)) if len(known) else float("nan"))
        self.depth_share.append(len(known) / max(len(some), 1))

    def _see_grey(self, image: Image) -> None:
        import cv2

        pixels = np.asarray(image.pixels, dtype=np.uint8)
        grey = pixels if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., 1])  # green is most of what is bright
        spread = float(grey.std())
        edges = np.asarray(cv2.Laplacian(grey, cv2.CV_32F))
        self.brightness.append(float(grey.mean()))
        self.contrast.append(spread)
        self.sharpness.append(float(edges.var()) / (spread**2 + 1.0))


def _size(message: Any) -> tuple[int, int]:
    """Return width and height of an Image or a CompressedImage without decoding it, (0, 0) where they do not show."""
    if hasattr(message, "width"):
        return int(message.width), int(message.height)
    data = np.asarray(message.data[:_HEAD_BYTES], dtype=np.uint8).tobytes()
    return image_size(data)
