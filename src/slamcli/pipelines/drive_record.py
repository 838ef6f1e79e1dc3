# SPDX-License-Identifier: MIT
"""What became of one goal, collected while the robot drives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.navigation.move_base import Cycle, MoveBase, Phase
from slamcli.navigation.robot_state import RobotState
from slamcli.simulation.contact import Contact
from slamcli.simulation.plant import Plant

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drive:
    """What became of one goal, seen from outside."""

    phase: Phase
    """SUCCEEDED, ABORTED, or what move_base was doing when time ran out."""
    message: str
    begin_s: float
    end_s: float
    length_m: float
    """Way that the robot truly drove."""
    clearance_m: float
    """Least distance that its body truly had to anything."""
    collisions: tuple[Contact, ...]
    recoveries: tuple[str, ...]
    plans: int
    """Number of global plans."""
    end_pose: Array
    """float64 (3,), where it truly stands in the end."""
    position_error_m: Array
    """float64 (N,), the localiser's error at each control cycle."""
    heading_error_rad: Array
    """float64 (N,), likewise, absolute."""


class DriveRecord:
    """Collects what `Drive` tells."""

    def __init__(self, plant: Plant, begin_s: float) -> None:
        self._plant, self._begin_s = plant, begin_s
        self._before = plant.pose.copy()
        self._first_collision = len(plant.collisions)
        self._length_m, self._clearance_m = 0.0, math.inf
        self._recoveries: list[str] = []
        self._plans = 0
        self._errors: list[tuple[float, float]] = []

    def add(self, cycle: Cycle, state: RobotState) -> None:
        """Take one control cycle."""
        plant = self._plant
        pose = plant.pose.copy()
        self._length_m += float(np.hypot(*(pose[:2] - self._before[:2])))
        self._before = pose
        self._clearance_m = min(self._clearance_m, plant.clearance_m)
        self._plans += cycle.plan is not None
        if cycle.recovery:
            self._recoveries.append(cycle.recovery)
        off = se2.between(pose, state.pose_map)
        self._errors.append((float(np.hypot(off[0], off[1])), abs(float(off[2]))))

    def finished(self, move_base: MoveBase, end_s: float) -> Drive:
        """Return the whole."""
        plant = self._plant
        errors = np.array(self._errors).reshape(-1, 2)
        return Drive(
            phase=move_base.phase,
            message=move_base.message,
            begin_s=self._begin_s,
            end_s=end_s,
            length_m=self._length_m,
            clearance_m=self._clearance_m,
            collisions=tuple(plant.collisions[self._first_collision :]),
            recoveries=tuple(self._recoveries),
            plans=self._plans,
            end_pose=plant.pose.copy(),
            position_error_m=errors[:, 0],
            heading_error_rad=errors[:, 1],
        )
