# SPDX-License-Identifier: MIT
"""Where a result went wrong, in a sentence: spells without poses, drift from the truth, double walls, scans off the map.

Every sentence follows from the data by the thresholds below, which docs/compare.md lists.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation.sharpness import Sharpness

LOST_S = 1.0
"""A spell without a pose is told from here on."""
DRIFT_M, DRIFT_TIMES = 0.1, 3.0
"""A distance from the truth is told above the larger of this and so many times the best result's ATE."""
RELATION_M, RELATION_TIMES, RELATION_SHARE = 0.2, 5.0, 0.01
"""A relation counts as missed above the larger of this and so many times the best result's mean; such a share is told."""
DOUBLE_M, DOUBLE_TIMES, DOUBLE_POINTS, DOUBLE_RADII = 0.1, 3.0, 15, 0.5
"""A place has double walls where the median offset between visits is above the larger of this and so many times that of the best
result, or above so many radii, at so many points."""
PLACE_RADII = 2.0
"""A place is a square as wide as so many radii of a neighbourhood."""
RESIDUAL_M, RESIDUAL_TIMES, RESIDUAL_SPELL_S = 0.15, 4.0, 1.0
"""Scans leave the map where their median distance to its walls is above the larger of this and so many times that of the best result,
for longer than this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that stands out."""

    kind: str
    """``lost``, ``drift``, ``relations``, ``alone``, ``double walls`` or ``off the map``."""
    at_s: float
    """When it began, seconds from the recording's start."""
    text: str
    at_m: tuple[float, float] | None = None
    """Where, in the result's own map."""


def lost_spells(stamps_ns: NDArray[np.int64], known: NDArray[np.bool_], begin_ns: int) -> list[Finding]:
    """Return the longest spell without poses, and how many more there are.

    Parameters
    ----------
    stamps_ns
        int64 (N,), when the sensor saw something.
    known
        bool (N,), whether there was a pose then.
    begin_ns
        Start of the recording.
    """
    order = np.argsort(stamps_ns, kind="stable")
    stamps, known = stamps_ns[order], known[order]
    if known.all() or not len(stamps):
        return []
    if not known.any():
        return [Finding(kind="lost", at_s=_since(stamps[0], begin_ns), text="no pose at any time")]
    edges = np.flatnonzero(np.diff(np.concatenate([[True], known, [True]]).astype(np.int8)))
    spells = []
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        last = stamps[after] if after < len(stamps) else stamps[-1]
        spells.append((float(last - stamps[first]) / 1e9, first, after))
    told = [spell for spell in spells if spell[0] >= LOST_S]
    if not told:
        return []
    seconds, first, after = max(told)
    at_s = _since(stamps[first], begin_ns)
    if first == 0:
        text = f"no pose for the first {seconds:.1f} s"
    elif after == len(stamps):
        text = f"lost track at {at_s:.1f} s and did not come back ({seconds:.1f} s)"
    else:
        text = f"lost track for {seconds:.1f} s at {at_s:.1f} s"
    others = len(told) - 1
    return [
        Finding(
            kind="lost",
            at_s=at_s,
            text=text + (f" ({others} shorter {'spells' if others > 1 else 'spell'})" if others else ""),
        )
    ]


def drift(
    stamps_ns: NDArray[np.int64], errors_m: NDArray[np.float64], best_m: float, begin_ns: int, against: str
) -> list[Finding]:
    """Return from when on a trajectory is far from the reference, if it is; `best_m` is the best result's root mean square error."""
    limit = max(DRIFT_M, DRIFT_TIMES * best_m)
    far = np.flatnonzero(errors_m > limit)
    if not len(far):
        return []
    at_s = _since(stamps_ns[far[0]], begin_ns)
    most = float(errors_m.max())
    share = 100.0 * len(far) / len(errors_m)
    return [
        Finding(
            kind="drift",
            at_s=at_s,
            text=f"up to {most:.2f} m off {against}, more than {limit:.2f} m from {at_s:.1f} s on ({share:.0f} % of the time)",
        )
    ]


def missed_relations(
    stamps_ns: NDArray[np.int64], errors_m: NDArray[np.float64], best_m: float, begin_ns: int
) -> list[Finding]:
    """Return how many relations are missed by far, and the first; `best_m` is the best result's mean error."""
    limit = max(RELATION_M, RELATION_TIMES * best_m)
    far = np.flatnonzero(errors_m > limit)
    if len(far) < max(RELATION_SHARE * len(errors_m), 1):
        return []
    first = far[np.argmin(stamps_ns[far])]
    at_s = _since(stamps_ns[first], begin_ns)
    return [
        Finding(
            kind="relations",
            at_s=at_s,
            text=f"misses {len(far)} of {len(errors_m)} true relations by more than {limit:.2f} m, the first at {at_s:.1f} s",
        )
    ]


def alone(
    stamps_ns: NDArray[np.int64], apart_m: NDArray[np.float64], nearest_m: float, closest_m: float, begin_ns: int
) -> list[Finding]:
    """Return that a result is far from all others while two of those agree.

    Parameters
    ----------
    stamps_ns, apart_m
        int64 (N,) and float64 (N,): distance over time to the nearest of the others.
    nearest_m, closest_m
        Root mean square distances: to the nearest of the others, and between the two of all that are closest to each other.
    """
    limit = max(DRIFT_M, DRIFT_TIMES * closest_m)
    far = np.flatnonzero(apart_m > limit)
    if nearest_m <= limit or not len(far):
        return []
    at_s = _since(stamps_ns[far[0]], begin_ns)
    text = f"stands alone: {nearest_m:.2f} m from the nearest of the others, two of which are within {closest_m:.2f} m; more than {limit:.2f} m from {at_s:.1f} s on"
    return [Finding(kind="alone", at_s=at_s, text=text)]


def double_walls(sharp: Sharpness, radius_m: float, best_m: float, begin_ns: int) -> list[Finding]:
    """Return the place where walls of different visits lie farthest apart, if that is far; `best_m` is the best result's median offset."""
    if not len(sharp.revisit_offset_m):
        return []
    usual = float(np.median(sharp.revisit_offset_m))
    limit = min(max(DOUBLE_M, DOUBLE_TIMES * best_m), DOUBLE_RADII * radius_m)
    side = PLACE_RADII * radius_m
    places, which = np.unique(np.floor(sharp.revisit_at_m[:, :2] / side).astype(np.int64), axis=0, return_inverse=True)
    which = which.ravel()
    worst: tuple[float, int] | None = None
    for place in range(len(places)):
        offsets = sharp.revisit_offset_m[which == place]
        if len(offsets) >= DOUBLE_POINTS:
            median = float(np.median(offsets))
            if median > limit and (worst is None or median > worst[0]):
                worst = (median, place)
    if worst is None:
        return []
    rows = np.flatnonzero((which == worst[1]) & (sharp.revisit_offset_m > limit))
    x, y = sharp.revisit_at_m[rows, :2].mean(axis=0).tolist()
    # The visit that made the wall double is the later one.
    at_s = _since(int(np.quantile(sharp.revisit_stamps_ns[rows], 0.75)), begin_ns)
    return [
        Finding(
            kind="double walls", at_m=(x, y), at_s=at_s,
            text=f"the map has double walls around ({x:.1f}, {y:.1f}): {worst[0]:.2f} m apart against {usual:.2f} m in half of the map, seen at {at_s:.1f} s",
        )
    ]  # fmt: skip


def off_the_map(
    stamps_ns: NDArray[np.int64], residuals_m: NDArray[np.float64], best_m: float, begin_ns: int
) -> list[Finding]:
    """Return when scans lay far from the map's walls, if they did for longer than a moment; `best_m` is the best result's median."""
    stamps, medians = medians_over_time(stamps_ns, residuals_m)
    if len(stamps) < 2:
        return []
    limit = max(RESIDUAL_M, RESIDUAL_TIMES * best_m)
    far = medians > limit
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(np.int8)))
    spells = [
        (a, b) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True) if b - a > RESIDUAL_SPELL_S
    ]
    if not spells:
        return []
    first, after = max(spells, key=lambda spell: spell[1] - spell[0])
    at_s = _since(stamps[first], begin_ns)
    worst = float(medians[first:after].max())
    return [
        Finding(
            kind="off the map",
            at_s=at_s,
            text=f"scans lie {worst:.2f} m off the map's walls from {at_s:.1f} s for {after - first} s",
        )
    ]


def medians_over_time(
    stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the median of values in each second that has any: the seconds' first stamps int64 (M,), and medians (M,)."""
    if not len(stamps_ns):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    second = (stamps_ns - stamps_ns.min()) // 1_000_000_000
    order = np.lexsort((values, second))
    seconds, first, count = np.unique(second[order], return_index=True, return_counts=True)
    return stamps_ns.min() + seconds * 1_000_000_000, values[order][first + count // 2]


def sentence(findings: list[Finding]) -> str:
    """Return what stands out, in one sentence, the first in time first; or that nothing does."""
    if not findings:
        return "nothing stood out"
    return "; ".join(finding.text for finding in sorted(findings, key=lambda finding: finding.at_s))


def _since(stamp_ns: int | np.int64, begin_ns: int) -> float:
    return float(int(stamp_ns) - begin_ns) / 1e9
