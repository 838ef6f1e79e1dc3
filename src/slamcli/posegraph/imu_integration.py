# SPDX-License-Identifier: MIT
"""What an IMU says about the motion between two times, without knowing where it is or which way is down.

The pre-integration of Lupton and Sukkarieh (T-RO 2012, doi:10.1109/TRO.2011.2170332), without biases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.posegraph import _imu_kernels as kernels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def integrate_imu(
    stamps_ns: Integers, angular_rad_s: Floats, linear_m_s2: Floats, begins_ns: Integers, ends_ns: Integers
) -> tuple[Floats, Floats, Floats]:
    """Return rotations and changes of velocity over K intervals, in the sensor's frame at the beginning of each.

    Parameters
    ----------
    stamps_ns : int64 (N,), increasing, N >= 1. A sample holds until the next; the first also holds before itself.
    angular_rad_s, linear_m_s2 : float64 (N, 3), rates and specific forces (gravity included) in the sensor's frame.
    begins_ns, ends_ns : int64 (K,), each end not before its beginning.

    Returns
    -------
    rotations : float64 (K, 4), quaternions xyzw that turn the frame at the end into that at the beginning.
    velocities : float64 (K, 3), metres per second; what gravity adds to it is still in there.
    gaps : float64 (K,), seconds between the samples that lie farthest apart among those used, including the time by which
        the interval begins before the first or ends after the last.

    Raises
    ------
    EstimationError
        If there is no sample, stamps do not increase, a value is not finite or an interval ends before it begins.

    Notes
    -----
    Within a sample's time rates are constant, and forces act half way through its rotation (second order).
    """
    stamps, begins, ends = (np.ascontiguousarray(values, np.int64) for values in (stamps_ns, begins_ns, ends_ns))
    rates, forces = (np.ascontiguousarray(values, np.float64) for values in (angular_rad_s, linear_m_s2))
    if len(stamps) == 0:
        raise EstimationError("there is no IMU sample to integrate")
    if np.any(np.diff(stamps) <= 0):
        at = stamps[1:][np.diff(stamps) <= 0][0]
        raise EstimationError(f"IMU samples do not increase in time at {at} ns")
    finite = np.isfinite(rates).all(axis=1) & np.isfinite(forces).all(axis=1)
    if not finite.all():
        raise EstimationError(f"the IMU sample at {stamps[~finite][0]} ns is not finite")
    if np.any(ends < begins):
        raise EstimationError(f"an interval of IMU samples ends before it begins, at {begins[ends < begins][0]} ns")
    rotations, velocities, gaps = np.zeros((len(begins), 4)), np.zeros((len(begins), 3)), np.zeros(len(begins))
    starts = np.maximum(np.searchsorted(stamps, begins, side="right") - 1, 0).astype(np.int64)
    kernels.integrate(stamps, rates, forces, begins, ends, starts, rotations, velocities, gaps)
    return rotations, velocities, gaps


def warm() -> None:
    """Compile the kernel of this module with one sample."""
    zero = np.zeros(1, np.int64)
    integrate_imu(zero, np.zeros((1, 3)), np.zeros((1, 3)), zero, zero + 1)
