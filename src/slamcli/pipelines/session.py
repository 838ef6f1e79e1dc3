# SPDX-License-Identifier: MIT
"""One update of the memory at a time (Labbé and Michaud, JFR 2019, section 3; T-RO 2013, section III)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.closing import Closing, Proposal
from slamcli.rtabmap.closure_check import ClosureRecord
from slamcli.rtabmap.frame_track import FrameTrack
from slamcli.rtabmap.keeping import Keeping
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.map_graph import GraphNode, MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.node_rate import flattened, has_moved
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature
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
    closing
        Finds places again.
    keeping
        The database.
    """

    def __init__(
        self,
        parameters: RtabmapParameters,
        *,
        memory: Memory,
        graph: MapGraph,
        closing: Closing,
        keeping: Keeping,
        log: RunLog,
    ) -> None:
        self.parameters = parameters
        self.memory, self.graph, self.closing, self.keeping = memory, graph, closing, keeping
        self.records: list[UpdateRecord] = []
        self.closures: list[ClosureRecord] = []
        self._log = log
        self._previous: Signature | None = None
        self._first_id = max(graph.nodes, default=0) + 1
        self._next_id = self._first_id
        self._map_id = max((node.map_id for node in graph.nodes.values()), default=-1)

    @property
    def own_nodes(self) -> list[int]:
        """Ids of the nodes of this run, increasing."""
        return [node_id for node_id in self.graph.nodes if node_id >= self._first_id]

    def update(self, node: NodeInput) -> int | None:
        """Take what may become a node; return its id, or None if the robot has not moved since the last one."""
        signature = self._signature(node)
        if self._stands(signature, node):
            self.memory.rehearse(signature)
            return None
        self._extend(signature, node)
        added = self.memory.add(signature)
        self.keeping.add(signature, node, self.graph)
        if added.merged_id is not None:
            self.graph.merge(added.merged_id, signature.id)
        hypothesis = self.closing.hypothesis(signature, self.graph)
        retrieved = self.memory.retrieve(hypothesis.node, self.graph)
        proposals = [
            *self.closing.by_looks(signature, hypothesis, self.graph),
            *self.closing.by_place(signature, self.graph),
        ]
        accepted, optimised = self._close(signature.id, proposals)
        transferred = self.memory.transfer(keep=[proposal.link.from_id for proposal in accepted], graph=self.graph)
        self.keeping.update(signature.id, self.graph, self.memory)
        by_looks = [proposal for proposal in accepted if proposal.link.kind == LinkKind.GLOBAL_CLOSURE]
        sizes = self.memory.sizes()
        self.records.append(
            UpdateRecord(
                stamp_ns=signature.stamp_ns, node=signature.id, map_id=signature.map_id, num_features=len(signature.features),
                hypothesis=hypothesis.node, posterior=hypothesis.posterior,
                loop_closure=by_looks[0].link.from_id if by_looks else 0,
                loop_inliers=by_looks[0].num_inliers if by_looks else 0,
                proximity_closures=len(accepted) - len(by_looks), refused=len(proposals) - len(accepted),
                short_term=sizes.short_term, working=sizes.working, long_term=sizes.long_term, words=sizes.words,
                retrieved=len(retrieved), transferred=len(transferred), rehearsed=added.merged_id or 0, optimised=optimised,
            )
        )  # fmt: skip
        self._previous = signature
        return signature.id

    def finish(self, track: FrameTrack) -> None:
        """Tie nodes by the odometry as it is known in the end, look once more for places, and optimise everything."""
        self._use_final_odometry(track)
        self._optimise_all()
        for proposals in self.closing.in_the_end(self.graph, self.memory):
            accepted, _ = self._close(proposals[0].link.to_id, proposals, everything=True)
            if accepted:
                self._optimise_all()
        self.keeping.finish(self.graph, self.memory, self.parameters)

    def _signature(self, node: NodeInput) -> Signature:
        if node.began_anew:
            self._map_id += 1
            self._previous = None
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

    def _extend(self, signature: Signature, node: NodeInput) -> None:
        """Put the node into the graph, tied to the one before it by odometry."""
        self._next_id += 1
        own = GraphNode(
            id=signature.id, map_id=signature.map_id, stamp_ns=signature.stamp_ns, T_odom_base=signature.T_odom_base
        )
        if self._previous is None:
            self.graph.add_node(own, signature.T_odom_base)
            return
        motion = se3.inverse(self._previous.T_odom_base) @ signature.T_odom_base
        link = Link(
            from_id=self._previous.id, to_id=signature.id, kind=LinkKind.NEIGHBOR, T_from_to=motion,
            information=information_of(node.covariance),
        )  # fmt: skip
        link = self.closing.refined(link, self._previous, signature)
        self.graph.add_node(own, self.graph.T_map_base[self._previous.id] @ link.T_from_to)
        self.graph.add_link(link)

    def _close(
        self, node_id: int, proposals: Sequence[Proposal], *, everything: bool = False
    ) -> tuple[list[Proposal], int]:
        """Return the closures that the graph bears, and how many nodes the optimisation moved."""
        if not proposals:
            return [], 0
        for proposal in proposals:
            self.graph.add_link(proposal.link)
        ids = self._scope(node_id, everything=everything)
        solution = self.closing.optimise(ids, self.graph)
        verdict = self.closing.judge(solution, proposals)
        if verdict.accepted:
            self.graph.place(ids, solution.T_map_base)
        self.closures += verdict.records
        self.graph.remove_links([proposal.link for proposal in verdict.refused])
        if verdict.refused and verdict.accepted:
            ids = self._scope(node_id, everything=everything)
            self.graph.place(ids, self.closing.optimise(ids, self.graph).T_map_base)
        elif verdict.refused and len(proposals) > 1:  # one wrong closure must not take the right ones along
            return self._one_by_one(node_id, proposals, everything=everything)
        return verdict.accepted, len(ids) if verdict.accepted else 0
