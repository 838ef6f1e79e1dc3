# SPDX-License-Identifier: MIT
"""``TRAJECTORY_BUILDER_2D``: local SLAM in the plane."""

from __future__ import annotations

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


@dataclass(frozen=True, slots=True, kw_only=True)
class CeresScanMatcher2d:
    """Non-linear alignment of a scan with a grid."""

    occupied_space_weight: float = weight(1.0, "weight of the points on obstacles, shared among them")
    translation_weight: float = weight(10.0, "weight of staying where the robot was predicted")
    rotation_weight: float = weight(
        40.0, "weight of keeping the heading that was predicted, or that the correlative search found"
    )
    ceres_solver_options: CeresSolverOptions = group(CeresSolverOptions())


@dataclass(frozen=True, slots=True, kw_only=True)
class GridOptions2d:
    """Kind and size of the cells."""

    grid_type: str = parameter(
        "PROBABILITY_GRID", "occupancy odds, or truncated signed distances", choices=("PROBABILITY_GRID", "TSDF")
    )
    resolution: float = parameter(0.05, "size of a cell", unit="m", minimum=1e-3, maximum=10.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbabilityGridInserter:
    """How a scan changes the odds of cells."""

    insert_free_space: bool = parameter(True, "cells that a beam crosses become freer")
    hit_probability: float = parameter(0.55, "probability that a hit multiplies in", minimum=0.500001, maximum=0.999)
    miss_probability: float = parameter(
        0.49, "probability that a crossing multiplies in", minimum=0.001, maximum=0.499999
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalEstimation:
    """Normals of a scan's surface."""

    num_normal_samples: int = count(4, "neighbours at most, half of them on each side", 1)
    sample_radius: float = length(0.5, "neighbours are not farther than this", 1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class TsdfInserter:
    """How a scan changes signed distances."""

    truncation_distance: float = length(0.3, "distances are cut here", 1e-3)
    maximum_weight: float = parameter(10.0, "weight of a cell at most", minimum=1e-6, maximum=1e6)
    update_free_space: bool = parameter(False, "also cells before the truncation distance are updated")
    normal_estimation_options: NormalEstimation = group(NormalEstimation())
    project_sdf_distance_to_scan_normal: bool = parameter(True, "distance along the surface's normal, not the beam")
    update_weight_range_exponent: int = parameter(
        0, "an update weighs range to minus this power", minimum=0, maximum=10
    )
    update_weight_angle_scan_normal_to_ray_kernel_bandwidth: float = parameter(
        0.5,
        "bandwidth over the angle between beam and normal; 0: no such weight",
        unit="rad",
        minimum=0.0,
        maximum=100.0,
    )
    update_weight_distance_cell_to_hit_kernel_bandwidth: float = parameter(
        0.5, "bandwidth over the distance from cell to hit; 0: no such weight", unit="m", minimum=0.0, maximum=100.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeDataInserter2d:
    """How scans enter a submap."""

    range_data_inserter_type: str = parameter(
        "PROBABILITY_GRID_INSERTER_2D",
        "must go with grid_type",
        choices=("PROBABILITY_GRID_INSERTER_2D", "TSDF_INSERTER_2D"),
    )
    probability_grid_range_data_inserter: ProbabilityGridInserter = group(ProbabilityGridInserter())
    tsdf_range_data_inserter: TsdfInserter = group(TsdfInserter())


@dataclass(frozen=True, slots=True, kw_only=True)
class Submaps2d:
    """Submaps of local SLAM."""

    num_range_data: int = count(90, "scans until the next submap starts; a submap is finished at twice that", 1)
    grid_options_2d: GridOptions2d = group(GridOptions2d())
    range_data_inserter: RangeDataInserter2d = group(RangeDataInserter2d())

    def __post_init__(self) -> None:
        grid, inserter = self.grid_options_2d.grid_type, self.range_data_inserter.range_data_inserter_type
        if inserter != f"{grid}_INSERTER_2D":
            raise ConfigError(
                f"TRAJECTORY_BUILDER_2D.submaps: range_data_inserter_type {inserter} does not go with grid_type {grid}: "
                f"set it to {grid}_INSERTER_2D"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOdometry2d:
    """Motion between scans before local SLAM, from scans, wheels and gyroscope together; slamcli's own."""

    enabled: bool = parameter(
        True, "predict by aligning each scan with the recent past; false: by odometry, else at constant velocity",
        extension=True,
    )  # fmt: skip
    trust: float = parameter(
        10.0, "factor of the scan matcher's pull to this prediction, which is better than an extrapolated one",
        minimum=0.0, maximum=1e6, extension=True,
    )  # fmt: skip
    time_offset: str = parameter(
        "auto", "seconds added to a scan's stamp before the odometry is looked up; auto: from the turns that both saw",
        unit="s", choices=("auto", "NUMBER"), extension=True,
    )  # fmt: skip
    calibrate: bool = parameter(
        True, "free the odometry of wrong wheel diameters and wheel base, as the scans tell them", extension=True
    )
    deskew: bool = parameter(
        True, "put beams to where they were when they were measured, by their times", extension=True
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryBuilder2d:
    """``TRAJECTORY_BUILDER_2D``."""

    use_imu_data: bool = parameter(True, "use the IMU's turning rate and gravity where the recording has an IMU")
    min_range: float = length(0.0, "nearer readings are left out")
    max_range: float = length(30.0, "farther readings are missing data", 1e-3)
    min_z: float = parameter(-0.8, "points of clouds below are left out", unit="m", minimum=-1e4, maximum=1e4)
    max_z: float = parameter(2.0, "points of clouds above are left out", unit="m", minimum=-1e4, maximum=1e4)
    missing_data_ray_length: float = length(
        5.0, "free space drawn for a reading beyond max_range (not for inf, which is dropped before)"
    )
    num_accumulated_range_data: int = count(1, "messages that make one scan to match", 1)
    voxel_filter_size: float = length(0.025, "edge of the voxels that thin a scan", 1e-4)
    adaptive_voxel_filter: AdaptiveVoxelFilter = group(AdaptiveVoxelFilter())
    loop_closure_adaptive_voxel_filter: AdaptiveVoxelFilter = group(
        AdaptiveVoxelFilter(max_length=0.9, min_num_points=100.0)
    )
    use_online_correlative_scan_matching: bool = parameter(False, "search around the prediction before the alignment")
    real_time_correlative_scan_matcher: RealTimeCorrelativeScanMatcher = group(RealTimeCorrelativeScanMatcher())
    ceres_scan_matcher: CeresScanMatcher2d = group(CeresScanMatcher2d())
    motion_filter: MotionFilter = group(MotionFilter())
    imu_gravity_time_constant: float = parameter(
        10.0,
        "of the extrapolation between published poses; what local SLAM uses stands in pose_extrapolator",
        unit="s",
        minimum=1e-3,
        maximum=1e6,
        effective=False,
    )
    pose_extrapolator: PoseExtrapolator = group(PoseExtrapolator())
    submaps: Submaps2d = group(Submaps2d())

    def __post_init__(self) -> None:
        if self.min_range >= self.max_range:
            raise ConfigError("TRAJECTORY_BUILDER_2D: min_range must be below max_range")
        if self.min_z > self.max_z:
            raise ConfigError("TRAJECTORY_BUILDER_2D: min_z must not be above max_z")

    scan_odometry: ScanOdometry2d = group(ScanOdometry2d())
