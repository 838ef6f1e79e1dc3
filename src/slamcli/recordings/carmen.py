# SPDX-License-Identifier: MIT
"""CARMEN logs as measurements: scans, odometry, tf, mounts and, where it is there, ground truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from slamcli.errors import RecordingError
from slamcli.measurements import LaserScan
from slamcli.recordings.carmen_lines import LaserLine, LineReader, OdometryLine, ParamLine, Pose, TruthLine
from slamcli.recordings.carmen_scanner import RangeSurvey, ScannerParams, beam_directions
from slamcli.recordings.log_record import LogClock, LogRecord, planar_odometry, planar_transform
from slamcli.runtime import RunLog

_SAME_M = 0.01
_SAME_RAD = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class CarmenOptions:
    """What a CARMEN log may leave open."""

    fov_rad: float | None = None
    """The scanner's field of view; None takes it from PARAM lines and the number of beams."""
    max_range_m: float | None = None
    """Readings at or over this are no return; None finds it from PARAM lines and the readings."""


@dataclass(slots=True)
class _Scanner:
    """One of the two scanners, as the first reading of the file shows it."""

    rear: bool
    count: int = 0
    ranges: RangeSurvey = field(default_factory=RangeSurvey)
    mount: Pose | None = None
    mount_varies: bool = False
    declared_max_m: float | None = None

    @property
    def frame(self) -> str:
        return "rear_laser" if self.rear else "laser"

    def add(self, line: LaserLine) -> None:
        self.count += 1
        self.ranges.add(line.ranges_m)
        mount = _between(line.robot_pose, line.laser_pose)
        if self.mount is None:
            self.mount = mount
        elif not self.mount_varies:
            turn = abs(math.remainder(mount[2] - self.mount[2], 2 * math.pi))
            far = math.hypot(mount[0] - self.mount[0], mount[1] - self.mount[1])
            self.mount_varies = far > _SAME_M or turn > _SAME_RAD
        if line.max_range_m is not None:
            self.declared_max_m = max(line.max_range_m, self.declared_max_m or 0.0)


def read_carmen(path: Path, log: RunLog, options: CarmenOptions | None = None) -> Iterator[LogRecord]:
    """Yield a CARMEN log's measurements in the order of its lines.

    Topics: ``/scan`` and ``/rear_scan`` (LaserScan), ``/odom`` (Odometry, from ODOM lines or, where there are none, from
    the laser's records), ``/tf`` (odom -> base_link), ``/tf_static`` (the mounts), ``/base_pose_ground_truth`` (Odometry,
    from TRUEPOS). Stamps are the log's ``ipc_timestamp``; log times increase with the lines.

    The file is read twice: the largest readings, which mean "no return", are known only at its end.

    Raises
    ------
    RecordingError
        If no line of the log can be used.
    """
    options = options or CarmenOptions()
    return _Log(path, log, options).records()


class _Log:
    def __init__(self, path: Path, log: RunLog, options: CarmenOptions) -> None:
        self._path = path
        self._log = log
        self._options = options
        self._scanners = {False: _Scanner(False), True: _Scanner(True)}
        self._num_odometry = 0
        self._num_truth = 0
        self._first_ns: int | None = None
        self._beams: dict[tuple[bool, int], tuple[float, float]] = {}
        self._num_without_return = 0
        self._limits: dict[bool, float] = {}
        self._params = ScannerParams({})
        self._survey()

    def records(self) -> Iterator[LogRecord]:
        clock = LogClock()
        used = [scanner for scanner in self._scanners.values() if scanner.count]
        self._limits = {scanner.rear: self._limit(scanner) for scanner in used}
        first_ns = self._first_ns or 0
        for scanner in used:
            x, y, yaw = self._mount(scanner)
            transform = planar_transform(first_ns, "base_link", scanner.frame, x, y, yaw, static=True)
            yield clock.record("/tf_static", transform)
        # Without ODOM lines the robot's pose in the records of one scanner is the odometry.
        odometry_scanner = max(used, key=lambda scanner: scanner.count).rear if used else None
        for line in LineReader(self._path):
            if isinstance(line, LaserLine):
                if not self._num_odometry and line.rear is odometry_scanner:
                    yield from _odometry(clock, line.stamp_ns, line.robot_pose)
                topic = "/rear_scan" if line.rear else "/scan"
                yield clock.record(topic, self._scan(line))
            elif isinstance(line, OdometryLine):
                yield from _odometry(clock, line.stamp_ns, line.pose, line.velocity)
            elif isinstance(line, TruthLine):
                yield clock.record("/base_pose_ground_truth", planar_odometry(line.stamp_ns, "map", line.pose))
        self._tell(clock)

    def _survey(self) -> None:
        """Read the file once for what must be known beforehand."""
        lines = LineReader(self._path)
        params: dict[str, str] = {}
        for line in lines:
            if isinstance(line, ParamLine):
                params.setdefault(line.name, line.value)
                continue
            if self._first_ns is None:
                self._first_ns = line.stamp_ns
            if isinstance(line, LaserLine):
                self._scanners[line.rear].add(line)
            elif isinstance(line, OdometryLine):
                self._num_odometry += 1
            else:
                self._num_truth += 1
        self._params = ScannerParams(params)
        if lines.damage:
            self._log.warn(lines.damage)
        if lines.num_malformed:
            self._log.counts["malformed lines"] += lines.num_malformed
            self._log.warn(
                f"{self._path}: {lines.num_malformed} malformed lines left out (first: {lines.first_malformed})"
            )
        if lines.ignored:
            kinds = ", ".join(f"{count} {kind}" for kind, count in lines.ignored.most_common(5))
            self._log.note(f"{self._path.name}: lines that hold nothing for a map are left out: {kinds}")
        if self._first_ns is None:
            raise RecordingError(
                f"{self._path}: no line of it can be used: a CARMEN log has FLASER, ROBOTLASER1 or ODOM lines"
                + (f" (first malformed one: {lines.first_malformed})" if lines.num_malformed else "")
            )

    def _mount(self, scanner: _Scanner) -> Pose:
        """Return the scanner's pose on the robot: as PARAM lines say, else as laser and robot poses in the records do."""
        mount = self._params.mount(scanner.rear)
        if mount is not None:
            return mount
        if scanner.mount is not None and not scanner.mount_varies:
            return scanner.mount
        self._log.warn(
            f"{self._path.name}: no PARAM line tells where the {scanner.frame} sits, and the poses in its records vary; "
            "it is put at the centre of the robot"
        )
        return (0.0, 0.0, math.pi if scanner.rear else 0.0)

    def _limit(self, scanner: _Scanner) -> float:
        found, shown = scanner.ranges.limit_m()
        declared = self._options.max_range_m or scanner.declared_max_m or self._params.max_range_m(scanner.rear)
        limit = min(declared, found) if declared and shown and not self._options.max_range_m else declared or found
        why = "as declared" if declared else "the readings show it" if shown else "the largest reading is below it"
        self._log.note(f"{self._path.name}: {scanner.frame}: readings of {limit:.2f} m and more are no return ({why})")
        return limit

    def _scan(self, line: LaserLine) -> LaserScan:
        limit = self._limits[line.rear]
        with np.errstate(over="ignore"):  # beyond float32 is beyond every scanner
            ranges = line.ranges_m.astype(np.float32)
        none = line.ranges_m >= limit
        ranges[none] = np.inf
        ranges[line.ranges_m < 0] = np.nan
        self._num_without_return += int(np.count_nonzero(none))
        start, increment = self._directions(line)
        return LaserScan(
            stamp_ns=line.stamp_ns,
            frame_id=self._scanners[line.rear].frame,
            angle_min_rad=start,
            angle_increment_rad=increment,
            range_min_m=0.0,
            range_max_m=limit,
            ranges_m=ranges,
        )

    def _directions(self, line: LaserLine) -> tuple[float, float]:
        if line.start_rad is not None and line.increment_rad is not None and self._options.fov_rad is None:
            return line.start_rad, line.increment_rad
        key = (line.rear, line.ranges_m.size)
        if key not in self._beams:
            fov = self._options.fov_rad or self._params.fov_rad(line.rear)
            self._beams[key] = beam_directions(line.ranges_m.size, fov_rad=fov)
        return self._beams[key]

    def _tell(self, clock: LogClock) -> None:
        counts = self._log.counts
        counts["scans"] += sum(scanner.count for scanner in self._scanners.values())
        counts["odometry"] += self._num_odometry
        counts["ground truth"] += self._num_truth
        counts["readings without return"] += self._num_without_return
        if not self._num_odometry and any(scanner.count for scanner in self._scanners.values()):
            self._log.note(f"{self._path.name}: no ODOM lines; the odometry is that of the laser's records")
        clock.tell(self._path.name, self._log)


def _odometry(
    clock: LogClock, stamp_ns: int, pose: Pose, velocity: tuple[float, float] = (0.0, 0.0)
) -> Iterator[LogRecord]:
    yield clock.record("/odom", planar_odometry(stamp_ns, "odom", pose, velocity))
    yield clock.record("/tf", planar_transform(stamp_ns, "odom", "base_link", *pose))


def _between(a: Pose, b: Pose) -> Pose:
    """Return pose b as seen from pose a."""
    cosine, sine = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    return cosine * dx + sine * dy, cosine * dy - sine * dx, math.remainder(b[2] - a[2], 2 * math.pi)
