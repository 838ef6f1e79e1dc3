# SPDX-License-Identifier: MIT
"""Tables that stand in several places of Cartographer's configuration, and the kinds of values in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from slamcli.parameters import group, parameter

LARGEST_WEIGHT = 1e12
LARGEST_LENGTH_M = 1e6
LARGEST_COUNT = 1_000_000_000


def weight(default: float, help: str, **more: Any) -> Any:
    """Declare a weight of a residual, not negative."""
    return parameter(default, help, minimum=0.0, maximum=LARGEST_WEIGHT, **more)


def length(default: float, help: str, minimum: float = 0.0, **more: Any) -> Any:
    """Declare a length in metres."""
    return parameter(default, help, unit="m", minimum=minimum, maximum=LARGEST_LENGTH_M, **more)


def angle(default: float, help: str, **more: Any) -> Any:
    """Declare an angle in radians, at most a whole turn."""
    return parameter(default, help, unit="rad", minimum=0.0, maximum=2.0 * math.pi, **more)


def count(default: int | None, help: str, minimum: int = 0, **more: Any) -> Any:
    """Declare a number of things; None stands for "not given"."""
    return parameter(default, help, kind=int, minimum=minimum, maximum=LARGEST_COUNT, **more)


def share(default: float, help: str, **more: Any) -> Any:
    """Declare a share, score or probability between 0 and 1."""
    return parameter(default, help, minimum=0.0, maximum=1.0, **more)


@dataclass(frozen=True, slots=True, kw_only=True)
class CeresSolverOptions:
    """How a non-linear least-squares problem is solved."""

    use_nonmonotonic_steps: bool = parameter(
        False, "allow steps that raise the cost; the solvers here never take one", effective=False
    )
    max_num_iterations: int = count(20, "iterations at most", 1)
    num_threads: int = count(1, "threads of the solver; here --jobs says how many run", 1, effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptiveVoxelFilter:
    """A voxel filter whose edge is made smaller until enough points are left."""

    max_length: float = length(0.5, "largest edge of a voxel", 1e-4)
    min_num_points: float = parameter(
        200.0, "the edge shrinks until at least this many points are left", unit="points", minimum=0.0, maximum=1e6
    )
    max_range: float = length(50.0, "points farther than this are left out", 1e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class RealTimeCorrelativeScanMatcher:
    """Exhaustive search around the predicted pose before the scan matcher."""

    linear_search_window: float = length(0.1, "half width of the search in each direction")
    angular_search_window: float = angle(math.radians(20.0), "half width of the search in heading")
    translation_delta_cost_weight: float = weight(0.1, "how a score falls with the distance from the prediction")
    rotation_delta_cost_weight: float = weight(0.1, "how a score falls with the angle from the prediction")


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionFilter:
    """A scan is left out of the map if all three are below."""

    max_time_seconds: float = parameter(5.0, "a scan is inserted after this time", unit="s", minimum=0.0, maximum=1e9)
    max_distance_meters: float = length(0.2, "a scan is inserted after this way")
    max_angle_radians: float = angle(math.radians(1.0), "a scan is inserted after this turn")


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantVelocityExtrapolator:
    """Predicts poses from the last ones, odometry and the turning rate."""

    imu_gravity_time_constant: float = parameter(
        10.0, "time over which the direction of gravity is averaged", unit="s", minimum=1e-3, maximum=1e6
    )
    pose_queue_duration: float = parameter(
        0.001, "poses kept to estimate velocities from, at least this long", unit="s", minimum=0.0, maximum=1e3
    )


_IMU_BASED = "of the IMU-based extrapolator, which is not used here: batch work extrapolates by constant velocity"


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuBasedSolverOptions:
    """How the original solves the problem of its IMU-based extrapolator."""

    use_nonmonotonic_steps: bool = parameter(False, f"solver {_IMU_BASED}", effective=False)
    max_num_iterations: int = count(10, f"iterations {_IMU_BASED}", 1, effective=False)
    num_threads: int = count(1, f"threads {_IMU_BASED}", 1, effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuBasedExtrapolator:
    """The original's experimental second extrapolator."""

    pose_queue_duration: float = parameter(
        5.0, f"length of the window {_IMU_BASED}", unit="s", minimum=0.0, maximum=1e3, effective=False
    )
    gravity_constant: float = parameter(
        9.806, f"gravity {_IMU_BASED}", unit="m/s^2", minimum=0.0, maximum=100.0, effective=False
    )
    pose_translation_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    pose_rotation_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    imu_acceleration_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    imu_rotation_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    odometry_translation_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    odometry_rotation_weight: float = weight(1.0, f"weight {_IMU_BASED}", effective=False)
    solver_options: ImuBasedSolverOptions = group(ImuBasedSolverOptions())


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseExtrapolator:
    """Predicts the pose at a scan's time."""

    use_imu_based: bool = parameter(
        False,
        "optimise over a window of IMU data; here the constant-velocity extrapolator always runs",
        effective=False,
    )
    constant_velocity: ConstantVelocityExtrapolator = group(ConstantVelocityExtrapolator())
    imu_based: ImuBasedExtrapolator = group(ImuBasedExtrapolator())
