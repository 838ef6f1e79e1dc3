# SPDX-License-Identifier: MIT
"""What an adapter knows of the topic whose messages it decodes: stamps, frame names, mends and counts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.geometry import quaternion
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog

_LARGEST_QUATERNION = 1e6


class DecodeContext:
    """One topic being decoded."""

    __slots__ = ("_frames", "log", "mends", "offset_ns", "topic")

    def __init__(self, topic: str, mends: Mends, log: RunLog) -> None:
        self.topic = topic
        self.mends = mends
        self.log = log
        self.offset_ns = mends.time_offsets_ns.get(topic, 0)
        self._frames: dict[str, str] = {}

    def frame(self, recorded: str) -> str:
        """Return the frame name without tf1's leading slash, renamed as the mends say."""
        name = self._frames.get(recorded)
        if name is None:
            bare = recorded.lstrip("/")
            name = self._frames[recorded] = self.mends.renamed_frames.get(bare, bare)
            if bare in self.mends.renamed_frames:
                self.log.counts[renaming(bare, name)] += 1
        return name

    def stamp_ns(self, stamp: Any, fallback_ns: int) -> int:
        """Return a message's own stamp with the topic's offset, or `fallback_ns` where it is unset (0)."""
        own = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
        return own + self.offset_ns if own else fallback_ns

    def count(self, what: str) -> None:
        """Count something that was mended or skipped on this topic."""
        self.log.counts[f"{self.topic}: {what}"] += 1

    def quaternion(self, q: Any) -> NDArray[np.float64]:
        """Return a message's quaternion with length one (float64 (4,), xyzw); an unset one is the identity, counted."""
        x, y, z, w = q.x, q.y, q.z, q.w
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if abs(norm - 1.0) < 1e-9:
            return np.array((x, y, z, w))
        if not norm < _LARGEST_QUATERNION:
            raise DataError(f"orientation ({x:g}, {y:g}, {z:g}, {w:g}) is no rotation")
        if norm < 1e-12:
            self.count("orientations that were unset (all zero), taken as no rotation")
        return quaternion.normalise(np.array((x, y, z, w), dtype=np.float64))


def renaming(old: str, new: str) -> str:
    """Return under which name the log counts the topics in which a frame was renamed."""
    return f"frame {old} read as {new}: topics"


def vector(v: Any) -> NDArray[np.float64]:
    """Return a message's point or vector as float64 (3,)."""
    return np.array((v.x, v.y, v.z), dtype=np.float64)
