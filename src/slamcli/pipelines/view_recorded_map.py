# SPDX-License-Identifier: MIT
"""The map that a recording holds: its last occupancy grid, and the path on it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from slamcli.geometry import se3
from slamcli.recordings import Recording, Topic
from slamcli.recordings.adapters import StampedGrid
from slamcli.reports.figures.map import map_image
from slamcli.reports.figures.raster import Pixels
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.pipelines.view import ViewOptions

_BASE_FRAMES = ("base_footprint", "base_link")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedMap:
    """The last map of a topic."""

    topic: str
    stamped: StampedGrid
    seconds: float
    """Its stamp, from the recording's start."""
    trajectory: Trajectory | None
    """Where transforms say that the robot was in the map's frame."""

    def image(self, max_pixels: int) -> Pixels:
        """Return its picture."""
        title = f"{self.topic} at {self.seconds:.1f} s"
        if self.trajectory is not None:
            title += f" with transforms {self.trajectory.frame_id} > {self.trajectory.child_frame_id}"
        return map_image(self.stamped.grid, trajectory=self.trajectory, title=title, max_pixels=max_pixels)

    def facts(self) -> dict[str, Any]:
        """Return its figures."""
        from slamcli.pipelines.view_content import map_facts

        return {"topic": self.topic, "stamp_ns": self.stamped.stamp_ns, **map_facts(self.stamped.grid)}


def last_map(recording: Recording, options: ViewOptions) -> RecordedMap | None:
    """Return the last map of the recording's part, None where it has none with cells."""
    for topic in sorted((t for t in recording.topics(StampedGrid) if t.count != 0), key=_preference):
        found = recording.measurements([topic], start_s=options.start_s, duration_s=options.duration_s)
        last: StampedGrid | None = next(iter(deque(found, maxlen=1)), None)
        if last is not None and last.grid.cells.size:
            seconds = (last.stamp_ns - recording.start_ns) / 1e9
            path = _path_in(recording, last.grid.frame_id)
            return RecordedMap(topic=topic.name, stamped=last, seconds=seconds, trajectory=path)
    return None


def _preference(topic: Topic) -> tuple[bool, bool, str]:
    """Order topics: maps before costmaps."""
    name = topic.name.lower()
    return "costmap" in name, not name.endswith("/map"), name


def _path_in(recording: Recording, frame: str) -> Trajectory | None:
    tree = recording.frames()
    for base in _BASE_FRAMES:
        if frame not in tree.frames or base not in tree.frames or not tree.connected(frame, base):
            continue
        moving = [edge.stamps_ns for edge in tree.path(frame, base) if not edge.static]
        if not moving:
            continue
        stamps = max(moving, key=len)
        poses, known = tree.lookup_many(frame, base, stamps)
        if known.any():
            return Trajectory.from_se2(stamps[known].copy(), se3.to_se2(poses[known]), frame, base)
    return None
