# SPDX-License-Identifier: MIT
"""BreezySLAM's logs (``exp*.dat``) as measurements: scans, wheel odometry, tf and the mount."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamcli.errors import RecordingError
from slamcli.measurements import LaserScan
from slamcli.recordings.log_record import LogClock, LogRecord, planar_odometry, planar_transform
from slamcli.runtime import RunLog

TIME_COLUMN, LEFT_COLUMN, RIGHT_COLUMN, NUM_OTHER_COLUMNS = 0, 2, 3, 24
"""Columns of microseconds and wheel ticks; the readings in millimetres are the last ones of at least so many others."""
MAX_LINE_BYTES = 1 << 20
_MAX_TIME_US = 2**31 * 10**6


@dataclass(frozen=True, slots=True, kw_only=True)
class BreezyOptions:
    """The robot; the defaults are the one of the Mines ParisTech logs (Steux and El Hamzaoui, ICARCV 2010)."""

    ticks_per_turn: float = 2000.0
    wheel_radius_m: float = 0.077
    half_axle_m: float = 0.165
    laser_ahead_m: float = 0.145
    num_beams: int = 682
    beam_step_rad: float = 2 * math.pi / 1024
    """Hokuyo URG-04LX: 1024 steps a turn, the middle beam straight ahead."""
    range_min_m: float = 0.02
    """Smaller readings are the scanner's error codes."""
    range_max_m: float = 4.0
    """Readings at or over this are no return."""
    scan_time_s: float = 0.1


def is_breezy(path: Path, options: BreezyOptions | None = None) -> bool:
    """Return whether the first line of a file is one of such a log."""
    options = options or BreezyOptions()
    try:
        with path.open("rb") as stream:
            line = stream.readline(MAX_LINE_BYTES)
            _parse(line if b"\0" not in line else b"", options)
    except (OSError, ValueError, IndexError, OverflowError):
        return False
    return True


def read_breezy(path: Path, log: RunLog, options: BreezyOptions | None = None) -> Iterator[LogRecord]:
    """Yield the log's measurements: ``/odom``, ``/tf`` (odom -> base_link), ``/scan``, and ``/tf_static`` (the mount).

    Odometry integrates the wheels' ticks along arcs; it begins at the origin.

    Raises
    ------
    RecordingError
        If no line of the log can be used.
    """
    options = options or BreezyOptions()
    clock = LogClock()
    wheels = _Wheels(options)
    num_scans, num_malformed, first = 0, 0, ""
    try:
        with path.open("rb") as stream:
            number = 0
            while line := stream.readline(MAX_LINE_BYTES):
                number += 1
                if not line.strip():
                    continue
                try:
                    stamp_ns, left, right, readings = _parse(line, options)
                except (ValueError, IndexError, OverflowError) as error:
                    num_malformed += 1
                    first = first or f"line {number}: {'too few values' if isinstance(error, IndexError) else error}"
                    continue
                if num_scans == 0:
                    mount = planar_transform(
                        stamp_ns, "base_link", "laser", options.laser_ahead_m, 0.0, 0.0, static=True
                    )
                    yield clock.record("/tf_static", mount)
                num_scans += 1
                pose, velocity = wheels.move(stamp_ns, left, right)
                yield clock.record("/odom", planar_odometry(stamp_ns, "odom", pose, velocity))
                yield clock.record("/tf", planar_transform(stamp_ns, "odom", "base_link", *pose))
                yield clock.record("/scan", _scan(stamp_ns, readings, options))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    if num_malformed:
        log.counts["malformed lines"] += num_malformed
        log.warn(f"{path}: {num_malformed} malformed lines left out (first: {first})")
    if not num_scans:
        columns = NUM_OTHER_COLUMNS + options.num_beams
        raise RecordingError(
            f"{path}: no line of it can be used: such a log has at least {columns} numbers on a line"
            + (f" ({first})" if first else "")
        )
    log.counts["scans"] += num_scans
    clock.tell(path.name, log)


class _Wheels:
    """Dead reckoning of a differential drive."""

    def __init__(self, options: BreezyOptions) -> None:
        self._options = options
        self._last: tuple[int, int, int] | None = None
        self._pose = (0.0, 0.0, 0.0)

    def move(self, stamp_ns: int, left: int, right: int) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Return the pose and the velocities (forward, turning) at new tick counts."""
        options = self._options
        velocity = (0.0, 0.0)
        if self._last is not None:
            metres = 2 * math.pi * options.wheel_radius_m / options.ticks_per_turn
            left_m, right_m = (left - self._last[1]) * metres, (right - self._last[2]) * metres
            forward, turn = (left_m + right_m) / 2, (right_m - left_m) / (2 * options.half_axle_m)
            x, y, yaw = self._pose
            middle = yaw + turn / 2
            self._pose = (x + forward * math.cos(middle), y + forward * math.sin(middle), yaw + turn)
            seconds = (stamp_ns - self._last[0]) / 1e9
            velocity = (forward / seconds, turn / seconds) if seconds > 0 else velocity
        self._last = (stamp_ns, left, right)
        return self._pose, velocity


def _parse(line: bytes, options: BreezyOptions) -> tuple[int, int, int, list[int]]:
    tokens = line.split()
    if len(tokens) < NUM_OTHER_COLUMNS + options.num_beams:
        raise IndexError
    time_us, left, right = (int(tokens[column]) for column in (TIME_COLUMN, LEFT_COLUMN, RIGHT_COLUMN))
    if not 0 <= time_us < _MAX_TIME_US or max(abs(left), abs(right)) > 2**63:
        raise ValueError("a time or a tick count is out of range")
    readings = [int(token) for token in tokens[-options.num_beams :]]
    if not all(-(2**31) <= reading < 2**31 for reading in readings):
        raise ValueError("a reading is out of range")
    return time_us * 1000, left, right, readings


def _scan(stamp_ns: int, readings: list[int], options: BreezyOptions) -> LaserScan:
    ranges = np.array(readings, dtype=np.float64) / 1000
    none = (ranges == 0.0) | (ranges >= options.range_max_m)  # 0 is the scanner's "farther than 22 m"
    wrong = ~none & (ranges < options.range_min_m)
    values = ranges.astype(np.float32)
    values[none] = np.inf
    values[wrong] = np.nan
    return LaserScan(
        stamp_ns=stamp_ns,
        frame_id="laser",
        angle_min_rad=-options.beam_step_rad * (options.num_beams - 1) / 2,
        angle_increment_rad=options.beam_step_rad,
        range_min_m=options.range_min_m,
        range_max_m=options.range_max_m,
        ranges_m=values,
        scan_time_s=options.scan_time_s,
    )
