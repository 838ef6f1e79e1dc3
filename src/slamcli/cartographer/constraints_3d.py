# SPDX-License-Identifier: MIT
"""The search for loop closures in space: which nodes are seen from which submaps, and from where exactly."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.cartographer.graph_3d import Graph3D
from slamcli.cartographer.matching_3d import volume_match
from slamcli.cartographer.parameters import CartographerParameters
from slamcli.errors import DataError
from slamcli.geometry import se3
from slamcli.grids.hybrid_blocks import HybridBlocks
from slamcli.grids.surfel_map import SurfelMap
from slamcli.posegraph import Constraint, LoopSearch, Node
from slamcli.registration.branch_and_bound_3d import CloudForSearch, Found3D, Search3D, SubmapSearch3D
from slamcli.registration.surfel_matching import SurfelMatch, align_with_surfels
from slamcli.registration.volume_matching import align_with_volumes, mean_probability

AGREEMENT = 0.45
"""Share of a node's points that must agree with the submap's planes, where planes are used."""
OWN_SHARE, OWN_PROBES = 0.8, 7
"""Where a submap's own nodes score less than the minimum over this share, it was seen too rarely for its cells to be sure of
themselves: then this share of their score is the minimum (some of them are looked at)."""
OPEN = "the place is open in one direction"
NEAR_OFF_M = 1.0
"""How far the estimate may be off for planes to be tried without a search."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pair to search, by rows of the graph."""

    submap: int
    node: int
    anywhere: bool = False
    """Search the whole submap at all yaws."""
    wide: bool = True
    """Search by branch and bound where the estimate alone does not lead to a match."""


class SubmapMatcher:
    """Everything that nodes are matched with in one submap; made once for all candidates of the submap."""

    def __init__(
        self, graph: Graph3D, row: int, members: Sequence[Constraint], parameters: CartographerParameters
    ) -> None:
        submap, self._p = graph.submaps[row], parameters
        high, low, histogram = submap.high_resolution, submap.low_resolution, submap.rotational_histogram
        if high is None or low is None or histogram is None:
            raise DataError(
                f"submap {submap.id.number} of trajectory {submap.id.trajectory} has no grids of 3D mapping"
            )
        self._records = (high, low, histogram)
        self._high, self._low = HybridBlocks.from_record(high), HybridBlocks.from_record(low)
        own = self._own_score(graph, members)
        builder = parameters.pose_graph.constraint_builder
        self._min_score = min(builder.min_score, OWN_SHARE * own)
        self._min_score_anywhere = min(builder.global_localization_min_score, OWN_SHARE * own)
        self._search: SubmapSearch3D | None = None
        self._surfels = self._planes(graph, members) if parameters.slamcli_3d.refine_loops else None

    def _own_score(self, graph: Graph3D, members: Sequence[Constraint]) -> float:
        """Return the median score of nodes in the submap that they are part of; 1 if it has none."""
        if not members:
            return 1.0
        chosen = [members[i] for i in np.unique(np.linspace(0, len(members) - 1, OWN_PROBES).astype(np.int64))]
        clouds = [cloud_of(graph.nodes[graph.node_row(member.node)]).high_points_m for member in chosen]
        scores = [
            mean_probability(points, member.T_submap_node, self._high)
            for points, member in zip(clouds, chosen, strict=True)
        ]
        return float(np.median(scores))

    def _planes(self, graph: Graph3D, members: Sequence[Constraint]) -> SurfelMap:
        p = self._p.slamcli_3d
        surfels = SurfelMap(p.surfel_size, p.surfel_levels, p.surfel_capacity)
        for member in members:
            points = _all_points(graph.nodes[graph.node_row(member.node)])
            surfels.add(points @ member.T_submap_node[:3, :3].T + member.T_submap_node[:3, 3])
        return surfels

    def match(
        self, node: Node, T_submap_node: NDArray[np.float64], candidate: Candidate
    ) -> tuple[NDArray[np.float64] | None, float, str]:
        """Return the node's pose in the submap, its mean probability there, and the reason if there is none."""
        cloud = cloud_of(node)
        if self._surfels is not None and not candidate.anywhere:
            T, agreement, is_open = self._by_planes(self._surfels, node, T_submap_node, NEAR_OFF_M)
            if is_open and agreement >= AGREEMENT:
                return None, 0.0, OPEN
            score = mean_probability(cloud.high_points_m, T, self._high)
            if agreement >= AGREEMENT and score >= self._min_score:
                return T, score, ""
        if not (candidate.wide or candidate.anywhere):
            return None, 0.0, "score"
        found = self._by_search(cloud, T_submap_node, candidate.anywhere)
        if isinstance(found, str):
            return None, 0.0, found
        settings = volume_match(self._p.pose_graph.constraint_builder.ceres_scan_matcher_3d)
        start = found.T_submap_node
        if self._surfels is None:
            T, _ = align_with_volumes(
                cloud.high_points_m, cloud.low_points_m, self._high, self._low, start, start, settings
            )  # fmt: skip
            return T, found.score, ""
        T, agreement, is_open = self._by_planes(self._surfels, node, start, 0.3)
        if is_open:
            return None, found.score, OPEN
        if agreement < AGREEMENT:
            return None, found.score, f"{agreement:.2f} of the points agree with the submap's planes"
        return T, found.score, ""

    def _by_planes(
        self, surfels: SurfelMap, node: Node, T_start: NDArray[np.float64], off_m: float
    ) -> tuple[NDArray[np.float64], float, bool]:
        p = self._p.slamcli_3d
        aligned = align_with_surfels(
            surfels,
            _all_points(node),
            T_start,
            T_start,
            (3.0 * off_m, 0.2),
            off_m,
            SurfelMatch(noise_m=p.point_noise),
        )
        return aligned.T_map_cloud, aligned.agreement * aligned.overlap, aligned.open_directions > 0

    def _by_search(self, cloud: CloudForSearch, T: NDArray[np.float64], anywhere: bool) -> Found3D | str:
        if self._search is None:
            self._search = SubmapSearch3D(*self._records, search_settings(self._p))
        if anywhere:
            return self._search.match_anywhere(cloud, T, self._min_score_anywhere)
        return self._search.match(cloud, T, self._min_score)


def search_all(
    graph: Graph3D, candidates: Sequence[Candidate], parameters: CartographerParameters, jobs: int, round_number: int
) -> tuple[list[LoopSearch], list[Constraint]]:
    """Return what became of all candidates, in their order, and the constraints of those that were accepted.

    Submaps are searched side by side; poses are read before the first and changed by none, so that the result does not
    depend on `jobs`.
    """
    members = graph.members()
    by_submap: dict[int, list[int]] = {}
    for place, candidate in enumerate(candidates):
        by_submap.setdefault(candidate.submap, []).append(place)
    results: list[tuple[LoopSearch, Constraint | None] | None] = [None] * len(candidates)

    def work(row: int) -> None:
        matcher = SubmapMatcher(graph, row, members[row], parameters)
        for place in by_submap[row]:
            results[place] = _searched(graph, matcher, candidates[place], parameters, round_number)

    if jobs > 1:
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(work, by_submap))
    else:
        for row in by_submap:
            work(row)
    done = [result for result in results if result is not None]
    return [search for search, _ in done], [constraint for _, constraint in done if constraint is not None]


def _searched(
    graph: Graph3D, matcher: SubmapMatcher, candidate: Candidate, parameters: CartographerParameters, round_number: int
) -> tuple[LoopSearch, Constraint | None]:
    submap, node = graph.submaps[candidate.submap], graph.nodes[candidate.node]
    T_initial = se3.inverse(graph.T_map_submap[candidate.submap]) @ graph.T_map_node[candidate.node]
    T, score, reason = matcher.match(node, T_initial, candidate)
    search = LoopSearch(
        submap=submap.id, node=node.id, score=score, accepted=T is not None, reason=reason, round=round_number
    )
    if T is None:
        return search, None
    builder = parameters.pose_graph.constraint_builder
    return search, Constraint(
        submap=submap.id,
        node=node.id,
        T_submap_node=T,
        translation_weight=builder.loop_closure_translation_weight,
        rotation_weight=builder.loop_closure_rotation_weight,
        kind="inter",
    )


def search_settings(parameters: CartographerParameters) -> Search3D:
    """Return the settings of the branch and bound from Cartographer's table."""
    s = parameters.pose_graph.constraint_builder.fast_correlative_scan_matcher_3d
    return Search3D(
        branch_and_bound_depth=s.branch_and_bound_depth,
        full_resolution_depth=min(s.full_resolution_depth, s.branch_and_bound_depth),
        min_rotational_score=s.min_rotational_score,
        min_low_resolution_score=s.min_low_resolution_score,
        linear_xy_search_window=s.linear_xy_search_window,
        linear_z_search_window=s.linear_z_search_window,
        angular_search_window=s.angular_search_window,
    )


def cloud_of(node: Node) -> CloudForSearch:
    """Return what of a node is matched."""
    low, histogram = node.low_resolution_points_m, node.rotational_histogram
    if low is None or histogram is None:
        raise DataError(f"node {node.id.number} of trajectory {node.id.trajectory} has no points of 3D mapping")
    return CloudForSearch(
        high_points_m=node.points_m.astype(np.float64),
        low_points_m=low.astype(np.float64),
        rotational_histogram=histogram,
        gravity_alignment_xyzw=node.gravity_alignment_xyzw,
    )


def _all_points(node: Node) -> NDArray[np.float64]:
    low = node.low_resolution_points_m
    parts = [node.points_m] if low is None else [node.points_m, low]
    return np.concatenate(parts).astype(np.float64)
