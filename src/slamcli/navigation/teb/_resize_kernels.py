# SPDX-License-Identifier: MIT
"""Kernel that keeps the time steps of a band near their reference; see `slamcli.navigation.teb.band`."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MAX_ROUNDS = 100


@njit(cache=True, nogil=True)
def resize(
    poses: Floats, dts: Floats, num: int, dt_ref: float, hysteresis: float, low: int, high: int, once: bool
) -> int:
    """Insert and remove poses in place until steps last dt_ref +- hysteresis; return how many poses there are now.

    poses : float64 (C, 3) and dts : float64 (C,), C >= high + 1, of which `num` poses and num - 1 steps are in use; low and
    high bound the number of steps; once : one round only.
    """
    steps = num - 1
    for _ in range(1 if once else _MAX_ROUNDS):
        changed = False
        i = 0
        while i < steps:
            if dts[i] > dt_ref + hysteresis and steps < high:
                if dts[i] > 2.0 * dt_ref:  # halve it; the first half is looked at again
                    for k in range(steps, i, -1):
                        poses[k + 1] = poses[k]
                        dts[k] = dts[k - 1]
                    dts[i] *= 0.5
                    dts[i + 1] = dts[i]
                    turn = poses[i + 2, 2] - poses[i, 2]
                    turn -= 2.0 * np.pi * np.floor((turn + np.pi) / (2.0 * np.pi))
                    poses[i + 1, 0] = 0.5 * (poses[i, 0] + poses[i + 2, 0])
                    poses[i + 1, 1] = 0.5 * (poses[i, 1] + poses[i + 2, 1])
                    poses[i + 1, 2] = poses[i, 2] + 0.5 * turn
                    steps += 1
                    changed = True
                    continue
                if i < steps - 1:  # the rest of the time goes to the next step
                    dts[i + 1] += dts[i] - dt_ref
                dts[i] = dt_ref
            elif dts[i] < dt_ref - hysteresis and steps > low:
                changed = True
                gone = i + 1 if i < steps - 1 else i  # the pose that goes
                if i < steps - 1:
                    dts[i + 1] += dts[i]
                else:
                    dts[i - 1] += dts[i]
                for k in range(gone, steps):
                    poses[k] = poses[k + 1]
                for k in range(i, steps - 1):
                    dts[k] = dts[k + 1]
                steps -= 1
                continue
            i += 1
        if not changed:
            break
    return steps + 1
