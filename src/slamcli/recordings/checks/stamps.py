# SPDX-License-Identifier: MIT
"""Checks of header stamps: against each other, against the log time, and between sensors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import Image, ImuSample, LaserScan, Odometry, PointCloud
from slamcli.recordings.checks.evidence import Evidence
from slamcli.recordings.checks.finding import Finding
from slamcli.recordings.classic_log import CLASSIC_FORMATS
from slamcli.recordings.survey import TopicSurvey
from slamcli.trajectory.time_offset import estimate
from slamcli.trajectory.wheel_odometry import smooth_stamps

_SENSORS = (LaserScan, PointCloud, ImuSample, Odometry, Image)
# cartographer_rosbag_validate: gaps in range data and in IMU data, and delay between stamp and log time.
_POINTS_GAP_S = 0.1
_IMU_GAP_S = 0.05
_DELAY_WARNING_S = 0.1
_DELAY_ERROR_S = 0.5
_CLOCK_OFFSET_S = 0.1
_LONGEST_SWEEP_S = 0.25
_TURNING_OFFSET_S = 0.05
_BACKWARD_SHARE = 0.01
_ABSURD_NS = 10**9 * 86400 * 30


def _stamped(evidence: Evidence) -> Iterator[tuple[str, TopicSurvey]]:
    for name, found in evidence.surveys.items():
        if found.has_header and found.num > 0:
            yield name, found


def unset(evidence: Evidence) -> Iterator[Finding]:
    """Find header stamps of 0."""
    for name, found in _stamped(evidence):
        if found.num_unset:
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{found.num_unset} of {found.num} header stamps are unset (0); the log time is used instead",
                count=found.num_unset,
            )


def unit(evidence: Evidence) -> Iterator[Finding]:
    """Find stamps that are micro- or milliseconds in place of nanoseconds, or of another clock altogether."""
    for name, found in _stamped(evidence):
        stamp, logged = int(np.median(found.stamps_ns)), int(np.median(found.log_times_ns))
        if stamp <= 0 or logged <= 0 or abs(stamp - logged) < _ABSURD_NS:
            continue
        ratio = logged / stamp
        for factor, what in ((1e3, "microseconds"), (1e6, "milliseconds"), (1e9, "seconds")):
            if 0.9 < ratio / factor < 1.1 or 0.9 < ratio * factor < 1.1:
                yield Finding(
                    severity="error",
                    topic=name,
                    message=f"stamps look like {what} written as nanoseconds (or the other way round): they say "
                    f"{stamp / 1e9:.3f} s where the log says {logged / 1e9:.3f} s",
                    stamp_ns=int(found.stamps_ns[0]),
                    mend="correct the driver's unit; results have the stamps as they are",
                )
                break
        else:
            yield Finding(
                severity="note",
                topic=name,
                message=f"stamps count from another zero than the log (simulation, or a replay): they say "
                f"{stamp / 1e9:.3f} s where the log says {logged / 1e9:.3f} s",
                stamp_ns=int(found.stamps_ns[0]),
            )


def backward(evidence: Evidence) -> Iterator[Finding]:
    """Find stamps that run backwards within a topic."""
    for name, found in _stamped(evidence):
        steps = np.diff(found.stamps_ns)
        bad = np.flatnonzero(steps < 0)
        if len(bad):
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{len(bad)} of {found.num} stamps run backwards, by up to {-steps.min() / 1e9:.3f} s; "
                "the recorded order is kept, and time differences are smoothed",
                stamp_ns=int(found.stamps_ns[bad[0] + 1]),
                count=len(bad),
            )


def duplicate(evidence: Evidence) -> Iterator[Finding]:
    """Find stamps that repeat within a topic."""
    for name, found in _stamped(evidence):
        bad = np.flatnonzero(np.diff(found.stamps_ns) == 0)
        if len(bad):
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{len(bad)} of {found.num} stamps repeat the one before",
                stamp_ns=int(found.stamps_ns[bad[0] + 1]),
                count=len(bad),
            )


def gaps(evidence: Evidence) -> Iterator[Finding]:
    """Find times without data: over 0.1 s (IMU 0.05 s), and over three periods of the sensor."""
    for name, found in _stamped(evidence):
        kind = found.adapter.produces if found.adapter is not None else None
        if kind not in _SENSORS or found.num < 10:
            continue
        steps = np.diff(found.stamps_ns) / 1e9
        typical = max(float(np.median(np.abs(steps))), float(np.mean(np.abs(steps))))
        limit = max(_IMU_GAP_S if kind is ImuSample else _POINTS_GAP_S, 3 * typical)
        bad = np.flatnonzero(steps > limit)
        if len(bad):
            worst = int(np.argmax(steps))
            yield Finding(
                severity="warning",
                topic=name,
                message=f"{len(bad)} gap{'s' * (len(bad) != 1)} of more than {limit:.2g} s, the longest of {steps[worst]:.3g} s "
                f"at {found.stamps_ns[worst] / 1e9:.3f} s",
                stamp_ns=int(found.stamps_ns[bad[0]]),
                count=len(bad),
            )


def _sweep_s(found: TopicSurvey) -> float:
    """Return how long after its stamp a message can be whole: the duration of a scanner's sweep, seconds."""
    if not isinstance(found.first, (LaserScan, PointCloud)) or found.num < 2:
        return 0.0
    period = float(np.median(np.abs(np.diff(found.stamps_ns)))) / 1e9
    said = 0.0
    if isinstance(found.first, LaserScan):
        scan = found.first
        said = (scan.num_beams - 1) * abs(scan.time_increment_s) or scan.scan_time_s
    # Drivers leave the duration out, or write it in milliseconds: a scanner that turns takes its period then.
    plausible = 0.01 * period < said < 1.5 * period
    return min(said if plausible else period, _LONGEST_SWEEP_S)


def _delays(found: TopicSurvey) -> NDArray[np.float64]:
    """Return log time minus stamp, seconds (N,); 0 where a sweep explains it."""
    delays = (found.log_times_ns - found.stamps_ns) / 1e9
    return delays - np.clip(delays, 0.0, _sweep_s(found))


def delay(evidence: Evidence) -> Iterator[Finding]:
    """Compare header stamps with log times: 0.1 s in more than 1 % of the messages warns, 0.5 s typically is an error.

    The duration of a scanner's sweep is no delay. Classic logs have no log times of their own.
    """
    if evidence.contents.format in CLASSIC_FORMATS:
        return
    for name, found in _stamped(evidence):
        kind = found.adapter.produces if found.adapter is not None else None
        delays = _delays(found)
        typical = float(np.median(delays))
        # An unsynchronised clock altogether (other epoch) concerns `stamp-unit` and `stamp-clocks`.
        if kind not in _SENSORS or abs(typical) > 1e6:
            continue
        bad = np.flatnonzero(np.abs(delays) > _DELAY_WARNING_S)
        if not len(bad):
            continue
        worst = float(delays[np.argmax(np.abs(delays))])
        often = len(bad) > 0.01 * found.num
        yield Finding(
            severity="error" if abs(typical) > _DELAY_ERROR_S else "warning" if often else "note",
            topic=name,
            message=f"{len(bad)} of {found.num} messages are stamped more than {_DELAY_WARNING_S} s from their log time "
            f"(typically {_beside(typical)} it, at worst {_beside(worst)} it{_beside_sweep(found)})",
            stamp_ns=int(found.stamps_ns[bad[0]]),
            count=len(bad),
        )


def _beside(delay_s: float) -> str:
    return f"{abs(delay_s):.3f} s {'before' if delay_s >= 0 else 'after'}"


def _beside_sweep(found: TopicSurvey) -> str:
    sweep = _sweep_s(found)
    return f", beside a sweep of {sweep:.3f} s" if sweep else ""


def clocks(evidence: Evidence) -> Iterator[Finding]:
    """Find sensors whose clocks differ: their stamps lie otherwise against the log time than the others'."""
    typical = {
        name: float(np.median(_delays(found)))
        for name, found in _stamped(evidence)
        if found.adapter is not None and found.adapter.produces in _SENSORS and found.num_unset < found.num
    }
    if len(typical) < 2:
        return
    reference = float(np.median(list(typical.values())))
    # With two topics the median says nothing of which is right: the one nearer to the log time is.
    if len(typical) == 2:
        reference = min(typical.values(), key=abs)
    for name, late in typical.items():
        offset = late - reference
        if abs(offset) > _CLOCK_OFFSET_S:
            yield Finding(
                severity="error" if abs(offset) > _DELAY_ERROR_S else "warning",
                topic=name,
                message=f"its clock is {abs(offset):.3f} s {'behind' if offset > 0 else 'ahead of'} the other sensors' "
                "(or its messages were logged late)",
                stamp_ns=int(evidence.surveys[name].stamps_ns[0]),
                mend=f"--time-offset {name}={offset + evidence.time_offsets_ns.get(name, 0) / 1e9:.3f}",
            )


def turning(evidence: Evidence) -> Iterator[Finding]:
    """Find scans and odometry that saw the robot turn at different times: their clocks differ, or one is late."""
    told = evidence.turns
    for name, seen in told.scans.items() if told is not None else ():
        assert told is not None  # noqa: S101 - for the type checker
        if len(seen.stamps_ns) < 2 or (np.diff(seen.stamps_ns) < 0).mean() > _BACKWARD_SHARE:
            continue
        found = estimate(smooth_stamps(seen.stamps_ns), seen.turns_rad, seen.trusted, told.wheels)
        if abs(found.seconds) < _TURNING_OFFSET_S:
            continue
        late = "after" if found.seconds < 0 else "before"
        mended, sign = (name, 1) if told.odometry == "/tf" else (told.odometry, -1)
        offset = sign * found.seconds + evidence.time_offsets_ns.get(mended, 0) / 1e9
        yield Finding(
            severity="warning",
            topic=name,
            message=f"scans show turns about {abs(found.seconds):.2f} s {late} {told.odometry} does, by {found.num_scans} turns "
            f"(they then agree within {np.degrees(found.error_after_rad):.2f}° instead of {np.degrees(found.error_before_rad):.2f}°): "
            "the clocks differ, or stamps are set late; mapping estimates this better and corrects it by itself",
            stamp_ns=int(evidence.surveys[name].stamps_ns[0]),
            mend=f"--time-offset {mended}={offset:.2f}",
        )
