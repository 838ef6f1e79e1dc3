# SPDX-License-Identifier: MIT
"""When things are written: log times that never run backwards, and the moments at which what grows is written again."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.trajectory import Trajectory

MAP_FRAME = "map"
_BASE_FRAME = "base_link"
_LEAST_GAP_NS = 500_000_000


class Entry(NamedTuple):
    """One message."""

    log_ns: int
    topic: str
    what: Any
    """A measurement, or a list of transforms."""
    msgtype: str | None = None


class Clock:
    """Stamps of poses as times at which something can have become known.

    Parameters
    ----------
    trajectory
        At least one pose.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        stamps = np.maximum(trajectory.stamps_ns, 1)
        self.begin_ns = int(stamps.min())
        """Log time of what holds from the start."""
        self.end_ns = int(stamps.max())
        self._known_ns = np.maximum.accumulate(stamps)

    def at_pose(self, index: int) -> int:
        """Return when everything up to pose `index` was recorded: stamps of a poor clock may run backwards."""
        return int(self._known_ns[index])

    def log_ns(self, stamp_ns: int) -> int:
        """Return the log time of a stamp."""
        return min(max(self.begin_ns, int(stamp_ns)), max(self.end_ns, int(stamp_ns)))

    def pose_before(self, stamp_ns: int) -> int:
        """Return the last pose that is known at a time, 0 before the first."""
        return max(int(np.searchsorted(self._known_ns, stamp_ns, side="right")) - 1, 0)


def moments(amounts: NDArray[np.int64], times_ns: NDArray[np.int64], most: int) -> list[int]:
    """Return the places at which what grows is written: each with a like share of what is new, the last one with all of it.

    Parameters
    ----------
    amounts
        int64 (N,), how much is new at each place.
    times_ns
        int64 (N,), not decreasing; two moments are half a second apart or more.
    most
        How many moments there may be.
    """
    total = np.cumsum(amounts)
    if not len(total) or not total[-1]:
        return []
    shares = np.unique(np.searchsorted(total, total[-1] * np.arange(1, most + 1) / most, side="left"))
    first, last = int(np.argmax(total > 0)), int(np.argmax(total == total[-1]))
    chosen: list[int] = []
    for place in np.unique([first, *np.minimum(shares, last), last]).tolist():
        if chosen and times_ns[place] - times_ns[chosen[-1]] < _LEAST_GAP_NS:
            if place != last:
                continue
            if len(chosen) > 1:
                chosen.pop()
        chosen.append(place)
    return chosen


def named_frames(trajectory: Trajectory) -> Trajectory:
    """Return the trajectory with frames: those of a file have no names."""
    return Trajectory(
        trajectory.stamps_ns,
        trajectory.positions_m,
        trajectory.quats_xyzw,
        trajectory.frame_id or MAP_FRAME,
        trajectory.child_frame_id or _BASE_FRAME,
    )
