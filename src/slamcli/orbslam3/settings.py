# SPDX-License-Identifier: MIT
"""The settings of each part, from the tier's parameters and the cameras."""

from __future__ import annotations

import math

from slamcli.grids.depth_projection import DepthGridSettings
from slamcli.measurements import CameraRig
from slamcli.orbslam3.keyframe_rules import KeyframeSettings
from slamcli.orbslam3.local_mapping import MappingSettings
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.session_settings import SessionSettings
from slamcli.orbslam3.tracking import TrackingSettings
from slamcli.vision.orb import OrbSettings
from slamcli.vision.pinhole import Pinhole

_LEAST_GAP_S = 0.15
"""Between two keyframes of a camera with depth, unless tracking is weak: what is seen sooner again tells next to nothing."""


def orb_settings(parameters: OrbSlam3Parameters) -> OrbSettings:
    """Return how key points are found."""
    extractor = parameters.extractor
    return OrbSettings(
        num_features=extractor.num_features,
        scale_factor=extractor.scale_factor,
        num_levels=extractor.num_levels,
        initial_threshold=extractor.initial_threshold,
        minimum_threshold=extractor.minimum_threshold,
    )


def grid_settings(parameters: OrbSlam3Parameters) -> DepthGridSettings:
    """Return what of the depth goes into the occupancy grid."""
    own = parameters.slamcli
    return DepthGridSettings(
        resolution_m=own.grid_resolution, low_m=own.grid_low, high_m=own.grid_high, reach_m=own.grid_reach
    )


def session_settings(parameters: OrbSlam3Parameters, rig: CameraRig, camera: Pinhole, seed: int) -> SessionSettings:
    """Return how a session tracks and maps; thresholds are ORB-SLAM3's for the kind of camera."""
    mono = rig.mode == "mono"
    close_m = math.inf if mono else parameters.device.stereo.th_depth * camera.baseline_m
    farthest_m = parameters.system.th_far_points or math.inf
    rate_hz = parameters.device.camera.fps or rig.rate_hz
    return SessionSettings(
        tracking=TrackingSettings(
            motion_radius=7.0 if rig.mode == "stereo" else 15.0,
            local_radius=3.0 if rig.mode == "rgbd" else 1.0,
            close_m=close_m,
            seed=seed,
        ),
        keyframes=KeyframeSettings(
            share=parameters.slamcli.keyframe_share,
            close_m=close_m,
            least_gap=max(1, round((0.1 if mono else _LEAST_GAP_S) * rate_hz)),
            most_gap=max(1, round(rate_hz)),
        ),
        mapping=MappingSettings(
            num_neighbours=20 if mono else 10,
            close_m=close_m,
            farthest_m=farthest_m,
            least_observations=2 if mono else 3,
        ),
        close_m=close_m,
        farthest_m=farthest_m,
        least_start=min(500, parameters.extractor.num_features // 4),
        seed=seed,
        mend_disparities=rig.mode == "stereo" and parameters.slamcli.mend_disparities,
        final_bundle_adjustment=parameters.slamcli.final_bundle_adjustment,
        check_focal_length=rig.mode == "rgbd" and parameters.slamcli.check_focal_length,
        reckons_keyframes=parameters.device.imu.insert_keyframes_when_lost,
        places=PlaceSettings(fix_scale=not mono, seed=seed) if parameters.loop_closing else None,
    )
