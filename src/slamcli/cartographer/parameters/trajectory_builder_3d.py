# SPDX-License-Identifier: MIT
"""``TRAJECTORY_BUILDER_3D``: local SLAM in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

from slamcli.cartographer.parameters.tables import (
    AdaptiveVoxelFilter,
    CeresSolverOptions,
    MotionFilter,
    PoseExtrapolator,
    RealTimeCorrelativeScanMatcher,
    count,
    length,
    weight,
)
from slamcli.errors import ConfigError
from slamcli.parameters import group, parameter

_NOT_USED = "(not used here: matching goes by shape alone)"


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityCostFunction:
    """Term of the alignment that compares intensities."""

    weight: float = weight(0.5, f"weight of the intensities {_NOT_USED}", effective=False)
    huber_scale: float = parameter(
        0.3, f"larger differences of intensities count linearly {_NOT_USED}", minimum=1e-9, maximum=1e6, effective=False
    )
    intensity_threshold: float = parameter(
        40.0, f"brighter points are left out of it {_NOT_USED}", minimum=0.0, maximum=1e9, effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CeresScanMatcher3d:
    """Non-linear alignment of a scan with the high and the low resolution grid."""

    occupied_space_weight_0: float = weight(1.0, "weight of the points on obstacles of the high resolution grid")
    occupied_space_weight_1: float = weight(6.0, "weight of the points on obstacles of the low resolution grid")
    intensity_cost_function_options_0: IntensityCostFunction = group(IntensityCostFunction())
    translation_weight: float = weight(5.0, "weight of staying where the search started")
    rotation_weight: float = weight(4e2, "weight of keeping the orientation that was predicted")
    only_optimize_yaw: bool = parameter(False, "leave roll and pitch as predicted")
    ceres_solver_options: CeresSolverOptions = group(CeresSolverOptions(max_num_iterations=12))


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeDataInserter3d:
    """How a scan changes the odds of voxels."""

    hit_probability: float = parameter(0.55, "probability that a hit multiplies in", minimum=0.500001, maximum=0.999)
    miss_probability: float = parameter(
        0.49, "probability that a crossing multiplies in", minimum=0.001, maximum=0.499999
    )
    num_free_space_voxels: int = count(2, "voxels before a hit that become freer")
    intensity_threshold: float = parameter(
        40.0, f"brighter points leave no intensity in the submap {_NOT_USED}", minimum=0.0, maximum=1e9, effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Submaps3d:
    """Submaps of local SLAM."""

    high_resolution: float = parameter(0.10, "edge of a voxel of the fine grid", unit="m", minimum=1e-3, maximum=10.0)
    high_resolution_max_range: float = length(20.0, "farther points do not enter the fine grid", 1e-3)
    low_resolution: float = parameter(0.45, "edge of a voxel of the coarse grid", unit="m", minimum=1e-3, maximum=100.0)
    num_range_data: int = count(160, "scans until the next submap starts; a submap is finished at twice that", 1)
    range_data_inserter: RangeDataInserter3d = group(RangeDataInserter3d())


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryBuilder3d:
    """``TRAJECTORY_BUILDER_3D``."""

    min_range: float = length(1.0, "nearer points are left out")
    max_range: float = length(60.0, "farther points are left out", 1e-3)
    num_accumulated_range_data: int = count(1, "messages that make one scan to match", 1)
    voxel_filter_size: float = length(0.15, "edge of the voxels that thin a scan", 1e-4)
    high_resolution_adaptive_voxel_filter: AdaptiveVoxelFilter = group(
        AdaptiveVoxelFilter(max_length=2.0, min_num_points=150.0, max_range=15.0)
    )
    low_resolution_adaptive_voxel_filter: AdaptiveVoxelFilter = group(
        AdaptiveVoxelFilter(max_length=4.0, min_num_points=200.0, max_range=60.0)
    )
    use_online_correlative_scan_matching: bool = parameter(False, "search around the prediction before the alignment")
    real_time_correlative_scan_matcher: RealTimeCorrelativeScanMatcher = group(
        RealTimeCorrelativeScanMatcher(linear_search_window=0.15, angular_search_window=math.radians(1.0))
    )
    ceres_scan_matcher: CeresScanMatcher3d = group(CeresScanMatcher3d())
    motion_filter: MotionFilter = group(
        MotionFilter(max_time_seconds=0.5, max_distance_meters=0.1, max_angle_radians=0.004)
    )
    rotational_histogram_size: int = count(120, "buckets over half a turn of the histogram of directions", 1)
    imu_gravity_time_constant: float = parameter(
        10.0,
        "of the extrapolation between published poses; what local SLAM uses stands in pose_extrapolator",
        unit="s",
        minimum=1e-3,
        maximum=1e6,
        effective=False,
    )
    pose_extrapolator: PoseExtrapolator = group(PoseExtrapolator())
    submaps: Submaps3d = group(Submaps3d())
    use_intensities: bool = parameter(False, f"align intensities {_NOT_USED}", effective=False)

    def __post_init__(self) -> None:
        if self.min_range >= self.max_range:
            raise ConfigError("TRAJECTORY_BUILDER_3D: min_range must be below max_range")
