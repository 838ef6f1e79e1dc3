# SPDX-License-Identifier: MIT
"""How visual odometry tracks and keeps its local map."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Filtering(IntEnum):
    """What smooths the poses that odometry gives out."""

    NONE = 0
    KALMAN = 1
    PARTICLE = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometrySettings:
    """Thresholds; the defaults are those of RTAB-Map but where the docstring says otherwise."""

    scales: tuple[float, ...]
    """Of the levels of the image pyramid that key points come from."""
    frame_to_map: bool = True
    """Or else to the last keyframe alone."""
    map_size: int = 2000
    """Points of the local map at most."""
    most_new: int = 0
    """Points that a keyframe adds at most; 0: any."""
    bundle_frames: int = 10
    """Keyframes that the local bundle adjustment moves; 0: all."""
    adjust: bool = True
    min_inliers: int = 20
    """Points that a pose must explain."""
    keyframe_share: float = 0.3
    """A frame becomes a keyframe when its inliers fall below this share of its key points,"""
    keyframe_inliers: int = 150
    """or below this number,"""
    keyframe_kept: float = 0.75
    """or (slamcli's own) below this share of what the last keyframe saw; 0: RTAB-Map's rules alone,"""
    keyframe_gap_ns: int = 150_000_000
    """if the last one is so old for the last rule."""
    window: float = 40.0
    """Pixels around the prediction in which points are looked for where the guess is poor."""
    ratio: float = 0.8
    """Of the distance of descriptors to that of the second best."""
    reprojection_px: float = 2.0
    """Error that RANSAC allows."""
    iterations: int = 300
    """Samples of RANSAC."""
    guess_motion: bool = True
    """Whether motion goes on as it was."""
    smoothing_ns: int = 0
    """The motion so far is the mean over this time."""
    reset_countdown: int = 0
    """After so many lost frames odometry begins anew; 0: never."""
    holonomic: bool = True
    filtering: Filtering = Filtering.NONE
    kalman_process: float = 0.001
    kalman_measurement: float = 0.01
    floor_threshold_m: float | None = None
    """Points lower than this above the base frame are not taken; None: all are."""
    align_with_ground: bool = False
