# SPDX-License-Identifier: MIT
"""Checks of laser scanners: beams, limits, returns, and the direction in which they turn."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import se2, se3
from slamcli.measurements import LaserScan
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.checks.turn_evidence import hangs_upside_down
from slamcli.recordings.scan_normalisation import turn_counter_clockwise

_FEW_RETURNS = 0.2
_WORTH_SAYING = 0.001
_MIN_TURNS = 8
_TURN_RAD = (math.radians(4.0), math.radians(30.0))
_MAX_PAIR_S = 1.5


def beam_count(evidence: Evidence) -> Iterator[Finding]:
    """Find scans that change their number of beams."""
    for name, seen in evidence.scans.items():
        if len(seen.beam_counts) > 1:
            frequent, times = seen.beam_counts.most_common(1)[0]
            others = sum(seen.beam_counts.values()) - times
            yield Finding(
                severity="note",
                topic=name,
                message=f"{others} scans have {min(seen.beam_counts)} to {max(seen.beam_counts)} beams, not {frequent}: "
                "they are resampled to one fan",
                stamp_ns=seen.first_change_ns,
                count=others,
            )
        if 0 in seen.beam_counts:
            yield Finding(severity="warning", topic=name, message="scans without any beam", count=seen.beam_counts[0])


def angle_max(evidence: Evidence) -> Iterator[Finding]:
    """Find scans whose angle_max contradicts their increment and number of beams."""
    for name, seen in evidence.scans.items():
        if seen.num_misfit:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"angle_max of {seen.num_misfit} scans does not fit angle_increment and the number of beams "
                f"(off by {seen.misfit_beams:.1f} beams); angle_increment is followed",
                stamp_ns=seen.first_misfit_ns,
                count=seen.num_misfit,
            )


def limits(evidence: Evidence) -> Iterator[Finding]:
    """Find range limits that make no sense."""
    for name, found in evidence.of(LaserScan).items():
        scan = found.first
        if not isinstance(scan, LaserScan):
            continue
        low, high = scan.range_min_m, scan.range_max_m
        if not high > low or not high > 0:
            yield Finding(
                severity="error",
                topic=name,
                message=f"range_min {low:g} m and range_max {high:g} m leave no range",
                stamp_ns=scan.stamp_ns,
            )
        elif high > 500:
            yield Finding(
                severity="note",
                topic=name,
                message=f"range_max is {high:g} m: the driver does not say how far the scanner sees",
                stamp_ns=scan.stamp_ns,
            )
        seen = evidence.scans[name]
        if seen.num_beyond > _WORTH_SAYING * seen.num_readings:
            yield Finding(
                severity="note",
                topic=name,
                message=f"{_share(seen.num_beyond, seen.num_readings)} of the readings lie beyond range_max "
                f"({high:g} m, largest reading {seen.largest_m:.2f} m): they count as no return",
                count=seen.num_beyond,
            )
        if seen.num_at_max > _WORTH_SAYING * seen.num_readings:
            yield Finding(
                severity="note",
                topic=name,
                message=f"{_share(seen.num_at_max, seen.num_readings)} of the readings are exactly range_max: no return",
                count=seen.num_at_max,
                mend="--no-return free lets them clear space",
            )


def returns(evidence: Evidence) -> Iterator[Finding]:
    """Say which share of the beams has no usable reading, and warn if that is nearly all."""
    for name, seen in evidence.scans.items():
        if seen.num_readings == 0:
            continue
        without = seen.num_infinite + seen.num_at_max + seen.num_beyond
        unusable = seen.num_nan + seen.num_zero + seen.num_below
        share = 1 - (without + unusable) / seen.num_readings
        parts = [
            f"{_share(number, seen.num_readings)} {what}"
            for number, what in (
                (seen.num_infinite, "inf"),
                (seen.num_nan, "NaN"),
                (seen.num_zero, "zero or less"),
                (seen.num_below, "below range_min"),
                (seen.num_at_max + seen.num_beyond, "at or beyond range_max"),
            )
            if number
        ]
        if without + unusable > 0.01 * seen.num_readings:
            yield Finding(
                severity="warning" if share < _FEW_RETURNS else "note",
                topic=name,
                message=f"{100 * share:.0f} % of the readings are distances; the others: {', '.join(parts)}",
                count=without + unusable,
            )


def direction(evidence: Evidence) -> Iterator[Finding]:
    """Say which scanners turn clockwise or hang upside down (both are handled)."""
    for name, found in evidence.of(LaserScan).items():
        scan = found.first
        if not isinstance(scan, LaserScan):
            continue
        if scan.angle_increment_rad < 0:
            yield Finding(
                severity="note", topic=name, message="beams run clockwise: they are turned", stamp_ns=scan.stamp_ns
            )
        if hangs_upside_down(evidence.frames, scan.frame_id):
            yield Finding(
                severity="note",
                topic=name,
                message="the scanner hangs upside down, as its transform says: scans are turned",
                stamp_ns=scan.stamp_ns,
            )


def mirrored(evidence: Evidence) -> Iterator[Finding]:
    """Find scans that turn against the odometry: beams in the wrong order, or a mount that tf does not tell."""
    track = _yaw_track(evidence)
    if track is None:
        return
    stamps, yaws = track
    for name, seen in evidence.scans.items():
        right, wrong, votes, num = 0.0, 0.0, 0, 0
        for (t0, before), (t1, after) in zip(seen.profiles, seen.profiles[1:], strict=False):
            if not 0 < t1 - t0 < _MAX_PAIR_S * 1e9 or t0 < stamps[0] or t1 > stamps[-1]:
                continue
            turn = float(np.diff(np.interp([t0, t1], stamps, yaws))[0])
            if not _TURN_RAD[0] < abs(turn) < _TURN_RAD[1]:
                continue
            flip = hangs_upside_down(evidence.frames, before.frame_id)
            mismatch = _mismatches(before, after, turn, flip)
            if mismatch is None:
                continue
            right, wrong, num = right + mismatch[0], wrong + mismatch[1], num + 1
            votes += mismatch[1] < mismatch[0]
        if num >= _MIN_TURNS and votes > 0.75 * num and wrong < 0.85 * right:
            yield Finding(
                severity="error",
                topic=name,
                message=f"scans turn against the odometry in {votes} of {num} turns: they are mirrored",
                stamp_ns=seen.profiles[0][0],
                count=votes,
                mend="--flip-scan (or --static-tf with a roll of 3.14159 if the scanner hangs upside down)",
            )


def _mismatches(before: LaserScan, after: LaserScan, turn_rad: float, flip: bool) -> tuple[float, float] | None:
    """Return how badly two scans fit (mean difference in metres) if the robot turned so, and if it turned the other way."""
    try:
        a, b = (turn_counter_clockwise(scan, mirrored=flip) for scan in (before, after))
    except DataError:
        return None
    if a.num_beams != b.num_beams or a.num_beams < 20:
        return None
    shift = abs(turn_rad) / a.angle_increment_rad
    if shift > 0.5 * a.num_beams:
        return None
    sign = 1 if turn_rad > 0 else -1
    best = []
    for way in (sign, -sign):
        shifts = {way * round(shift * factor) for factor in (0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3)}
        costs = [cost for k in shifts if (cost := _shifted_cost(a.ranges_m, b.ranges_m, k)) is not None]
        if not costs:
            return None
        best.append(min(costs))
    return best[0], best[1]


def _shifted_cost(a: NDArray[np.float32], b: NDArray[np.float32], k: int) -> float | None:
    """Return the mean difference (clipped to 1 m) of ``b[i]`` and ``a[i + k]``, None for too little overlap."""
    first, second = (a[k:], b[: len(b) - k]) if k >= 0 else (a[:k], b[-k:])
    usable = np.isfinite(first) & np.isfinite(second)
    if np.count_nonzero(usable) < 20:
        return None
    return float(np.minimum(np.abs(first[usable] - second[usable]), 1.0).mean())


def _yaw_track(evidence: Evidence) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Return stamps (ascending) and unwrapped yaw of the odometry, None without."""
    for name, found in evidence.odometry.items():
        if len(found.stamps) >= 10 and "truth" not in name.lower():
            return _sorted_track(np.array(found.stamps, dtype=np.int64), np.array(found.poses)[:, 2])
    for edge in evidence.frames.edges:
        if not edge.static and "odom" in edge.parent and len(edge.stamps_ns) >= 10:
            poses = se3.to_se2(se3.from_position_quaternion(edge.positions_m, edge.quats_xyzw))
            return _sorted_track(edge.stamps_ns, poses[:, 2])
    return None


def _sorted_track(
    stamps: NDArray[np.int64], yaws: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    # Turns are summed in recorded order: sorting by a jittering clock would invent turns.
    unwrapped = np.concatenate([[0.0], np.cumsum(se2.wrap_angle(np.diff(yaws)))])
    ascending = np.maximum.accumulate(stamps)
    return ascending, unwrapped


def _share(number: int, of: int) -> str:
    percent = 100 * number / max(of, 1)
    return f"{percent:.0f} %" if percent >= 1 else f"{percent:.2g} %"
