# SPDX-License-Identifier: MIT
"""Images with depth whose place is known, for dense models."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.pinhole import Pinhole


class PosedView(NamedTuple):
    """Colours and depth as the ideal camera saw them, and where it was."""

    colour: NDArray[np.uint8]
    """uint8 (H, W, 3), red, green, blue."""
    depth: NDArray[np.float32]
    """float32 (H, W), metres along z; 0 where unknown."""
    camera: Pinhole
    T_map_camera: NDArray[np.float64]
    """float64 (4, 4)."""


class DepthViews(Protocol):
    """Views that can be gone through more than once, one at a time."""

    def __iter__(self) -> Iterator[PosedView]:
        """Go through them in the order of time."""
