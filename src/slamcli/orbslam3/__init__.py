# SPDX-License-Identifier: MIT
"""Feature-based visual and visual-inertial SLAM (Campos et al., T-RO 2021; Mur-Artal and Tardos, T-RO 2017)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from slamcli.mapper import InputPlan, Mapper, SensorOffer, Setup
from slamcli.orbslam3.inputs import MODES, ROLES, plan_inputs
from slamcli.orbslam3.parameters import OrbSlam3Parameters
from slamcli.runtime import RunLog


class OrbSlam3Tier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "orbslam3"
    parameters: type = OrbSlam3Parameters
    roles = ROLES
    modes = MODES
    resumes = False
    remembers = False

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:  # noqa: ARG002
        """Return which cameras to take of those that are offered, and whether the IMU."""
        return plan_inputs(parameters, offer, log)

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from importlib import import_module

        mapper: Mapper = import_module("slamcli.orbslam3.mapper").OrbSlam3Mapper(parameters, setup)
        return mapper


TIER = OrbSlam3Tier()

__all__ = ["TIER", "OrbSlam3Parameters", "OrbSlam3Tier"]
