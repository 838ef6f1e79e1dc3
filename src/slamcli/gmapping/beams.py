# SPDX-License-Identifier: MIT
"""Scans as gmapping uses them: which beams are matched, which clear space, which end at an obstacle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.measurements import LaserScan

_UPRIGHT_TOLERANCE = 1e-3
"""How far the scanner's axis may be from the vertical (1 - |cos|), as in slam_gmapping."""


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """One scan in the base frame, metres."""

    points: NDArray[np.float64]
    """float64 (M, 2), end points that are matched."""
    directions: NDArray[np.float64]
    """float64 (M, 2), unit vectors of the matched beams."""
    start: NDArray[np.float64]
    """float64 (1, 2), where all beams start."""
    ends: NDArray[np.float64]
    """float64 (B, 2), where drawn beams end."""
    hit: NDArray[np.bool_]
    """bool (B,), whether a drawn beam ended at an obstacle."""


class BeamModel:
    """Turns scans of one scanner into `Beams`.

    Raises
    ------
    CalibrationError
        If the scanner's axis is not vertical.
    """

    def __init__(
        self, parameters: GmappingParameters, T_base_laser: NDArray[np.float64], no_return: str = "ignore"
    ) -> None:
        if 1.0 - abs(float(T_base_laser[2, 2])) > _UPRIGHT_TOLERANCE:
            tilt = math.degrees(math.acos(min(1.0, abs(float(T_base_laser[2, 2])))))
            raise CalibrationError(
                f"the scanner is tilted by {tilt:.1f} degrees: gmapping needs a scanner that sweeps the floor plane (see --laser-pose)"
            )
        self._parameters, self._no_return = parameters, no_return
        self._rotation, self._position = T_base_laser[:2, :2], T_base_laser[:2, 3]
        self._fan: tuple[int, float, float] | None = None
        self._unit: NDArray[np.float64] = np.empty((0, 2))

    def beams(self, scan: LaserScan, twist: NDArray[np.float64] | None = None) -> Beams:
        """Return the beams of a scan: readings below range_min and NaN are dropped, those beyond the maximum are no return.

        With a `twist` (3,), the base's velocity in metres and radians per second during the sweep, the beams are put to
        where they were when they were measured, all of them seen from the base at the scan's stamp.
        """
        max_range, usable = self.limits(scan)
        unit = self._directions(scan)
        ranges = scan.ranges_m.astype(np.float64)
        valid = (ranges >= scan.range_min_m) & (ranges > 0.0)
        returned = valid & (ranges < max_range)
        matched = returned & (ranges < usable)
        cleared = returned & ~matched
        if self._no_return != "ignore":
            cleared |= valid & ~returned
        if not math.isfinite(usable):  # nobody knows how far such a beam was free
            cleared[:] = False
        drawn = matched | cleared
        length = np.where(matched, ranges, usable)
        hit = matched | (cleared & (self._no_return == "max"))
        every = np.flatnonzero(matched)[:: self._parameters.lskip + 1]
        points = self._position + unit[every] * ranges[every, None]
        ends = self._position + unit[drawn] * length[drawn, None]
        directions = unit[every]
        if twist is not None and scan.time_increment_s != 0.0:
            times = sweep_times(scan)
            points, directions = _moved(points, times[every], twist), _turned(directions, times[every] * twist[2])
            ends = _moved(ends, times[drawn], twist)
        start = self._position.reshape(1, 2).astype(np.float64)
        return Beams(points, np.ascontiguousarray(directions), start, ends, np.ascontiguousarray(hit[drawn]))

    def limits(self, scan: LaserScan) -> tuple[float, float]:
        """Return maxRange and maxUrange as they apply to a scan, metres."""
        parameters = self._parameters
        max_range = parameters.maxRange if parameters.maxRange is not None else scan.range_max_m - 0.01
        usable = parameters.maxUrange if parameters.maxUrange is not None else max_range
        return max_range, min(usable, max_range)

    def _directions(self, scan: LaserScan) -> NDArray[np.float64]:
        fan = (scan.num_beams, scan.angle_min_rad, scan.angle_increment_rad)
        if fan != self._fan:
            angles = scan.angles_rad
            self._fan, self._unit = fan, np.stack([np.cos(angles), np.sin(angles)], axis=1) @ self._rotation.T
        return self._unit


def sweep_times(scan: LaserScan) -> NDArray[np.float64]:
    """Return when each beam was measured, float64 (N,), seconds after the stamp; a negative increment is a reversed sweep."""
    order = np.arange(scan.num_beams, dtype=np.float64)
    return (order if scan.time_increment_s > 0 else order[::-1]) * abs(scan.time_increment_s)


def _turned(vectors: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (N, 2) turned by angles (N,), radians."""
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]], axis=1)


def _moved(points: NDArray[np.float64], times: NDArray[np.float64], twist: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (N, 2), each seen by the base at its time, in the base at time 0; the velocity is constant."""
    return _turned(points, times * twist[2]) + times[:, None] * twist[:2]
