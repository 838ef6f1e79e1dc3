# SPDX-License-Identifier: MIT
"""Checks of the sweeps of range sensors: whether they overlap, repeat or see nothing, and what their stamps mean."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import PointCloud
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.classic_log import CLASSIC_FORMATS

_OVERLAP_S = 0.002
_OVERLAP_SHARE = 0.05
_OFTEN = 0.01
_BLIND_S = 1.0
_SHORT_SWEEP_S = 0.02


def overlap(evidence: Evidence) -> Iterator[Finding]:
    """Find sweeps that begin before the one before them has ended: beam times or stamps are wrong."""
    for name, seen in evidence.sweeps.items():
        first, last = seen.first_ns, seen.last_ns
        if not seen.timed or len(first) < 2:
            continue
        lengths_s, over_s = (last - first) / 1e9, (last[:-1] - first[1:]) / 1e9
        ahead = np.diff(evidence.surveys[name].stamps_ns) > 0 if len(first) == evidence.surveys[name].num else True
        bad = np.flatnonzero(ahead & (over_s > np.maximum(_OVERLAP_S, _OVERLAP_SHARE * lengths_s[1:])))
        if not len(bad):
            continue
        yield Finding(
            severity="warning" if len(bad) > _OFTEN * len(first) else "note",
            topic=name,
            message=f"{len(bad)} of {len(first)} sweeps begin before the one before has ended, by up to "
            f"{over_s[bad].max():.3g} s (a sweep takes {float(np.median(lengths_s)):.3g} s by its points' times, and they come "
            f"every {float(np.median(np.abs(np.diff(first)))) / 1e9:.3g} s): the robot's motion during a sweep is not corrected well",
            stamp_ns=int(first[bad[0] + 1]),
            count=len(bad),
        )


def stamp_meaning(evidence: Evidence) -> Iterator[Finding]:
    """Find sweeps that are logged before their last point was measured: they are stamped at their end."""
    if evidence.contents.format in CLASSIC_FORMATS:
        return
    for name, seen in evidence.sweeps.items():
        found = evidence.surveys[name]
        last = seen.last_ns
        if len(last) != found.num or not len(last):
            continue
        length_s = float(np.median(last - seen.first_ns)) / 1e9
        early_s = float(np.median(last - found.log_times_ns)) / 1e9
        period_s = float(np.median(np.abs(np.diff(found.stamps_ns)))) / 1e9 if found.num > 1 else length_s
        # Clocks of another epoch concern `stamp-clocks`, sweeps that last for long `sweep-overlap`.
        if _SHORT_SWEEP_S < length_s < 1.1 * period_s and 0.5 * length_s < early_s < 1.5 * length_s:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"messages are logged {early_s:.3f} s before their last point was measured, by its time: stamps seem to "
                f"be those of the sweep's end, and times to count from its beginning (a sweep takes {length_s:.3f} s)",
                stamp_ns=int(found.stamps_ns[0]),
                mend=f"--time-offset {name}={evidence.time_offsets_ns.get(name, 0) / 1e9 - length_s:.3f}",
            )


def repeated(evidence: Evidence) -> Iterator[Finding]:
    """Find sweeps with exactly the readings of the one before: a driver that publishes old data again, or a simulated robot at rest."""
    for name, seen in evidence.sweeps.items():
        num = len(seen.num_points)
        if seen.num_repeats:
            yield Finding(
                severity="note",
                topic=name,
                message=f"{seen.num_repeats} of {num} sweeps hold exactly the readings of the one before: the driver repeats "
                "itself, or a simulated robot stands still",
                stamp_ns=seen.first_repeat_ns,
                count=seen.num_repeats,
            )


def blind(evidence: Evidence) -> Iterator[Finding]:
    """Find times in which a sensor sees nothing at all."""
    for name, seen in evidence.sweeps.items():
        nothing = seen.num_points == 0
        if not nothing.any():
            continue
        begins, ends = _longest_run(nothing, seen.first_ns)
        length_s = (ends - begins) / 1e9
        yield Finding(
            severity="warning" if length_s > _BLIND_S or nothing.mean() > _OFTEN else "note",
            topic=name,
            message=f"{int(nothing.sum())} of {len(nothing)} sweeps hold no distance at all, for up to {length_s:.3g} s "
            f"(from {begins / 1e9:.3f} s)",
            stamp_ns=begins,
            count=int(nothing.sum()),
        )


def _longest_run(flags: NDArray[np.bool_], stamps_ns: NDArray[np.int64]) -> tuple[int, int]:
    """Return when the longest run of flags begins, and the time of the first sweep after it (or of its last one)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    begins, ends = edges[::2], np.minimum(edges[1::2], len(flags) - 1)
    lengths = stamps_ns[ends] - stamps_ns[begins]
    longest = int(np.argmax(lengths))
    return int(stamps_ns[begins[longest]]), int(stamps_ns[ends[longest]])


def point_times(evidence: Evidence) -> Iterator[Finding]:
    """Say where the times of points are missing, or of another clock than the stamps."""
    for name, found in evidence.of(PointCloud).items():
        if isinstance(found.first, PointCloud) and found.first.offset_ns is None:
            yield Finding(
                severity="note",
                topic=name,
                message="points carry no times: the robot's motion during a sweep is not corrected",
                stamp_ns=found.first.stamp_ns,
            )
        for what, count in evidence.counts.items():
            if what.startswith(f"{name}: clouds whose point times"):
                yield Finding(severity="note", topic=name, message=what.removeprefix(f"{name}: "), count=count)


def slashes(evidence: Evidence) -> Iterator[Finding]:
    """Name sensors whose frames begin with a slash, as tf did before 2012 (Cartographer and tf2 refuse them)."""
    for name, frame in evidence.slashed.items():
        yield Finding(
            severity="note", topic=name, message=f"its frame is written {frame}, with a leading slash: it is left out"
        )
