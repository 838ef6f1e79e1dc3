# SPDX-License-Identifier: MIT
"""How key points are found."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from slamcli.vision.corner_description import OpenCvOrbSettings
from slamcli.vision.gftt import GfttSettings
from slamcli.vision.orb import OrbSettings
from slamcli.vision.row_matching import RowMatchSettings


class Detector(IntEnum):
    """Those of RTAB-Map's detectors whose descriptors have 256 bits; its numbers."""

    ORB = 2
    GFTT_BRIEF = 6
    GFTT_ORB = 8
    ORB_OCTREE = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSettings:
    """What is taken from an image."""

    detector: Detector = Detector.ORB_OCTREE
    max_features: int = 1000
    """The strongest; 0: all."""
    min_depth_m: float = 0.0
    max_depth_m: float = 0.0
    """0: no limit. What has a depth beyond is dropped."""
    depth_as_mask: bool = True
    """Whether only pixels with a depth are looked at (RGB-D)."""
    floor_threshold_m: float = 0.0
    """With `depth_as_mask`: pixels lower than this in the base frame are left out; 0: none."""
    roi_ratios: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Shares of the image that are cut off left, right, at the top and at the bottom."""
    grid_rows: int = 1
    grid_columns: int = 1
    """Each cell gives its share of `max_features`."""
    spread: bool = False
    """Whether suppression via square covering chooses, and not strength alone."""
    subpixel_window: int = 3
    subpixel_iterations: int = 0
    """0: corners stay where the detector found them."""
    subpixel_epsilon: float = 0.02
    decimation: int = 1
    """The image is made so many times smaller before."""
    gftt: GfttSettings = field(default_factory=GfttSettings)
    orb: OpenCvOrbSettings = field(default_factory=OpenCvOrbSettings)
    octree: OrbSettings = field(default_factory=OrbSettings)
    rows: RowMatchSettings = field(default_factory=RowMatchSettings)
    """How corners are found again in the right image."""
    depth_weight: float = 3.0
    """How much better than the virtual right camera of RGB-D would tell depth is measured."""

    @property
    def scales(self) -> tuple[float, ...]:
        """Of the levels of the image pyramid that key points come from."""
        if self.detector is Detector.ORB_OCTREE:
            return tuple(self.octree.scale_factor**level for level in range(self.octree.num_levels))
        if self.detector is Detector.ORB:
            return tuple(self.orb.scale_factor**level for level in range(self.orb.num_levels))
        return (1.0,)
