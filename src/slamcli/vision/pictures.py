# SPDX-License-Identifier: MIT
"""Small pictures of what a camera saw, kept for people to look at: nothing is computed from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """An image at a whole fraction of its size, about 10 kB."""

    jpeg: bytes
    width: int
    height: int
    factor: int
    """Image pixels per picture pixel."""

    def places(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where pixels (N, 2) of the image lie in the picture."""
        return (pixels + 0.5) / self.factor - 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KeyframeView:
    """The picture of a keyframe or node, and the key points in it that count."""

    stamp_ns: int
    picture: Picture
    places: NDArray[np.float64]
    """float64 (N, 2), picture pixels."""
    num_features: int
    """Key points of the image, those that see nothing too."""
    name: str = ""
    """What the tier calls it; empty: nothing."""
    of_this_run: bool = True
    """Whether it was seen in this run; its time says nothing otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceView:
    """The same place at two times: what closed a loop, joined two maps, or was held for the same place and is not."""

    older: KeyframeView
    """With `places` (M, 2) of the matches alone."""
    newer: KeyframeView
    """The same, row by row."""
    kind: Literal["loop", "join", "near", "refused"] = "loop"
    reason: str = ""
    """Why it was refused, a sentence."""
