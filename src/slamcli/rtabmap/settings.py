# SPDX-License-Identifier: MIT
"""From parameters to what the parts of the tier are told."""

from __future__ import annotations

from dataclasses import replace

from slamcli.measurements import CameraRig
from slamcli.rtabmap.feature_settings import Detector, FeatureSettings
from slamcli.rtabmap.parameters import KpGroup, RtabmapParameters, VisGroup
from slamcli.rtabmap.scan_odometry import ScanOdometrySettings
from slamcli.vision.corner_description import OpenCvOrbSettings
from slamcli.vision.gftt import GfttSettings
from slamcli.vision.orb import OrbSettings
from slamcli.vision.preparation import PreparationSettings
from slamcli.vision.row_matching import RowMatchSettings


def preparation_settings(parameters: RtabmapParameters, rig: CameraRig) -> PreparationSettings:
    """Return how images are prepared: made Mem/ImagePreDecimation times smaller."""
    step = parameters.mem.image_pre_decimation
    return PreparationSettings(
        width=None if step <= 1 else max(16, round(rig.main.width / step)), virtual_baseline_m=parameters.g2o.baseline
    )


def feature_settings(parameters: RtabmapParameters) -> FeatureSettings:
    """Return which key points odometry follows (Vis/*); the strongest Kp/MaxFeatures of them become words of a node."""
    vis = parameters.vis
    settings = _extraction(parameters, vis, Detector(vis.feature_type))
    return replace(
        settings, depth_as_mask=vis.depth_as_mask, floor_threshold_m=vis.depth_mask_floor_thr,
        decimation=parameters.odom.image_decimation,
    )  # fmt: skip


def word_settings(parameters: RtabmapParameters) -> FeatureSettings:
    """Return which key points a node has that does not take those of odometry (Kp/*)."""
    kp = parameters.kp
    settings = _extraction(parameters, kp, Detector(kp.detector_strategy))
    mask, floor = parameters.mem.depth_as_mask, parameters.mem.depth_mask_floor_thr
    return replace(settings, depth_as_mask=mask, floor_threshold_m=floor)


def words_are_odometrys(parameters: RtabmapParameters) -> bool:
    """Return whether nodes take the key points of own visual odometry: if asked, and both are of one kind."""
    same = parameters.kp.detector_strategy == parameters.vis.feature_type
    return parameters.slamcli.odometry in ("visual", "guided") and parameters.mem.use_odom_features and same


def _extraction(parameters: RtabmapParameters, group: KpGroup | VisGroup, detector: Detector) -> FeatureSettings:
    """Return what both have in common; enough points are taken for words and for matching."""
    gftt, orb, stereo = parameters.gftt, parameters.orb, parameters.stereo
    unbounded = 0 in (parameters.vis.max_features, parameters.kp.max_features)
    most = 0 if unbounded else max(parameters.vis.max_features, parameters.kp.max_features)
    return FeatureSettings(
        detector=detector, max_features=most, min_depth_m=group.min_depth, max_depth_m=group.max_depth, roi_ratios=group.roi,
        grid_rows=group.grid_rows, grid_columns=group.grid_cols, spread=group.ssc, subpixel_window=group.sub_pix_win_size,
        subpixel_iterations=group.sub_pix_iterations, subpixel_epsilon=group.sub_pix_eps,
        gftt=GfttSettings(
            quality_level=gftt.quality_level, min_distance=gftt.min_distance, block_size=gftt.block_size,
            harris=gftt.use_harris_detector, harris_k=gftt.k,
        ),
        orb=OpenCvOrbSettings(
            num_features=most or 100_000, scale_factor=orb.scale_factor, num_levels=orb.n_levels,
            edge_threshold=orb.edge_threshold, first_level=orb.first_level, wta_k=orb.wta_k, fast_score=orb.score_type == 1,
            patch_size=orb.patch_size, fast_threshold=parameters.fast.threshold,
        ),
        octree=OrbSettings(
            num_features=most or 100_000, initial_threshold=parameters.fast.threshold,
            minimum_threshold=min(parameters.fast.min_threshold, parameters.fast.threshold),
        ),
        rows=RowMatchSettings(
            window_width=stereo.win_width, window_height=stereo.win_height, min_disparity=stereo.min_disparity,
            max_disparity=stereo.max_disparity, squared=stereo.ssd,
        ),
        depth_weight=parameters.slamcli.depth_weight,
    )  # fmt: skip


def scan_odometry_settings(parameters: RtabmapParameters, no_return: str) -> ScanOdometrySettings:
    """Return how planar scans are aligned (Icp/*, Odom/*)."""
    icp = parameters.icp
    return ScanOdometrySettings(
        cell_m=icp.voxel_size or 0.05, deskewing=parameters.odom.deskewing, range_min_m=icp.range_min, range_max_m=icp.range_max,
        no_return=no_return,
    )  # fmt: skip
