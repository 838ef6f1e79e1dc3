# SPDX-License-Identifier: MIT
"""What a new keyframe sets off: culling, new points, fusion, local bundle adjustment."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.bundles import adjust_local
from slamcli.orbslam3.fusion import fuse_around
from slamcli.orbslam3.inertial_mapping import InertialMapping
from slamcli.orbslam3.point_creation import points_from_neighbours
from slamcli.orbslam3.sparse_map import Ids, SparseMap

_LEAST_FOUND = 0.25
"""Share of the frames in which a new point should be seen that see it (ORB-SLAM, section VI-B)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingSettings:
    """How much is done per keyframe; the defaults are those of ORB-SLAM3."""

    num_neighbours: int = 10
    """Keyframes with which new points are triangulated; 20 for a camera without depth."""
    most_local: int = 25
    """Keyframes whose poses a local bundle adjustment moves."""
    close_m: float = float("inf")
    farthest_m: float = float("inf")
    culling: float = 0.9
    """A keyframe whose points are seen by three others to this share is redundant."""
    least_observations: int = 3
    """How often a point must be seen soon after it was made, more than: with depth counts twice; 2 for a camera without depth."""


class LocalMapping:
    """Keeps the map around the newest keyframe consistent and small."""

    def __init__(
        self, settings: MappingSettings, counts: Counter[str], inertial: InertialMapping | None = None
    ) -> None:
        self._settings, self._counts, self._inertial = settings, counts, inertial
        self._recent: Ids = np.empty(0, dtype=np.int64)

    def insert(self, sparse_map: SparseMap, keyframe: int, fresh: Ids, colours: NDArray[np.uint8] | None) -> None:
        """Work a keyframe into the map to the end.

        Parameters
        ----------
        fresh
            Points that were made from its depth.
        colours
            (N, 3), of its features.
        """
        settings = self._settings
        self._cull_points(sparse_map, keyframe)
        sparse_map.refresh_points(sparse_map.points_of(np.array([keyframe])))
        neighbours, _ = sparse_map.covisible(keyframe)
        made = points_from_neighbours(
            sparse_map, keyframe, neighbours[: settings.num_neighbours], colours, settings.farthest_m
        )
        self._recent = np.concatenate([self._recent, fresh, made])
        fuse_around(sparse_map, keyframe, neighbours[: settings.num_neighbours])
        inertially = self._inertial is not None and self._inertial.adjust_local(sparse_map, keyframe)
        if not inertially and len(sparse_map.living_keyframes) > 2:
            adjust_local(sparse_map, keyframe, most=settings.most_local)
        self._cull_keyframes(sparse_map, keyframe)

    def renumber(self, offset: int) -> None:
        """All points of the map got numbers higher by `offset`."""
        self._recent = self._recent + offset

    def forget(self) -> None:
        """Start with another map."""
        self._recent = np.empty(0, dtype=np.int64)

    def _cull_points(self, sparse_map: SparseMap, keyframe: int) -> None:
        """Take out recent points that too few frames find or too few keyframes see (ORB-SLAM, section VI-B)."""
        recent = self._recent[sparse_map.point_alive[self._recent]]
        if not len(recent):
            return
        seen = sparse_map.count_observations(recent)
        age = keyframe - sparse_map.first_keyframe[recent]
        rare = sparse_map.found[recent] < _LEAST_FOUND * sparse_map.visible[recent]
        lonely = (age >= 2) & (seen <= self._settings.least_observations)
        gone = rare | lonely
        sparse_map.remove_points(recent[gone])
        self._counts["points culled"] += int(gone.sum())
        self._recent = recent[~gone & (age < 3)]

    def _cull_keyframes(self, sparse_map: SparseMap, keyframe: int) -> None:
        """Take out keyframes around the newest whose points others see as well (ORB-SLAM, section VI-E)."""
        neighbours, _ = sparse_map.covisible(keyframe)
        ids = sparse_map.points_of(neighbours)
        observations, sightings = sparse_map.count_observations(ids), sparse_map.sightings(ids)
        for k in sorted(neighbours.tolist()):
            if sparse_map.parent[k] < 0 or k >= keyframe - 1:
                continue
            if self._inertial is not None and not self._inertial.may_cull(sparse_map, k):
                continue
            close = self._close(sparse_map, k)
            if sparse_map.redundancy(k, close, observations, 3, sightings) > self._settings.culling:
                sparse_map.remove_keyframe(k)
                observations = sparse_map.count_observations(ids)
                self._counts["keyframes culled"] += 1

    def _close(self, sparse_map: SparseMap, keyframe: int) -> NDArray[np.bool_]:
        """Return which features count: with a depth sensor those whose depth it measures well."""
        depth = sparse_map.depth[keyframe]
        if sparse_map.camera.baseline_m <= 0:
            return np.ones(len(depth), dtype=np.bool_)
        with np.errstate(invalid="ignore"):
            return depth < self._settings.close_m
