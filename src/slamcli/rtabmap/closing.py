# SPDX-License-Identifier: MIT
"""Where places are known again: by their looks, and by being near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.closure_check import ClosureCheck, ClosureRecord, Verdict, closure_link, closure_record
from slamcli.rtabmap.fixed_map import FixedMap
from slamcli.rtabmap.graph import GraphOptimiser, OptimisedGraph, graph_root, graph_settings, worst_link
from slamcli.rtabmap.hypothesis import Hypothesis
from slamcli.rtabmap.landmarks import MarkerFinder, prior_links
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.local_bundle import Around, adjusted_locally
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.pairs_near import pairs_near
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.registration import Registration, refused
from slamcli.rtabmap.scan_joining import ScanJoining
from slamcli.rtabmap.scan_proximity import ScanProximity
from slamcli.rtabmap.scan_registration import refined_by_scans, refined_motion
from slamcli.rtabmap.scan_settings import ScanSettings
from slamcli.rtabmap.sights import Sights
from slamcli.rtabmap.signature import NodeImages, NodeScan, Signature
from slamcli.rtabmap.visual_proximity import visual_proximity, visual_proximity_in_time
from slamcli.rtabmap.visual_registration import register_best, register_visual
from slamcli.rtabmap.visual_settings import visual_settings
from slamcli.vision.pinhole import Pinhole

Floats = NDArray[np.float64]

_UNSURE = 0.02
"""Standard deviation, metres or radians, that a motion between nodes has which the images did not tell."""
_NEIGHBOURS = 2
"""Nodes before and after a hypothesis that are tried too: the best view of a place is not always the likeliest."""
_AGREEING = 0.3
"""Standard deviations: a closure by scans, of which there are many, that the graph agrees with so well moves nothing worth the time;
the last optimisation has it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """A closure that was found; the graph has not been asked yet."""

    link: Link
    """From the older node to the newer one."""
    stamp_ns: int
    """Of the newer node."""
    registration: Registration
    posterior: float = 0.0
    """Of the hypothesis that led there; 0: found because it is near."""
    by_scans: bool = False
    """Whether scans alone tell it: then it says nothing about what is seen there."""


class Closing:
    """Compares the newest node with what the memory holds.

    Parameters
    ----------
    camera, T_base_camera
        Of all nodes' features; None for a robot without cameras.
    fixed
        The map, where it is only localised in; None: everything may move.
    """

    def __init__(
        self, parameters: RtabmapParameters, memory: Memory, camera: Pinhole | None, T_base_camera: Floats, seed: int,
        fixed: FixedMap | None = None,
    ) -> None:  # fmt: skip
        self._parameters, self._memory = parameters, memory
        self._camera, self._seed = camera, seed
        self.T_base_camera = T_base_camera
        self._settings = visual_settings(parameters.vis, parameters.reg)
        optimizer, gtsam = parameters.optimizer, parameters.gtsam
        settings = graph_settings(optimizer, gtsam, planar=parameters.reg.force_3dof)
        self.fixed = fixed if fixed is not None else FixedMap([], sigma=1.0)
        """Nodes that keep their poses."""
        self._optimiser = GraphOptimiser(replace(settings, priors_ignored=False) if self.fixed.ids else settings)
        robust = replace(self._optimiser.settings, robust=True, incremental=False)
        self._sorter = GraphOptimiser(robust)
        self._last_check = ClosureCheck(parameters.rgbd, robust=True)
        self._scan_settings = ScanSettings.of(parameters)
        self._scan_proximity = ScanProximity(parameters)
        self._joining = ScanJoining(parameters, lambda node_id: memory.recall(node_id).scan)
        self._localising = bool(self.fixed.ids)
        self._check = ClosureCheck(parameters.rgbd, robust=parameters.optimizer.robust, localising=self._localising)
        markers = parameters.rgbd.marker_detection and camera is not None
        self._markers = MarkerFinder(parameters.marker) if markers else None
        self._marker_priors = {link.from_id: link for link in prior_links(parameters.marker)} if markers else {}
        self.records: list[ClosureRecord] = []
        """Places that were compared, with what came of it."""
        self.sights = Sights()
        """Some of them, for pictures."""

    @property
    def sees(self) -> bool:
        """Whether the robot has a camera."""
        return self._camera is not None

    def optimise(
        self,
        ids: Sequence[int],
        graph: MapGraph,
        links: Sequence[Link] | None = None,
        *,
        by: GraphOptimiser | None = None,
    ) -> OptimisedGraph:
        """Return where links among some nodes agree best, all that the graph has unless told; nothing is changed.

        Of a fixed map only the nodes that links tie to others are in it, where they are.
        """
        poses = np.array([graph.T_map_base[node_id] for node_id in ids])
        used = graph.links_among(ids) if links is None else links
        if self.fixed.ids:
            part = self.fixed.part(ids, poses, used)
            ids, poses, used = part.ids, part.T_map_base, part.links
        root = graph_root(ids, from_end=self._parameters.rgbd.optimize_from_graph_end)
        return (by or self._optimiser).optimise(ids, poses, used, root=root)

    def sort_out(self, ids: Sequence[int], graph: MapGraph, proposals: Sequence[Proposal]) -> Verdict:
        """Return which of many proposed closures agree with each other and the graph, all taken together (Optimizer/Robust)."""
        new = [proposal.link for proposal in proposals]
        return self._last_check.judge(
            lambda links: self.optimise(ids, graph, links, by=self._sorter), graph.links_among(ids), new
        )

    def judge(self, ids: Sequence[int], graph: MapGraph, proposals: Sequence[Proposal]) -> Verdict:
        """Return which of the proposed closures, which the graph does not have yet, it can bear."""
        new = [proposal.link for proposal in proposals]
        agreeing = self._agreed(ids, graph, new) if all(proposal.by_scans for proposal in proposals) else None
        return self._check.judge(
            lambda links: self.optimise(ids, graph, links) if agreeing is None else agreeing,
            graph.links_among(ids),
            new,
        )

    def _agreed(self, ids: Sequence[int], graph: MapGraph, new: Sequence[Link]) -> OptimisedGraph | None:
        """Return the graph as it is, if new links say what it says anyway: there is nothing to optimise before others come."""
        poses = np.array([graph.T_map_base[node_id] for node_id in ids])
        rows = {node_id: row for row, node_id in enumerate(ids)}
        ratio, worst, rotation = worst_link(new, poses, rows, planar=self._optimiser.settings.solver.planar)
        if ratio > _AGREEING or self._parameters.optimizer.robust:
            return None
        return OptimisedGraph(
            ids=tuple(ids), T_map_base=poses, max_ratio=ratio, worst=worst, worst_is_rotation=rotation, iterations=0, error=0.0,
            moved=0,
        )  # fmt: skip

    def note(self, proposals: Sequence[Proposal], verdict: Verdict) -> None:
        """Keep what became of proposals, for the report."""
        reasons = {(link.from_id, link.to_id): reason for link, reason in verdict.refused}
        for proposal in proposals:
            link, found = proposal.link, proposal.registration
            reason = reasons.get((link.from_id, link.to_id), "")
            self.records.append(
                closure_record(
                    link, proposal.stamp_ns, found, reason=reason, posterior=proposal.posterior, ratio=verdict.ratio
                )
            )
            if not proposal.by_scans:
                ends = (self._memory.signature(link.from_id), self._memory.signature(link.to_id))
                self.sights.offer(*ends, link.kind, found, reason)

    def by_looks(self, node: Signature, hypothesis: Hypothesis, graph: MapGraph) -> list[Proposal]:
        """Return the closure with the place that the node most likely shows, if it is accepted and its geometry holds."""
        if not hypothesis.accepted or self._camera is None or graph.are_linked(hypothesis.node, node.id):
            return []
        around = [other for other in graph.neighbours(hypothesis.node) if other in graph.nodes and other != node.id]
        candidates = [self._memory.signature(other) for other in (hypothesis.node, *around[: 2 * _NEIGHBOURS])]
        known = [candidate for candidate in candidates if candidate is not None and len(candidate.features)]
        known = [candidate for candidate in known if not graph.are_linked(candidate.id, node.id)]
        if not known:
            return []
        rgbd = self._parameters.rgbd
        old_id, found = register_best(
            known, node, self._camera, self.T_base_camera, self._settings, seed=self._seed,
            guess=np.eye(4) if rgbd.loop_closure_identity_guess else None, inversely=rgbd.inverted_reg,
        )  # fmt: skip
        old = self._memory.signature(old_id)
        if rgbd.local_bundle_on_loop_closure and old is not None:
            beside = self._around(old_id, graph)
            found = adjusted_locally(
                found, old, node, beside, self._camera, self.T_base_camera, self._settings, seed=self._seed
            )
        found = self._by_scans_too(found, old, node)
        proposal = self._proposal(old_id, node, LinkKind.GLOBAL_CLOSURE, found, hypothesis.posterior)
        return [] if proposal is None else [proposal]

    def _around(self, node_id: int, graph: MapGraph) -> list[Around]:
        """Return the nodes that links tie to a node and that memory holds with their features."""
        back = se3.inverse(graph.T_map_base[node_id])
        held = [self._memory.signature(other) for other in graph.neighbours(node_id) if other in graph.nodes]
        return [
            Around(signature=one, T_old_node=back @ graph.T_map_base[one.id])
            for one in held
            if one is not None and len(one.features)
        ]

    def by_markers(
        self, node: Signature, images: NodeImages | None, graph: MapGraph
    ) -> tuple[list[Link], list[Proposal]]:
        """Return links to markers that were not seen before, with what is told of them, and closures by known ones."""
        if self._markers is None or images is None:
            return [], []
        seen = self._markers.links(node.id, images)
        known = [link for link in seen if link.to_id in graph.T_map_base]
        new = [link for link in seen if link.to_id not in graph.T_map_base]
        told = [self._marker_priors[link.to_id] for link in new if link.to_id in self._marker_priors]
        return [*new, *told], [_by_marker(link, node.stamp_ns) for link in known]

    def by_place(self, node: Signature, graph: MapGraph) -> list[Proposal]:
        """Return the closures with places near by, in space and in time, by looks and by scans."""
        found = self._near_by_looks(node, graph) if self._camera is not None else []
        tied = {proposal.link.from_id for proposal in found}
        if node.scan is not None:
            found += [proposal for proposal in self._near_by_scans(node, graph) if proposal.link.from_id not in tied]
        return found

    def _near_by_looks(self, node: Signature, graph: MapGraph) -> list[Proposal]:
        rgbd, memory = self._parameters.rgbd, self._memory
        held = (memory.signature(node_id) for node_id in memory.short_term if node_id != node.id)
        poses, tied = graph.part(memory.held)
        matches = [
            *visual_proximity_in_time(node, tied, [old for old in held if old is not None], self._register, rgbd),
            *visual_proximity(
                node, poses, tied, memory.signature, self._register, rgbd,
                among=memory.working, last_closure=memory.last_closure,
            ),
        ]  # fmt: skip
        found = (self._proposal(match.near_id, node, match.kind, match.registration) for match in matches)
        return [proposal for proposal in found if proposal is not None]

    def _near_by_scans(self, node: Signature, graph: MapGraph) -> list[Proposal]:
        memory = self._memory
        matches = self._scan_proximity.links(
            node.id, graph, self._scan_of, among=memory.working, held=memory.held, last_closure=memory.last_closure,
            localising=self._localising,
        )  # fmt: skip
        found = (
            self._proposal(match.near_id, node, match.kind, match.registration, by_scans=True) for match in matches
        )
        return [*self._joined_by_scans(node, graph), *(proposal for proposal in found if proposal is not None)]

    def _joined_by_scans(self, node: Signature, graph: MapGraph) -> list[Proposal]:
        """Return the closure with an older map that nothing ties this one to yet, where scans are all there is."""
        joining = self._joining.closure(node.id, graph, self._memory.working) if self._camera is None else None
        if joining is None:
            return []
        proposal = self._proposal(
            joining.old_id, node, LinkKind.LOCAL_SPACE_CLOSURE, joining.registration, by_scans=True
        )
        return [] if proposal is None else [proposal]

    def _scan_of(self, node_id: int) -> NodeScan | None:
        held = self._memory.signature(node_id)
        return None if held is None else held.scan

    def _by_scans_too(self, found: Registration, old: Signature | None, new: Signature) -> Registration:
        """Return what looks tell as scans correct it, where Reg/Strategy asks for that."""
        if self._parameters.reg.strategy == 0 or old is None:
            return found
        return refined_by_scans(found, old.scan, new.scan, self._scan_settings)

    def in_the_end(self, graph: MapGraph, node_ids: Sequence[int]) -> list[Proposal]:
        """Return closures of nodes with others near them in the finished map that no link ties to them yet."""
        found = []
        for old_id, node_id in pairs_near(graph, node_ids) if self._camera is not None else ():
            old, node = self._memory.recall(old_id), self._memory.recall(node_id)
            guess = se3.inverse(graph.T_map_base[old_id]) @ graph.T_map_base[node_id]
            registration = self._by_scans_too(self._register(old, node, guess), old, node)
            found.append(self._proposal(old_id, node, LinkKind.LOCAL_SPACE_CLOSURE, registration))
        return [proposal for proposal in found if proposal is not None]

    def refined(self, link: Link, old: Signature, new: Signature) -> Link:
        """Return a link between neighbours, measured anew if RGBD/NeighborLinkRefining asks for it and it can be.

        What odometry matched itself is not matched again, but scans measure where wheels carried visual odometry on.
        """
        rgbd, scans, odometry = self._parameters.rgbd, (old.scan, new.scan), self._parameters.slamcli.odometry
        if not rgbd.neighbor_link_refining or odometry not in ("recording", "guided"):
            return link
        covariance = np.asarray(np.linalg.inv(link.information), dtype=np.float64)
        if odometry == "guided" and (self._parameters.reg.strategy == 0 or np.diag(covariance).max() < _UNSURE**2):
            return link
        if self._parameters.reg.strategy > 0:
            motion, spread = refined_motion(scans, link.T_from_to, covariance, self._scan_settings)
            return replace(link, T_from_to=motion, information=information_of(spread))
        found = refused("no camera") if self._camera is None else self._register(old, new, link.T_from_to)
        if found.T_a_b is None:
            return link
        return replace(link, T_from_to=found.T_a_b, information=information_of(found.covariance))

    def _register(self, old: Signature, new: Signature, guess: Floats | None) -> Registration:
        if self._camera is None:
            raise ValueError("places without cameras are not compared by features")
        return register_visual(old, new, self._camera, self.T_base_camera, self._settings, seed=self._seed, guess=guess)

    def _proposal(
        self,
        old_id: int,
        node: Signature,
        kind: LinkKind,
        found: Registration,
        posterior: float = 0.0,
        *,
        by_scans: bool = False,
    ) -> Proposal | None:
        """Return a closure that can be proposed; what failed is noted."""
        if found.T_a_b is None:
            self.records.append(closure_record((old_id, node.id, kind), node.stamp_ns, found, posterior=posterior))
            if kind == LinkKind.GLOBAL_CLOSURE:
                self.sights.offer(self._memory.signature(old_id), node, kind, found, found.reason)
            return None
        return Proposal(
            link=closure_link(old_id, node.id, kind, found),
            stamp_ns=node.stamp_ns,
            registration=found,
            posterior=posterior,
            by_scans=by_scans,
        )


def _by_marker(link: Link, stamp_ns: int) -> Proposal:
    """Return a closure by a marker that other nodes saw too."""
    covariance = np.asarray(np.linalg.inv(link.information), dtype=np.float64)
    seen = Registration(T_a_b=link.T_from_to, covariance=covariance, matches=np.zeros((0, 2), dtype=np.int64))
    return Proposal(link=link, stamp_ns=stamp_ns, registration=seen)


def information_of(covariance: Floats) -> Floats:
    """Return the inverse of a covariance (6, 6) of a motion; what is known better than 0.1 mm and 0.01 degree is not."""
    floor = np.diag([1e-8, 1e-8, 1e-8, 3e-8, 3e-8, 3e-8])
    information = np.asarray(np.linalg.inv(covariance + floor), dtype=np.float64)
    return 0.5 * (information + information.T)
