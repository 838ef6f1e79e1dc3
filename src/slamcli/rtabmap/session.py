# SPDX-License-Identifier: MIT
"""One update of the memory at a time (Labbé and Michaud, JFR 2019, section 3; T-RO 2013, section III)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.rtabmap.closing import Closing, Proposal, information_of
from slamcli.rtabmap.closure_check import Verdict
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.graph import OptimisedGraph
from slamcli.rtabmap.gravity import gravity_link
from slamcli.rtabmap.hypothesis import LoopDetector
from slamcli.rtabmap.keeping import Keeping
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.node_rate import flattened, has_moved
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature, is_bad
from slamcli.rtabmap.update_cost import update_work
from slamcli.rtabmap.update_record import UpdateRecord
from slamcli.runtime import RunLog

Floats = NDArray[np.float64]


class Session:
    """The memory, the graph and the database of one run, and what of them came before.

    Parameters
    ----------
    memory
        Short-term and working memory; empty or as the database had it.
    graph
        Of all nodes; empty or as the database had it.
    detector
        Tells which place a node shows again.
    closing
        Compares places.
    keeping
        The database.
    """

    def __init__(
        self,
        parameters: RtabmapParameters,
        *,
        memory: Memory,
        graph: MapGraph,
        detector: LoopDetector,
        closing: Closing,
        keeping: Keeping,
        log: RunLog,
    ) -> None:
        self.parameters = parameters
        self.memory, self.graph, self.closing, self.keeping = memory, graph, closing, keeping
        self.records: list[UpdateRecord] = []
        self._detector, self._log = detector, log
        self._previous: Signature | None = None
        self._measured: set[tuple[int, int]] = set()
        """Links between neighbours that registration measured, better than odometry."""
        self._first_id = max(graph.nodes, default=0) + 1
        self._next_id = self._first_id
        self._map_id = max((node.map_id for node in graph.nodes.values()), default=-1)

    @property
    def own_nodes(self) -> list[int]:
        """Ids of the nodes of this run, increasing."""
        return [node_id for node_id in self.graph.nodes if node_id >= self._first_id]

    @property
    def localising(self) -> bool:
        """Whether the map is fixed."""
        return not self.parameters.mem.incremental_memory

    def update(self, node: NodeInput) -> int | None:
        """Take what may become a node; return its id, or None if the robot has not moved since the last one."""
        signature = self._signature(node)
        if self._stands(signature, node):
            self.memory.rehearse(signature)
            return None
        if self._is_useless(signature):
            return None
        waits = self._waits()
        self._extend(signature, node)
        if not waits:
            self.keeping.add(signature, node)
        added = self.memory.add(signature, self.graph)
        for gone, kept in added.reduced:
            self._merge(gone, kept)
        hypothesis = self._detector.hypothesis(signature, self.graph)
        retrieved = self.memory.retrieve(hypothesis.node, self.graph, here=signature.id)
        landmarks, by_markers = self.closing.by_markers(signature, node.images, self.graph)
        for link in landmarks:
            self.graph.add_link(link)
        self.keeping.link([link for link in landmarks if link.kind == LinkKind.LANDMARK])
        proposals = [
            *by_markers,
            *self.closing.by_looks(signature, hypothesis, self.graph),
            *self.closing.by_place(signature, self.graph),
        ]
        accepted, optimised = self._close(signature.id, proposals)
        if waits and not accepted:
            self._take_back(signature.id)
            return None
        if waits:
            self.keeping.add(signature, node)
        work = update_work(
            signature, self.memory.sizes(), retrieved=len(retrieved), registrations=len(proposals), optimised=optimised
        )
        keep = [proposal.link.from_id for proposal in accepted]
        transferred = self.memory.transfer(self.graph, keep=keep, work=work)
        self._previous = signature
        by_looks = [proposal for proposal in accepted if proposal.link.kind == LinkKind.GLOBAL_CLOSURE]
        sizes = self.memory.sizes()
        self.records.append(
            UpdateRecord(
                stamp_ns=signature.stamp_ns, node=signature.id, map_id=signature.map_id, num_features=len(signature.features),
                hypothesis=hypothesis.node, posterior=hypothesis.posterior,
                loop_closure=by_looks[0].link.from_id if by_looks else 0,
                loop_inliers=by_looks[0].registration.num_inliers if by_looks else 0,
                proximity_closures=len(accepted) - len(by_looks), refused=len(proposals) - len(accepted),
                short_term=sizes.short_term, working=sizes.working, long_term=sizes.long_term, words=sizes.words,
                retrieved=len(retrieved), transferred=len(transferred), similarity=added.similarity, optimised=optimised,
            )
        )  # fmt: skip
        self.keeping.end_update(self.memory, self.records[-1])
        return signature.id

    def _waits(self) -> bool:
        """Return whether the next node is kept only if a closure ties it to a map (Rtabmap/StartNewMapOnLoopClosure)."""
        wanted = self.parameters.rtabmap.start_new_map_on_loop_closure and not self.localising
        return wanted and self._previous is None and bool(self.graph.nodes) and self.closing.sees

    def _take_back(self, node_id: int) -> None:
        """Forget a node that does not begin a map after all."""
        self.keeping.unlink(self.graph.links_of(node_id))
        self.memory.forget(node_id)
        for landmark in [other for other in self.graph.neighbours(node_id) if other < 0]:
            if self.graph.neighbours(landmark) == [node_id]:
                self.graph.remove_node(landmark)
        self.graph.remove_node(node_id)
        self._next_id -= 1

    def finish(self, track: FrameTrack) -> None:
        """Tie nodes by the odometry as it is known in the end, look once more for places, and optimise everything."""
        self._use_final_odometry(track)
        self._optimise_all()
        for _ in range(self.parameters.slamcli.final_searches):
            if not self._search_again():
                break
            self._optimise_all()

    def close(self, ids: Sequence[int], grid: OccupancyGrid | None) -> None:
        """Write what the next session begins with, with the poses of some nodes, and close the database."""
        self.keeping.finish(self.graph, self.memory, self.parameters, ids, grid)

    def _search_again(self) -> bool:
        """Return whether the finished map showed places that no closure tied yet."""
        proposals = self.closing.in_the_end(self.graph, self.own_nodes)
        if not proposals:
            return False
        ids = self._scope([end for one in proposals for end in (one.link.from_id, one.link.to_id)], everything=True)
        return bool(self._take(proposals, self.closing.sort_out(ids, self.graph, proposals)))

    def _merge(self, gone: int, kept: int) -> None:
        """Let one node stand for another that saw the same."""
        old = list(self.graph.links_of(gone))
        before = len(self.graph.links) - len(old)
        self.graph.merge(gone, kept)
        self.keeping.unlink(old)
        self.keeping.link(self.graph.links[before:])

    def _signature(self, node: NodeInput) -> Signature:
        if node.began_anew:
            self._map_id += 1
            self._previous = None
            self.memory.begin_session()
        T_odom_base = flattened(node.T_odom_base) if self.parameters.reg.force_3dof else node.T_odom_base
        return Signature(
            id=self._next_id, map_id=self._map_id, stamp_ns=node.stamp_ns, T_odom_base=T_odom_base,
            features=node.features, points=node.points, word_ids=self.memory.words_of(node.features), scan=node.scan,
        )  # fmt: skip

    def _stands(self, signature: Signature, node: NodeInput) -> bool:
        """Return whether the robot has not moved since the last node of this map."""
        if self._previous is None or node.began_anew:
            return False
        motion = se3.inverse(self._previous.T_odom_base) @ signature.T_odom_base
        limits = self.parameters.rgbd
        return not has_moved(motion, limits.linear_update, limits.angular_update)

    def _is_useless(self, signature: Signature) -> bool:
        """Return whether an image with too few words makes no node (Mem/BadSignaturesIgnored), or does not begin a map."""
        p = self.parameters
        begins = self._previous is None and p.rtabmap.start_new_map_on_good_signature
        return p.kp.max_features >= 0 and (p.mem.bad_signatures_ignored or begins) and is_bad(signature)

    def _extend(self, signature: Signature, node: NodeInput) -> None:
        """Put the node into the graph, tied to the one before it by odometry."""
        self._next_id += 1
        own = GraphNode(
            id=signature.id, map_id=signature.map_id, stamp_ns=signature.stamp_ns, T_odom_base=signature.T_odom_base
        )
        if self._previous is None:
            self.graph.add_node(own, signature.T_odom_base)
            self._level(node, signature.id)
            return
        motion = se3.inverse(self._previous.T_odom_base) @ signature.T_odom_base
        link = Link(
            from_id=self._previous.id, to_id=signature.id, kind=LinkKind.NEIGHBOR, T_from_to=motion,
            information=information_of(self._covariance(node)),
        )  # fmt: skip
        link = self.closing.refined(link, self._previous, signature)
        if not np.array_equal(link.T_from_to, motion):
            self._measured.add((link.from_id, link.to_id))
        self.graph.add_node(own, self.graph.T_map_base[self._previous.id] @ link.T_from_to)
        self.graph.add_link(link)
        self.keeping.link([link])
        self._level(node, signature.id)

    def _covariance(self, node: NodeInput) -> Floats:
        covariance = node.covariance
        return np.diag(np.diag(covariance)) if self.parameters.mem.cov_off_diag_ignored else covariance

    def _level(self, node: NodeInput, node_id: int) -> None:
        """Tell the graph which way is up at a node."""
        if node.R_level_base is not None:
            link = gravity_link(node_id, node.R_level_base)
            self.graph.add_link(link)
            self.keeping.link([link])

    def _close(self, node_id: int, proposals: Sequence[Proposal]) -> tuple[list[Proposal], int]:
        """Return the closures that the graph bears, and how many nodes the optimisation moved."""
        if not proposals:
            return [], 0
        ends = [node_id, *(end for one in proposals for end in (one.link.from_id, one.link.to_id))]
        ids = self._scope(ends)
        verdict = self.closing.judge(ids, self.graph, proposals)
        if verdict.graph is None and len(proposals) > 1:  # one wrong closure must not take the right ones along
            return self._one_by_one(node_id, proposals)
        accepted = self._take(proposals, verdict)
        return accepted, 0 if verdict.graph is None else verdict.graph.moved

    def _take(self, proposals: Sequence[Proposal], verdict: Verdict) -> list[Proposal]:
        """Put into the graph what a verdict accepts, and nodes where it has them; return the accepted closures."""
        self.graph.remove_links(verdict.dropped)
        self.keeping.unlink(verdict.dropped)
        for link in verdict.accepted:
            self.graph.add_link(link)
        self.keeping.link(verdict.accepted)
        self.closing.note(proposals, verdict)
        if verdict.graph is None:
            return []
        self._place(verdict.graph)
        taken = {(link.from_id, link.to_id) for link in verdict.accepted}
        accepted = [proposal for proposal in proposals if (proposal.link.from_id, proposal.link.to_id) in taken]
        for proposal in accepted:
            if proposal.link.kind != LinkKind.LANDMARK:
                self.memory.closed(proposal.link.from_id, proposal.link.to_id, by_scans=proposal.by_scans)
        return accepted

    def _one_by_one(self, node_id: int, proposals: Sequence[Proposal]) -> tuple[list[Proposal], int]:
        """Return which closures the graph bears if they are tried one after the other, the best seen first."""
        accepted, moved = [], 0
        for proposal in sorted(proposals, key=lambda one: -one.registration.num_inliers):
            taken, count = self._close(node_id, [proposal])
            accepted += taken
            moved = max(moved, count)
        return accepted, moved

    def _scope(self, ends: Sequence[int], *, everything: bool = False) -> list[int]:
        """Return which nodes an optimisation moves: those tied to some nodes by links, among what the memory holds."""
        bounded = self.memory.bounded and not everything
        held = {*(self.memory.held or ()), *ends} if bounded else None
        found: set[int] = set()
        for end in ends:
            if end not in found:
                found.update(self.graph.component(end, among=held))
        return sorted(found)

    def _optimise_all(self) -> None:
        """Optimise every map by itself."""
        waiting = set(self.graph.nodes)
        while waiting:
            ids = self.graph.component(min(waiting))
            if not set(ids) <= self.closing.fixed.ids:
                self._place(self.closing.optimise(ids, self.graph))
            waiting -= set(ids)

    def _place(self, optimised: OptimisedGraph) -> None:
        """Take over where nodes are; those of a fixed map stay, to the last bit."""
        fixed = self.closing.fixed.ids
        rows = [row for row, node_id in enumerate(optimised.ids) if node_id not in fixed]
        self.graph.place([optimised.ids[row] for row in rows], optimised.T_map_base[rows])

    def _use_final_odometry(self, track: FrameTrack) -> None:
        """Measure the links between neighbours anew by what odometry knows in the end."""
        if not track.refined:
            return
        better: list[tuple[Link, Link]] = []
        for link in self.graph.links:
            if (link.from_id, link.to_id) in self._measured:
                continue
            first, second = track.node_pose(link.from_id), track.node_pose(link.to_id)
            if link.kind in (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED) and first is not None and second is not None:
                better.append((link, replace(link, T_from_to=se3.inverse(first) @ second)))
        self.graph.replace_links(better)
        self.keeping.unlink([old for old, _ in better])
        self.keeping.link([new for _, new in better])
