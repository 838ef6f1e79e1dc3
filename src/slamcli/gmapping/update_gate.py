# SPDX-License-Identifier: MIT
"""Which scans the filter takes: the first, and each after enough motion or time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.gmapping.parameters import GmappingParameters


@dataclass(slots=True)
class UpdateGate:
    """Counts motion and time since the last scan that was taken (linearUpdate, angularUpdate, temporalUpdate)."""

    parameters: GmappingParameters
    _distance_m: float = 0.0
    _turn_rad: float = 0.0
    _last_ns: int | None = None

    def takes(self, stamp_ns: int, motion: NDArray[np.float64]) -> bool:
        """Return whether the filter takes the next scan, to which `motion` (3,) led from the one before."""
        p = self.parameters
        self._distance_m += math.hypot(motion[0], motion[1])
        self._turn_rad += abs(motion[2])
        due = (
            self._last_ns is None
            or self._distance_m >= p.linearUpdate
            or self._turn_rad >= p.angularUpdate
            or (p.temporalUpdate >= 0 and (stamp_ns - self._last_ns) / 1e9 > p.temporalUpdate)
        )
        if due:
            self._distance_m, self._turn_rad, self._last_ns = 0.0, 0.0, stamp_ns
        return due
