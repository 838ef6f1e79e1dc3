# SPDX-License-Identifier: MIT
"""The scans and clouds of a recording at the poses that a result gave them: points in the map, and when its cells became known."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.mapper import InputPlan, find_tier
from slamcli.measurements import LaserScan, PointCloud
from slamcli.pipelines.range_input import planned_sensors
from slamcli.pipelines.replay_tracks import ScanTrack
from slamcli.recordings import Mends, open_recording
from slamcli.recordings.sensor_picks import NONE, TopicNames
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

_LIKE = {"amcl": "gmapping"}
"""Systems that are no tiers, and a tier that takes the same sensors."""
_MOST_SCANS = 1500
_MOST_POINTS = 240
"""Of one scan."""
_REACH_KEYS = ("maxUrange", "TRAJECTORY_BUILDER_2D.max_range", "TRAJECTORY_BUILDER_3D.max_range", "Grid/RangeMax")
"""How far tiers look, of their parameters; 0 is without limit."""
_MOST_RAYS = 20_000
_FARTHEST_M = 1000.0


def follow_ranges(
    files: Sequence[Path], run: Mapping[str, Any], trajectory: Trajectory, grid: OccupancyGrid | None,
    mends: Mends | None, log: RunLog,
) -> tuple[ScanTrack | None, NDArray[np.int32] | None]:  # fmt: skip
    """Return the scans of the topics that the run used, thinned, and int32 (H, W) when the cells of its map became known.

    Each scan is laid at the pose that has its stamp; those without one are left out. None where the run used no scans or clouds, or none
    has a pose; the second also where there is no map.

    Raises
    ------
    InputError
        If the recording cannot be read, or has no such topic.
    """
    topics = {role: _listed(run, "topics", role) for role in ("scan", "points")}
    if not any(topics.values()) or not run.get("algo"):
        return None, None
    thinned = _ThinnedScans(len(trajectory))
    seen = None
    if grid is not None:
        from slamcli.grids.first_seen import FirstSeen

        seen = FirstSeen(grid)
    reach_m = _reach(run)
    T_map_base = trajectory.transforms
    unplaced = 0
    indices = _by_stamp(trajectory)
    with log.stage("replay scans"):
        for stamp_ns, points, T_base_sensor in _points(files, run, topics, mends):
            found = indices[stamp_ns].popleft() if indices.get(stamp_ns) else None
            if found is None:
                unplaced += 1
                continue
            T = T_map_base[found] @ T_base_sensor
            in_map = (points @ T[:3, :3].T + T[:3, 3])[:, :2]
            if seen is not None:
                seen.add_rays(found, T[:2, 3], _shortened(T[:2, 3], in_map, reach_m))
            thinned.add(stamp_ns, found, in_map)
    if unplaced:
        log.note(f"{unplaced} scans of the recording have no pose in the result and are left out")
    return thinned.track(), None if seen is None else seen.result()


def _points(
    files: Sequence[Path], run: Mapping[str, Any], topics: Mapping[str, tuple[str, ...]], mends: Mends | None
) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield stamp, points (N, 3) in the sensor's frame and its mount (4, 4), in recorded order."""
    base = _listed(run, "frames", "base")
    plan = InputPlan(
        parameters=None, num_laser_scans=len(topics["scan"]), num_point_clouds=len(topics["points"]), spatial=True,
        keep_scans=True, odometry=False,
    )  # fmt: skip
    names = TopicNames(
        scans=topics["scan"] or (NONE,), points=topics["points"] or (NONE,), odometry=NONE,
        base_frame=base[0] if base else None,
    )  # fmt: skip
    quiet = RunLog()  # what there is to say about the recording was said when it was mapped
    with open_recording(list(files), mends=mends, log=quiet) as recording:
        feed = planned_sensors(recording, find_tier(_LIKE.get(str(run["algo"]), str(run["algo"]))), plan, names, quiet)
        for measurement in feed.measurements():
            if isinstance(measurement, LaserScan):
                yield measurement.stamp_ns, _ends(measurement), feed.T_base_laser[measurement.topic]
            elif isinstance(measurement, PointCloud):
                every = max(1, math.ceil(len(measurement.points_m) / _MOST_RAYS))
                points = measurement.points_m[::every].astype(np.float64)
                yield measurement.stamp_ns, points, feed.T_base_laser[measurement.topic]


def _ends(scan: LaserScan) -> NDArray[np.float64]:
    """Return the points (N, 3) that a scan hit, metres, in the scanner's frame."""
    hit = np.isfinite(scan.ranges_m) & (scan.ranges_m > 0)
    ranges, angles = scan.ranges_m[hit].astype(np.float64), scan.angles_rad[hit]
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))])


def _shortened(start: NDArray[np.float64], ends: NDArray[np.float64], reach_m: float) -> NDArray[np.float64]:
    """Return the ends of rays (N, 2) that are no longer than `reach_m`; longer ones end there."""
    along = ends - start
    lengths = np.hypot(along[:, 0], along[:, 1])
    scale = np.minimum(1.0, reach_m / np.maximum(lengths, 1e-9))
    return np.asarray(start + along * scale[:, None])


def _reach(run: Mapping[str, Any]) -> float:
    parameters = run.get("parameters")
    told = [parameters.get(key) for key in _REACH_KEYS] if isinstance(parameters, dict) else []
    return min((float(v) for v in told if isinstance(v, (int, float)) and 0 < v < _FARTHEST_M), default=_FARTHEST_M)


def _listed(run: Mapping[str, Any], section: str, role: str) -> tuple[str, ...]:
    """Return the names that stand in a section of the record: one, or several as a list."""
    values = run.get(section)
    value = values.get(role) if isinstance(values, dict) else None
    listed = value if isinstance(value, list) else [value]
    return tuple(name for name in listed if isinstance(name, str))


def _by_stamp(trajectory: Trajectory) -> dict[int, deque[int]]:
    """Return the poses of each stamp, in their order."""
    indices: defaultdict[int, deque[int]] = defaultdict(deque)
    for i, stamp in enumerate(trajectory.stamps_ns.tolist()):
        indices[stamp].append(i)
    return dict(indices)


class _ThinnedScans:
    """Keeps scans evenly, so that there are never more than 1500, of at most 240 points each.

    Parameters
    ----------
    number
        How many scans may come.
    """

    def __init__(self, number: int) -> None:
        self._every = max(1, math.ceil(number / _MOST_SCANS))
        self._number = 0
        self._stamps: list[int] = []
        self._indices: list[int] = []
        self._points: list[NDArray[np.float32]] = []

    def add(self, stamp_ns: int, index: int, points_m: NDArray[np.float64]) -> None:
        """Take the next scan, points (N, 2)."""
        self._number += 1
        if (self._number - 1) % self._every:
            return
        self._stamps.append(stamp_ns)
        self._indices.append(index)
        every = max(1, math.ceil(len(points_m) / _MOST_POINTS))
        self._points.append(points_m[::every].astype(np.float32))

    def track(self) -> ScanTrack | None:
        """Return what was kept, None if nothing was."""
        if not self._stamps:
            return None
        return ScanTrack(
            stamps_ns=np.array(self._stamps, dtype=np.int64),
            pose_index=np.array(self._indices, dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum([len(points) for points in self._points])]).astype(np.int64),
            points_m=np.concatenate(self._points),
        )
