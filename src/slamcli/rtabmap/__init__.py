# SPDX-License-Identifier: MIT
"""Appearance-based graph SLAM with a memory (Labbé and Michaud, T-RO 2013; JFR 2019)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from slamcli.mapper import InputPlan, Mapper, SensorOffer, Setup
from slamcli.rtabmap.inputs import MODES, ROLES, plan_inputs
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.runtime import RunLog


class RtabmapTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "rtabmap"
    parameters: type = RtabmapParameters
    roles = ROLES
    modes = MODES
    resumes = False
    remembers = True

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
        """Return which sensors to take of those that are offered, and the parameters that follow from them."""
        return plan_inputs(parameters, given, offer, log)

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from importlib import import_module

        mapper: Mapper = import_module("slamcli.rtabmap.mapper").RtabmapMapper(parameters, setup)
        return mapper


TIER = RtabmapTier()

__all__ = ["TIER", "RtabmapParameters", "RtabmapTier"]
