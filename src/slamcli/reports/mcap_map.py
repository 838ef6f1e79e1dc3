# SPDX-License-Identifier: MIT
"""Maps and points of a replay as messages: the growing map, submaps as they finish, clouds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.measurements import PointCloud
from slamcli.pipelines.replay import Replay
from slamcli.recordings.adapters import StampedGrid
from slamcli.reports.mcap_clock import Clock, Entry, moments

_MOST_MAPS = 100
_MAP_BYTES = 250_000_000
"""Of all maps together before compression, which makes about a fiftieth of it."""
_MOST_SUBMAPS = 200
_CLOUD_BYTES = 24_000_000
_MOST_CLOUDS = 12
_MOST_POINTS = 600_000


def growing_map(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/map``: whole grids of one size, for Foxglove applies no updates of parts, each with a like share of new cells."""
    grid, seen = replay.grid, replay.first_seen
    if grid is None:
        return
    if seen is None:
        yield Entry(clock.begin_ns, "/map", StampedGrid(stamp_ns=clock.begin_ns, grid=grid))
        return
    number = len(replay.trajectory)
    amounts = np.bincount(seen[seen >= 0], minlength=number).astype(np.int64)
    times = np.array([clock.at_pose(i) for i in range(number)], dtype=np.int64)
    most = max(2, min(_MOST_MAPS, _MAP_BYTES // max(grid.cells.size, 1)))
    for i in moments(amounts, times, most):
        part = replay.map_at(i)
        if part is not None:
            yield Entry(clock.at_pose(i), "/map", StampedGrid(stamp_ns=clock.at_pose(i), grid=part))


def newest_submap(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/submap``: each planar submap at its place in the map, when it is finished."""
    if replay.submaps is None:
        return
    times = [clock.log_ns(stamp) for stamp in replay.submaps.finished_ns.tolist()]
    found = sorted((time, i) for i, time in enumerate(times) if replay.submaps.grids[i] is not None)
    last = 0
    for finished, i in found[:: max(1, math.ceil(len(found) / _MOST_SUBMAPS))]:
        grid = replay.submaps.grids[i]
        time = last = max(finished, last + 1)  # two are finished when the run ends
        if grid is not None:
            yield Entry(time, "/submap", StampedGrid(stamp_ns=time, grid=grid))


def growing_cloud(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/cloud``: each point from when the cell of the map below it is known, all from the start where there is no such map."""
    if replay.cloud is None or not len(replay.cloud.points_m):
        return
    cloud = _thinned(replay.cloud)
    since = _known_since(replay, cloud)
    amounts = np.bincount(since, minlength=len(replay.trajectory)).astype(np.int64)
    times = np.array([clock.at_pose(i) for i in range(len(amounts))], dtype=np.int64)
    most = max(1, min(_MOST_CLOUDS, 2 * _CLOUD_BYTES // (16 * len(cloud.points_m))))
    for i in moments(amounts, times, most) if most > 1 else [0]:
        part = _where(cloud, since <= i) if most > 1 else cloud
        time = clock.at_pose(i)
        yield Entry(time, "/cloud", replace(part, stamp_ns=time, frame_id=replay.trajectory.frame_id))


def dense_cloud(replay: Replay, clock: Clock) -> Iterator[Entry]:
    """Yield ``/dense``, whole and once, when everything was seen."""
    if replay.dense is not None and len(replay.dense.points_m):
        stamped = replace(_thinned(replay.dense), stamp_ns=clock.end_ns, frame_id=replay.trajectory.frame_id)
        yield Entry(clock.end_ns, "/dense", stamped)


def _known_since(replay: Replay, cloud: PointCloud) -> NDArray[np.int64]:
    """Return for each point (P,) the pose from which it is shown."""
    grid, seen = replay.grid, replay.first_seen
    if grid is None or seen is None:
        return np.zeros(len(cloud.points_m), dtype=np.int64)
    rows, columns = np.clip(grid.map_to_cell(cloud.points_m[:, :2]), 0, np.array(seen.shape) - 1).T
    since = seen[rows, columns].astype(np.int64)
    # Points over what the map does not know: with the last of it.
    return np.where(since >= 0, since, int(seen.max()))


def _thinned(cloud: PointCloud) -> PointCloud:
    every = max(1, math.ceil(len(cloud.points_m) / _MOST_POINTS))
    return _where(cloud, np.arange(len(cloud.points_m)) % every == 0)


def _where(cloud: PointCloud, chosen: NDArray[np.bool_]) -> PointCloud:
    colours = None if cloud.colours is None else cloud.colours[chosen]
    return PointCloud(stamp_ns=0, frame_id=cloud.frame_id, points_m=cloud.points_m[chosen], colours=colours)
