# SPDX-License-Identifier: MIT
"""Submaps, nodes and constraints of all trajectories in the plane, and their adjustment (Hess et al., ICRA 2016, V-A)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.parameters import OptimizationProblem, PoseGraph
from slamcli.geometry import se2
from slamcli.grids.submap_grid import SubmapGrid
from slamcli.posegraph import Id
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges, PlanarSolution, optimise_planar, rows
from slamcli.posegraph.planar_start import start_planar

CELL_M = 0.05
"""A loop whose position is known to a cell counts fully."""
_TURN_RAD_M = 0.2
"""How uncertain the heading is where the position is by a metre and scans told neither."""


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A node that was found again in a submap."""

    submap: int
    """Row of the submap in the graph."""
    node: int
    relative: NDArray[np.float64]
    """float64 (3,), pose of the node seen from the submap."""
    covariance: NDArray[np.float64]
    """float64 (2, 2), m^2: over which positions the match is ambiguous, along the axes of the node."""
    score: float
    round: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrajectoryPart:
    """What one trajectory brings into the graph; poses are float64 (., 3)."""

    trajectory: int
    frozen: bool
    submap_ids: Sequence[Id]
    submap_local: NDArray[np.float64]
    submap_map: NDArray[np.float64]
    grids: Sequence[SubmapGrid]
    finished: Sequence[bool]
    node_ids: Sequence[Id]
    node_local: NDArray[np.float64]
    node_map: NDArray[np.float64]
    points: Sequence[NDArray[np.float64]]
    """float64 (N, 2) for each node."""
    members: Sequence[Sequence[int]]
    """For each node the rows, in this part, of the submaps that hold it, the oldest first."""
    slack_m: NDArray[np.float64]
    """float64 (N,), how uncertain the way to each node from the one before is, beyond what local SLAM is trusted with."""


@dataclass(slots=True, eq=False)
class PoseGraph2d:
    """The graph of all parts; rows of submaps and nodes go through the parts in their order."""

    parameters: PoseGraph
    parts: Sequence[TrajectoryPart]
    submap: NDArray[np.float64] = field(init=False)
    """float64 (S, 3), poses in the map."""
    node: NDArray[np.float64] = field(init=False)
    """float64 (N, 3)."""
    submap_local: NDArray[np.float64] = field(init=False)
    node_local: NDArray[np.float64] = field(init=False)
    submap_part: NDArray[np.int64] = field(init=False)
    node_part: NDArray[np.int64] = field(init=False)
    home: NDArray[np.int64] = field(init=False)
    """int64 (N,), row of the oldest submap that holds each node."""
    membership: NDArray[np.int64] = field(init=False)
    """int64 (K, 2), rows of a submap and of a node that it holds."""
    grids: list[SubmapGrid] = field(init=False)
    points: list[NDArray[np.float64]] = field(init=False)
    loops: list[Loop] = field(default_factory=list)
    more: Sequence[tuple[PlanarEdges, Loss]] = ()
    """Further terms between nodes and poses of `extra`; rows count submaps, nodes, then extra poses."""
    extra: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """float64 (E, 3), poses of landmarks and fixed frames."""
    extra_held: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    """bool (E,), those that the adjustment must not move."""

    def __post_init__(self) -> None:
        parts = self.parts
        self.submap = np.concatenate([part.submap_map for part in parts])
        self.node = np.concatenate([part.node_map for part in parts])
        self.submap_local = np.concatenate([part.submap_local for part in parts])
        self.node_local = np.concatenate([part.node_local for part in parts])
        self.submap_part = np.repeat(np.arange(len(parts)), [len(part.submap_ids) for part in parts])
        self.node_part = np.repeat(np.arange(len(parts)), [len(part.node_ids) for part in parts])
        firsts = np.concatenate([[0], np.cumsum([len(part.submap_ids) for part in parts])])
        rows = [
            [first + row for row in held] for first, part in zip(firsts, parts, strict=False) for held in part.members
        ]
        self.home = np.array([held[0] if held else -1 for held in rows], dtype=np.int64)
        pairs = [(submap, node) for node, held in enumerate(rows) for submap in held]
        self.membership = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        self.grids = [grid for part in parts for grid in part.grids]
        self.points = [points for part in parts for points in part.points]

    @property
    def fixed(self) -> NDArray[np.bool_]:
        """Bool (S + N + E,): what the adjustment must not move: frozen trajectories, else the first submap."""
        frozen = np.array([part.frozen for part in self.parts], np.bool_)
        fixed = np.concatenate([frozen[self.submap_part], frozen[self.node_part], self.extra_held])
        if not frozen.any():
            fixed[0] = True
        return fixed

    def add_terms(
        self,
        terms: Sequence[tuple[PlanarEdges, Loss]],
        extra: NDArray[np.float64],
        held: NDArray[np.bool_] | None = None,
    ) -> None:
        """Add terms with further poses (K, 3), which come after those of `extra`, and which of them (K,) are held."""
        self.more = [*self.more, *terms]
        self.extra = np.concatenate([self.extra, extra])
        self.extra_held = np.concatenate([self.extra_held, np.zeros(len(extra), np.bool_) if held is None else held])

    def prior(self, submap: int, nodes: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return where nodes (K,) are believed to be in a submap's grid, float64 (K, 3), in its local frame."""
        T_local_map = se2.compose(self.submap_local[submap], se2.inverse(self.submap[submap]))
        return se2.compose(T_local_map[None], self.node[nodes])

    def optimise(self, iterations: int, known: NDArray[np.bool_] | None = None) -> PlanarSolution:
        """Adjust all poses that are not fixed; of these only those that are `known`, bool (S + N + E,), if it is given."""
        o = self.parameters.optimization_problem
        poses = np.concatenate([self.submap, self.node, self.extra])
        groups = [(self._local_edges(o), Loss()), *self.more]
        if self.loops:
            groups.insert(1, (self._loop_edges(), Loss(kind="huber", scale=self._huber_scale())))
        if known is not None:
            groups = [(_among(edges, known), loss) for edges, loss in groups]
        (edges, loss), *more = groups
        start = start_planar(poses, self.fixed, edges, loss=loss, more=more)
        solution = optimise_planar(start, self.fixed, edges, loss=loss, more=more, max_iterations=iterations)
        self.submap, self.node, self.extra = np.split(
            solution.poses, [len(self.submap), len(self.submap) + len(self.node)]
        )
        return solution

    def _huber_scale(self) -> float:
        """The scale of the loops' loss: larger in batch search, where loops are checked before they are believed."""
        batch = self.parameters.batch_search
        scale = self.parameters.optimization_problem.huber_scale
        return batch.huber_factor * scale if batch.enabled else scale

    def residuals(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return how far each loop (L,) is from what its match says: metres, of which ambiguous directions are left out, and radians."""
        if not self.loops:
            return np.zeros(0), np.zeros(0)
        submaps, nodes = (np.array([getattr(loop, name) for loop in self.loops]) for name in ("submap", "node"))
        relative = np.array([loop.relative for loop in self.loops])
        error = se2.between(relative, se2.between(self.submap[submaps], self.node[nodes]))
        roots = CELL_M * _inverse_root(np.array([loop.covariance for loop in self.loops]))
        return np.hypot(*np.einsum("kij,kj->ki", roots, error[:, :2]).T), np.abs(error[:, 2])

    def _local_edges(self, o: OptimizationProblem) -> PlanarEdges:
        """Each node in the submaps that hold it, and after the node before."""
        p, count = self.parameters, len(self.submap)
        submaps, nodes = self.membership.T
        after = np.flatnonzero(np.diff(self.node_part) == 0) + 1
        slack = np.concatenate([part.slack_m for part in self.parts])[after]
        measured = [
            se2.between(self.submap_local[submaps], self.node_local[nodes]),
            se2.between(self.node_local[after - 1], self.node_local[after]),
        ]
        unit, local = unit_weight(p), o.local_slam_pose_translation_weight
        in_submap, turn_in_submap = self.membership_weights()
        return PlanarEdges(
            first=np.concatenate([submaps, after - 1 + count]),
            second=np.concatenate([nodes, after]) + count,
            measured=np.concatenate(measured),
            translation_weight=np.concatenate([in_submap, _softened(local, unit, slack)]),
            rotation_weight=np.concatenate(
                [
                    turn_in_submap,
                    _softened(o.local_slam_pose_rotation_weight, unit, _TURN_RAD_M * slack),
                ]
            ),
            robust=np.zeros(len(nodes) + len(after), np.bool_),
        )

    def membership_weights(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what each membership (K,) weighs, translation and rotation.

        A node is as uncertain in its submap as the way is since scans last told where the robot was.
        """
        p, unit = self.parameters, unit_weight(self.parameters)
        submaps, nodes = self.membership.T
        slack = np.concatenate([part.slack_m for part in self.parts])
        told = np.maximum.accumulate(np.where(slack == 0.0, np.arange(len(slack)), 0))
        firsts = np.full(len(self.submap), len(slack) - 1, dtype=np.int64)
        np.minimum.at(firsts, submaps, nodes)
        variance = np.cumsum(slack**2)
        since = np.maximum(told[nodes], firsts[submaps])
        blind = np.sqrt(np.maximum(variance[nodes] - variance[since], 0.0))
        return (
            _softened(p.matcher_translation_weight, unit, blind),
            _softened(p.matcher_rotation_weight, unit, _TURN_RAD_M * blind),
        )

    def _loop_edges(self) -> PlanarEdges:
        b, loops = self.parameters.constraint_builder, self.loops
        information = np.zeros((len(loops), 3, 3))
        roots = (
            CELL_M * b.loop_closure_translation_weight * _inverse_root(np.array([loop.covariance for loop in loops]))
        )
        information[:, :2, :2] = roots @ roots
        information[:, 2, 2] = b.loop_closure_rotation_weight**2
        ones = np.ones(len(loops))
        return PlanarEdges(
            first=np.array([loop.submap for loop in loops]),
            second=np.array([loop.node for loop in loops]) + len(self.submap),
            measured=np.array([loop.relative for loop in loops]),
            translation_weight=ones,
            rotation_weight=ones,
            robust=ones > 0,
            information=information,
        )


def unit_weight(parameters: PoseGraph) -> float:
    """Return the weight of what is known to one metre, 1/m: as loops weigh, which are known to a cell."""
    return max(CELL_M * parameters.constraint_builder.loop_closure_translation_weight, 1.0)


def _softened(weight: float, unit: float, uncertain: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (K,) of measurements to whose deviation, unit / weight, another one is added."""
    return np.asarray(weight / np.hypot(1.0, uncertain * weight / unit))


def _among(edges: PlanarEdges, known: NDArray[np.bool_]) -> PlanarEdges:
    """Return the edges all of whose poses are known; the other poses are then tied to nothing, and stay."""
    of = rows(edges)
    kept = np.all(known[of] | (of < 0), axis=1)
    values: dict[str, Any] = {}
    for field_ in fields(edges):
        value = getattr(edges, field_.name)
        values[field_.name] = None if value is None else value[kept]
    return PlanarEdges(**values)


def _inverse_root(covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse square roots (..., 2, 2), 1/m, of covariances to which that of one cell is added."""
    values, vectors = np.linalg.eigh(covariances + CELL_M**2 * np.eye(2))
    return np.asarray((vectors / np.sqrt(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2))
