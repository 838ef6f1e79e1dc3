# SPDX-License-Identifier: MIT
"""Checks of IMUs: gravity and units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding

# cartographer_rosbag_validate: no specific force outside of 3 to 30 m/s², on average 9.5 to 10.5.
_LOW, _HIGH = 3.0, 30.0
_MEAN_LOW, _MEAN_HIGH = 9.5, 10.5
_GRAVITY = 9.81
_FASTEST_RAD_S = 35.0


def gravity(evidence: Evidence) -> Iterator[Finding]:
    """Find an IMU that does not measure gravity in m/s²."""
    for name, found in evidence.imus.items():
        force = np.array(found.acceleration)
        if len(force) == 0:
            continue
        mean = float(np.nanmean(force)) if np.isfinite(force).any() else float("nan")
        if not _MEAN_LOW <= mean <= _MEAN_HIGH:
            yield Finding(
                severity="error" if not _LOW <= mean <= _HIGH else "warning",
                topic=name,
                message=f"the specific force is {mean:.3g} m/s² on average, not {_MEAN_LOW} to {_MEAN_HIGH}: {_guess(mean)}",
                stamp_ns=found.stamps[0],
            )
        outside = np.flatnonzero(~((force >= _LOW) & (force <= _HIGH)))
        if len(outside) and _LOW <= mean <= _HIGH:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{len(outside)} of {len(force)} samples lie outside of {_LOW:g} to {_HIGH:g} m/s²",
                stamp_ns=found.stamps[int(outside[0])],
                count=len(outside),
            )


def _guess(mean: float) -> str:
    if 0.9 < mean < 1.1:
        return "it looks like multiples of g"
    if mean < 0.5:
        return "gravity seems to be removed"
    if 900 < mean < 1100:
        return "it looks like thousandths of g"
    return "the unit, the calibration or the mount is wrong"


def rotation(evidence: Evidence) -> Iterator[Finding]:
    """Find angular velocities in degrees per second."""
    for name, found in evidence.imus.items():
        rates = np.array(found.rotation)
        if len(rates) == 0:
            continue
        fastest = float(np.nanmax(rates)) if np.isfinite(rates).any() else 0.0
        if fastest > _FASTEST_RAD_S:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"turns at up to {fastest:.3g} rad/s: it looks like degrees per second",
                stamp_ns=found.stamps[int(np.nanargmax(rates))],
            )
