# SPDX-License-Identifier: MIT
"""One image as tracking works on it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid
from slamcli.vision.pictures import Picture


def _origin() -> NDArray[np.float64]:
    return np.eye(4)


@dataclass(slots=True, kw_only=True, eq=False)
class Frame:
    """Key points of one moment, and what tracking found out about them."""

    number: int
    """Position among the frames that the mapper was given."""
    stamp_ns: int
    features: Features
    grid: FeatureGrid
    T_camera_map: NDArray[np.float64] = field(default_factory=_origin)
    """float64 (4, 4); the identity until it is tracked."""
    points: NDArray[np.int64]
    """(N,), map point that each feature sees, or -1."""
    reference: int = -1
    """Keyframe that shares most points with it."""
    colours: NDArray[np.uint8] | None = None
    """(N, 3) RGB at the key points."""
    picture: Picture | None = None
    """For people to look at, where it becomes a keyframe."""
    depth: NDArray[np.float16] | None = None
    """(M,) metres at every few pixels (`slamcli.orbslam3.frame_making.FrameMaker.depth_pixels`), for the occupancy grid."""

    @property
    def num_points(self) -> int:
        """How many features see a map point."""
        return int((self.points >= 0).sum())


def repeats(last: Frame, frame: Frame) -> bool:
    """Return whether a frame shows the very image of the last one, as drivers send when they have no new one."""
    one, other = last.features, frame.features
    return (
        len(one) == len(other) > 0
        and np.array_equal(one.pixels, other.pixels)
        and np.array_equal(one.descriptors, other.descriptors)
    )
