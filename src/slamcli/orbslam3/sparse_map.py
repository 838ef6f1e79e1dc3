# SPDX-License-Identifier: MIT
"""Keyframes, points and who sees what, as columns of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.orbslam3 import _map_kernels as kernels
from slamcli.orbslam3 import _sighting_kernels as sighting_kernels
from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.rows import Rows
from slamcli.orbslam3.sightings import Sightings, SightingTable
from slamcli.vision.features import Features
from slamcli.vision.matching import FeatureGrid, feature_grid
from slamcli.vision.pictures import Picture
from slamcli.vision.pinhole import Pinhole

Ids = NDArray[np.int64]
_WEAK = 15
"""Keyframes that share fewer points are not neighbours in the covisibility graph (ORB-SLAM, section III-D)."""


class SparseMap:
    """A map of points and keyframes.

    Rows are never taken out: a keyframe or point that was culled is dead (`keyframe_alive`, `point_alive`) and sees or is seen by
    nothing. There is one table of observations, `seen`, which `see` writes; everything else about who sees what comes from it.
    """

    def __init__(self, camera: Pinhole, scales: NDArray[np.float64]) -> None:
        self.camera = camera
        self.scales = np.asarray(scales, dtype=np.float64)
        """(L,), scale of each level of the image pyramid."""
        self.grids: list[FeatureGrid] = []
        self.words: list[Any] = []
        """What place recognition keeps of each keyframe; None without a vocabulary."""
        self.pictures: list[Picture | None] = []
        """For people to look at."""
        self.counts: list[int] = []
        """Number of features of each keyframe."""
        self.loop_edges: list[tuple[int, int]] = []
        self.T_world_map: NDArray[np.float64] | None = None
        """float64 (4, 4), where the map lies in the frame of results (z up), once that is known."""
        self.version = 0
        """Goes up whenever poses or points are moved by more than local mapping does (loop, merge)."""
        self._sightings = SightingTable()
        self._columns = {
            "T_camera_map": Rows((4, 4), np.float64), "stamp_ns": Rows((), np.int64), "frame_number": Rows((), np.int64),
            "keyframe_alive": Rows((), np.bool_), "parent": Rows((), np.int64),
            "T_camera_parent": Rows((4, 4), np.float64),
            "pixels": Rows((1, 2), np.float64), "raw_pixels": Rows((1, 2), np.float64),
            "octaves": Rows((1,), np.int64), "angles": Rows((1,), np.float64), "responses": Rows((1,), np.float64),
            "key_descriptors": Rows((1, 32), np.uint8), "sigmas": Rows((1,), np.float64, 1.0),
            "right": Rows((1,), np.float64, np.nan), "depth": Rows((1,), np.float64, np.nan),
            "positions": Rows((3,), np.float64), "normals": Rows((3,), np.float64), "descriptors": Rows((32,), np.uint8),
            "near": Rows((), np.float64), "far": Rows((), np.float64), "reference": Rows((), np.int64),
            "point_alive": Rows((), np.bool_), "visible": Rows((), np.int64), "found": Rows((), np.int64),
            "first_keyframe": Rows((), np.int64), "replaced_by": Rows((), np.int64, -1), "colours": Rows((3,), np.uint8),
        }  # fmt: skip

    def __getattr__(self, name: str) -> NDArray[Any]:
        """Return a column as a view that writes through; it is outdated by the next keyframe or points."""
        try:
            rows: Rows = self.__dict__["_columns"][name]
        except KeyError:
            raise AttributeError(name) from None
        return rows.values

    # observations

    @property
    def seen(self) -> Ids:
        """int64 (K, F), the point that each feature of each keyframe sees, -1 for none; `see` writes it."""
        return self._sightings.seen

    def see(self, keyframes: ArrayLike, features: Ids, points: ArrayLike) -> None:
        """Let features (N,) of keyframes (N,) see points (N,), -1 for none; one keyframe or point stands for N."""
        self._sightings.write(keyframes, features, points)

    def restore_seen(self, seen: Ids) -> None:
        """Take over a whole table (K, F) of who sees what."""
        self._sightings.restore(seen)

    # keyframes

    @property
    def num_keyframes(self) -> int:
        """Number of keyframes, dead ones too."""
        return len(self.counts)

    @property
    def num_points(self) -> int:
        """Number of points, dead ones too."""
        return len(self._columns["positions"])

    @property
    def living_keyframes(self) -> Ids:
        """Keyframes that were not culled, in increasing order."""
        return np.flatnonzero(self.keyframe_alive)

    @property
    def centres(self) -> NDArray[np.float64]:
        """float64 (K, 3), where the cameras were, map frame, metres."""
        T = self.T_camera_map
        return -np.einsum("kji,kj->ki", T[:, :3, :3], T[:, :3, 3])

    def features(self, keyframe: int) -> Features:
        """Return a keyframe's features, as views."""
        n = self.counts[keyframe]
        rows = {
            name: getattr(self, name)[keyframe, :n]
            for name in ("pixels", "octaves", "angles", "responses", "sigmas", "right", "depth", "raw_pixels")
        }
        return Features(descriptors=self.key_descriptors[keyframe, :n], **rows)

    def add_keyframe(self, frame: Frame, parent: int, words: Any = None) -> int:
        """Append a tracked frame with what it sees; return its number as a keyframe.

        Parameters
        ----------
        parent
            Keyframe above it in the spanning tree; -1 for the first.
        words
            What place recognition keeps of it.
        """
        k, features = self.num_keyframes, frame.features
        wide: dict[str, NDArray[Any]] = {
            "pixels": features.pixels, "raw_pixels": features.raw_pixels, "octaves": features.octaves,
            "angles": features.angles, "responses": features.responses, "key_descriptors": features.descriptors,
            "sigmas": features.sigmas, "right": features.right, "depth": features.depth,
        }  # fmt: skip
        for name, row in wide.items():
            rows = self._columns[name]
            rows.widen(len(row))
            whole = np.full((1, *rows.values.shape[1:]), rows.fill, dtype=rows.values.dtype)
            whole[0, : len(row)] = row
            rows.append(whole)
        single = {
            "T_camera_map": frame.T_camera_map, "stamp_ns": frame.stamp_ns, "frame_number": frame.number,
            "keyframe_alive": True, "parent": parent, "T_camera_parent": np.eye(4),
        }  # fmt: skip
        for name, value in single.items():
            self._columns[name].append(np.asarray(value)[None])
        self._sightings.add_keyframe(self.resolved(frame.points))
        self.counts.append(len(features))
        self.grids.append(frame.grid)
        self.words.append(words)
        self.pictures.append(frame.picture)
        return k

    def append(self, other: SparseMap) -> tuple[int, int]:
        """Append another map's keyframes and points, dead ones too; return what is added to the numbers of each."""
        keyframes, points = self.num_keyframes, self.num_points
        shifts = {
            "replaced_by": points,
            "parent": keyframes,
            "reference": keyframes,
            "first_keyframe": keyframes,
        }
        for name, rows in self._columns.items():
            values = getattr(other, name)
            if name in shifts:
                values = np.where(values >= 0, values + shifts[name], values)
            if values.ndim > 1:
                rows.widen(values.shape[1])
                whole = np.full((len(values), *rows.values.shape[1:]), rows.fill, dtype=rows.values.dtype)
                whole[:, : values.shape[1]] = values
                values = whole
            rows.append(values)
        self._sightings.add_points(other.num_points)
        self._sightings.append(other._sightings, points)
        self.grids += other.grids
        self.words += other.words
        self.pictures += other.pictures
        self.counts += other.counts
        self.loop_edges += [(a + keyframes, b + keyframes) for a, b in other.loop_edges]
        return keyframes, points

    def remove_keyframe(self, keyframe: int) -> None:
        """Cull a keyframe that has a parent: it sees nothing any more, its children get another parent, and its pose hangs on its own parent's."""
        parent = int(self.parent[keyframe])
        self.T_camera_parent[keyframe] = self.T_camera_map[keyframe] @ np.linalg.inv(self.T_camera_map[parent])
        for child in np.flatnonzero((self.parent == keyframe) & self.keyframe_alive):
            self.parent[child] = self._new_parent(int(child), keyframe, parent)
        self.see(keyframe, np.arange(self.seen.shape[1]), -1)
        self.pictures[keyframe] = None
        self.keyframe_alive[keyframe] = False

    def _new_parent(self, child: int, culled: int, grandparent: int) -> int:
        """Return the strongest neighbour that is no descendant of the child, else the culled keyframe's parent."""
        below = self._descendants(child)
        neighbours, _ = self.covisible(child)
        return next((int(k) for k in neighbours if k != culled and not below[k]), grandparent)

    def _descendants(self, keyframe: int) -> NDArray[np.bool_]:
        below = np.zeros(self.num_keyframes, dtype=np.bool_)
        below[keyframe] = True
        while True:
            grown = below | ((self.parent >= 0) & below[self.parent])
            if (grown == below).all():
                return below
            below = grown

    def poses_of_all(self) -> NDArray[np.float64]:
        """Return float64 (K, 4, 4), T_camera_map of all keyframes; culled ones hang on their parents, wherever those went."""
        return np.array([self.pose_of(k) for k in range(self.num_keyframes)]).reshape(-1, 4, 4)

    def pose_of(self, keyframe: int) -> NDArray[np.float64]:
        """Return T_camera_map (4, 4) of a keyframe; a culled one hangs on its parent."""
        chain = np.eye(4)
        while not self.keyframe_alive[keyframe]:
            chain = chain @ self.T_camera_parent[keyframe]
            keyframe = int(self.parent[keyframe])
        return chain @ self.T_camera_map[keyframe]

    def covisible(self, keyframe: int, least: int = _WEAK) -> tuple[Ids, Ids]:
        """Return the keyframes that share at least `least` points, the strongest first, and how many they share."""
        counts = self.count_shared(np.unique(self.seen[keyframe]))
        counts[keyframe] = 0
        return _strongest(counts, least)

    def all_shared(self) -> NDArray[np.int64]:
        """Return (K, K): how many points each two keyframes share, 0 on the diagonal."""
        offsets, keyframes, _ = self.observations(np.flatnonzero(self.point_alive))
        return kernels.count_all_shared(offsets, keyframes, self.num_keyframes)

    def count_shared(self, ids: Ids) -> Ids:
        """Return (K,): how many of some points each keyframe sees; each is given once, and -1 is none."""
        return self._sightings.count_shared(ids[ids >= 0])

    # points

    def add_points(
        self, positions: NDArray[np.float64], keyframe: int, features: Ids, colours: NDArray[np.uint8] | None = None
    ) -> Ids:
        """Append points (N, 3), map frame, that features of a keyframe see; return their numbers."""
        n = len(positions)
        ids = self.append_points({
            "positions": positions, "normals": np.zeros((n, 3)), "descriptors": self.key_descriptors[keyframe, features],
            "near": np.zeros(n), "far": np.full(n, np.inf), "reference": np.full(n, keyframe),
            "visible": np.ones(n, dtype=np.int64), "found": np.ones(n, dtype=np.int64), "first_keyframe": np.full(n, keyframe),
            "colours": np.full((n, 3), 128, dtype=np.uint8) if colours is None else colours,
        })  # fmt: skip
        self.see(keyframe, features, ids)
        return ids

    def append_points(self, columns: Mapping[str, NDArray[Any]]) -> Ids:
        """Append points given by their columns (N, ...), which nothing sees yet; return their numbers."""
        n, first = len(columns["positions"]), self.num_points
        for name, rows in columns.items():
            self._columns[name].append(rows)
        self._columns["point_alive"].append(np.ones(n, dtype=np.bool_))
        self._columns["replaced_by"].append(np.full(n, -1))
        self._sightings.add_points(n)
        return np.arange(first, first + n)

    def remove_points(self, ids: Ids) -> None:
        """Take points out of the map."""
        if len(ids):
            self._sightings.clear(ids)
            self.point_alive[ids] = False

    def merge_points(self, old: Ids, new: Ids) -> None:
        """Let each new point (N,) take over what sees the old one (N,); pairs hold one after another."""
        gone = sighting_kernels.join(
            self.resolved(old), self.resolved(new), self.replaced_by, self.point_alive, self.visible, self.found
        )
        if len(gone):
            self._sightings.move(gone, self.replaced_by)

    def resolve(self, frame: Frame) -> None:
        """Let a frame's features see what became of the points they saw."""
        frame.points = self.resolved(frame.points)

    def resolved(self, ids: Ids) -> Ids:
        """Return the points that stand for `ids` now; -1 where there is none."""
        ids = np.array(ids, dtype=np.int64)
        sighting_kernels.follow(self.replaced_by, self.point_alive, ids)
        return ids

    def count_observations(self, ids: Ids | None = None) -> Ids:
        """Return (R,): how often points `ids`, or all, are seen; an observation with depth counts twice (ORB-SLAM2, stereo)."""
        return self._sightings.count(np.arange(self.num_points) if ids is None else ids, self.right)

    def observations(self, ids: Ids) -> tuple[Ids, Ids, Ids]:
        """Return who sees points `ids` (R,): offsets (R + 1,), keyframes (M,), features (M,)."""
        return self._sightings.of(ids)

    def refresh_points(self, ids: Ids) -> None:
        """Compute viewing direction, range of distances and descriptor of points anew from who sees them."""
        offsets, keyframes, features = self.observations(ids)
        kernels.refresh_points(
            offsets, keyframes, features, ids, self.positions, self.centres, self.octaves, self.key_descriptors.view(np.uint64), self.scales,
            self._sightings.changed, self.reference, self.normals, self.near, self.far, self.descriptors.view(np.uint64),
        )  # fmt: skip

    def points_of(self, keyframes: Ids) -> Ids:
        """Return the points that any of the keyframes sees, in increasing order."""
        return np.flatnonzero(kernels.mark_seen(self.seen, np.asarray(keyframes, dtype=np.int64), self.num_points))

    def sightings(self, ids: Ids) -> Sightings:
        """Return who sees points `ids` (R,), to be looked up by point."""
        row_of_point = np.full(self.num_points, -1, dtype=np.int64)
        row_of_point[ids] = np.arange(len(ids))
        return Sightings(row_of_point, *self.observations(ids))

    def redundancy(
        self, keyframe: int, close: NDArray[np.bool_], observations: Ids, least: int, sightings: Sightings
    ) -> float:
        """Return the share of a keyframe's points (features `close` (F,)) that `least` living others see as well at least as finely.

        `observations` (R,) is how often each point of `sightings` is seen (`count_observations`).
        """
        redundant, total = kernels.count_redundant(
            self.seen, keyframe, self.octaves, observations, close, least, *sightings, self.keyframe_alive
        )
        return redundant / total if total else 0.0


def neighbours_in(shared: NDArray[np.int64], keyframe: int, least: int = _WEAK) -> Ids:
    """Return the keyframes that share at least `least` points with one, the strongest first, by the table `SparseMap.all_shared`."""
    return _strongest(shared[keyframe], least)[0]


def _strongest(counts: Ids, least: int) -> tuple[Ids, Ids]:
    """Return the keyframes with at least so many points in common, the strongest first, and their counts."""
    if (counts >= least).any():
        found = np.flatnonzero(counts >= least)
    else:  # the strongest alone, so that the graph holds together
        found = np.array([counts.argmax()]) if counts.any() else np.empty(0, dtype=np.int64)
    order = np.argsort(-counts[found], kind="stable")
    return found[order], counts[found[order]]


def warm() -> None:
    """Compile the kernels of this module on tiny input."""
    sparse_map = SparseMap(Pinhole(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=2, height=2), np.array([1.0, 1.2]))
    two, none = np.zeros(2), np.full(2, np.nan)
    features = Features(
        pixels=np.zeros((2, 2)), raw_pixels=np.zeros((2, 2)), octaves=np.zeros(2, dtype=np.int64), angles=two, responses=two,
        descriptors=np.zeros((2, 32), dtype=np.uint8), sigmas=np.ones(2), right=none, depth=none,
    )  # fmt: skip
    grid = feature_grid(features, sparse_map.camera)
    for k in range(2):
        unseen = np.full(2, -1, dtype=np.int64)
        sparse_map.add_keyframe(Frame(number=k, stamp_ns=k, features=features, grid=grid, points=unseen), k - 1)
    ids = sparse_map.add_points(np.ones((2, 3)), 0, np.arange(2))
    sparse_map.see(1, np.arange(2), ids)
    sparse_map.refresh_points(ids)
    sparse_map.covisible(0)
    sparse_map.all_shared()
    sparse_map.restore_seen(sparse_map.seen.copy())
    sparse_map.redundancy(
        1, np.ones(2, dtype=np.bool_), sparse_map.count_observations(ids), 3, sparse_map.sightings(ids)
    )
    sparse_map.merge_points(ids[:1], ids[1:])
    sparse_map.remove_points(ids)
