# SPDX-License-Identifier: MIT
"""Every parameter of Cartographer and of its ROS node under its name, and slamcli's own, declared once."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.cartographer.parameters.extensions_3d import Extensions3d
from slamcli.cartographer.parameters.map_builder import MapBuilder, PureLocalizationTrimmer, TrajectoryBuilder
from slamcli.cartographer.parameters.options import NodeOptions
from slamcli.cartographer.parameters.pose_graph import (
    ConstraintBuilder,
    FastCorrelativeScanMatcher2d,
    FastCorrelativeScanMatcher3d,
    OptimizationProblem,
    OverlappingSubmapsTrimmer2d,
    PoseGraph,
)
from slamcli.cartographer.parameters.tables import (
    AdaptiveVoxelFilter,
    CeresSolverOptions,
    ConstantVelocityExtrapolator,
    MotionFilter,
    PoseExtrapolator,
    RealTimeCorrelativeScanMatcher,
)
from slamcli.cartographer.parameters.trajectory_builder_2d import (
    CeresScanMatcher2d,
    ProbabilityGridInserter,
    Submaps2d,
    TrajectoryBuilder2d,
    TsdfInserter,
)
from slamcli.cartographer.parameters.trajectory_builder_3d import (
    CeresScanMatcher3d,
    RangeDataInserter3d,
    Submaps3d,
    TrajectoryBuilder3d,
)
from slamcli.parameters import group


@dataclass(frozen=True, slots=True, kw_only=True)
class CartographerParameters:
    """All tables; native names begin with the global table they stand in, options of the ROS node with nothing."""

    options: NodeOptions = group(NodeOptions(), name="")
    map_builder: MapBuilder = group(MapBuilder(), name="MAP_BUILDER")
    trajectory_builder: TrajectoryBuilder = group(TrajectoryBuilder(), name="TRAJECTORY_BUILDER")
    trajectory_builder_2d: TrajectoryBuilder2d = group(TrajectoryBuilder2d(), name="TRAJECTORY_BUILDER_2D")
    trajectory_builder_3d: TrajectoryBuilder3d = group(TrajectoryBuilder3d(), name="TRAJECTORY_BUILDER_3D")
    pose_graph: PoseGraph = group(PoseGraph(), name="POSE_GRAPH")
    slamcli_3d: Extensions3d = group(Extensions3d(), name="SLAMCLI_3D")


__all__ = [
    "AdaptiveVoxelFilter",
    "CartographerParameters",
    "CeresScanMatcher2d",
    "CeresScanMatcher3d",
    "CeresSolverOptions",
    "ConstantVelocityExtrapolator",
    "ConstraintBuilder",
    "Extensions3d",
    "FastCorrelativeScanMatcher2d",
    "FastCorrelativeScanMatcher3d",
    "MapBuilder",
    "MotionFilter",
    "NodeOptions",
    "OptimizationProblem",
    "OverlappingSubmapsTrimmer2d",
    "PoseExtrapolator",
    "PoseGraph",
    "ProbabilityGridInserter",
    "PureLocalizationTrimmer",
    "RangeDataInserter3d",
    "RealTimeCorrelativeScanMatcher",
    "Submaps2d",
    "Submaps3d",
    "TrajectoryBuilder",
    "TrajectoryBuilder2d",
    "TrajectoryBuilder3d",
    "TsdfInserter",
]
