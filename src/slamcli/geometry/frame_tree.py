# SPDX-License-Identifier: MIT
"""The tree of coordinate frames that a recording's transforms span (tf), and lookups across it."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import CalibrationError, DataError
from slamcli.geometry import quaternion, se3

EXTRAPOLATION_TOLERANCE_S = 0.1
"""How far beyond an edge's first or last sample a lookup holds that sample."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameEdge:
    """All samples of ``T_parent_child``, sorted by stamp; one sample that holds for all times if static."""

    parent: str
    child: str
    stamps_ns: NDArray[np.int64]
    """int64 (N,), N >= 1, ascending, no stamp twice."""
    positions_m: NDArray[np.float64]
    """float64 (N, 3), metres."""
    quats_xyzw: NDArray[np.float64]
    """float64 (N, 4), unit quaternions."""
    static: bool
    """True if every sample is the same or the transform was published as static."""
    num_samples: int
    """Samples as recorded (duplicates and repetitions included)."""

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return ``T_parent_child`` (M, 4, 4) at stamps (M,): linear and slerp between samples, held outside of them."""
        if len(self.stamps_ns) == 1:
            T = se3.from_position_quaternion(self.positions_m[0], self.quats_xyzw[0])
            return np.broadcast_to(T, (len(stamps_ns), 4, 4))
        after = np.clip(np.searchsorted(self.stamps_ns, stamps_ns, side="left"), 1, len(self.stamps_ns) - 1)
        before = after - 1
        span = self.stamps_ns[after] - self.stamps_ns[before]
        fraction = np.clip((stamps_ns - self.stamps_ns[before]) / span, 0.0, 1.0)
        position = self.positions_m[before] + fraction[:, None] * (self.positions_m[after] - self.positions_m[before])
        quat = quaternion.slerp(self.quats_xyzw[before], self.quats_xyzw[after], fraction)
        return se3.from_position_quaternion(position, quat)

    def outside_ns(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return by how much stamps (M,) lie outside of the samples, 0 inside and for static transforms."""
        if self.static:
            return np.zeros(len(stamps_ns), dtype=np.int64)
        early, late = self.stamps_ns[0] - stamps_ns, stamps_ns - self.stamps_ns[-1]
        return np.maximum(np.maximum(early, late), 0)


class FrameTreeBuilder:
    """Collects transforms in any order; :meth:`build` makes the tree."""

    def __init__(self) -> None:
        # Stamps, and seven numbers per stamp, in compact arrays: an hour of /tf at 100 Hz stays under 30 MB per edge.
        self._samples: dict[tuple[str, str], tuple[array[int], array[float]]] = {}
        self._static: dict[tuple[str, str], tuple[ArrayLike, ArrayLike]] = {}
        self._overrides: dict[str, str] = {}
        self._fallbacks: dict[tuple[str, str], tuple[ArrayLike, ArrayLike]] = {}

    def add(
        self, parent: str, child: str, stamp_ns: int, position_m: Sequence[float], quat_xyzw: Sequence[float]
    ) -> None:
        """Add one stamped sample of ``T_parent_child``."""
        samples = self._samples.get((parent, child))
        if samples is None:
            samples = self._samples[parent, child] = (array("q"), array("d"))
        samples[0].append(stamp_ns)
        samples[1].extend((*position_m, *quat_xyzw))

    def add_static(self, parent: str, child: str, position_m: ArrayLike, quat_xyzw: ArrayLike) -> None:
        """Add a transform that holds for all times; a later one for the same frames replaces it."""
        self._static[parent, child] = (position_m, quat_xyzw)

    def override(self, parent: str, child: str, position_m: ArrayLike, quat_xyzw: ArrayLike) -> None:
        """Add a static transform that wins over everything else that is known about `child`."""
        self._overrides[child] = parent
        self._static[parent, child] = (position_m, quat_xyzw)
        self._samples.pop((parent, child), None)

    def fall_back(self, parent: str, child: str, position_m: ArrayLike, quat_xyzw: ArrayLike) -> None:
        """Add a static transform (a robot model's) that is used only if nothing else places `child`."""
        self._fallbacks[parent, child] = (position_m, quat_xyzw)

    def build(self, tolerance_s: float = EXTRAPOLATION_TOLERANCE_S) -> FrameTree:
        """Return the tree; contradictions are settled and listed in its `problems`."""
        problems: list[str] = []
        candidates: dict[str, list[FrameEdge]] = {}
        for edge in self._edges(problems):
            candidates.setdefault(edge.child, []).append(edge)
        edges = {child: self._choose(child, found, problems) for child, found in candidates.items()}
        for (parent, child), (position, quat) in self._fallbacks.items():
            if child not in edges:
                edges[child] = _static_edge(parent, child, position, quat)
        _cut_cycles(edges, problems)
        return FrameTree(edges, problems, tolerance_s)

    def _edges(self, problems: list[str]) -> Iterable[FrameEdge]:
        for (parent, child), samples in self._samples.items():
            if (parent, child) in self._static:
                continue
            if parent == child:
                problems.append(f"frame {child!r} is its own parent: ignored")
                continue
            yield _stamped_edge(parent, child, *samples)
        for (parent, child), (position, quat) in self._static.items():
            if parent == child:
                problems.append(f"frame {child!r} is its own parent: ignored")
                continue
            if (parent, child) in self._samples:
                problems.append(f"{parent} -> {child} is published both as static and on /tf: the static one is used")
            yield _static_edge(parent, child, position, quat)

    def _choose(self, child: str, found: list[FrameEdge], problems: list[str]) -> FrameEdge:
        """Return the edge that places `child`: what the user gave, else the parent that was published most."""
        wanted = self._overrides.get(child)
        if wanted is not None:
            return next(edge for edge in found if edge.parent == wanted)
        best = max(found, key=lambda edge: edge.num_samples)
        if len(found) > 1:
            parents = ", ".join(f"{edge.parent} ({edge.num_samples} x)" for edge in found)
            problems.append(f"frame {child!r} has two parents: {parents}; {best.parent} is used")
        return best


def _static_edge(parent: str, child: str, position_m: ArrayLike, quat_xyzw: ArrayLike) -> FrameEdge:
    return FrameEdge(
        parent=parent,
        child=child,
        stamps_ns=np.zeros(1, dtype=np.int64),
        positions_m=np.asarray(position_m, dtype=np.float64).reshape(1, 3),
        quats_xyzw=quaternion.normalise(np.asarray(quat_xyzw, dtype=np.float64).reshape(1, 4)),
        static=True,
        num_samples=1,
    )


def _stamped_edge(parent: str, child: str, recorded_ns: array[int], numbers: array[float]) -> FrameEdge:
    """Return an edge with its samples sorted by stamp; of equal stamps the last recorded sample stays."""
    stamps = np.array(recorded_ns, dtype=np.int64)
    poses = np.array(numbers, dtype=np.float64).reshape(-1, 7)
    positions, quats = poses[:, :3], quaternion.normalise(poses[:, 3:])
    constant = bool(
        (positions == positions[0]).all() and (np.abs(np.sum(quats * quats[0], axis=1)) > 1 - 1e-12).all()
    ) and (len(stamps) > 1)
    order = np.argsort(stamps, kind="stable")
    last_of_equal = np.append(np.diff(stamps[order]) > 0, True)
    keep = order[:1] if constant else order[last_of_equal]
    return FrameEdge(
        parent=parent,
        child=child,
        stamps_ns=stamps[keep],
        positions_m=positions[keep],
        quats_xyzw=quats[keep],
        static=constant,
        num_samples=len(stamps),
    )


def _cut_cycles(edges: dict[str, FrameEdge], problems: list[str]) -> None:
    """Remove the least published edge of every cycle."""
    for start in list(edges):
        seen: list[str] = []
        frame = start
        while frame in edges and frame not in seen:
            seen.append(frame)
            frame = edges[frame].parent
        if frame in seen:
            cycle = seen[seen.index(frame) :]
            weakest = min(cycle, key=lambda name: edges[name].num_samples)
            way = " -> ".join([*reversed(cycle), cycle[-1]])
            problems.append(f"frames form a cycle: {way}; {edges[weakest].parent} -> {weakest} is ignored")
            del edges[weakest]


class FrameTree:
    """Frames connected by transforms; every frame has at most one parent.

    Lookups interpolate between samples (linearly and by slerp). Up to `tolerance_s` beyond the first and last sample of
    an edge they hold that sample and count it in `num_extrapolated`; further out they fail.
    """

    def __init__(
        self,
        edges: dict[str, FrameEdge] | None = None,
        problems: Iterable[str] = (),
        tolerance_s: float = EXTRAPOLATION_TOLERANCE_S,
    ) -> None:
        self._edges = dict(edges or {})
        self.problems: tuple[str, ...] = tuple(problems)
        """Contradictions that were found while the tree was built, and how they were settled."""
        self.tolerance_ns = round(tolerance_s * 1e9)
        self.num_extrapolated = 0
        """Lookups so far that held a sample beyond its time."""

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of all frames, sorted."""
        return tuple(sorted({*self._edges, *(edge.parent for edge in self._edges.values())}))

    @property
    def edges(self) -> tuple[FrameEdge, ...]:
        """All edges, sorted by parent and child."""
        return tuple(sorted(self._edges.values(), key=lambda edge: (edge.parent, edge.child)))

    @property
    def roots(self) -> tuple[str, ...]:
        """Frames without a parent, sorted; more than one means that the tree falls apart."""
        return tuple(frame for frame in self.frames if frame not in self._edges)

    def parent(self, frame: str) -> str | None:
        """Return the parent of a frame, None for a root or an unknown frame."""
        edge = self._edges.get(frame)
        return edge.parent if edge is not None else None

    def edge(self, child: str) -> FrameEdge | None:
        """Return the edge that places a frame in its parent, None for a root or an unknown frame."""
        return self._edges.get(child)

    def connected(self, a: str, b: str) -> bool:
        """Return whether a transform between two frames is known at some time."""
        known = self.frames
        return a == b or (a in known and b in known and self._to_root(a)[-1] == self._to_root(b)[-1])

    def path(self, target: str, source: str) -> tuple[FrameEdge, ...]:
        """Return the edges between two frames.

        Raises
        ------
        CalibrationError
            If a frame is unknown or the two are not connected.
        """
        up, down = self._chains(target, source)
        return tuple(self._edges[frame] for frame in (*up, *down))

    def is_static(self, target: str, source: str) -> bool:
        """Return whether the transform between two frames never changes; see :meth:`path` for errors."""
        return all(edge.static for edge in self.path(target, source))

    def lookup(self, target: str, source: str, stamp_ns: int | None = None) -> NDArray[np.float64]:
        """Return ``T_target_source`` (4, 4) at a time, or the last one known where no time is given.

        Raises
        ------
        CalibrationError
            If a frame is unknown or the two are not connected; the message names the frames that are.
        DataError
            If the time lies outside of the recorded transforms by more than the tolerance.
        """
        if stamp_ns is None:
            dynamic = [edge.stamps_ns[-1] for edge in self.path(target, source) if not edge.static]
            stamp_ns = int(min(dynamic)) if dynamic else 0
        transforms, valid = self.lookup_many(target, source, np.array([stamp_ns], dtype=np.int64))
        if not valid[0]:
            raise DataError(self._too_far(target, source, stamp_ns))
        return transforms[0]

    def lookup_many(
        self, target: str, source: str, stamps_ns: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return ``T_target_source`` (N, 4, 4) at stamps (N,), and whether each lies within the tolerance (N,).

        Raises
        ------
        CalibrationError
            If a frame is unknown or the two are not connected.
        """
        stamps = np.atleast_1d(np.asarray(stamps_ns, dtype=np.int64))
        up, down = self._chains(target, source)
        outside = np.zeros(len(stamps), dtype=np.int64)
        for frame in (*up, *down):
            outside = np.maximum(outside, self._edges[frame].outside_ns(stamps))
        valid = outside <= self.tolerance_ns
        self.num_extrapolated += int(np.count_nonzero(valid & (outside > 0)))
        return se3.inverse(self._chain_at(up, stamps)) @ self._chain_at(down, stamps), valid

    def _chain_at(self, chain: list[str], stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return ``T_ancestor_first`` (N, 4, 4) of a chain of frames that leads upwards."""
        T = np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4))
        for frame in chain:
            T = self._edges[frame].at(stamps_ns) @ T
        return T

    def _to_root(self, frame: str) -> list[str]:
        chain = [frame]
        while chain[-1] in self._edges:
            chain.append(self._edges[chain[-1]].parent)
        return chain

    def _chains(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """Return the frames from target and from source up to, without, their nearest common ancestor."""
        if target == source:
            return [], []
        known = self.frames
        for frame in (target, source):
            if frame not in known:
                listed = ", ".join(known) if known else "none"
                raise CalibrationError(
                    f"no frame {frame!r} among the recording's transforms (known: {listed}); "
                    f"give it with --static-tf parent,{frame},x,y,z,yaw,pitch,roll, or rename one with --rename-frame"
                )
        up, down = self._to_root(target), self._to_root(source)
        if up[-1] != down[-1]:
            near = ", ".join(frame for frame in known if self._to_root(frame)[-1] == up[-1])
            raise CalibrationError(
                f"frames {target!r} and {source!r} are not connected ({target} is connected to {near}); "
                f"give the missing transform with --static-tf {target},{down[-1]},x,y,z,yaw,pitch,roll"
            )
        while up and down and up[-1] == down[-1]:
            up, down = up[:-1], down[:-1]
        return up, down

    def _too_far(self, target: str, source: str, stamp_ns: int) -> str:
        stamps = np.array([stamp_ns], dtype=np.int64)
        worst = max(self.path(target, source), key=lambda edge: int(edge.outside_ns(stamps)[0]))
        return (
            f"no transform {worst.parent} -> {worst.child} at {stamp_ns / 1e9:.3f} s: it is known from "
            f"{worst.stamps_ns[0] / 1e9:.3f} to {worst.stamps_ns[-1] / 1e9:.3f} s"
        )
