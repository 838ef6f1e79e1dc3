# SPDX-License-Identifier: MIT
"""How visual odometry tracks and keeps its local map."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from slamcli.rtabmap.parameters import RtabmapParameters


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
    least_motion_px: float = 0.0
    """By which key points moved on average since the last keyframe, before another is made; 0: any."""
    most_views: int = 0
    """Of a point that count in the adjustment, the newest; 0: all."""
    min_inliers: int = 20
    """Points that a pose must explain."""
    keyframe_share: float = 0.3
    """A frame becomes a keyframe when its inliers fall below this share of its key points,"""
    keyframe_inliers: int = 150
    """or below this number,"""
    keyframe_kept: float = 0.75
    """or (slamcli's own) below this share of what the last keyframe saw; 0: RTAB-Map's rules alone,"""
    keyframe_gap_ns: int = 60_000_000
    """if, for the last rule, the last one is so old and not the frame before,"""
    keyframe_age_ns: int = 150_000_000
    """or so old and the frame before."""
    window: float = 40.0
    """Pixels around the prediction in which points are looked for where the guess is poor."""
    ratio: float = 0.8
    """Of the distance of descriptors to that of the second best."""
    iterations: int = 300
    """Samples of RANSAC."""
    guess_motion: bool = True
    """Whether motion goes on as it was."""
    smoothing_ns: int = 0
    """The motion so far is the mean over this time."""
    reset_countdown: int = 10
    """After so many lost frames odometry begins anew; 0: never."""
    holonomic: bool = True
    filtering: Filtering = Filtering.NONE
    kalman_process: float = 0.001
    kalman_measurement: float = 0.01
    particles: int = 400
    particle_noise_t: float = 0.002
    """Metres a second."""
    particle_lambda_t: float = 100.0
    particle_noise_r: float = 0.002
    """Radians a second."""
    particle_lambda_r: float = 100.0
    floor_threshold_m: float = 0.0
    """Points lower than this above the base frame are not taken; 0: all are."""
    seed: int = 0

    @property
    def filters_motion(self) -> bool:
        """Whether the poses that are given out are others than those that were found."""
        return self.filtering is not Filtering.NONE or not self.holonomic


def odometry_settings(parameters: RtabmapParameters, scales: tuple[float, ...], seed: int) -> OdometrySettings:
    """Return how odometry tracks, by ``Odom/*``, ``OdomF2M/*`` and ``Vis/*``.

    Parameters
    ----------
    scales
        `FeatureSettings.scales` of the key points that it is given.
    seed
        Of RANSAC and the particle filter.
    """
    odom, f2m, vis = parameters.odom, parameters.odom_f2m, parameters.vis
    return OdometrySettings(
        scales=scales, frame_to_map=odom.strategy == 0, map_size=f2m.max_size, most_new=f2m.max_new_features,
        bundle_frames=f2m.bundle_adjustment_max_frames, adjust=f2m.bundle_adjustment != 0,
        least_motion_px=f2m.bundle_adjustment_min_motion, most_views=f2m.bundle_adjustment_max_key_frames_per_feature, min_inliers=vis.min_inliers,
        keyframe_share=odom.key_frame_thr, keyframe_inliers=odom.vis_key_frame_thr, window=float(vis.cor_guess_win_size),
        ratio=vis.cor_nndr, iterations=vis.iterations, guess_motion=odom.guess_motion,
        smoothing_ns=round(odom.guess_smoothing_delay * 1e9), reset_countdown=odom.reset_countdown, holonomic=odom.holonomic,
        filtering=Filtering(odom.filtering_strategy), kalman_process=odom.kalman_process_noise,
        kalman_measurement=odom.kalman_measurement_noise, particles=odom.particle_size, particle_noise_t=odom.particle_noise_t,
        particle_lambda_t=odom.particle_lambda_t, particle_noise_r=odom.particle_noise_r,
        particle_lambda_r=odom.particle_lambda_r, floor_threshold_m=f2m.floor_threshold, seed=seed,
    )  # fmt: skip
