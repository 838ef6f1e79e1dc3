# SPDX-License-Identifier: MIT
"""Lines of CARMEN logs (``.log``, ``.clf``, also gzipped), one record each, malformed ones counted.

The format is described in the head of every log::

    FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp
    ROBOTLASER1 type start_angle field_of_view resolution maximum_range accuracy remission_mode num_readings
        [range_readings] num_remissions [remissions] laser_x laser_y laser_theta robot_x robot_y robot_theta
        tv rv forward_safety side_safety turn_axis ipc_timestamp host logger_timestamp
    ODOM x y theta tv rv accel …        TRUEPOS true_x true_y true_theta odom_x odom_y odom_theta …
    PARAM name value …
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError

MAX_LINE_BYTES = 4 << 20
_HEAD_BYTES = 1 << 20
_BINARY_BYTES = 4096
MAX_BEAMS = 100_000
_MAX_STAMP_NS = 2**31 * 10**9  # seconds are int32 in ROS 2
_GZIP_MAGIC = b"\x1f\x8b"

Pose = tuple[float, float, float]


class LaserLine(NamedTuple):
    """FLASER, RLASER, ROBOTLASER1 or ROBOTLASER2."""

    stamp_ns: int
    rear: bool
    ranges_m: NDArray[np.float64]
    laser_pose: Pose
    robot_pose: Pose
    start_rad: float | None = None
    increment_rad: float | None = None
    max_range_m: float | None = None


class OdometryLine(NamedTuple):
    """ODOM: pose, forward velocity, turning velocity."""

    stamp_ns: int
    pose: Pose
    velocity: tuple[float, float]


class TruthLine(NamedTuple):
    """TRUEPOS: the true pose."""

    stamp_ns: int
    pose: Pose


class ParamLine(NamedTuple):
    """PARAM: a setting of the robot."""

    name: str
    value: str


Line = LaserLine | OdometryLine | TruthLine | ParamLine


class LineReader:
    """Reads a log; after the last line the counts are complete."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ignored: Counter[str] = Counter()
        """Lines of kinds that hold nothing for a map, by kind."""
        self.num_malformed = 0
        self.first_malformed = ""
        self.damage = ""

    def __iter__(self) -> Iterator[Line]:
        with self._open() as stream:
            number = 0
            while True:
                try:
                    line = stream.readline(MAX_LINE_BYTES)
                except (EOFError, OSError, zlib.error) as error:
                    self.damage = f"{self.path}: damaged after line {number} ({error}); read up to there"
                    return
                if not line:
                    return
                number += 1
                kind, *values = line.split()[: MAX_BEAMS * 3] or [b"#"]
                parse = _PARSERS.get(kind)
                if parse is None:
                    if not kind.startswith(b"#"):
                        self.ignored[kind[:20].decode("ascii", errors="replace")] += 1
                    continue
                try:
                    yield parse(values)
                except (ValueError, IndexError, OverflowError, InvalidOperation) as error:
                    self.num_malformed += 1
                    self.first_malformed = self.first_malformed or f"line {number}: {_reason(error)}"

    def _open(self) -> IO[bytes]:
        try:
            with self.path.open("rb") as stream:
                packed = stream.read(2) == _GZIP_MAGIC
            return gzip.open(self.path, "rb") if packed else self.path.open("rb")  # type: ignore[return-value]
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read ({error.strerror or error})") from error


def is_carmen(path: Path) -> bool:
    """Return whether the first lines of a file look like a CARMEN log's."""
    try:
        with path.open("rb") as stream:
            head = stream.read(2)
        with gzip.open(path, "rb") if head == _GZIP_MAGIC else path.open("rb") as lines:
            block = lines.read(_HEAD_BYTES)
    except (OSError, EOFError, zlib.error):
        return False
    # Bags and databases have zeros near their beginning: they are not searched for lines.
    if b"\0" in block[:_BINARY_BYTES]:
        return False
    names = (*_PARSERS, b"SYNC", b"RAWLASER1")
    return any(line.partition(b" ")[0] in names for line in block.split(b"\n", 200)[:200])


def stamp_from_text(text: bytes) -> int:
    """Return a decimal number of seconds as nanoseconds, without rounding through a float.

    Raises
    ------
    ValueError
        If it is no number, negative, or beyond ROS's range.
    """
    seconds, _, fraction = text.partition(b".")
    if seconds.isdigit() and (fraction.isdigit() or not fraction) and len(fraction) <= 9:
        stamp = int(seconds) * 10**9 + int(fraction.ljust(9, b"0"))
    else:
        value = Decimal(text.decode("ascii"))
        if not value.is_finite() or abs(value) > 2**31:
            raise ValueError("a time stamp is not a possible number")
        stamp = round(value * 10**9)
    if not 0 <= stamp < _MAX_STAMP_NS:
        raise ValueError("a time stamp is out of range")
    return stamp


def _reason(error: Exception) -> str:
    return "too few values" if isinstance(error, IndexError) else str(error)[:100]


def _numbers(tokens: list[bytes], count: int) -> list[float]:
    if len(tokens) < count:
        raise IndexError
    values = [float(token) for token in tokens[:count]]
    if not all(map(math.isfinite, values)):
        raise ValueError("a value is not a finite number")
    return values


def _ranges(tokens: list[bytes], count: int) -> NDArray[np.float64]:
    if not 0 < count <= MAX_BEAMS:
        raise ValueError(f"{count} readings")
    if len(tokens) < count:
        raise IndexError
    return np.array([float(token) for token in tokens[:count]])


def _pose(values: list[float]) -> Pose:
    return values[0], values[1], values[2]


def _old_laser(tokens: list[bytes], rear: bool) -> LaserLine:
    count = int(tokens[0])
    ranges = _ranges(tokens[1:], count)
    tail = tokens[1 + count :]
    values = _numbers(tail, 6)
    return LaserLine(stamp_from_text(tail[6]), rear, ranges, _pose(values), _pose(values[3:]))


def _new_laser(tokens: list[bytes], rear: bool) -> LaserLine:
    _, start, _, increment, max_range, _, _ = _numbers(tokens, 7)
    count = int(tokens[7])
    ranges = _ranges(tokens[8:], count)
    num_remissions = int(tokens[8 + count])
    if not 0 <= num_remissions <= MAX_BEAMS:
        raise ValueError(f"{num_remissions} remissions")
    tail = tokens[9 + count + num_remissions :]
    values = _numbers(tail, 11)
    stamp = stamp_from_text(tail[11])
    return LaserLine(stamp, rear, ranges, _pose(values), _pose(values[3:]), start, increment or None, max_range or None)


def _odometry(tokens: list[bytes]) -> OdometryLine:
    values = _numbers(tokens, 6)
    return OdometryLine(stamp_from_text(tokens[6]), _pose(values), (values[3], values[4]))


def _truth(tokens: list[bytes]) -> TruthLine:
    values = _numbers(tokens, 6)
    return TruthLine(stamp_from_text(tokens[6]), _pose(values))


def _param(tokens: list[bytes]) -> ParamLine:
    return ParamLine(tokens[0].decode("utf-8", errors="replace"), tokens[1].decode("utf-8", errors="replace"))


_PARSERS: dict[bytes, Callable[[list[bytes]], Line]] = {
    b"FLASER": lambda tokens: _old_laser(tokens, rear=False),
    b"RLASER": lambda tokens: _old_laser(tokens, rear=True),
    b"ROBOTLASER1": lambda tokens: _new_laser(tokens, rear=False),
    b"ROBOTLASER2": lambda tokens: _new_laser(tokens, rear=True),
    b"ODOM": _odometry,
    b"TRUEPOS": _truth,
    b"PARAM": _param,
}
