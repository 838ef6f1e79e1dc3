# SPDX-License-Identifier: MIT
"""The two submaps that scans are put into at a time, and what becomes of them when they are finished."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import Submaps3d
from slamcli.geometry import se3
from slamcli.grids.hybrid_blocks import HybridBlocks
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.posegraph import Id
from slamcli.registration.rotational_histogram import rotate_histogram


@dataclass(slots=True, eq=False)
class ActiveSubmap:
    """A submap that still grows."""

    id: Id
    T_local_submap: NDArray[np.float64]
    """float64 (4, 4); its z axis is against gravity."""
    high_resolution: HybridBlocks
    low_resolution: HybridBlocks
    rotational_histogram: NDArray[np.float32]
    num_range_data: int = 0
    nodes: list[Id] = field(default_factory=list)

    def insert(self, scan: ScanForSubmaps, settings: Submaps3d) -> None:
        """Put a scan into both grids and its directions into the histogram."""
        T = se3.inverse(self.T_local_submap) @ scan.T_local_base
        origin = T[:3, :3] @ scan.origin_m + T[:3, 3]
        points = scan.points_m @ T[:3, :3].T + T[:3, 3]
        inserter = settings.range_data_inserter
        odds = (inserter.hit_probability, inserter.miss_probability, inserter.num_free_space_voxels)
        away = scan.points_m - scan.origin_m
        near = np.einsum("ij,ij->i", away, away) <= settings.high_resolution_max_range**2
        self.high_resolution.insert(origin, points[near], *odds)
        self.low_resolution.insert(origin, points, *odds)
        upright = se3.inverse(self.T_local_submap)[:3, :3] @ scan.local_from_gravity
        self.rotational_histogram = self.rotational_histogram + rotate_histogram(
            scan.rotational_histogram, math.atan2(upright[1, 0], upright[0, 0])
        )
        self.num_range_data += 1
        self.nodes.append(scan.node)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanForSubmaps:
    """A matched scan as submaps take it."""

    node: Id
    T_local_base: NDArray[np.float64]
    points_m: NDArray[np.float64]
    """float64 (N, 3), base frame."""
    origin_m: NDArray[np.float64]
    """float64 (3,), the sensor, base frame."""
    rotational_histogram: NDArray[np.float32]
    """Of the points turned upright."""
    local_from_gravity: NDArray[np.float64]
    """float64 (3, 3), from the frame in which the histogram was made to the local one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinishedSubmap:
    """A submap that takes no more scans."""

    id: Id
    T_local_submap: NDArray[np.float64]
    high_resolution: HybridGrid
    low_resolution: HybridGrid
    rotational_histogram: NDArray[np.float32]
    num_range_data: int
    nodes: tuple[Id, ...]
    """Those that were put into it, in their order."""
    finished: bool = True


class ActiveSubmaps3D:
    """Every scan goes into both active submaps; matching uses the older (Hess et al., ICRA 2016, IV)."""

    def __init__(self, trajectory: int, settings: Submaps3d, histogram_size: int, first_number: int = 0) -> None:
        self._trajectory, self._settings, self._histogram_size = trajectory, settings, histogram_size
        self._next = first_number
        self.active: list[ActiveSubmap] = []

    @property
    def matching(self) -> ActiveSubmap | None:
        """The older active submap; None before the first scan."""
        return self.active[0] if self.active else None

    def insert(self, scan: ScanForSubmaps) -> tuple[tuple[ActiveSubmap, ...], FinishedSubmap | None]:
        """Put a scan into the active submaps; return those it went into and the submap that this finished, if any."""
        fresh = not self.active or self.active[-1].num_range_data == self._settings.num_range_data
        if fresh:
            self._start(scan)
        for submap in self.active:
            submap.insert(scan, self._settings)
        into = tuple(self.active)
        if self.active[0].num_range_data < 2 * self._settings.num_range_data:
            return into, None
        return into, finished(self.active.pop(0))

    def rest(self) -> list[FinishedSubmap]:
        """Return the submaps that are still active at the end of a run, as unfinished ones."""
        return [finished(submap, complete=False) for submap in self.active]

    def _start(self, scan: ScanForSubmaps) -> None:
        T = se3.from_rotation_translation(scan.local_from_gravity, scan.T_local_base[:3, 3])
        self.active.append(
            ActiveSubmap(
                Id(self._trajectory, self._next),
                T,
                HybridBlocks(self._settings.high_resolution),
                HybridBlocks(self._settings.low_resolution),
                np.zeros(self._histogram_size, dtype=np.float32),
            )
        )
        self._next += 1


def finished(submap: ActiveSubmap, *, complete: bool = True) -> FinishedSubmap:
    """Return an active submap as a record."""
    return FinishedSubmap(
        id=submap.id,
        T_local_submap=submap.T_local_submap,
        high_resolution=submap.high_resolution.record(),
        low_resolution=submap.low_resolution.record(),
        rotational_histogram=submap.rotational_histogram,
        num_range_data=submap.num_range_data,
        nodes=tuple(submap.nodes),
        finished=complete,
    )
