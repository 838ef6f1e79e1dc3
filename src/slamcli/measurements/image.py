# SPDX-License-Identifier: MIT
"""One image: grey, colour or depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """Decoded pixels: uint8 (H, W) grey, uint8 (H, W, 3) in the order of `encoding` (rgb8 or bgr8), or depth.

    Depth is float32 (H, W) in metres with encoding "depth"; 0 and NaN mean "no depth". What is to be written as whole
    millimetres (16UC1) is uint16; nothing that is read is.
    """

    stamp_ns: int
    frame_id: str
    encoding: str
    """mono8, rgb8, bgr8 or depth."""
    pixels: NDArray[np.uint8] | NDArray[np.float32] | NDArray[np.uint16]
    topic: str = ""

    def __post_init__(self) -> None:
        shapes = {"mono8": 2, "rgb8": 3, "bgr8": 3, "depth": 2}
        if self.pixels.ndim != shapes.get(self.encoding, -1):
            raise DataError(f"image at {self.stamp_ns} ns: {self.encoding} pixels of shape {self.pixels.shape}")
