# SPDX-License-Identifier: MIT
"""The best particle's map as it grows: what was drawn stays while the particle's past stays the same."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2
from slamcli.gmapping.parameters import GmappingParameters
from slamcli.gmapping.result import BeamsOf
from slamcli.grids import OccupancyGrid
from slamcli.grids.tiles import TiledMaps
from slamcli.trajectory.bending import between_updates, moved_scans

_SAME_M, _SAME_RAD = 0.01, 0.003
"""A past pose that differs from the drawn one by less is not drawn anew."""
_SETTLED, _SHOWN = 0, 1


class LiveMap:
    """Draws scans along the best particle's path into one map, and those after its last update into a copy of that.

    The former are settled: their poses are bent to pass through both updates around them. Those of the latter will still
    be bent, so they are drawn into a copy, which shares all tiles but the touched ones. When the best particle is another
    one with another past, everything is drawn again.
    """

    def __init__(self, parameters: GmappingParameters, beams: BeamsOf) -> None:
        self._parameters, self._beams = parameters, beams
        self._maps: TiledMaps | None = None
        self._path: NDArray[np.float64] = np.zeros((0, 3))
        self._poses: NDArray[np.float64] = np.zeros((0, 3))
        self._drawn: NDArray[np.int64] = np.zeros(0, np.int64)
        self._indices: NDArray[np.int64] = np.zeros(0, np.int64)

    def draw(
        self, indices: NDArray[np.int64], path: NDArray[np.float64], motions: NDArray[np.float64], frame_id: str
    ) -> OccupancyGrid:
        """Return the map of a path (K, 3) at the scans `indices` (K,), with motions (N, 3) that lead to each scan.

        Raises
        ------
        EstimationError
            If no scan shows anything.
        """
        maps = self._maps = self._maps or self._new_maps(path[0])
        same = self._same_past(path)
        if same < min(len(self._path), len(path)):
            maps.clear(_SETTLED)
            self._drawn, same = self._drawn[:0], 0
        # The stretch after the last update that was known is bent anew.
        first = max(same - 1, 0)
        begin = int(indices[first])
        tail = between_updates(motions[begin:], indices[first:] - begin, path[first:])
        self._poses = np.concatenate([self._poses[:begin], tail])
        self._path, self._indices = np.concatenate([self._path[:first], path[first:]]), indices
        chosen = self._chosen()
        settled, pending = chosen[chosen < indices[-1]], chosen[chosen >= indices[-1]]
        self._add(_SETTLED, settled)
        self._drawn = np.concatenate([self._drawn, settled])
        maps.resample(np.array([_SETTLED, _SETTLED]))
        self._add(_SHOWN, pending)
        return maps.occupancy(_SHOWN, self._parameters.occ_thresh, frame_id)

    def _same_past(self, path: NDArray[np.float64]) -> int:
        """Return how many of the first updates are where they were when they were drawn."""
        count = min(len(path), len(self._path))
        apart = path[:count] - self._path[:count]
        moved = np.hypot(apart[:, 0], apart[:, 1]) > _SAME_M
        moved |= np.abs(se2.wrap_angle(apart[:, 2])) > _SAME_RAD
        return int(np.argmax(moved)) if moved.any() else count

    def _chosen(self) -> NDArray[np.int64]:
        """Return the scans that are to be drawn and are not settled yet."""
        p, first = self._parameters, 0 if not len(self._drawn) else int(self._drawn[-1])
        if p.map_scans == "processed":
            chosen = self._indices
        else:  # goes on from the last one that was drawn
            chosen = first + moved_scans(self._poses[first:], every=p.map_scans == "all")
        return chosen[chosen > first] if len(self._drawn) else chosen

    def _add(self, index: int, scans: NDArray[np.int64]) -> None:
        if self._maps is None:
            return
        for k in scans.tolist():
            beams = self._beams(k)
            self._maps.add_scan(
                self._poses[k].reshape(1, 3), beams.start, beams.ends, beams.hit, np.array([index], np.int64)
            )

    def _new_maps(self, first: NDArray[np.float64]) -> TiledMaps:
        x, y = math.floor(float(first[0])), math.floor(float(first[1]))
        return TiledMaps(2, self._parameters.delta, (x - 20.0, y - 20.0, x + 20.0, y + 20.0))
