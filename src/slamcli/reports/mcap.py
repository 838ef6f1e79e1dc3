# SPDX-License-Identifier: MIT
"""A result as a recording that Foxglove, RViz and every ROS tool open: the run as it went, in the order of time."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from slamcli.errors import UsageError
from slamcli.grids import OccupancyGrid
from slamcli.measurements import PointCloud
from slamcli.pipelines.replay import Replay, replay_of
from slamcli.posegraph import MapState
from slamcli.recordings import create_recording
from slamcli.recordings.adapters import LogLine, StampedGrid, StampedPath
from slamcli.reports import mcap_graph, mcap_map, mcap_motion, mcap_words
from slamcli.reports.mcap_clock import Clock, Entry, named_frames
from slamcli.trajectory import Trajectory

LATCHED = ("/trajectory", "/ground_truth", "/submaps", "/nodes", "/constraints", "/cloud", "/dense")
"""Topics of which who listens later gets the last message, besides maps and static transforms."""


def write_replay(path: Path, replay: Replay) -> dict[str, int]:
    """Write a replay to a recording (.mcap, .bag or a ROS 2 folder) and return the number of messages by topic.

    Everything is in the frame of the map, and log times are recorded time. What grows comes whole each time, so that a player can
    jump: the map (``/map``), the path (``/trajectory``), the graph (``/submaps``, ``/nodes``, ``/constraints``) and the points
    (``/cloud``); each at most some dozen times, when enough is new. ``docs/foxglove.md`` lists all topics. The same replay gives
    the same bytes.

    Raises
    ------
    InputError
        If the file cannot be written, or an image cannot be read.
    """
    clock = Clock(replay.trajectory)
    sources: tuple[Iterator[Entry], ...] = (
        mcap_motion.transforms(replay, clock),
        mcap_map.growing_map(replay, clock),
        mcap_map.newest_submap(replay, clock),
        mcap_motion.growing_path(replay, clock),
        mcap_motion.ground_truth(replay, clock),
        mcap_graph.growing_submaps(replay, clock),
        mcap_graph.growing_graph(replay, clock),
        mcap_map.growing_cloud(replay, clock),
        mcap_map.dense_cloud(replay, clock),
        mcap_motion.poses(replay, clock),
        mcap_motion.scans(replay, clock),
        mcap_motion.particles(replay, clock),
        mcap_words.images(replay, clock),
        mcap_words.steps(replay, clock),
        mcap_words.log_lines(replay, clock),
    )
    return _write(path, heapq.merge(*sources, key=lambda entry: entry.log_ns))


def write_result(
    path: Path,
    *,
    grid: OccupancyGrid | None = None,
    trajectory: Trajectory | None = None,
    truth: Trajectory | None = None,
    state: MapState | None = None,
    cloud: PointCloud | None = None,
) -> dict[str, int]:
    """Write what is no folder of a result, as `write_replay`; without a trajectory the map alone.

    Raises
    ------
    UsageError
        If there is nothing to write, or the file cannot be written.
    """
    if trajectory is not None and len(trajectory):
        moving = named_frames(trajectory)
        return write_replay(path, replay_of(path.stem, moving, grid=grid, truth=truth, state=state, cloud=cloud))
    truth = None if truth is None or not len(truth) else named_frames(truth)
    if grid is None and truth is None:
        raise UsageError(f"{path}: neither a map nor a trajectory to write")
    begin = 1 if truth is None else max(1, int(truth.stamps_ns.min()))
    entries = [] if grid is None else [Entry(begin, "/map", StampedGrid(stamp_ns=begin, grid=grid))]
    if truth is not None:
        entries.append(Entry(begin, "/ground_truth", StampedPath(stamp_ns=begin, path=truth)))
    return _write(path, iter(entries))


def _write(path: Path, entries: Iterator[Entry]) -> dict[str, int]:
    written: Counter[str] = Counter()
    compression = "lz4" if path.suffix.lower() == ".bag" else None  # maps of all sizes compress to a fiftieth
    with create_recording(path, compression=compression, latched=LATCHED) as recording:
        for log_ns, topic, what, msgtype in entries:
            if isinstance(what, list):
                recording.write_transforms(topic, what, log_time_ns=log_ns)
            else:
                kind = LogLine.msgtype(ros1=recording.ros1) if isinstance(what, LogLine) else msgtype
                recording.write(topic, what, log_time_ns=log_ns, msgtype=kind)
            written[topic] += 1
    return dict(sorted(written.items()))
