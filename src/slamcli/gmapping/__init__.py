# SPDX-License-Identifier: MIT
"""The Rao-Blackwellised particle filter of gmapping (Grisetti, Stachniss and Burgard, T-RO 2007)."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from slamcli.gmapping.parameters import GmappingParameters
from slamcli.mapper import InputPlan, LiveMapper, Mapper, SensorOffer, Setup
from slamcli.runtime import RunLog


class GmappingTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "gmapping"
    parameters: type = GmappingParameters
    roles = frozenset({"scans", "odometry"})
    modes: tuple[str, ...] = ()
    resumes = False
    remembers = False

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:  # noqa: ARG002
        """Return that one scanner is used, and the odometry where there is one."""
        return InputPlan(
            parameters=parameters,
            base_frame=parameters.base_frame if "base_frame" in given else None,
            odom_frame=parameters.odom_frame if "odom_frame" in given else None,
            map_frame=parameters.map_frame,
        )

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from slamcli.gmapping.mapper import GmappingMapper

        return GmappingMapper(parameters, setup)

    def build_live(self, parameters: Any, setup: Setup) -> LiveMapper:
        """Return a mapper that answers after each scan."""
        from slamcli.gmapping.live import LiveGmapping

        return LiveGmapping(parameters, setup)


TIER = GmappingTier()

__all__ = ["TIER", "GmappingParameters", "GmappingTier"]
