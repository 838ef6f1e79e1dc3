# SPDX-License-Identifier: MIT
"""Closures with paths near by, from scans: the new scan is registered in the merged scans of each (Labbé and Michaud, JFR 2019, section 3.3.3)."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.geometry import se3
from slamcli.rtabmap.graph_uncertainty import LinkVariances, WaysFromNode
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.local_scan_map import LocalScanMap, Sought, local_scan_map
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.near_paths import ALONG, near_paths
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.registration import Registration, refused
from slamcli.rtabmap.scan_registration import registered
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.signature import NodeScan

Floats = NDArray[np.float64]
ScanOf = Callable[[int], NodeScan | None]
"""The scan of a node, None where memory has it no more."""

_KEPT_MAPS = 12
_TURNED_RAD = 0.5
"""A node of a path that turned so far since the last one taken is taken too: it saw something else."""
_SUPPORTING = 8
"""Nodes before the new one whose scans support a search."""
_KNOWN_M, _KNOWN_RAD = 0.05, 0.03
"""Standard deviations from which a closure would hardly tell anything new (intel: half the closures, the same error)."""
_CONFIRMED_M, _CONFIRMED_RAD = 0.25, 0.05
"""How well a second closure must agree with a first that moved the robot far."""
_CONFIRMED_WITHIN = 5
"""How many nodes later it must come."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScanProximityMatch:
    """What came of comparing a node's scan with a path near by."""

    near_id: int
    kind: LinkKind
    registration: Registration
    """a: the node near by, in whose frame the path's scans are merged, b: the new one."""
    merged_ids: tuple[int, ...]
    """Nodes whose scans were merged."""
    sigma_m: float
    """How uncertain the graph was of the new node's position, seen from the one near by, before."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    """A closure that awaits a second one that agrees."""

    new_id: int
    near_id: int
    T_near_new: Floats


class ScanProximity:
    """One-to-many proximity detection.

    Parameters
    ----------
    parameters
        ``RGBD/LocalRadius``, ``RGBD/Proximity*``, ``Icp/*`` and ``Reg/Force3DoF``.

    Notes
    -----
    RTAB-Map registers at most ``RGBD/ProximityPathFilteringRadius`` from the path. Here a path is compared that the robot may be at by
    what the graph knows (three standard deviations), and none whose place is known within 5 cm and 0.03 rad already; planar scans are then searched for. A closure that such a search found farther
    off than that radius must be confirmed by a second one, within five nodes, that agrees with it: then that one is
    returned.
    """

    def __init__(self, parameters: RtabmapParameters) -> None:
        self._rgbd = parameters.rgbd
        self._settings = ScanSettings.of(parameters)
        self._variances = LinkVariances()
        self._maps: OrderedDict[tuple[int, ...], LocalScanMap] = OrderedDict()
        self._pending: list[_Pending] = []

    def links(
        self, new_id: int, graph: MapGraph, scan_of: ScanOf, *, among: Collection[int], held: Collection[int] | None = None,
        last_closure: int = 0, localising: bool = False,
    ) -> list[ScanProximityMatch]:  # fmt: skip
        """Return how a node's scan compares with the paths near it, accepted or not, newest path first.

        Parameters
        ----------
        graph
            With the node in it; poses are those of the last optimisation.
        among
            Nodes of working memory, without short-term memory.
        held
            Nodes of short-term and working memory: links among them alone are followed. None: all.
        last_closure
            Node that the robot was last found at; 0: none.
        localising
            Whether the map is fixed (``RGBD/ProximityGlobalScanMap`` applies then).
        """
        s, scan = self._rgbd, scan_of(new_id)
        if not s.proximity_by_space or s.proximity_path_max_neighbors <= 0 or scan is None or not len(scan.points):
            return []
        poses, tied = graph.part(held)
        paths = near_paths(new_id, poses, tied, s, among=among, last_closure=last_closure)
        if not paths:
            return []
        ways = WaysFromNode(new_id, poses, tied, self._variances)
        if localising and s.proximity_global_scan_map:
            paths = [sorted(set().union(*paths))]
        matches: list[ScanProximityMatch] = []
        for path in paths:
            if s.proximity_max_paths and len(matches) >= s.proximity_max_paths:
                break
            match = self._compare(
                new_id, scan, path, graph, scan_of, ways, whole=localising and s.proximity_global_scan_map
            )
            if match is not None:
                matches.append(match)
        return matches

    def forget(self) -> None:
        """Drop merged scans: nodes have changed otherwise than by optimisation."""
        self._maps.clear()

    def _compare(
        self, new_id: int, scan: NodeScan, path: list[int], graph: MapGraph, scan_of: ScanOf, ways: WaysFromNode, *, whole: bool
    ) -> ScanProximityMatch | None:  # fmt: skip
        s = self._rgbd
        here = graph.T_map_base[new_id]
        distances = [float(np.linalg.norm(graph.T_map_base[i][:3, 3] - here[:3, 3])) for i in path]
        near_id = path[int(np.argmin(distances))]
        sigma_m, sigma_rad = (math.sqrt(v) for v in ways.variances(near_id))
        if graph.are_linked(new_id, near_id) or not math.isfinite(sigma_m):
            return None
        if sigma_m < _KNOWN_M and sigma_rad < _KNOWN_RAD:
            return None
        if s.proximity_path_filtering_radius and min(distances) > s.proximity_path_filtering_radius + 3.0 * sigma_m:
            return None
        merged_ids, merged = self._merged(path, near_id, graph, scan_of, whole=whole)
        if merged is None:
            return None
        T_guess = se3.inverse(graph.T_map_base[near_id]) @ here
        sought = Sought(
            scan=scan,
            T_guess=T_guess,
            sigma_m=sigma_m,
            sigma_rad=sigma_rad,
            before=self._before(new_id, graph, scan_of),
        )
        fit = merged.fit(sought, s.local_radius)
        found = registered(fit, s.proximity_merged_scan_cov_factor)
        if found.T_a_b is not None and fit.searched:
            found = self._confirmed(new_id, near_id, found, T_guess, graph)
        return ScanProximityMatch(
            near_id=near_id,
            kind=LinkKind.LOCAL_SPACE_CLOSURE,
            registration=found,
            merged_ids=merged_ids,
            sigma_m=sigma_m,
        )

    def _merged(
        self, path: list[int], near_id: int, graph: MapGraph, scan_of: ScanOf, *, whole: bool
    ) -> tuple[tuple[int, ...], LocalScanMap | None]:
        """Return the merged scans of a path about a node, in that node's frame, and whose they are."""
        poses: Mapping[int, Floats] = (
            _by_odometry(path, graph) if self._rgbd.proximity_path_raw_poses_used and not whole else graph.T_map_base
        )
        ids = tuple(
            self._members(path, near_id, poses, len(path) if whole else self._rgbd.proximity_path_max_neighbors)
        )
        known = {i: scan for i in ids if (scan := scan_of(i)) is not None and len(scan.points)}
        if not known:
            return (), None
        fixed = self._rgbd.proximity_path_raw_poses_used and not whole
        if fixed and ids in self._maps:
            self._maps.move_to_end(ids)
            return ids, self._maps[ids]
        T = se3.inverse(poses[near_id]) @ np.array([poses[i] for i in known])
        try:
            merged = local_scan_map(T, list(known.values()), self._settings)
        except EstimationError:
            return ids, None
        if fixed:
            self._maps[ids] = merged
            if len(self._maps) > _KEPT_MAPS:
                self._maps.popitem(last=False)
        return ids, merged

    def _members(self, path: list[int], near_id: int, poses: Mapping[int, Floats], most: int) -> list[int]:
        """Return the node and those around it on the path, to both sides, that are a filtering radius apart."""
        spacing, middle = self._rgbd.proximity_path_filtering_radius, path.index(near_id)
        members = [near_id]
        for side in (path[middle + 1 :], path[:middle][::-1]):
            last, count = poses[near_id], 0
            for node in side:
                motion = se3.inverse(last) @ poses[node]
                turn = math.acos(min(1.0, max(-1.0, (float(np.trace(motion[:3, :3])) - 1.0) / 2.0)))
                if float(np.linalg.norm(motion[:3, 3])) >= spacing or turn >= _TURNED_RAD:
                    members.append(node)
                    last, count = poses[node], count + 1
                if count >= most:
                    break
        return members

    def _before(self, new_id: int, graph: MapGraph, scan_of: ScanOf) -> list[tuple[Floats, NodeScan]]:
        """Return the scans of the nodes before one, with their poses seen from it by odometry."""
        node = graph.nodes[new_id]
        recent = [i for i in range(new_id - 1, max(0, new_id - 1 - _SUPPORTING), -1) if i in graph.nodes]
        found = []
        for other in (graph.nodes[i] for i in recent):
            scan = scan_of(other.id)
            if other.map_id != node.map_id:
                break
            if scan is not None:
                found.append((se3.inverse(node.T_odom_base) @ other.T_odom_base, scan))
        return found

    def _confirmed(
        self, new_id: int, near_id: int, found: Registration, T_guess: Floats, graph: MapGraph
    ) -> Registration:
        """Return a closure if it moves the robot little, or agrees with one found shortly before; else what tells that it waits."""
        assert found.T_a_b is not None  # noqa: S101  (asked only then)
        off = float(np.linalg.norm((se3.inverse(T_guess) @ found.T_a_b)[:3, 3]))
        self._pending = [p for p in self._pending if new_id - p.new_id <= _CONFIRMED_WITHIN and p.new_id in graph.nodes]
        if off <= self._rgbd.proximity_path_filtering_radius:
            return found
        node = graph.nodes[new_id]
        for earlier in self._pending:
            known = earlier.near_id in graph.nodes and graph.nodes[earlier.new_id].map_id == node.map_id
            if not known or graph.nodes[earlier.near_id].map_id != graph.nodes[near_id].map_id:
                continue
            T_near = se3.inverse(graph.nodes[earlier.near_id].T_odom_base) @ graph.nodes[near_id].T_odom_base
            T_new = se3.inverse(graph.nodes[earlier.new_id].T_odom_base) @ node.T_odom_base
            error = se3.inverse(earlier.T_near_new @ T_new) @ (T_near @ found.T_a_b)
            if (
                float(np.linalg.norm(error[:3, 3])) <= _CONFIRMED_M
                and abs(float(se3.to_se2(error)[2])) <= _CONFIRMED_RAD
            ):
                return found
        self._pending.append(_Pending(new_id, near_id, found.T_a_b))
        return refused(
            f"{off:.1f} m from where the graph has it: waits for a second closure that agrees", num_matches=found.num_matches,
            num_inliers=found.num_inliers,
        )  # fmt: skip


def _by_odometry(path: list[int], graph: MapGraph) -> dict[int, Floats]:
    """Return poses of a path's nodes by odometry, refined where its links are; where a link is missing as the graph has them."""
    along = {(k.from_id, k.to_id): k.T_from_to for k in graph.links_among(path) if k.kind in ALONG}
    poses = {path[0]: graph.T_map_base[path[0]]}
    for a, b in pairwise(path):
        if (a, b) in along:
            T_a_b = along[a, b]
        elif (b, a) in along:
            T_a_b = se3.inverse(along[b, a])
        else:
            T_a_b = se3.inverse(graph.T_map_base[a]) @ graph.T_map_base[b]
        poses[b] = poses[a] @ T_a_b
    return poses
