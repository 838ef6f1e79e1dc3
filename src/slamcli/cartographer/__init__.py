# SPDX-License-Identifier: MIT
"""Submaps, loop closure by branch and bound and a pose graph (Hess et al., ICRA 2016), in 2D and 3D."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from slamcli.cartographer.inputs import MODES, ROLES, plan_inputs
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.grids import OccupancyGrid
from slamcli.mapper import InputPlan, Mapper, SensorOffer, Setup
from slamcli.posegraph import MapState
from slamcli.runtime import RunLog


class CartographerTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "cartographer"
    parameters: type = CartographerParameters
    roles = ROLES
    modes = MODES
    resumes = True

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
        """Return which sensors to take of those that are offered."""
        return plan_inputs(parameters, given, offer, log)

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from importlib import import_module

        mapper: Mapper = import_module("slamcli.cartographer.mapper").CartographerMapper(parameters, setup)
        return mapper

    def draw(self, parameters: Any, state: MapState, map_frame: str) -> OccupancyGrid:  # noqa: ARG002
        """Return the map that is in a state."""
        from slamcli.posegraph.rendering import draw_state

        return draw_state(state, map_frame)


TIER = CartographerTier()

__all__ = ["TIER", "CartographerParameters", "CartographerTier"]
