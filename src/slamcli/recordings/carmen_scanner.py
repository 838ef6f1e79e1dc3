# SPDX-License-Identifier: MIT
"""What a CARMEN log leaves unsaid about its scanner: directions of the beams, and which readings are none."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

# Scanners that are known by their number of beams: field of view in degrees, with a beam at either end.
_FIELDS_OF_VIEW_DEG = {
    101: 100.0,  # SICK LMS, 1 deg
    201: 100.0,  # 0.5 deg
    401: 100.0,  # 0.25 deg
    541: 270.0,  # SICK LMS 1xx, 0.5 deg
    682: 681 * 360.0 / 1024,  # Hokuyo URG-04LX
    683: 682 * 360.0 / 1024,
    726: 725 * 360.0 / 1024,
    769: 768 * 360.0 / 1024,
    1081: 270.0,  # Hokuyo UTM-30LX
}
_SICK_LIMITS_M = (8.0, 16.0, 32.0, 80.0)
_SICK_UNITS_M = (0.001, 0.01)
_KEPT_VALUES = 64


def beam_directions(
    num_beams: int, *, fov_rad: float | None = None, increment_rad: float | None = None
) -> tuple[float, float]:
    """Return the direction of the first beam and the step between beams, radians, symmetric about the scanner's x axis.

    Scanners of the CARMEN age see 180°: an odd number of beams has one at either end (181: -90° to +90° by 1°), an even
    one leaves out the last (180: -90° to +89° by 1°).
    """
    if increment_rad is not None and fov_rad is None:
        return -increment_rad * (num_beams - 1) / 2, increment_rad
    known = fov_rad is not None or num_beams in _FIELDS_OF_VIEW_DEG
    fov = fov_rad if fov_rad is not None else math.radians(_FIELDS_OF_VIEW_DEG.get(num_beams, 180.0))
    if increment_rad is None:
        closed = num_beams % 2 == 1 or (known and fov_rad is None)
        increment_rad = fov / max(num_beams - 1 if closed else num_beams, 1)
    return -fov / 2, increment_rad


class RangeSurvey:
    """Finds the reading that means "no return" from all readings of a scanner."""

    def __init__(self) -> None:
        self._largest: dict[float, int] = {}
        self._threshold = 0.0
        self._total = 0

    def add(self, ranges_m: NDArray[np.float64]) -> None:
        """Take in one scan."""
        self._total += ranges_m.size
        high = ranges_m[np.isfinite(ranges_m) & (ranges_m >= self._threshold)]
        if not high.size:
            return
        for value, count in zip(*(part.tolist() for part in np.unique(high, return_counts=True)), strict=True):
            self._largest[value] = self._largest.get(value, 0) + count
        if len(self._largest) > 2 * _KEPT_VALUES:
            kept = sorted(self._largest)[-_KEPT_VALUES:]
            self._largest = {value: self._largest[value] for value in kept}
            self._threshold = kept[0]

    def limit_m(self) -> tuple[float, bool]:
        """Return the range from which on a reading is no return, and whether the readings show one.

        Three signs are looked for. SICK scanners measure to 80 m at most, and send the last eight codes of their number
        format (81.83 to 81.91 m, or 8.183 to 8.191 m) for errors. Any scanner or simulator that clips has one largest
        value that stands out by its number. Without a sign the limit is the nearest one of a SICK above all readings.
        """
        if not self._largest:
            return _SICK_LIMITS_M[-1], False
        values = sorted(self._largest, reverse=True)
        largest = values[0]
        if largest >= _SICK_LIMITS_M[-1]:
            return _SICK_LIMITS_M[-1], True
        for unit in _SICK_UNITS_M:
            for bits in (13, 14):
                first, last = (2**bits - 9) * unit, (2**bits - 1) * unit
                if first - 0.004 <= largest <= last + 0.006:
                    return first - 0.004, True
        others = max((self._largest[value] for value in values[1:]), default=0)
        count = self._largest[largest]
        if count >= 20 and count >= 1e-4 * self._total and count >= 5 * others:
            return largest, True
        return next((limit for limit in _SICK_LIMITS_M if limit > largest), largest + 1.0), False


class ScannerParams:
    """The scanners' settings among a log's PARAM lines."""

    def __init__(self, params: Mapping[str, str]) -> None:
        self._params = {name.lower(): value for name, value in params.items()}

    def mount(self, rear: bool) -> tuple[float, float, float] | None:
        """Return the scanner's pose on the robot (x, y in metres, yaw in radians), None where no PARAM tells."""
        side = "rear" if rear else "front"
        x = self._number(f"robot_{side}laser_offset", f"robot_{side}_laser_offset")
        if x is None:
            return None
        y = self._number(f"robot_{side}laser_side_offset", f"robot_{side}_laser_side_offset") or 0.0
        yaw = self._number(f"robot_{side}laser_angular_offset", f"robot_{side}_laser_angular_offset")
        return x, y, (math.pi if rear else 0.0) if yaw is None else yaw

    def fov_rad(self, rear: bool) -> float | None:
        """Return the field of view; PARAM lines hold degrees (or radians, if the number is small enough)."""
        value = self._number(*self._names(rear, "fov", "field_of_view"))
        if value is None or value <= 0:
            return None
        return value if value < 2 * math.pi + 0.01 else math.radians(value) if value <= 360 else None

    def max_range_m(self, rear: bool) -> float | None:
        """Return the range at which the scanner's measurements end."""
        value = self._number(*self._names(rear, "max", "max_range", "maxrange"))
        return value if value is not None and value > 0 else None

    def _names(self, rear: bool, *endings: str) -> list[str]:
        side, number = ("rear", 2) if rear else ("front", 1)
        stems = (
            f"laser_{side}_laser",
            f"robot_{side}_laser",
            f"robot_{side}laser",
            f"laser_laser{number}",
            f"laser{number}",
            f"{side}laser",
            f"simulator_{side}laser",
            "simulator_laser",
            "laser",
        )
        return [f"{stem}_{ending}" for stem in stems for ending in endings]

    def _number(self, *names: str) -> float | None:
        for name in names:
            try:
                value = float(self._params[name])
            except (KeyError, ValueError):
                continue
            if math.isfinite(value):
                return value
        return None
