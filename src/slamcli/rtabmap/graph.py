# SPDX-License-Identifier: MIT
"""The graph of nodes and landmarks, optimised (``Optimizer/*``, ``GTSAM/*``), and how well its links agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.posegraph.gtsam_poses import IncrementalPoses, optimise_poses
from slamcli.posegraph.pose_problem import GtsamSettings, Method, PoseEdges, PoseKnowledge, PoseProblem
from slamcli.rtabmap.links import CLOSURES, Link, LinkKind
from slamcli.rtabmap.parameters import GtsamGroup, OptimizerGroup

Floats = NDArray[np.float64]

METHODS: tuple[Method, ...] = ("levenberg", "gauss_newton", "dogleg")
"""By GTSAM/Optimizer."""
LANDMARKS_FROM = 1 << 40
"""Key of marker 0 in the graph of poses; nodes have their ids."""
LEAST_INFORMATION = 1e-6
"""1/m^2 and 1/rad^2: what nothing is known of is held by this, as RTAB-Map's variance 9999 does."""
ALONE = (LinkKind.POSE_PRIOR, LinkKind.GRAVITY)
"""Links of a node with itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphSettings:
    """How the graph is optimised."""

    solver: GtsamSettings
    incremental: bool = False
    variance_ignored: bool = False
    robust: bool = False
    priors_ignored: bool = True
    landmarks_ignored: bool = False


def graph_settings(optimizer: OptimizerGroup, gtsam: GtsamGroup, *, planar: bool) -> GraphSettings:
    """Return the settings of ``Optimizer/*`` and ``GTSAM/*``; `planar` is ``Reg/Force3DoF``."""
    solver = GtsamSettings(
        method=METHODS[gtsam.optimizer], iterations=optimizer.iterations, epsilon=optimizer.epsilon, planar=planar,
        gravity_sigma=optimizer.gravity_sigma, relinearise_threshold=gtsam.inc_relinearize_threshold,
        relinearise_skip=gtsam.inc_relinearize_skip,
    )  # fmt: skip
    return GraphSettings(
        solver=solver, incremental=gtsam.incremental, variance_ignored=optimizer.variance_ignored,
        robust=optimizer.robust, priors_ignored=optimizer.priors_ignored, landmarks_ignored=optimizer.landmarks_ignored,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OptimisedGraph:
    """Where the nodes are, by all links together."""

    ids: tuple[int, ...]
    """Nodes and landmarks, N."""
    T_map_base: Floats
    """float64 (N, 4, 4), in the same order; those that no link ties to the root stay."""
    max_ratio: float
    """The largest error of a link, over its standard deviation; 0 without links."""
    worst: Link | None
    """Whose it is."""
    worst_is_rotation: bool
    iterations: int
    error: float
    """Half the sum of the weighted squares."""
    moved: int
    """Nodes and landmarks that were optimised."""
    outvoted: tuple[Link, ...] = ()
    """Closures that do not count as they contradict the others (``Optimizer/Robust``)."""

    def pose(self, node_id: int) -> Floats:
        """Return the pose (4, 4) of a node or landmark."""
        return self.T_map_base[self.ids.index(node_id)]


class GraphOptimiser:
    """Optimises one graph as it grows."""

    def __init__(self, settings: GraphSettings) -> None:
        self.settings = settings
        self._incremental = IncrementalPoses(settings.solver) if settings.incremental else None

    def optimise(self, ids: Sequence[int], T_map_base: Floats, links: Sequence[Link], *, root: int) -> OptimisedGraph:
        """Return the graph where its links agree best.

        Parameters
        ----------
        ids
            Nodes, positive, and landmarks, negative; distinct, one per row of `T_map_base`.
        T_map_base
            float64 (N, 4, 4), where to begin.
        links
            Links whose ends are not both among the ids are left out.
        root
            Node that stays; only what links tie to it is optimised.

        Raises
        ------
        EstimationError
            If it cannot be solved.
        """
        settings = self.settings
        row_of = {node_id: row for row, node_id in enumerate(ids)}
        used = [link for link in links if link.from_id in row_of and link.to_id in row_of and self._wanted(link)]
        tied = _component(root, used)
        used = [link for link in used if link.from_id in tied]
        rows = np.array([row for row, node_id in enumerate(ids) if node_id in tied], np.int64)
        result = np.array(T_map_base, np.float64)
        iterations, error = 0, 0.0
        outvoted: tuple[Link, ...] = ()
        if used:
            problem = _problem(ids, result, rows, used, root, settings)
            if self._incremental is None or problem.edges.robust.any():
                solution = optimise_poses(problem, settings.solver)
            else:
                solution = self._incremental.optimise(problem)
            between = [link for link in used if link.kind not in ALONE]
            outvoted = tuple(between[row] for row in np.flatnonzero(solution.weights < 0.5))
            dropped = {id(link) for link in outvoted}
            used = [link for link in used if id(link) not in dropped]
            result[rows], iterations, error = solution.T_map_pose, solution.iterations, solution.error_after
        ratio, worst, is_rotation = worst_link(used, result, row_of, planar=settings.solver.planar)
        return OptimisedGraph(
            ids=tuple(ids), T_map_base=result, max_ratio=ratio, worst=worst, worst_is_rotation=is_rotation, iterations=iterations,
            error=error, moved=len(rows) if used else 0, outvoted=outvoted,
        )  # fmt: skip

    def _wanted(self, link: Link) -> bool:
        settings = self.settings
        if link.kind == LinkKind.POSE_PRIOR:
            return link.from_id < 0 or not settings.priors_ignored  # what is told of markers is meant
        if link.kind == LinkKind.GRAVITY:
            return settings.solver.gravity_sigma > 0 and not settings.solver.planar
        return not (settings.landmarks_ignored and link.kind == LinkKind.LANDMARK)


def optimise_graph(
    ids: Sequence[int], T_map_base: Floats, links: Sequence[Link], settings: GraphSettings, *, root: int
) -> OptimisedGraph:
    """Return a graph where its links agree best; see :meth:`GraphOptimiser.optimise`."""
    return GraphOptimiser(settings).optimise(ids, T_map_base, links, root=root)


def graph_root(ids: Sequence[int], *, from_end: bool) -> int:
    """Return the node of a component that stays: its oldest, or with ``RGBD/OptimizeFromGraphEnd`` its newest."""
    nodes = [node_id for node_id in ids if node_id > 0]
    return max(nodes) if from_end else min(nodes)


def link_ratios(
    links: Sequence[Link], T_map_base: Floats, row_of: dict[int, int], *, planar: bool
) -> tuple[Floats, Floats]:
    """Return the error of each link over its standard deviation, float64 (L,) of the translation and of the rotation.

    The largest error along an axis over the largest standard deviation along one, as RTAB-Map does; in the plane without z,
    roll and pitch. Links of a node with itself have 0.
    """
    if not links:
        return np.zeros(0), np.zeros(0)
    first = T_map_base[[row_of[link.from_id] for link in links]]
    second = T_map_base[[row_of[link.to_id] for link in links]]
    measured = np.array([link.T_from_to for link in links])
    seen = se3.inverse(first) @ second
    shift = np.abs(seen[:, :3, 3] - measured[:, :3, 3])
    apart = seen[:, :3, :3] @ measured[:, :3, :3].transpose(0, 2, 1)
    turn = np.abs(quaternion.to_rotation_vector(quaternion.from_matrix(apart)))
    variances = np.linalg.inv(_held(np.array([link.information for link in links])))
    variances = np.diagonal(variances, axis1=1, axis2=2)
    shifts, turns = (shift[:, :2], turn[:, 2:]) if planar else (shift, turn)
    linear, angular = (variances[:, :2], variances[:, 5:]) if planar else (variances[:, :3], variances[:, 3:])
    between = np.array([link.kind not in ALONE for link in links])
    ratios = [
        np.where(between, errors.max(axis=1) / np.sqrt(of.max(axis=1)), 0.0)
        for errors, of in ((shifts, linear), (turns, angular))
    ]
    return ratios[0], ratios[1]


def worst_link(
    links: Sequence[Link], T_map_base: Floats, row_of: dict[int, int], *, planar: bool
) -> tuple[float, Link | None, bool]:
    """Return the largest of all `link_ratios`, whose it is, and whether it is that of the rotation."""
    if not links:
        return 0.0, None, False
    translation, rotation = link_ratios(links, T_map_base, row_of, planar=planar)
    i, j = int(np.argmax(translation)), int(np.argmax(rotation))
    if rotation[j] > translation[i]:
        return float(rotation[j]), links[j], True
    return float(translation[i]), links[i], False


def _problem(
    ids: Sequence[int], T: Floats, rows: NDArray[np.int64], links: Sequence[Link], root: int, settings: GraphSettings
) -> PoseProblem:
    """Return the part of the graph that hangs together, as the solver takes it."""
    place = {ids[row]: k for k, row in enumerate(rows.tolist())}
    between = [link for link in links if link.kind not in ALONE]
    alone = [link for link in links if link.kind in ALONE]
    edges = PoseEdges(
        first=np.array([place[link.from_id] for link in between], np.int64),
        second=np.array([place[link.to_id] for link in between], np.int64),
        T_first_second=_stacked([link.T_from_to for link in between], 4),
        information=_information(between, settings),
        robust=np.array([settings.robust and link.kind in CLOSURES for link in between], np.bool_),
    )
    known = PoseKnowledge(
        row=np.array([place[link.from_id] for link in alone], np.int64),
        T_map_pose=_stacked([link.T_from_to for link in alone], 4), information=_information(alone, settings),
        gravity=np.array([link.kind == LinkKind.GRAVITY for link in alone], np.bool_),
    )  # fmt: skip
    keys = np.array([ids[row] for row in rows.tolist()], np.int64)
    return PoseProblem(
        keys=np.where(keys < 0, LANDMARKS_FROM - keys, keys), T_map_pose=T[rows], root=place[root], edges=edges,
        known=known,
    )  # fmt: skip


def _information(links: Sequence[Link], settings: GraphSettings) -> Floats:
    if settings.variance_ignored:
        return np.tile(np.eye(6), (len(links), 1, 1))
    return _held(_stacked([link.information for link in links], 6))


def _held(information: Floats) -> Floats:
    """Return information with a little of everything where a diagonal has none."""
    out = np.array(information, np.float64)
    axes = np.arange(6)
    out[:, axes, axes] = np.maximum(out[:, axes, axes], LEAST_INFORMATION)
    return out


def _stacked(matrices: Sequence[Floats], size: int) -> Floats:
    return np.array(matrices, np.float64).reshape(-1, size, size)


def _component(root: int, links: Sequence[Link]) -> set[int]:
    """Return what links tie to the root, itself among it."""
    linked: dict[int, list[int]] = {}
    for link in links:
        linked.setdefault(link.from_id, []).append(link.to_id)
        linked.setdefault(link.to_id, []).append(link.from_id)
    found, waiting = {root}, [root]
    while waiting:
        for other in linked.get(waiting.pop(), ()):
            if other not in found:
                found.add(other)
                waiting.append(other)
    return found
