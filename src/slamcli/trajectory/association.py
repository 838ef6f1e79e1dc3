# SPDX-License-Identifier: MIT
"""Which poses of two trajectories belong together: by nearest stamp, by interpolation, or by their number."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import EstimationError, UsageError
from slamcli.trajectory.resampling import interpolate
from slamcli.trajectory.trajectory import Trajectory

SyncMethod = Literal["nearest_time", "interpolation"]


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """Two trajectories of equal length whose poses belong together one by one."""

    reference: Trajectory
    estimate: Trajectory
    num_reference: int
    """Poses that the reference had."""
    num_estimate: int
    """Poses that the estimate had."""

    def __len__(self) -> int:
        return len(self.reference)


def match_stamps(
    stamps_s: ArrayLike, others_s: ArrayLike, max_diff_s: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return, for each stamp that has one within reach, its index and the index of the nearest other stamp.

    Parameters
    ----------
    stamps_s
        float64 (N,), seconds, in any order.
    others_s
        float64 (M,), seconds, in any order.
    max_diff_s
        Largest difference that still is a match, seconds, inclusive.

    Returns
    -------
    tuple
        Two int64 (K,) arrays; the first is increasing. One of the others can be matched more than once. Of two that are
        equally near the earlier one is taken; of several with the same stamp the last one where the others are sorted, and
        the first one where they are not (both as evo does).

    Notes
    -----
    Stamps are compared as float64 seconds, which is what evo and the TUM tools do: a difference at the tolerance falls on
    the same side. O((N + M) log M).
    """
    stamps, others = np.asarray(stamps_s, dtype=np.float64), np.asarray(others_s, dtype=np.float64)
    if not stamps.size or not others.size:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    is_sorted = bool((np.diff(others) >= 0).all())
    order = np.arange(len(others)) if is_sorted else np.argsort(others, kind="stable")
    times = others[order]
    above = np.searchsorted(times, stamps, side="right")
    lower, upper = np.maximum(above - 1, 0), np.minimum(above, len(times) - 1)
    if not is_sorted:
        lower = np.searchsorted(times, times[lower], side="left")
    diff_lower, diff_upper = np.abs(stamps - times[lower]), np.abs(times[upper] - stamps)
    take_upper = diff_upper < diff_lower
    if not is_sorted:
        take_upper |= (diff_upper == diff_lower) & (order[upper] < order[lower])
    best = np.where(take_upper, upper, lower)
    near = np.where(take_upper, diff_upper, diff_lower) <= max_diff_s
    return np.flatnonzero(near), order[best[near]]


def associate(
    reference: Trajectory,
    estimate: Trajectory,
    *,
    max_diff_s: float = 0.01,
    offset_s: float = 0.0,
    method: SyncMethod = "nearest_time",
) -> Matched:
    """Return the poses of two trajectories that belong together in time.

    Every pose of the trajectory with fewer poses (the estimate, if both have as many) looks for the nearest pose of the
    other one, so that none of the sparser one's poses is lost to the choice of partners.

    Parameters
    ----------
    reference, estimate
        Trajectories with stamps.
    max_diff_s
        Largest difference of stamps that still is a match, seconds.
    offset_s
        Is added to the stamps of the estimate for the comparison, seconds.
    method
        ``nearest_time`` takes poses as they are; ``interpolation`` gives the denser trajectory the stamps of the sparser.

    Raises
    ------
    EstimationError
        If no pose has a partner; the message compares the two time ranges.
    UsageError
        If one trajectory has no stamps and they differ in length.
    """
    if not (reference.timed and estimate.timed):
        return _by_number(reference, estimate)
    second_longer = len(estimate) > len(reference)
    short, long = (reference, estimate) if second_longer else (estimate, reference)
    shift = offset_s if second_longer else -offset_s
    kept, partners = match_stamps(short.stamps_s, long.stamps_s + shift, max_diff_s)
    if not kept.size:
        raise EstimationError(_no_match(reference, estimate, max_diff_s, offset_s))
    short = short.select(kept)
    long = interpolate(long, short.stamps_ns, shift_s=-shift) if method == "interpolation" else long.select(partners)
    pair = (short, long) if second_longer else (long, short)
    return Matched(*pair, num_reference=len(reference), num_estimate=len(estimate))


def _by_number(reference: Trajectory, estimate: Trajectory) -> Matched:
    if len(reference) != len(estimate):
        raise UsageError(
            f"{reference.source or 'the reference'} has {len(reference)} poses and"
            f" {estimate.source or 'the estimate'} has {len(estimate)}: without stamps in both, poses are paired line by line"
            " and must be as many (a times file gives stamps to a KITTI file)"
        )
    if reference.timed != estimate.timed:
        stamps = reference.stamps_ns if reference.timed else estimate.stamps_ns
        reference = replace(reference, stamps_ns=stamps, timed=True)
        estimate = replace(estimate, stamps_ns=stamps, timed=True)
    return Matched(reference, estimate, num_reference=len(reference), num_estimate=len(estimate))


def _no_match(reference: Trajectory, estimate: Trajectory, max_diff_s: float, offset_s: float) -> str:
    """Say why nothing matches: other unit, other range, or just too far apart."""
    ref, est = reference.stamps_s, estimate.stamps_s + offset_s
    message = (
        f"no stamps of {estimate.source or 'the estimate'} and {reference.source or 'the reference'} are within"
        f" {max_diff_s:g} s of each other: the estimate covers {_range(est)}, the reference {_range(ref)}"
    )
    ratio = float(np.abs(est).max() / max(np.abs(ref).max(), 1e-9))
    for factor in (1e3, 1e6, 1e9):
        if 0.9 < ratio / factor < 1.1 or 0.9 < ratio * factor < 1.1:
            return f"{message}; they differ by a factor of {factor:.0e}: the stamps have different units"
    if est.max() < ref.min() - max_diff_s or est.min() > ref.max() + max_diff_s:
        return f"{message}; they do not overlap: are these of the same run? (starts differ by {ref.min() - est.min():.6f} s)"
    return f"{message}; they overlap: allow a larger difference, or give the offset between the clocks"


def _range(stamps_s: NDArray[np.float64]) -> str:
    return f"{stamps_s.min():.6f} to {stamps_s.max():.6f} s"
