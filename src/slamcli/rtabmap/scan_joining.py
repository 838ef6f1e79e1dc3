# SPDX-License-Identifier: MIT
"""Joining maps of planar scans: a session that nothing ties to an older map yet is searched for in all of that map.

References
----------
W. Hess, D. Kohler, H. Rapp, D. Andor, ICRA 2016, doi:10.1109/ICRA.2016.7487258, section V-B (branch and bound).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.rtabmap.local_scan_map import LocalScanMap, Sought, local_scan_map
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.node_rate import motion_size
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.registration import Registration, refused
from slamcli.rtabmap.scan_registration import registered
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]

_EVERY = 5
"""A search after so many nodes."""
_LATER, _LATEST = 0.1, 20
"""And after this share of those that were in vain, but not more than so many."""
_LEAST_SCORE = 0.6
"""Mean probability of the cells that the points must fall in."""
_AROUND_M = 8.0
"""Nodes of the session back to this way support a search with their scans."""
_STEP_M, _STEP_RAD = 0.5, 0.5
"""Of nodes nearer to each other one is enough."""
_LEAST_SUPPORT = 4
"""Other scans without which a search is too likely to be wrong."""
_AGREE_M, _AGREE_RAD = 0.5, 0.1
"""How well two searches must agree, seen along the odometry between them."""
_AGREE_WITHIN = 4
"""How many searches later the second one must come."""
_FACTOR = 25.0
"""Points of one scan are not independent of each other: the covariance that they tell counts so many times."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joining:
    """A closure between two maps."""

    old_id: int
    registration: Registration
    """a: the old node, b: the new one."""


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    new_id: int
    T_map_new: Floats
    old_ids: tuple[int, ...]


class ScanJoining:
    """Searches for the newest session in the map of the older ones.

    Parameters
    ----------
    parameters
        ``Icp/*`` and ``Reg/Force3DoF``.
    scan_of
        The scan of any node, from long-term memory too.

    Notes
    -----
    A place that is found counts when a second search, from other places, agrees with it: rooms look alike.
    """

    def __init__(self, parameters: RtabmapParameters, scan_of: Callable[[int], NodeScan | None]) -> None:
        self._settings, self._scan_of = ScanSettings.of(parameters), scan_of
        self._old_ids: tuple[int, ...] = ()
        self._old: LocalScanMap | None = None
        self._found: list[_Found] = []
        self._count, self._next = 0, _EVERY
        self._joined = -1
        """Newest session of which it is known that an older map is joined."""

    def closure(self, new_id: int, graph: MapGraph, working: Sequence[int]) -> Joining | None:
        """Return how a new node lies in an older map, if that was searched for; None otherwise.

        Parameters
        ----------
        working
            Nodes of working memory.
        """
        session = graph.nodes[new_id].map_id
        if session in (0, self._joined):
            return None
        self._count += 1
        if self._count < self._next:
            return None
        self._next = self._count + max(_EVERY, min(_LATEST, int(_LATER * self._count)))
        scan, own = self._scan_of(new_id), graph.component(new_id)
        if any(graph.nodes[node].map_id < session for node in own if node > 0):
            self._joined = session
            return None
        old_ids = self._largest(graph, [node for node in working if node < min(n for n in own if n > 0)])
        if scan is None or not scan.planar or not old_ids:
            return None
        before = self._before(new_id, graph, own)
        if len(before) < _LEAST_SUPPORT:
            return None
        return self._search(new_id, scan, before, graph, old_ids)

    def _search(
        self, new_id: int, scan: NodeScan, before: list[tuple[Floats, NodeScan]], graph: MapGraph, old_ids: tuple[int, ...]
    ) -> Joining | None:  # fmt: skip
        old = self._merged(old_ids, graph)
        if old is None:
            return None
        places = np.array([graph.T_map_base[node][:3, 3] for node in old_ids])
        low, high = places.min(axis=0), places.max(axis=0)
        reach = 0.5 * float((high - low)[:2].max()) + 2.0
        T_guess = np.eye(4)
        T_guess[:3, 3] = 0.5 * (low + high)
        fit = old.fit(
            Sought(
                scan=scan, T_guess=T_guess, sigma_m=reach, sigma_rad=math.pi, before=before, least_score=_LEAST_SCORE
            ),
            reach,
        )
        in_map = registered(fit, _FACTOR)
        if in_map.T_a_b is None:
            near = int(old_ids[0])
            return Joining(old_id=near, registration=in_map)
        near = old_ids[int(np.argmin(np.linalg.norm(places - in_map.T_a_b[:3, 3], axis=1)))]
        if not self._agrees(new_id, in_map.T_a_b, graph, old_ids):
            self._next = self._count + _EVERY
            self._found = [*self._found, _Found(new_id, in_map.T_a_b, old_ids)][-_AGREE_WITHIN:]
            why = "found in the older map: waits for a second search that agrees"
            return Joining(old_id=near, registration=refused(why, num_inliers=in_map.num_inliers))
        return Joining(old_id=near, registration=_seen_from(graph.T_map_base[near], in_map))

    def _agrees(self, new_id: int, T_map_new: Floats, graph: MapGraph, old_ids: tuple[int, ...]) -> bool:
        for earlier in self._found:
            if earlier.old_ids[0] != old_ids[0] or earlier.new_id not in graph.T_map_base:
                continue
            T_moved = se3.inverse(graph.T_map_base[earlier.new_id]) @ graph.T_map_base[new_id]
            way, turn = motion_size(se3.inverse(earlier.T_map_new @ T_moved) @ T_map_new)
            if way <= _AGREE_M and turn <= _AGREE_RAD:
                return True
        return False

    def _largest(self, graph: MapGraph, older: list[int]) -> tuple[int, ...]:
        """Return the nodes of the largest older map among some nodes."""
        waiting, best = set(older), tuple[int, ...]()
        while waiting:
            first = min(waiting)
            members = tuple(node for node in graph.component(first) if node in waiting)
            waiting -= set(members)
            best = max(best, members, key=len)
        return best

    def _merged(self, old_ids: tuple[int, ...], graph: MapGraph) -> LocalScanMap | None:
        """Return the scans of an older map, whose poses stay as they are until something joins it."""
        if old_ids != self._old_ids:
            chosen = _apart(old_ids, graph)
            scans = {node: scan for node in chosen if (scan := self._scan_of(node)) is not None and len(scan.points)}
            self._old_ids, self._old = old_ids, None
            if scans and all(scan.planar for scan in scans.values()):
                poses = np.array([graph.T_map_base[node] for node in scans])
                try:
                    self._old = local_scan_map(poses, list(scans.values()), self._settings)
                except EstimationError:
                    self._old = None
        return self._old

    def _before(self, new_id: int, graph: MapGraph, own: Sequence[int]) -> list[tuple[Floats, NodeScan]]:
        """Return the scans of nodes of the session some way back, with their poses seen from the new one."""
        back = se3.inverse(graph.T_map_base[new_id])
        found: list[tuple[Floats, NodeScan]] = []
        way, last, taken = 0.0, np.eye(4), np.eye(4)
        for node in reversed([other for other in own if 0 < other < new_id]):
            T = back @ graph.T_map_base[node]
            way += motion_size(se3.inverse(last) @ T)[0]
            last = T
            if way > _AROUND_M:
                break
            if _is_apart(taken, T) and (scan := self._scan_of(node)) is not None:
                found.append((T, scan))
                taken = T
        return found


def _apart(ids: Sequence[int], graph: MapGraph) -> list[int]:
    """Return nodes one after the other that are somewhat apart."""
    chosen = [ids[0]]
    for node in ids[1:]:
        if _is_apart(graph.T_map_base[chosen[-1]], graph.T_map_base[node]):
            chosen.append(node)
    return chosen


def _is_apart(T_a: Floats, T_b: Floats) -> bool:
    way, turn = motion_size(se3.inverse(T_a) @ T_b)
    return way >= _STEP_M or turn >= _STEP_RAD


def _seen_from(T_map_near: Floats, in_map: Registration) -> Registration:
    """Return a place in the map as one of its nodes sees it; the covariance along that node's axes."""
    if in_map.T_a_b is None:
        return in_map
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = T_map_near[:3, :3].T
    return Registration(
        T_a_b=se3.inverse(T_map_near) @ in_map.T_a_b, covariance=turn @ in_map.covariance @ turn.T,
        num_matches=in_map.num_matches, num_inliers=in_map.num_inliers, matches=in_map.matches,
    )  # fmt: skip
