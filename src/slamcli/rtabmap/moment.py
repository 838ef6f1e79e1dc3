# SPDX-License-Identifier: MIT
"""A frame or scan on its way from the sensors to the memory."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.rtabmap.node_input import OdometryStep
from slamcli.rtabmap.signature import NodeScan
from slamcli.vision.features import Features
from slamcli.vision.preparation import PreparedFrame


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """What is known of one frame or scan; images and scans are looked at only if it becomes a node."""

    step: OdometryStep
    features: Features | None = None
    """None for a robot without cameras."""
    prepared: PreparedFrame | None = None
    scan: NodeScan | None = None
