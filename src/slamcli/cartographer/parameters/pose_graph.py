# SPDX-License-Identifier: MIT
"""``POSE_GRAPH``: loop closure and optimisation."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from slamcli.cartographer.parameters.tables import CeresSolverOptions, angle, count, length, share, weight
from slamcli.cartographer.parameters.trajectory_builder_2d import CeresScanMatcher2d
from slamcli.cartographer.parameters.trajectory_builder_3d import CeresScanMatcher3d
from slamcli.parameters import group, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class FastCorrelativeScanMatcher2d:
    """Branch and bound in the plane."""

    linear_search_window: float = length(
        7.0, "half width of the search in each direction, where batch_search (which has its own windows) is not enabled"
    )
    angular_search_window: float = angle(
        math.radians(30.0), "half width of the search in heading, where batch_search is not enabled"
    )
    branch_and_bound_depth: int = parameter(7, "grids of halved resolution", unit="levels", minimum=1, maximum=16)


@dataclass(frozen=True, slots=True, kw_only=True)
class FastCorrelativeScanMatcher3d:
    """Branch and bound in space."""

    branch_and_bound_depth: int = parameter(8, "grids of halved resolution", unit="levels", minimum=1, maximum=16)
    full_resolution_depth: int = parameter(3, "grids that keep the finest voxels", unit="levels", minimum=1, maximum=16)
    min_rotational_score: float = share(0.77, "headings whose histogram fits worse are not searched")
    min_low_resolution_score: float = share(0.55, "candidates that fit the coarse grid worse are dropped")
    linear_xy_search_window: float = length(5.0, "half width of the search in x and y")
    linear_z_search_window: float = length(1.0, "half width of the search in z")
    angular_search_window: float = angle(math.radians(15.0), "half width of the search in heading")


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintBuilder:
    """Search for loop closures."""

    sampling_ratio: float = share(0.3, "share of the pairs of node and submap that are tried")
    max_constraint_distance: float = length(15.0, "pairs farther apart are not tried")
    min_score: float = share(0.55, "least mean probability of a match")
    global_localization_min_score: float = share(0.6, "least mean probability of a match without a prior pose")
    loop_closure_translation_weight: float = weight(1.1e4, "weight of a loop closure's translation")
    loop_closure_rotation_weight: float = weight(1e5, "weight of a loop closure's rotation")
    log_matches: bool = parameter(
        True, "log every match; here they are always in run.json and report.html", effective=False
    )
    fast_correlative_scan_matcher: FastCorrelativeScanMatcher2d = group(FastCorrelativeScanMatcher2d())
    ceres_scan_matcher: CeresScanMatcher2d = group(
        CeresScanMatcher2d(
            occupied_space_weight=20.0,
            translation_weight=10.0,
            rotation_weight=1.0,
            ceres_solver_options=CeresSolverOptions(use_nonmonotonic_steps=True, max_num_iterations=10),
        )
    )
    fast_correlative_scan_matcher_3d: FastCorrelativeScanMatcher3d = group(FastCorrelativeScanMatcher3d())
    ceres_scan_matcher_3d: CeresScanMatcher3d = group(
        CeresScanMatcher3d(
            occupied_space_weight_0=5.0,
            occupied_space_weight_1=30.0,
            translation_weight=10.0,
            rotation_weight=1.0,
            ceres_solver_options=CeresSolverOptions(max_num_iterations=10),
        )
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimizationProblem:
    """Terms of the pose graph."""

    huber_scale: float = parameter(
        1e1, "loop closures with a larger weighted residual count linearly", minimum=1e-9, maximum=1e12
    )
    acceleration_weight: float = weight(1.1e2, "weight of the IMU's acceleration (3D)")
    rotation_weight: float = weight(1.6e4, "weight of the IMU's turning rate (3D)")
    local_slam_pose_translation_weight: float = weight(1e5, "weight of local SLAM between consecutive nodes")
    local_slam_pose_rotation_weight: float = weight(1e5, "weight of local SLAM between consecutive nodes")
    odometry_translation_weight: float = weight(1e5, "weight of odometry between consecutive nodes")
    odometry_rotation_weight: float = weight(1e5, "weight of odometry between consecutive nodes")
    odometry_term: str = parameter(
        "never",
        "whether odometry between consecutive nodes is a term of its own, with the odometry's weights, beside that of local SLAM, "
        "whose scan odometry follows the wheels already",
        choices=("never", "always"),
        extension=True,
    )
    fixed_frame_pose_translation_weight: float = weight(1e1, "weight of a GPS fix")
    fixed_frame_pose_rotation_weight: float = weight(1e2, "weight of a fixed-frame orientation")
    fixed_frame_pose_use_tolerant_loss: bool = parameter(False, "fixes within a tolerance cost little")
    fixed_frame_pose_tolerant_loss_param_a: float = parameter(
        1.0, "where the tolerant loss begins to rise", minimum=0.0, maximum=1e12
    )
    fixed_frame_pose_tolerant_loss_param_b: float = parameter(
        1.0, "how soft the tolerant loss begins to rise", minimum=1e-9, maximum=1e12
    )
    log_solver_summary: bool = parameter(
        False, "log each optimisation; here their figures are always in run.json", effective=False
    )
    use_online_imu_extrinsics_in_3d: bool = parameter(True, "also estimate how the IMU is mounted (3D)")
    fix_z_in_3d: bool = parameter(False, "keep heights as local SLAM has them (3D)")
    ceres_solver_options: CeresSolverOptions = group(CeresSolverOptions(max_num_iterations=50, num_threads=7))


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchSearch:
    """Search for loops when the whole recording is known; slamcli's own."""

    enabled: bool = parameter(
        True,
        "search all pairs within the drift between them, optimise, and again until nothing is added; false: as the original, "
        "each new node and submap once, with optimize_every_n_nodes, sampling_ratio and whole windows",
        extension=True,
    )
    widest_window: float = length(
        25.0, "half width of the widest search, where the drift asks for it (linear_search_window is that of the original's search)",
        extension=True,
    )  # fmt: skip
    widest_turn: float = angle(math.radians(60.0), "half width of the widest search in heading", extension=True)
    huber_factor: float = parameter(
        10.0, "factor of huber_scale in this search, whose loops have witnesses: with less a long loop stays open", minimum=0.01,
        maximum=1e6, extension=True,
    )  # fmt: skip
    drift_translation: float = parameter(
        0.05, "standard deviation of local SLAM's position after one metre", unit="m/sqrt(m)", minimum=1e-4, maximum=10.0,
        extension=True,
    )  # fmt: skip
    drift_rotation: float = parameter(
        math.radians(0.15), "standard deviation of local SLAM's heading after one metre", unit="rad/sqrt(m)", minimum=1e-6,
        maximum=1.0, extension=True,
    )  # fmt: skip


_TRIMMER = "auto: no trimming; giving any key of this table turns it on"


@dataclass(frozen=True, slots=True, kw_only=True)
class OverlappingSubmapsTrimmer2d:
    """Drops submaps whose area newer ones cover; on when any of its keys is given."""

    fresh_submaps_count: int = count(
        None, f"newest submaps over a cell that count as fresh there (typical: 1); {_TRIMMER}", 1
    )
    min_covered_area: float = parameter(
        None,
        f"a submap with less area that is fresh is dropped (typical: 2); {_TRIMMER}",
        kind=float,
        unit="m^2",
        minimum=0.0,
        maximum=1e9,
    )
    min_added_submaps_count: int = count(None, f"trim after this many new submaps (typical: 5); {_TRIMMER}", 1)

    @property
    def is_on(self) -> bool:
        """Whether any key of the table was given."""
        return any(getattr(self, field.name) is not None for field in dataclasses.fields(self))

    def filled(self) -> OverlappingSubmapsTrimmer2d:
        """Return the trimmer with the typical values where none were given."""
        return OverlappingSubmapsTrimmer2d(
            fresh_submaps_count=1 if self.fresh_submaps_count is None else self.fresh_submaps_count,
            min_covered_area=2.0 if self.min_covered_area is None else self.min_covered_area,
            min_added_submaps_count=5 if self.min_added_submaps_count is None else self.min_added_submaps_count,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseGraph:
    """``POSE_GRAPH``."""

    optimize_every_n_nodes: int = count(
        90,
        "search loops and optimise after this many nodes, as it goes (live) or where batch_search is not enabled (2D); 0: only at the end",
    )
    constraint_builder: ConstraintBuilder = group(ConstraintBuilder())
    matcher_translation_weight: float = weight(5e2, "weight of a node's translation in the submaps that it is part of")
    matcher_rotation_weight: float = weight(1.6e3, "weight of a node's rotation in the submaps that it is part of")
    optimization_problem: OptimizationProblem = group(OptimizationProblem())
    max_num_final_iterations: int = count(200, "iterations of the last optimisation", 1)
    global_sampling_ratio: float = share(
        0.003, "share of the nodes that are searched for in submaps of other trajectories; here a few that lie far apart are",
        effective=False,
    )  # fmt: skip
    log_residual_histograms: bool = parameter(
        True, "log histograms of residuals; here they are always in report.html", effective=False
    )
    global_constraint_search_after_n_seconds: float = parameter(
        10.0,
        "trajectories not joined for this long are searched without a prior pose; here they are at once",
        unit="s",
        minimum=0.0,
        maximum=1e9,
        effective=False,
    )
    overlapping_submaps_trimmer_2d: OverlappingSubmapsTrimmer2d = group(OverlappingSubmapsTrimmer2d())
    batch_search: BatchSearch = group(BatchSearch())
