# SPDX-License-Identifier: MIT
"""Which poses of a trajectory are compared as pairs in relative errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from slamcli.errors import EstimationError, UsageError
from slamcli.evaluation.units import DeltaUnit
from slamcli.trajectory import Trajectory, path_lengths

Pairs = NDArray[np.int64]

_BLOCK = 512
_NEAR = 1e-6


def find_pairs(
    trajectory: Trajectory, delta: float, unit: DeltaUnit, *, all_pairs: bool = False, rel_tol: float = 0.1
) -> Pairs:
    """Return the pairs (K, 2), first and second index, that are `delta` apart.

    Consecutive pairs start where the one before ended; the second pose is the first one at which `delta` is reached
    (accumulated along the path for metres, degrees and radians). All pairs: for metres and seconds each pose with the later
    one that is nearest to `delta` away, if within ``rel_tol * delta``; for degrees and radians all pairs whose orientations
    differ by `delta` within ``rel_tol * delta``. For frames every pose is paired with the one `delta` later.

    Raises
    ------
    UsageError
        If `delta` is out of range for its unit.
    EstimationError
        If no pair is found.
    """
    _check(delta, unit)
    if unit is DeltaUnit.FRAMES:
        pairs = _by_frames(len(trajectory), int(delta), all_pairs=all_pairs)
    elif unit in (DeltaUnit.METRES, DeltaUnit.SECONDS):
        pairs = _by_progress(trajectory, delta, unit, delta * rel_tol, all_pairs=all_pairs)
    else:
        tolerance = delta * rel_tol
        if unit is DeltaUnit.DEGREES:
            delta, tolerance = float(np.deg2rad(delta)), float(np.deg2rad(tolerance))
        rotations = Rotation.from_matrix(trajectory.transforms[:, :3, :3])
        if all_pairs:
            pairs = _all_by_angle(rotations, delta, tolerance)
        else:
            pairs = _consecutive((rotations[:-1].inv() * rotations[1:]).magnitude().tolist(), delta)
    if not len(pairs):
        raise EstimationError(
            f"no two of {len(trajectory)} matched poses are {delta:g} {_NAMES[unit]} apart: ask for less"
            " or allow a larger tolerance"
        )
    return pairs


_NAMES = {
    DeltaUnit.FRAMES: "frames",
    DeltaUnit.METRES: "m",
    DeltaUnit.DEGREES: "rad",
    DeltaUnit.RADIANS: "rad",
    DeltaUnit.SECONDS: "s",
}


def _check(delta: float, unit: DeltaUnit) -> None:
    if not (math.isfinite(delta) and delta > 0):
        raise UsageError(f"delta {delta:g} must be a positive number")
    if unit is DeltaUnit.FRAMES and not float(delta).is_integer():
        raise UsageError(f"delta {delta:g} must be a whole number of frames")
    limit = {DeltaUnit.DEGREES: 180.0, DeltaUnit.RADIANS: math.pi}.get(unit, math.inf)
    if delta > limit:
        raise UsageError(f"delta {delta:g} is more than the largest angle between two orientations, {limit:g}")


def _by_frames(count: int, delta: int, *, all_pairs: bool) -> Pairs:
    first = np.arange(0, max(count - delta, 0), 1 if all_pairs else delta, dtype=np.int64)
    return np.column_stack([first, first + delta])


def _by_progress(trajectory: Trajectory, delta: float, unit: DeltaUnit, tolerance: float, *, all_pairs: bool) -> Pairs:
    if unit is DeltaUnit.METRES:
        if not all_pairs:
            return _consecutive(np.linalg.norm(np.diff(trajectory.positions_m, axis=0), axis=1).tolist(), delta)
        return _nearest(path_lengths(trajectory.positions_m), delta, tolerance)
    if not trajectory.timed:
        raise UsageError("a delta in seconds needs stamps; these poses have none")
    # A clock that runs backwards makes no progress until it has caught up.
    progress = np.maximum.accumulate(trajectory.stamps_ns - trajectory.stamps_ns[0]) / 1e9
    if all_pairs:
        return _nearest(progress, delta, tolerance)
    starts, last = [0], 0
    while True:
        last = int(np.searchsorted(progress, progress[last] + delta * (1 - 1e-9)))
        if last >= len(progress):
            return np.column_stack([starts[:-1], starts[1:]]).astype(np.int64)
        starts.append(last)


def _consecutive(steps: list[float], delta: float) -> Pairs:
    """Return pairs between which the steps add up to at least `delta`; the sum starts anew at each pair."""
    ends, total = [0], 0.0
    for i, step in enumerate(steps, start=1):
        total += step
        if total >= delta:
            ends.append(i)
            total = 0.0
    return np.column_stack([ends[:-1], ends[1:]]).astype(np.int64)


def _nearest(progress: NDArray[np.float64], delta: float, tolerance: float) -> Pairs:
    """Return each index with the first later one whose progress differs from its own by the nearest to `delta`."""
    count = len(progress)
    first = np.arange(count - 1)
    above = np.clip(np.searchsorted(progress, progress[:-1] + delta), first + 1, count - 1)
    below = np.searchsorted(progress, progress[np.maximum(above - 1, first + 1)])  # the first of equal ones
    below = np.maximum(below, first + 1)
    off_above = np.abs(progress[above] - progress[:-1] - delta)
    off_below = np.abs(progress[below] - progress[:-1] - delta)
    second = np.where(off_below <= off_above, below, above)
    near = np.minimum(off_below, off_above) <= tolerance
    return np.column_stack([first[near], second[near]])


def _all_by_angle(rotations: Rotation, delta: float, tolerance: float) -> Pairs:
    """Return all pairs whose orientations differ by an angle within `tolerance` of `delta`, in blocks of rows.

    The angle comes from the scalar product of the quaternions; the few pairs near a bound are measured again from their
    relative rotation, because the scalar product resolves small angles badly.
    """
    quats = rotations.as_quat()
    low, high = delta - tolerance, delta + tolerance
    found = []
    for start in range(0, len(quats) - 1, _BLOCK):
        rows = np.arange(start, min(start + _BLOCK, len(quats) - 1))
        dots = np.abs(quats[rows] @ quats[start + 1 :].T)
        angles = 2 * np.arccos(np.minimum(dots, 1.0))
        later = np.arange(start + 1, len(quats))[None, :] > rows[:, None]
        margin = _NEAR if low > 1e-3 else 1e-3
        i, j = np.nonzero(later & (angles >= low - margin) & (angles <= high + margin))
        value = angles[i, j]
        unsure = (np.abs(value - low) <= margin) | (np.abs(value - high) <= margin)
        i, j = i + start, j + start + 1
        if unsure.any():
            value[unsure] = (rotations[i[unsure]].inv() * rotations[j[unsure]]).magnitude()
        keep = (value >= low) & (value <= high)
        found.append(np.column_stack([i[keep], j[keep]]))
    return np.concatenate(found) if found else np.empty((0, 2), dtype=np.int64)
