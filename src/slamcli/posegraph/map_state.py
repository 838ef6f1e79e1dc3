# SPDX-License-Identifier: MIT
"""What a submap-based mapping run knows: submaps, nodes and the constraints between them (Hess et al., ICRA 2016, IV)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import ImuSample, Landmarks, Odometry, StampedPose


def _no_rotation() -> NDArray[np.float64]:
    return np.array([0.0, 0.0, 0.0, 1.0])


if TYPE_CHECKING:  # with the grids their kernels are loaded, which a report or `--help` has no need of
    from slamcli.grids.hybrid_grid import HybridGrid
    from slamcli.grids.probability_grid import ProbabilityGrid
    from slamcli.grids.tsdf_grid import TsdfGrid


class Id(NamedTuple):
    """Which node or submap: the trajectory it belongs to and its place there, both from 0."""

    trajectory: int
    number: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Node:
    """A range measurement that was put into submaps, in the tracking frame."""

    id: Id
    stamp_ns: int
    T_local_node: NDArray[np.float64]
    """float64 (4, 4), pose by local SLAM in the trajectory's local frame."""
    T_map_node: NDArray[np.float64]
    """float64 (4, 4), pose after optimisation."""
    gravity_alignment_xyzw: NDArray[np.float64]
    """float64 (4,), rotation of the tracking frame into a frame whose z is up."""
    points_m: NDArray[np.float32]
    """float32 (N, 3), filtered returns for loop closure, gravity-aligned (2D) or in the tracking frame at high resolution (3D)."""
    low_resolution_points_m: NDArray[np.float32] | None = None
    """float32 (M, 3), 3D only."""
    rotational_histogram: NDArray[np.float32] | None = None
    """float32 (B,), 3D only."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Submap:
    """A local map built from consecutive nodes; its grid lies in the trajectory's local frame (2D) or its own (3D)."""

    id: Id
    T_local_submap: NDArray[np.float64]
    """float64 (4, 4)."""
    T_map_submap: NDArray[np.float64]
    """float64 (4, 4), pose after optimisation."""
    num_range_data: int
    finished: bool
    grid: ProbabilityGrid | TsdfGrid | None = None
    """2D only."""
    high_resolution: HybridGrid | None = None
    low_resolution: HybridGrid | None = None
    rotational_histogram: NDArray[np.float32] | None = None
    """float32 (B,), 3D only."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Constraint:
    """The pose of a node seen from a submap; ``intra`` where the node is part of the submap, ``inter`` closes a loop."""

    submap: Id
    node: Id
    T_submap_node: NDArray[np.float64]
    """float64 (4, 4)."""
    translation_weight: float
    rotation_weight: float
    kind: Literal["intra", "inter"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopSearch:
    """One search for a node in a submap, and what became of it."""

    submap: Id
    node: Id
    score: float
    """Mean probability of the best match, 0 to 1; 0 where none passed the bound."""
    accepted: bool
    reason: str
    """What it was rejected for; empty if accepted."""
    translation_residual_m: float = float("nan")
    """How far the optimised poses are from what the match says; NaN unless accepted."""
    rotation_residual_rad: float = float("nan")
    round: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryData:
    """What the optimisation found out of a trajectory's sensors."""

    gravity_m_s2: float = 9.8
    imu_calibration_xyzw: NDArray[np.float64] = field(default_factory=_no_rotation)
    """float64 (4,), rotation of the IMU's readings into the tracking frame."""
    T_map_fixed_frame: NDArray[np.float64] | None = None
    """float64 (4, 4), origin of the fixed-frame poses (GPS) in the map; None where there were none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapState:
    """Everything that mapping goes on from; the content of a ``.pbstream``."""

    nodes: tuple[Node, ...]
    submaps: tuple[Submap, ...]
    constraints: tuple[Constraint, ...]
    frozen: frozenset[int] = frozenset()
    """Trajectories whose submaps and nodes the optimisation must not move."""
    imu: dict[int, tuple[ImuSample, ...]] = field(default_factory=dict)
    """By trajectory, in the tracking frame."""
    odometry: dict[int, tuple[Odometry, ...]] = field(default_factory=dict)
    fixed_frame_poses: dict[int, tuple[StampedPose, ...]] = field(default_factory=dict)
    landmarks: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Optimised poses float64 (4, 4) by the landmark's id."""
    landmark_observations: dict[int, tuple[Landmarks, ...]] = field(default_factory=dict)
    """By trajectory, in the tracking frame."""
    trajectory_data: dict[int, TrajectoryData] = field(default_factory=dict)
    options: dict[int, bytes] = field(default_factory=dict)
    """By trajectory: the options that a ``.pbstream`` was written with, as they lie in the file; kept for Cartographer."""

    @property
    def trajectories(self) -> tuple[int, ...]:
        """The trajectories that have nodes or submaps, in increasing order."""
        found = {node.id.trajectory for node in self.nodes} | {submap.id.trajectory for submap in self.submaps}
        return tuple(sorted(found))
