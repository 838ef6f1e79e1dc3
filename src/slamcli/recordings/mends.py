# SPDX-License-Identifier: MIT
"""What is mended while a recording is read; the recording itself is never changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import CameraModel, FrameTransform

NO_RETURN_POLICIES = ("ignore", "free", "max")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mends:
    """Corrections that are applied while reading.

    `no_return` is the one policy for beams without return (+inf or at the scanner's maximum) of all tiers and costmaps:
    ``ignore`` them, let them clear the space up to the usable range (``free``), or take them as a hit there (``max``).
    """

    time_offsets_ns: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Added to the header stamps of a topic."""
    renamed_frames: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """New frame name by recorded name (without a leading slash)."""
    static_transforms: tuple[FrameTransform, ...] = ()
    """Win over what the recording says about their child frames."""
    model_transforms: tuple[FrameTransform, ...] = ()
    """Fixed joints of a robot model (URDF): used where the recording says nothing about their child frames."""
    camera_models: Mapping[str, CameraModel] = field(default_factory=lambda: MappingProxyType({}))
    """Replace the CameraInfo of a topic, or of every topic where the key is empty."""
    flip_scan: bool = False
    """Mirror laser scans: beams run clockwise instead of counter-clockwise, or the other way round."""
    depth_units_per_m: float | None = None
    """Raw depth value of one metre (1000 for millimetres, 5000 for TUM RGB-D); None for what the encoding says."""
    settings_depth_units_per_m: float | None = None
    """The same by a tier's settings (ORB-SLAM's DepthMapFactor): for whole numbers alone, because depth in fractions is in
    metres whatever the files were that it was made of. `depth_units_per_m` goes before it."""
    no_return: str = "ignore"
    shared: bool = False
    """Several recordings are read with these: what one of them does not need is no mistake."""
    laser_pose: NDArray[np.float64] | None = None
    """float64 (3,) or None: x, y, yaw of the scanner in the base frame, used instead of the recording's transforms."""
