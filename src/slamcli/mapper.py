# SPDX-License-Identifier: MIT
"""What every tier takes and gives: the `Mapper` protocol and its `MappingResult`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.grids import OccupancyGrid
from slamcli.measurements import Measurement, PointCloud
from slamcli.posegraph import LoopSearch, MapState
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingResult:
    """What a tier ends with."""

    trajectory: Trajectory
    """One pose of the base frame in the map for every scan or frame that was given, in their order."""
    grid: OccupancyGrid | None = None
    steps: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Per-step statistics: columns of equal length, with ``stamp_ns`` among them."""
    summary: Mapping[str, Any] = field(default_factory=dict)
    """Figures for ``run.json``: counts and what was found."""
    keyframes: Trajectory | None = None
    """Poses of the nodes of the graph, where there is one."""
    state: MapState | None = None
    """Submaps, nodes and constraints, from which mapping can go on; graph-based tiers have one."""
    loop_searches: tuple[LoopSearch, ...] = ()
    """Searches for loop closures that found a candidate, accepted or not, in the order in which they were made."""
    cloud: PointCloud | None = None
    """The mapped points in the map frame (3D)."""


class Mapper(Protocol):
    """A SLAM system: measurements in, one result out."""

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement; scans or frames in the order in which they were recorded."""

    def finish(self) -> MappingResult:
        """End the run and return its result; the mapper is of no use afterwards."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What a mapper is built with besides its parameters."""

    T_base_laser: Mapping[str, NDArray[np.float64]]
    """Mount of each range sensor (laser, point cloud) by topic: float64 (4, 4)."""
    T_base_sensor: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Mount of each other sensor (IMU, fixed-frame pose, landmark detector) by topic: float64 (4, 4)."""
    map_frame: str = "map"
    base_frame: str = "base_link"
    seed: int = 0
    jobs: int = 1
    state: MapState | None = None
    """Where mapping goes on from (``--load-state``); None for a new map."""
    no_return: str = "ignore"
    """What an inf or maximum-range beam means: ignore, free (clears up to the usable range) or max (an end point)."""
    log: RunLog = field(default_factory=RunLog)


class Tier(Protocol):
    """What an entry point of the group ``slamcli.mappers`` names."""

    name: str
    parameters: type
    """Parameter dataclass; see `slamcli.parameters`."""

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""


def find_tier(name: str) -> Tier:
    """Return the tier of that name from the installed entry points.

    Raises
    ------
    UsageError
        If no such tier is installed.
    """
    from importlib.metadata import entry_points

    found = {point.name: point for point in entry_points(group="slamcli.mappers")}
    if name not in found:
        raise UsageError(f"no SLAM system {name!r}: installed are {', '.join(sorted(found)) or 'none'}")
    tier: Tier = found[name].load()
    return tier
