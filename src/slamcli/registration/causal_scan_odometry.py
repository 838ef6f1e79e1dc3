# SPDX-License-Identifier: MIT
"""The motion between scans as they come, from the wheels and the scans themselves; `laser_odometry` has whole recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.measurements import Odometry
from slamcli.registration.beams import Beams
from slamcli.registration.scan_odometry import ScanOdometry, ScanStep, between
from slamcli.trajectory.bending import as_pose
from slamcli.trajectory.causal_odometry import CausalOdometry

_LONGEST_PERIOD_S = 1.0
"""Time between two scans over which the motion does not tell the velocity."""
_SWEEP_SHARE = 1.1
"""A sweep that takes longer than the time between two scans cannot be what it says."""
_STEP_NS = 1000

BeamsOf = Callable[[NDArray[np.float64] | None], Beams]
"""Gives a scan's beams, moved by the base's velocity (3,) during the sweep (None: as they are)."""


@dataclass(frozen=True, slots=True, eq=False)
class CausalStep:
    """How the robot came to the newest scan."""

    stamp_ns: int
    """Greater than that of the scan before."""
    motion: NDArray[np.float64]
    """float64 (3,), from the scan before, seen from there; zero for the first."""
    twist: NDArray[np.float64] | None
    """float64 (3,), velocity by which the sweep was straightened; None where it was not."""
    odom: NDArray[np.float64]
    """float64 (3,), T_odom_base at the scan; zero without odometry."""
    match: ScanStep | None
    """How the scan was aligned; None where scans are not."""


class CausalScanOdometry:
    """Leads from scan to scan: by the wheels, and by alignment with the recent past where that is wanted.

    The velocity during a sweep is the newest that is known, where a whole recording would tell that during the sweep.
    """

    def __init__(
        self, delta_m: float, *, align: bool, deskew: bool, offset_s: float = 0.0, tangent: float = 1.0
    ) -> None:
        """Scans are aligned on cells of `delta_m`; `offset_s` is added to their stamps to look up the odometry."""
        self.wheels = CausalOdometry()
        self._aligned = ScanOdometry(delta_m, tangent=tangent) if align else None
        self._deskew, self._offset_ns = deskew, round(offset_s * 1e9)
        self._last: CausalStep | None = None

    def add(self, odometry: Odometry) -> None:
        """Take the next message of the wheels."""
        self.wheels.add(odometry)

    def step(self, stamp_ns: int, sweep_s: float, beams: BeamsOf) -> CausalStep:
        """Take the next scan, whose sweep takes `sweep_s` seconds (0: all at once)."""
        last = self._last
        stamp = stamp_ns if last is None else max(stamp_ns, last.stamp_ns + _STEP_NS)
        odom = self.wheels.at(stamp + self._offset_ns)
        motion, period_s = np.zeros(3), 0.0
        if last is not None:
            period_s = (stamp - last.stamp_ns) / 1e9
            motion = np.asarray(se2.between(last.odom, odom)) if self.wheels.is_known else last.motion
        twist = self._twist(motion, sweep_s, period_s)
        match = None
        if self._aligned is not None:
            before = self._aligned.pose
            match = self._aligned.step(beams(twist), as_pose(motion), known=self.wheels.is_known)
            motion = np.array(between(before, self._aligned.pose))
        self._last = CausalStep(stamp, motion, twist, odom, match)
        return self._last

    def _twist(self, motion: NDArray[np.float64], sweep_s: float, period_s: float) -> NDArray[np.float64] | None:
        """Return the velocity by which to straighten a sweep; None to leave it as it is."""
        if (
            not self._deskew
            or sweep_s == 0.0
            or not 1e-3 < period_s < _LONGEST_PERIOD_S
            or sweep_s > _SWEEP_SHARE * period_s
        ):
            return None
        return self.wheels.twist() if self.wheels.is_known else motion / period_s
