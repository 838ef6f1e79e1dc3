# SPDX-License-Identifier: MIT
"""Which clouds make one sweep, and when everything that happened during it has arrived."""

from __future__ import annotations

from collections import deque

import numpy as np

from slamcli.measurements import PointCloud

MOST_WAITING = 3
"""More groups than this do not wait for an IMU that is late."""


class CloudGrouping:
    """Collects clouds until each sensor has given its share, and holds them until time has passed their last point."""

    def __init__(self, num_sensors: int, clouds_each: int) -> None:
        self._num_sensors, self._clouds_each = max(1, num_sensors), clouds_each
        self._group: list[PointCloud] = []
        self._ready: deque[tuple[int, list[PointCloud]]] = deque()

    def add(self, cloud: PointCloud) -> None:
        """Take the next cloud; a sensor's cloud that is one too many begins the next group."""
        if sum(other.topic == cloud.topic for other in self._group) >= self._clouds_each:
            self._close()
        self._group.append(cloud)
        if len(self._group) >= self._num_sensors * self._clouds_each:
            self._close()

    def due(self, now_ns: int) -> list[list[PointCloud]]:
        """Return the groups whose last point is not after `now_ns`."""
        out = []
        while self._ready and (self._ready[0][0] <= now_ns or len(self._ready) > MOST_WAITING):
            out.append(self._ready.popleft()[1])
        return out

    def rest(self) -> list[list[PointCloud]]:
        """Return all groups that are left at the end."""
        self._close()
        out = [group for _, group in self._ready]
        self._ready.clear()
        return out

    def _close(self) -> None:
        if self._group:
            self._ready.append((max(_end_ns(cloud) for cloud in self._group), self._group))
            self._group = []


def _end_ns(cloud: PointCloud) -> int:
    if cloud.offset_ns is None or not len(cloud.offset_ns):
        return cloud.stamp_ns
    return cloud.stamp_ns + max(0, int(np.max(cloud.offset_ns)))
