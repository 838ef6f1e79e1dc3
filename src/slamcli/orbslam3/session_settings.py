# SPDX-License-Identifier: MIT
"""What a session is built with."""

from __future__ import annotations

from dataclasses import dataclass, field

from slamcli.orbslam3.keyframe_rules import KeyframeSettings
from slamcli.orbslam3.local_mapping import MappingSettings
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.relocalisation import RelocalisationSettings
from slamcli.orbslam3.tracking import TrackingSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionSettings:
    """What the parts of a session are built with."""

    tracking: TrackingSettings
    keyframes: KeyframeSettings
    mapping: MappingSettings
    close_m: float
    farthest_m: float
    least_start: int = 500
    """Features that the first keyframe of a camera with depth needs."""
    seed: int = 0
    places: PlaceSettings | None = None
    """How places are recognised; None: loops are not closed, maps not joined."""
    reckons_keyframes: bool = True
    """Whether a lost camera that measures depth begins anew where the IMU says it is (IMU.InsertKFsWhenLost)."""
    lost: RelocalisationSettings = field(default_factory=RelocalisationSettings)
    patience_ns: int = 2_000_000_000
    """So long, and for five frames at least, a lost frame is looked for in the map; then another map is begun where the track was lost."""
    mend_disparities: bool = False
    """Whether an error that all disparities share is looked for at the end (stereo)."""
    final_bundle_adjustment: bool = True
    """Whether each map is adjusted as a whole at the end (with an IMU it always is)."""
    check_focal_length: bool = False
    """Whether the focal lengths that fit best are looked for at the end (RGB-D)."""
    localise_only: bool = False
    """Whether the maps that were given stay as they are."""
