# SPDX-License-Identifier: MIT
"""Scans as gmapping uses them: which beams are matched, which clear space, which end at an obstacle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.measurements import LaserScan
from slamcli.registration.beams import Beams, moved, sweep_times, turned

_UPRIGHT_TOLERANCE = 1e-3
"""How far the scanner's axis may be from the vertical (1 - |cos|), as in slam_gmapping."""


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
            points, directions = moved(points, times[every], twist), turned(directions, times[every] * twist[2])
            ends = moved(ends, times[drawn], twist)
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
