# SPDX-License-Identifier: MIT
"""Proximity detection with scans: a new scan is registered in the merged scans of paths that lead past (JFR 2019, 3.3.3)."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se2, se3
from slamcli.registration.agreement import BeamAgreement
from slamcli.registration.merged_scans import MergedScans, PlanarMatch, PlanarScan
from slamcli.rtabmap.graph_uncertainty import LinkSigmas, WaysFromNode
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]

_KEPT_MAPS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximitySettings:
    radius_m: float = 10.0
    max_paths: int = 3
    max_neighbors: int = 10
    filtering_radius_m: float = 1.0
    covariance_factor: float = 100.0
    max_depth: int = 0
    recent: int = 10
    cell_m: float = 0.05
    spacing_m: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProximityTrial:
    new_id: int
    old_id: int
    reason: str
    link: Link | None = None
    match: PlanarMatch | None = None
    sigma_m: float = 0.0


class ScanProximity:
    def __init__(self, settings: ProximitySettings) -> None:
        self._settings = settings
        self._sigmas = LinkSigmas()
        self._maps: OrderedDict[tuple[int, ...], MergedScans] = OrderedDict()
        self._planar: dict[int, PlanarScan] = {}

    def links(self, new: int, graph: MapGraph, scans: Mapping[int, NodeScan]) -> list[ProximityTrial]:
        s = self._settings
        ids = np.array([i for i in graph.T_map_base if 0 < i < new], np.int64)
        if len(ids) <= s.recent:
            return []
        old = ids[: -s.recent]
        positions = np.array([graph.T_map_base[int(i)][:2, 3] for i in old])
        here = graph.T_map_base[new][:2, 3]
        distance = np.hypot(*(positions - here).T)
        near = distance < s.radius_m
        if not near.any():
            return []
        ways = WaysFromNode(new, graph.T_map_base, graph.links, self._sigmas)
        trials = []
        for path in _paths(old[near], distance[near], s)[: s.max_paths]:
            trial = self._try(new, path, graph, scans, ways)
            if trial is not None:
                trials.append(trial)
        return trials

    def _try(self, new, path, graph, scans, ways):
        s = self._settings
        row = int(np.argmin([np.hypot(*(graph.T_map_base[i][:2, 3] - graph.T_map_base[new][:2, 3])) for i in path]))
        anchor = path[row]
        if graph.are_linked(new, anchor):
            return None
        moved, turned = ways.variances(anchor)
        sigma, sigma_rad = math.sqrt(moved), math.sqrt(turned)
        T = se2.between(se3.to_se2(graph.T_map_base[anchor]), se3.to_se2(graph.T_map_base[new]))
        if math.hypot(T[0], T[1]) > s.filtering_radius_m + 3 * sigma:
            return None
        members = self._members(path, anchor, graph)
        merged = self._merged(tuple(members), anchor, graph, scans)
        scan = self._scan(new, scans)
        if 3 * sigma < 0.3 and 3 * sigma_rad < 0.15:
            match = merged.align(scan, T, np.array([max(sigma, 0.05)] * 2 + [max(sigma_rad, 0.02)]))
        else:
            before = self._before(new, graph, scans)
            around = np.concatenate([se2.transform_points(p, b.points[::2]) for p, b in before])
            match = merged.search(
                scan, around, T, min(3 * sigma + 0.2, s.radius_m), min(3 * sigma_rad + 0.1, math.pi), least_score=0.45
            )
            if match is None:
                return ProximityTrial(new_id=new, old_id=anchor, reason="nothing fits", sigma_m=sigma)
            support = sum(
                (merged.agreement(b, se2.compose(match.pose, p)) for p, b in before), BeamAgreement(0, 0, 0, 0)
            )
            match = replace(match, support=support)
        reason = self._doubt(match)
        link = None
        if not reason:
            link = self._link(anchor, new, match)
        return ProximityTrial(new_id=new, old_id=anchor, reason=reason, link=link, match=match, sigma_m=sigma)

    def _doubt(self, m):
        a = m.agreement
        if a.num_beams < 20:
            return "few beams"
        if a.share_on_surface < 0.55:
            return "little on surfaces"
        if a.share_contradicting > 0.2:
            return "ends in free space"
        if a.share_through > 0.15:
            return "through walls"
        return ""

    def _link(self, anchor, new, m):
        c, s_ = math.cos(m.pose[2]), math.sin(m.pose[2])
        covariance = self._settings.covariance_factor * np.linalg.inv(m.information + np.diag([1.0, 1.0, 1.0]))
        covariance += np.diag([0.005**2] * 2 + [0.001**2])
        if m.spread is not None:
            covariance[:2, :2] += m.spread * 1.0
        full = np.diag([1e-4] * 6)
        idx = [0, 1, 5]
        full[np.ix_(idx, idx)] = covariance
        return Link(
            from_id=anchor,
            to_id=new,
            kind=LinkKind.LOCAL_SPACE_CLOSURE,
            T_from_to=se3.from_se2(m.pose),
            information=np.linalg.inv(full),
        )

    def _members(self, path, anchor, graph):
        s = self._settings
        k = path.index(anchor)
        chosen = [anchor]
        for step in (1, -1):
            last = graph.T_map_base[anchor]
            count = 0
            j = k + step
            while 0 <= j < len(path) and count < s.max_neighbors:
                T = graph.nodes[path[j]].T_odom_base
                L = graph.nodes[chosen[-1] if count else anchor].T_odom_base
                if (
                    np.hypot(*(T[:2, 3] - L[:2, 3])) >= s.spacing_m
                    or abs(math.remainder(se3.to_se2(T)[2] - se3.to_se2(L)[2], math.tau)) > 0.5
                ):
                    chosen.append(path[j])
                    count += 1
                j += step
        return chosen

    def _merged(self, members, anchor, graph, scans):
        if members in self._maps:
            self._maps.move_to_end(members)
            return self._maps[members]
        poses = np.array([se3.to_se2(graph.nodes[i].T_odom_base) for i in members])
        poses = se2.between(poses[0], poses)
        merged = MergedScans(poses, [self._scan(i, scans) for i in members], cell_m=self._settings.cell_m)
        self._maps[members] = merged
        if len(self._maps) > _KEPT_MAPS:
            self._maps.popitem(last=False)
        return merged

    def _scan(self, i, scans):
        if i not in self._planar:
            n = scans[i]
            free = np.zeros((0, 2)) if n.open_ends is None else n.open_ends[:, :2].astype(float)
            self._planar[i] = PlanarScan(
                np.ascontiguousarray(n.points[:, :2].astype(float)), n.T_base_sensor[:2, 3].astype(float), free
            )
        return self._planar[i]

    def _before(self, new, graph, scans):
        here = se3.to_se2(graph.nodes[new].T_odom_base)
        return [
            (se2.between(here, se3.to_se2(graph.nodes[i].T_odom_base)), self._scan(i, scans))
            for i in sorted(graph.nodes)[-9:-1]
        ]


def _paths(ids, distance, s):
    """Runs of ids that follow each other, the latest first."""
    gaps = np.flatnonzero(np.diff(ids) > 1) + 1
    return [part.tolist() for part in np.split(ids, gaps)][::-1]
