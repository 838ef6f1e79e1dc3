# SPDX-License-Identifier: MIT
"""Submaps, loop closure by branch and bound and a pose graph (Hess et al., ICRA 2016), in 2D and 3D."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from slamcli.cartographer.inputs import MODES, ROLES, plan_inputs
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.mapper import InputPlan, LiveMapper, Mapper, SensorOffer, Setup, StateDrawing
from slamcli.posegraph import MapState
from slamcli.runtime import RunLog


class CartographerTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "cartographer"
    parameters: type = CartographerParameters
    roles = ROLES
    modes = MODES
    resumes = True
    remembers = False

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
        """Return which sensors to take of those that are offered."""
        return plan_inputs(parameters, given, offer, log)

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from importlib import import_module

        mapper: Mapper = import_module("slamcli.cartographer.mapper").CartographerMapper(parameters, setup)
        return mapper

    def build_live(self, parameters: Any, setup: Setup) -> LiveMapper:
        """Return a mapper that answers after each scan, in the plane."""
        from slamcli.cartographer.live_2d import LiveCartographer2d

        return LiveCartographer2d(parameters, setup)

    def draw(self, parameters: Any, state: MapState, map_frame: str) -> StateDrawing:
        """Return the map and the points that are in a state."""
        if any(submap.high_resolution is not None for submap in state.submaps):
            from slamcli.cartographer.state_map_3d import draw_state_3d, state_cloud

            grid = draw_state_3d(parameters.slamcli_3d, state, map_frame)
            return StateDrawing(grid, state_cloud(state, map_frame))
        from slamcli.posegraph.rendering import draw_state

        return StateDrawing(draw_state(state, map_frame))


TIER = CartographerTier()

__all__ = ["TIER", "CartographerParameters", "CartographerTier"]
