# SPDX-License-Identifier: MIT
"""A bundle problem sorted by point, its normal equations with the points eliminated, and the step they ask for."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.vision import _bundle_kernels as kernels
from slamcli.vision import _observation_kernels as observations
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.camera_system import CameraSystem

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
RANGES = 4  # of points, each with sums of its own: fixed, so that the bytes do not depend on the threads


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BundleState:
    """Where the unknowns stand."""

    poses: Floats
    """float64 (C, 3, 4), upper rows of T_camera_map."""
    points: Floats
    """float64 (P, 3)."""
    camera: Floats
    """float64 (5,): fx, fy, cx, cy, bf."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReducedSystem:
    """Normal equations of F cameras, by rank, without damping of their own."""

    blocks: Floats
    """float64 (B, 6, 6), as `CameraSystem` stores them."""
    diagonal: Floats
    """float64 (F, 6), of the cameras' own blocks, before points were eliminated: what Marquardt's damping scales with."""
    gradient: Floats
    """float64 (F, 6)."""
    cost: float
    """Half the sum of the losses."""


class BundleSystem:
    """Normal equations of a problem (Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, 6.1)."""

    def __init__(
        self,
        problem: BundleProblem,
        held: NDArray[np.bool_],
        pool: Executor | None = None,
        refined: NDArray[np.bool_] | None = None,
    ) -> None:
        """Sort the observations.

        `held` bool (P,): points that stay; `refined` bool (5,): intrinsics that do not. Those follow the cameras as one
        more row of all that has F rows.
        """
        self._pool, self._held = pool, np.ascontiguousarray(held, np.bool_)
        self._wanted = np.append(np.zeros(5, np.bool_) if refined is None else refined, False).astype(np.float64)
        self._calibrate = bool(self._wanted.any())
        free = np.flatnonzero(~problem.fixed)
        columns = np.full(len(problem.fixed), -1, np.int64)
        columns[free] = np.arange(len(free))
        order, starts = _sorted(problem.point_index, len(problem.points))
        size = len(free) + self._calibrate
        pairs = np.eye(size, dtype=np.bool_)
        pairs[:, len(free) :] = True
        observations.mark_pairs(starts, columns[problem.camera_index[order]], pairs)
        self.system = CameraSystem(pairs, shared=self._calibrate)
        self.free = free
        """int64 (F,), cameras that move."""
        self.camera_ranks = columns.copy()
        """int64 (C,), rank of each camera, -1: fixed."""
        self.camera_ranks[free] = self.system.ranks[: len(free)]
        # by point, within a point by rank, the fixed ones last
        turns = np.where(self.camera_ranks < 0, len(free), self.camera_ranks)[problem.camera_index]
        by_turn, _ = _sorted(turns, len(free) + 1)
        again, self._starts = _sorted(problem.point_index[by_turn], len(problem.points))
        order = by_turn[again]
        self._cameras = np.ascontiguousarray(problem.camera_index[order], np.int64)
        self._ranks = self.camera_ranks[self._cameras]
        moving = np.concatenate([[0], np.cumsum(self._ranks >= 0)])
        self._free_ends = self._starts[:-1] + moving[self._starts[1:]] - moving[self._starts[:-1]]
        self._measured = np.column_stack([problem.pixels, problem.right])[order]
        self._weights = 1.0 / problem.sigmas[order] ** 2
        self._ranges = _ranges(self._starts)
        count, blocks = len(problem.points), len(self.system.rows)
        self._couplings = np.empty((len(problem), 3, 6))
        self._shared = np.empty((count if self._calibrate else 0, 3, 6))
        self._factors, self._costs = np.zeros((count, 9)), np.zeros(count)
        self._hessians, self._gradients = np.empty((RANGES, size, 6, 6)), np.empty((RANGES, size, 6))
        self._blocks, self._reduced = np.empty((RANGES, blocks, 6, 6)), np.empty((RANGES, size, 6))

    def linearise(self, state: BundleState, damping: float, robust: bool) -> ReducedSystem:
        """Return the normal equations of the cameras at a state, with the points eliminated.

        `damping` multiplies the diagonals of the points' blocks (Marquardt's scaling) before they are eliminated.
        """
        for sums in (self._hessians, self._gradients, self._blocks, self._reduced):
            sums[:] = 0.0

        def part(r: int) -> None:
            kernels.build(
                self._ranges[r], self._ranges[r + 1], self._starts, self._free_ends, self._cameras, self._ranks,
                self.system.slots, self._measured, self._weights, state.poses, state.points, self._held,
                state.camera, self._wanted, bool(robust), float(damping), self._couplings, self._shared, self._factors, self._costs, self._hessians[r], self._gradients[r],
                self._blocks[r], self._reduced[r],
            )  # fmt: skip

        self._each(part)
        blocks, own = _added(self._blocks), _added(self._hessians)
        blocks[self.system.diagonal_slots] += own
        return ReducedSystem(
            blocks=blocks, diagonal=np.einsum("fii->fi", own).copy(), cost=float(self._costs.sum()),
            gradient=_added(self._reduced) + _added(self._gradients),
        )  # fmt: skip

    def solve(self, reduced: ReducedSystem, damping: float) -> Floats | None:
        """Return the cameras' steps (F, 6), by rank, with `damping` times their diagonals added; None if not definite."""
        blocks, diagonal = reduced.blocks.copy(), reduced.diagonal
        added = damping * np.maximum(diagonal, 1e-9 * diagonal.max(axis=1, initial=0.0, keepdims=True))
        added += np.where(diagonal + added > 0, 0.0, 1.0)  # a camera that sees nothing stays
        blocks[self.system.diagonal_slots[:, None], np.arange(6), np.arange(6)] += added
        return self.system.solve(-reduced.gradient) if self.system.factorise(blocks) else None

    def intrinsics_sigmas(self, state: BundleState, robust: bool) -> Floats:
        """Return standard deviations (5,) of the refined intrinsics at a state, pixels (bf: times metres); NaN for others."""
        sigmas = np.full(5, np.nan)
        known = np.flatnonzero(self._wanted > 0)
        reduced = self.linearise(state, 1e-9, robust)
        if len(known) and self.solve(reduced, 1e-9) is not None:
            information = self.system.last_information()[np.ix_(known, known)]
            sigmas[known] = np.sqrt(np.diag(np.linalg.inv(information)))
        return sigmas

    def step(self, state: BundleState, steps: Floats, robust: bool) -> tuple[BundleState, float]:
        """Return the state after the cameras' steps (F, 6), by rank, and those of the points that follow, and its cost."""
        poses = np.empty_like(state.poses)
        observations.move_cameras(state.poses, self.camera_ranks, steps, poses)
        camera = state.camera + steps[-1, :5] if self._calibrate else state.camera
        moved = BundleState(poses=poses, points=state.points, camera=camera)
        points, cost = self.follow(moved, steps, robust)
        return replace(moved, points=points), cost

    def follow(self, state: BundleState, steps: Floats, robust: bool) -> tuple[Floats, float]:
        """Return where the points go with the cameras' steps, and the cost there.

        `state` has the cameras after these steps, and the points of the last linearisation.
        """
        moved = np.empty_like(state.points)
        totals = np.zeros(RANGES)

        def part(r: int) -> None:
            totals[r] = kernels.move_points(
                self._ranges[r], self._ranges[r + 1], self._starts, self._free_ends, self._cameras, self._ranks,
                self._measured, self._weights, state.poses, state.points, state.camera, self._calibrate, bool(robust),
                self._couplings, self._shared, self._factors, self._costs, steps, moved,
            )  # fmt: skip

        self._each(part)
        return moved, float(_added(totals))

    def _each(self, part: Callable[[int], None]) -> None:
        """Do all ranges, side by side where there are threads."""
        if self._pool is None:
            for r in range(RANGES):
                part(r)
        else:
            list(self._pool.map(part, range(RANGES)))


def _sorted(keys: Integers, size: int) -> tuple[Integers, Integers]:
    """Return a stable order (M,) by keys below `size`, and where each key begins (size + 1,)."""
    order, starts = np.empty(len(keys), np.int64), np.empty(size + 1, np.int64)
    observations.sort_stably(np.ascontiguousarray(keys, np.int64), size, order, starts)
    return order, starts


def _ranges(starts: Integers) -> Integers:
    """Return bounds (RANGES + 1,) of points with about the same work: it grows as the square of a point's observations."""
    work = np.cumsum(np.diff(starts) ** 2 + 10)
    total = int(work[-1]) if len(work) else 0
    inner = np.searchsorted(work, total * np.arange(1, RANGES) // RANGES)
    return np.concatenate([[0], inner, [len(work)]]).astype(np.int64)


def _added(parts: Floats) -> Floats:
    """Return the sum over the ranges, always in the same order."""
    total = parts[0].copy()
    for part in parts[1:]:
        total += part
    return total
