# SPDX-License-Identifier: MIT
"""What visual-inertial bundle adjustment takes and gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.measurements import ImuNoise
from slamcli.posegraph.imu_samples import ImuSamples
from slamcli.vision.bundle_problem import BundleProblem

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualInertialProblem:
    """A bundle of cameras some of which carry states of an IMU, linked by its samples."""

    bundle: BundleProblem
    """In metres. Cameras that are fixed there stay; their states may move in velocity and biases."""
    cameras: Integers
    """int64 (S,), the camera of each state."""
    stamps_ns: Integers
    """int64 (S,), of the states."""
    velocities: Floats
    """float64 (S, 3), m/s in the map, where they begin."""
    biases: Floats
    """float64 (S, 6), gyroscope and accelerometer, where they begin."""
    held: NDArray[np.bool_]
    """bool (S,), states whose velocity and biases stay."""
    links: Integers
    """int64 (K, 2), pairs of states between which the samples are integrated, the earlier first."""
    samples: ImuSamples
    noise: ImuNoise
    T_camera_imu: Floats
    """float64 (4, 4), metres."""
    gravity_map: Floats
    """float64 (3,), m/s^2, pointing down."""
    gravity_moves: bool = False
    """Whether its direction is estimated too: where a camera is fixed that does not know which way is down."""
    gyroscope_bias_sigma: float = 0.1
    """rad/s, of the prior around zero of the first state of every chain."""
    accelerometer_bias_sigma: float = 0.2
    """m/s^2."""

    def __post_init__(self) -> None:
        states = len(self.cameras)
        wanted = {
            "stamps_ns": (states,), "velocities": (states, 3), "biases": (states, 6), "held": (states,),
            "links": (len(self.links), 2), "T_camera_imu": (4, 4), "gravity_map": (3,),
        }  # fmt: skip
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise DataError(f"visual-inertial bundle: {name} is {getattr(self, name).shape}, {shape} is wanted")
        for name, size in (("cameras", len(self.bundle.T_camera_map)), ("links", states)):
            index = getattr(self, name)
            if index.size and (index.min() < 0 or index.max() >= size):
                raise DataError(f"visual-inertial bundle: {name} holds {int(index.max())}, but there are {size}")
        for name in ("velocities", "biases", "gravity_map"):
            if not np.isfinite(getattr(self, name)).all():
                raise DataError(f"visual-inertial bundle: {name} has numbers that are not finite")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisualInertialResult:
    """The adjusted bundle; rows are those of the problem."""

    T_camera_map: Floats
    """float64 (C, 4, 4)."""
    points: Floats
    """float64 (P, 3)."""
    velocities: Floats
    """float64 (S, 3)."""
    biases: Floats
    """float64 (S, 6)."""
    gravity_map: Floats
    """float64 (3,)."""
    link_squares: Floats
    """float64 (K,), squared whitened residuals of each link: 15 on average where noise is as assumed."""
    iterations: int
    cost_before: float
    cost: float
    converged: bool
