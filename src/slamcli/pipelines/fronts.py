# SPDX-License-Identifier: MIT
"""What stands between the sensors and the memory: one front for each kind of main sensor."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.mapper import Setup
from slamcli.measurements import Measurement
from slamcli.rtabmap.moment import Moment
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import NodeImages
from slamcli.vision.features import Features
from slamcli.vision.preparation import PreparedFrame

Floats = NDArray[np.float64]


class Front(Protocol):
    """Takes measurements in the order in which they were recorded, and hands out moments with a pose by odometry."""

    def take(self, measurement: Measurement) -> Iterator[Moment]:
        """Take the next measurement; yield what is ready."""

    def finish(self) -> Iterator[Moment]:
        """Yield what still waited for something later."""

    def images(self, prepared: PreparedFrame) -> NodeImages:
        """Return what a node keeps of a frame."""

    def points(self, features: Features) -> Floats:
        """Return where key points lie, (N, 3), metres, base frame; NaN where unknown."""

    def refined(self) -> tuple[NDArray[np.int64], Floats] | None:
        """Return stamps (F,) and poses T_odom_base (F, 4, 4) as odometry knows them in the end; None: as they were given."""

    def why_nothing(self) -> str:
        """Return in words why no node was made, if there is none."""


def front_of(parameters: RtabmapParameters, setup: Setup) -> Front:
    """Return the front for the sensors that the plan chose."""
    if setup.rig is not None:
        from slamcli.rtabmap.visual_front import VisualFront

        return VisualFront(parameters, setup)
    from slamcli.rtabmap.scan_front import ScanFront

    return ScanFront(parameters, setup)
