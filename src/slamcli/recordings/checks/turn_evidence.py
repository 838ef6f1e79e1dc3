# SPDX-License-Identifier: MIT
"""How scans and odometry saw a robot turn: from scan to scan by the profiles of ranges alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import se3
from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import LaserScan, Odometry
from slamcli.recordings.recording import Recording
from slamcli.recordings.scan_normalisation import turn_counter_clockwise
from slamcli.recordings.topic_ranks import SCANS, ranked, usable_odometry
from slamcli.trajectory.wheel_odometry import WheelOdometry, smooth_stamps

ENOUGH = 300
"""Turns after which a scanner has shown what its clock is worth."""
_TURNING_RAD = 0.02
_NEAR_NS = 800_000_000
_LARGEST_TURN_RAD = math.radians(40.0)
_CLIP_M = 0.5
_MIN_BEAMS = 30
_MARGIN_BEAMS = 5
_CLEAR = 0.6
_MAX_SCANNERS = 4
_LONGEST_SWEEP_S = 0.25
_MIN_POSES = 10
_BACKWARD_SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnEvidence:
    """Turns between the scans of one topic."""

    stamps_ns: NDArray[np.int64]
    """int64 (N,), of the middle of each scan's sweep."""
    turns_rad: NDArray[np.float64]
    """float64 (N - 1,), from each scan to the next; 0 where the odometry knows of no turn nearby."""
    trusted: NDArray[np.bool_]
    """bool (N - 1,), whether the scans fit together so."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnsOfRobot:
    """How scans and odometry saw the robot turn."""

    odometry: str
    """Topic of the odometry, ``/tf`` for transforms."""
    wheels: WheelOdometry
    scans: dict[str, TurnEvidence]
    """By the scanner's topic."""


class _Poses(Protocol):
    stamps: list[int]
    poses: list[tuple[float, float, float]]


def turns_of_robot(recording: Recording, odometry: Mapping[str, _Poses]) -> TurnsOfRobot | None:
    """Return how a recording's scanners and odometry saw the robot turn; None where one is missing or its clock is bad.

    Parameters
    ----------
    odometry
        What the topics of odometry said, by name.
    """
    found = _wheels(recording, odometry)
    topics = ranked((topic for topic in recording.topics(LaserScan) if topic.count != 0), SCANS)[:_MAX_SCANNERS]
    if found is None or not topics:
        return None
    name, wheels = found
    scans = {}
    for topic in topics:
        first = next(iter(recording.measurements([topic])), None)
        if first is None:
            continue
        mirrored = hangs_upside_down(recording.frames(), first.frame_id)
        scans[topic.name] = measure_turns(recording.measurements([topic]), wheels, mirrored=mirrored)
    return TurnsOfRobot(odometry=name, wheels=wheels, scans=scans)


def _wheels(recording: Recording, odometry: Mapping[str, _Poses]) -> tuple[str, WheelOdometry] | None:
    topics = usable_odometry(topic for topic in recording.topics(Odometry) if topic.name in odometry)
    for topic in topics:
        told = odometry[topic.name]
        stamps = np.array(told.stamps, dtype=np.int64)
        if len(stamps) < _MIN_POSES or (np.diff(stamps) < 0).mean() > _BACKWARD_SHARE:
            return None
        return topic.name, WheelOdometry(smooth_stamps(stamps), np.array(told.poses))
    for edge in recording.frames().edges:
        if not edge.static and "odom" in edge.parent and len(edge.stamps_ns) >= _MIN_POSES:
            poses = se3.to_se2(se3.from_position_quaternion(edge.positions_m, edge.quats_xyzw))
            return "/tf", WheelOdometry(smooth_stamps(edge.stamps_ns), poses)
    return None


def hangs_upside_down(tree: FrameTree, laser_frame: str) -> bool:
    """Return whether a scanner's z axis points down in the robot's base frame, as far as that is known."""
    for base in ("base_link", "base_footprint", "base"):
        if base in tree.frames and laser_frame in tree.frames and tree.connected(base, laser_frame):
            return bool(tree.lookup(base, laser_frame)[2, 2] < 0)
    return False


def measure_turns(scans: Iterable[LaserScan], wheels: WheelOdometry, *, mirrored: bool = False) -> TurnEvidence:
    """Return the turns between scans until enough of them are known.

    A turn shifts the profile of ranges by so many beams; the shift of the least mean difference (clipped to 0.5 m) is
    found to a fraction of a beam by a parabola. Translation blurs it, which is why this tells clocks and no poses.

    Parameters
    ----------
    wheels
        Says where turns are worth looking for: within 0.8 s.
    mirrored
        True for a scanner that is mounted upside down.
    """
    stamps: list[int] = []
    turns: list[float] = []
    trusted: list[bool] = []
    before: LaserScan | None = None
    found = 0
    for scan in scans:
        after = _upright(scan, mirrored=mirrored)
        if after is None:
            continue
        if before is not None:
            largest = _largest_turn(wheels, before.stamp_ns, after.stamp_ns)
            turn = _turn(before, after, largest) if largest > _TURNING_RAD else (0.0, True)
            turns.append(0.0 if turn is None else turn[0])
            trusted.append(turn is not None and turn[1])
            found += trusted[-1] and abs(turns[-1]) > _TURNING_RAD
        stamps.append(after.stamp_ns + _half_sweep_ns(after))
        before = after
        if found >= ENOUGH:
            break
    return TurnEvidence(
        stamps_ns=np.array(stamps, dtype=np.int64),
        turns_rad=np.array(turns, dtype=np.float64),
        trusted=np.array(trusted, dtype=np.bool_),
    )


def _upright(scan: LaserScan, *, mirrored: bool) -> LaserScan | None:
    try:
        return turn_counter_clockwise(scan, mirrored=mirrored)
    except DataError:
        return None


def _half_sweep_ns(scan: LaserScan) -> int:
    sweep_s = abs(scan.time_increment_s) * (scan.num_beams - 1)
    return round(0.5e9 * sweep_s) if sweep_s < _LONGEST_SWEEP_S else 0


def _largest_turn(wheels: WheelOdometry, first_ns: int, last_ns: int) -> float:
    """Return how far the robot turned at most, by its wheels, in a time as long as that between two scans around it."""
    period = min(max(last_ns - first_ns, 20_000_000), _NEAR_NS)
    times = np.arange(first_ns - _NEAR_NS, last_ns + _NEAR_NS + period, period // 2)
    yaws = np.unwrap(wheels.at(times)[:, 2])
    return float(np.abs(yaws[2:] - yaws[:-2]).max())


def _turn(before: LaserScan, after: LaserScan, largest_rad: float) -> tuple[float, bool] | None:
    """Return the turn from one scan to the next, radians, and whether it stands out; None where nothing can be said."""
    step, num = before.angle_increment_rad, before.num_beams
    if num != after.num_beams or num < _MIN_BEAMS or not step > 0:
        return None
    reach = min(int(min(1.5 * largest_rad, _LARGEST_TURN_RAD) / step) + _MARGIN_BEAMS, num // 3)
    a, b = (np.where(np.isinf(scan.ranges_m), np.float32(np.nan), scan.ranges_m) for scan in (before, after))
    costs = np.full(2 * reach + 1, np.inf)
    for shift in range(-reach, reach + 1):
        costs[shift + reach] = _cost(a, b, shift)
    best = int(np.argmin(costs))
    known = costs[np.isfinite(costs)]
    if not 0 < best < 2 * reach or len(known) < reach or not np.isfinite(costs[best - 1 : best + 2]).all():
        return None
    low, middle, high = costs[best - 1 : best + 2]
    curve = low - 2 * middle + high
    fraction = 0.5 * (low - high) / curve if curve > 0 else 0.0
    return (best - reach + fraction) * step, bool(middle < _CLEAR * np.median(known))


def _cost(a: NDArray[np.float32], b: NDArray[np.float32], shift: int) -> float:
    """Return the mean difference of ``b[i]`` and ``a[i + shift]``, inf for too little overlap."""
    first, second = (a[shift:], b[: len(b) - shift]) if shift >= 0 else (a[:shift], b[-shift:])
    difference = np.abs(first - second)
    difference = difference[~np.isnan(difference)]
    if len(difference) < _MIN_BEAMS:
        return math.inf
    return float(np.minimum(difference, _CLIP_M).mean())
