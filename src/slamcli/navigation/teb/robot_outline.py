# SPDX-License-Identifier: MIT
"""The robot's outline as the optimiser of a timed elastic band sees it: segments that may be thick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.teb.parameters import FootprintModel

Array = NDArray[np.float64]
_NEARLY_A_CIRCLE = 1.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotOutline:
    """What distances to obstacles are measured from."""

    segments: Array
    """float64 (S, 5), S >= 1: x1, y1, x2, y2 in the base frame and a radius, metres."""
    closed: bool
    """Whether the segments are a polygon with an inside."""

    @property
    def radius_m(self) -> float:
        """The radius of the circle about the base frame's origin that holds all of it."""
        ends = np.maximum(np.hypot(*self.segments[:, 0:2].T), np.hypot(*self.segments[:, 2:4].T))
        return float((ends + self.segments[:, 4]).max())


def robot_outline(model: FootprintModel, costmap: CostWindow) -> RobotOutline:
    """Return the outline of a footprint model; of the costmap's footprint for ``auto``."""
    if model.type == "point":
        return _discs((0.0, 0.0, 0.0))
    if model.type == "circular":
        return _discs((0.0, 0.0, model.radius))
    if model.type == "two_circles":
        return _discs((model.front_offset, 0.0, model.front_radius), (-model.rear_offset, 0.0, model.rear_radius))
    if model.type == "line":
        ends = model.points()
        return RobotOutline(segments=np.array([[*ends[0], *ends[1], 0.0]]), closed=False)
    if model.type == "polygon":
        return polygon(model.points())
    if costmap.circumscribed_radius_m <= _NEARLY_A_CIRCLE * costmap.inscribed_radius_m:
        return _discs((0.0, 0.0, costmap.circumscribed_radius_m))
    return polygon(costmap.footprint)


def _discs(*discs: tuple[float, float, float]) -> RobotOutline:
    return RobotOutline(segments=np.array([[x, y, x, y, radius] for x, y, radius in discs]), closed=False)


def polygon(corners: Array) -> RobotOutline:
    """Return the outline with corners, float64 (N, 2), base frame."""
    segments = np.column_stack([corners, np.roll(corners, -1, axis=0), np.zeros(len(corners))])
    return RobotOutline(segments=np.ascontiguousarray(segments), closed=True)
