# SPDX-License-Identifier: MIT
"""What the robot remembers: short-term memory, working memory, and what it reads back from long-term memory.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III.
M. Labbé, F. Michaud, Journal of Field Robotics 36(2), 2019, doi:10.1002/rob.21831, section 3.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.rtabmap.bayes_filter import BayesFilter, Posterior
from slamcli.rtabmap.dictionary import Dictionary, DictionarySettings
from slamcli.rtabmap.held_places import HeldPlaces
from slamcli.rtabmap.likelihood import adjusted, similarity, word_bag
from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.memory_records import Added, Likelihood, MemorySizes
from slamcli.rtabmap.memory_store import LongTermStore
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.place_links import place_links
from slamcli.rtabmap.rehearsal import Rehearsal, reduced_to, rehearse
from slamcli.rtabmap.retrieval import around, local_nodes
from slamcli.rtabmap.signature import Signature
from slamcli.rtabmap.transfer import nodes_to_transfer
from slamcli.rtabmap.update_cost import UpdateWork, modelled_ms
from slamcli.vision.features import Features

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]


class Memory:
    """Signatures of the nodes at hand, their words and weights.

    One update is: `words_of` the image; `add` the node (or `rehearse` it if the robot stands); `likelihood` and `posterior`;
    `retrieve`; `closed` for each accepted closure; `transfer`. Links are the graph's: it must have the new node, and its link to
    the node before, when `add` is called, and hears of merged nodes from the caller.

    Parameters
    ----------
    parameters
        ``Rtabmap``, ``Mem``, ``Kp``, ``RGBD`` and ``Bayes``.
    store
        Where nodes and words were written before they may be transferred; None: there is no long-term memory, and nothing is.
    """

    def __init__(self, parameters: RtabmapParameters, store: LongTermStore | None = None) -> None:
        self._rtabmap, self._mem, self._kp, self._rgbd = (
            parameters.rtabmap,
            parameters.mem,
            parameters.kp,
            parameters.rgbd,
        )
        self._store = store
        self.dictionary = Dictionary(
            DictionarySettings(
                incremental=parameters.kp.incremental_dictionary, nndr_ratio=parameters.kp.nndr_ratio,
                new_words_compared_together=parameters.kp.new_words_compared_together, exact=parameters.kp.nn_strategy in (0, 3),
            )
        )  # fmt: skip
        self._reach = len(parameters.bayes.prediction) - 1
        self._filter = BayesFilter(parameters.bayes.prediction, parameters.bayes.virtual_place_prior_thr)
        self._held = HeldPlaces(self.dictionary)
        self._short_term: list[int] = []
        self._working: dict[int, int] = {}
        self._immune: set[int] = set()
        self._num_added = 0
        self._uses = 0
        self._num_known = 0
        self.last_closure = 0
        """Newest node of the last accepted closure; 0: none yet, or it is no longer in memory."""

    @property
    def bounded(self) -> bool:
        """Whether nodes go to long-term memory when there are too many or an update takes too long."""
        return self._store is not None and (self._rtabmap.memory_thr > 0 or self._rtabmap.time_thr > 0.0)

    @property
    def short_term(self) -> list[int]:
        """Ids in short-term memory, oldest first."""
        return list(self._short_term)

    @property
    def working(self) -> list[int]:
        """Ids in working memory, increasing."""
        return sorted(self._working)

    def sizes(self) -> MemorySizes:
        """Return how many nodes and words there are."""
        return MemorySizes(
            short_term=len(self._short_term), working=len(self._working), words=len(self.dictionary),
            long_term=self._num_known - len(self._held.signatures),
        )  # fmt: skip

    def signature(self, node_id: int) -> Signature | None:
        """Return a node of short-term or working memory; None for others."""
        return self._held.signatures.get(node_id)

    def recall(self, node_id: int) -> Signature:
        """Return a node, read from long-term memory if it is there; memory does not change.

        Raises
        ------
        DataError
            If there is no such node.
        """
        found = self._held.signatures.get(node_id)
        if found is not None:
            return found
        if self._store is None:
            raise DataError(f"node {node_id} is not in memory, and there is no database")
        return self._store.read_signature(node_id)

    def weight(self, node_id: int) -> int:
        """Return how often a place was seen again; -1 for an intermediate node."""
        return self._held.weights.get(node_id, 0)

    def take_changed_weights(self) -> list[tuple[int, int]]:
        """Return nodes whose weights changed since the last call, with the weights."""
        return self._held.take_changed_weights()

    # --- a new image -----------------------------------------------------------------------------------------------

    def words_of(self, features: Features) -> Ids:
        """Begin an update: return the word of each key point, int64 (N,), 0 for those that are not quantised.

        The first `Kp/MaxFeatures` are, unless they are so few that the image is bad (`Kp/BadSignRatio`): then none.
        """
        self._immune, self._num_added = set(), 0
        self.dictionary.drop_unused()
        words, most = np.zeros(len(features), np.int64), self._kp.max_features
        count = len(features) if most == 0 else max(0, min(most, len(features)))
        if count == 0 or count < self._kp.bad_sign_ratio * self._usual_words():
            return words
        words[:count] = self.dictionary.quantise(np.ascontiguousarray(features.descriptors[:count]))
        return words

    def _usual_words(self) -> float:
        """What a good image has: `Kp/MaxFeatures`, or the mean of the nodes in memory where that is not bounded."""
        if self._kp.max_features > 0:
            return float(self._kp.max_features)
        return sum(bag.total for bag in self._held.bags.values()) / max(1, len(self._held.bags))

    def is_bad(self, signature: Signature) -> bool:
        """Return whether a node has no words: it is no place that could be known again."""
        return not (signature.word_ids > 0).any()

    # --- rehearsal -------------------------------------------------------------------------------------------------

    def rehearse(self, signature: Signature) -> bool:
        """Take what is seen while the robot stands; return whether it is the last place again, whose weight grows then."""
        last = self._last_place()
        if last is None or not self._mem.incremental_memory or self.is_bad(signature):
            return False
        if similarity(word_bag(signature.word_ids), self._held.bags[last]) < self._mem.rehearsal_similarity:
            return False
        self._held.set_weight(last, self._held.weights[last] + 1)
        return True

    def add(self, signature: Signature, graph: MapGraph, *, moved: bool = True, intermediate: bool = False) -> Added:
        """Put a node into short-term memory, and compare it with the one before.

        Parameters
        ----------
        signature
            With the words of `words_of`.
        graph
            Has the node and its link to the one before.
        moved
            Whether the robot moved since the node before: a node that looks like it is then not merged, only the weight goes over.
        intermediate
            Whether it only ties others together (`Rtabmap/CreateIntermediateNodes`).

        Raises
        ------
        DataError
            If the node is there already.
        """
        if signature.id in self._held.signatures:
            raise DataError(f"memory: node {signature.id} is there already")
        last = self._last_place()
        self._remember(signature, weight=-1 if intermediate else 0)
        found = Rehearsal(similarity=0.0)
        if last is not None and not intermediate and self._mem.incremental_memory and not self.is_bad(signature):
            found = rehearse(
                self._held.bags[last], self._held.bags[signature.id], (self._held.weights[last], self._held.weights[signature.id]),
                threshold=self._mem.rehearsal_similarity, moved=moved, linked=graph.are_linked(last, signature.id),
                to_new=self._mem.rehearsal_id_updated_to_new_one,
                ignored_while_moving=self._mem.rehearsal_weight_ignored_while_moving,
            )  # fmt: skip
        kept, merged = signature.id, None
        if last is not None and found.weights is not None:
            self._held.set_weight(last, found.weights[0])
            self._held.set_weight(signature.id, found.weights[1])
        if last is not None and found.merged:
            kept, merged = self._merge(last, signature)
        return Added(kept_id=kept, merged_id=merged, similarity=found.similarity, reduced=self._age(graph))

    def _remember(self, signature: Signature, *, weight: int) -> None:
        self._held.take(signature, weight=weight)
        self._short_term.append(signature.id)
        self._num_added += 1
        self._num_known += 1

    def _last_place(self) -> int | None:
        """The newest node of short-term memory that is not an intermediate one."""
        return next((node for node in reversed(self._short_term) if self._held.weights[node] >= 0), None)

    def _merge(self, last: int, signature: Signature) -> tuple[int, int]:
        """Make one node of the last and the new one: what the last one saw, under the number of one of them."""
        if not self._mem.rehearsal_id_updated_to_new_one:
            self.forget(signature.id)
            return last, signature.id
        seen = self._held.signatures[last]
        weight = self._held.weights[signature.id]
        self.forget(signature.id)
        self.forget(last)
        self._remember(replace(seen, id=signature.id, stamp_ns=signature.stamp_ns), weight=weight)
        self.last_closure = signature.id if self.last_closure == last else self.last_closure
        return signature.id, last

    def _age(self, graph: MapGraph) -> tuple[tuple[int, int], ...]:
        """Move what is too much for short-term memory into working memory."""
        reduced: list[tuple[int, int]] = []
        while sum(self._held.weights[node] >= 0 for node in self._short_term) > self._mem.stm_size:
            oldest = self._short_term[0]
            held_by = reduced_to(oldest, graph) if self._mem.reduce_graph else None
            if held_by is not None and held_by in self._held.signatures:
                if self.last_closure == oldest:
                    self.last_closure = held_by
                self.forget(oldest)
                reduced.append((oldest, held_by))
            else:
                self._short_term.pop(0)
                self._use(oldest)
        return tuple(reduced)

    def begin_session(self) -> None:
        """Move all of short-term memory into working memory: what comes next is another session, which may be elsewhere."""
        for node in self._short_term:
            self._use(node)
        self._short_term = []

    def forget(self, node_id: int) -> None:
        """Take a node out of memory for good; the graph and the database are the caller's."""
        self._release(node_id)
        self._held.weights.pop(node_id, None)
        self._num_known -= 1

    # --- places known again ----------------------------------------------------------------------------------------

    def likelihood(self, signature: Signature) -> Likelihood | None:
        """Return how much the places in working memory look like a node in memory; None if it is bad or there are none."""
        ids = np.array([node for node in self.working if self._held.weights[node] >= 0], np.int64)
        if not len(ids) or self.is_bad(signature) or signature.id not in self._held.file:
            return None
        sums, common = self._held.file.scores(self._held.bags[signature.id], ids)
        scores = sums if self._kp.tf_idf_likelihood_used else common
        ratio = self._rtabmap.virtual_place_likelihood_ratio
        return Likelihood(ids=ids, scores=scores, values=adjusted(scores, ratio=ratio))

    def posterior(self, likelihood: Likelihood, graph: MapGraph) -> Posterior:
        """Return where the robot is again."""
        intermediate = frozenset(node for node in self._held.signatures if self._held.weights[node] < 0)
        links = place_links(self._held.signatures, graph.links_of, intermediate=intermediate)
        return self._filter.update(likelihood.ids, likelihood.values, links)

    def closed(self, a: int, b: int, *, by_scans: bool = False) -> None:
        """Note that a closure ties two nodes: one takes over the other's weight, the newer, or with `Mem/ReduceGraph` the older.

        Closures by scans (proximity, one to many) say nothing about what is seen, and change nothing.
        """
        if (
            by_scans
            or not self._mem.incremental_memory
            or a not in self._held.signatures
            or b not in self._held.signatures
        ):
            return
        old, new = sorted((a, b))
        self.last_closure = new
        taking, giving = (old, new) if self._mem.reduce_graph else (new, old)
        if self._held.weights[taking] >= 0 and self._held.weights[giving] >= 0:
            self._held.set_weight(taking, self._held.weights[taking] + self._held.weights[giving])
            self._held.set_weight(giving, 0)

    # --- long-term memory ------------------------------------------------------------------------------------------

    def retrieve(self, hypothesis: int, graph: MapGraph, *, here: int | None = None) -> list[int]:
        """Bring nodes back from long-term memory, and return them: around a hypothesis (0: none), and near the robot.

        Those around the hypothesis, near the robot, or brought back now are not transferred in this update.

        Parameters
        ----------
        here
            The newest node, with its pose in the graph.
        """
        if self._store is None or (not self.bounded and self._num_known == len(self._held.signatures)):
            return []
        wanted: list[int] = []
        most = self._rtabmap.max_retrieved
        if here is not None and here in graph.nodes:
            wanted = self._near(here, graph)
            most += len(wanted)
        if hypothesis in graph.nodes:
            search = partial(
                around, graph, hypothesis, self._reach, held=self._held.signatures.__contains__,
                most_outside=self._rtabmap.max_retrieved,
            )  # fmt: skip
            in_time = search(in_time=True)
            self._immune.update(node for node in in_time if node not in self._short_term)
            wanted += in_time + search(in_time=False)
        absent = [node for node in dict.fromkeys(wanted) if node not in self._held.signatures][:most]
        self._bring_back(absent)
        self._immune.update(absent)
        return absent

    def _near(self, here: int, graph: MapGraph) -> list[int]:
        """Make nodes near the robot immune, and return which to bring back beside them."""
        room = int(self._rgbd.local_immunization_ratio * len(self._working)) if self.bounded else 0
        local = local_nodes(
            graph, here, self._held.signatures, self._working, radius_m=self._rgbd.local_radius, most_immune=room,
            most_absent=self._rgbd.max_local_retrieved,
        )  # fmt: skip
        self._immune.update(local.immune)
        for node in reversed(local.near):  # the nearest was used last
            self._use(node)
        return local.absent

    def transfer(self, graph: MapGraph, *, keep: Iterable[int] = (), work: UpdateWork | None = None) -> list[int]:
        """Send nodes to long-term memory if there are too many or the update took too long, and return them.

        One more than the update added goes. Links to short-term memory, what is near or was brought back, and `keep` stay.

        Parameters
        ----------
        work
            What the update did: its modelled time is held against `Rtabmap/TimeThr`.
        """
        bound, limit_ms = self._rtabmap.memory_thr, self._rtabmap.time_thr
        late = work is not None and limit_ms > 0.0 and modelled_ms(work) > limit_ms
        if not self.bounded or not (late or 0 < bound < len(self._working)):
            return []
        tied = {other for node in self._short_term for other in graph.neighbours(node)}
        gone = nodes_to_transfer(
            self._working, self._held.weights, self._num_added + 1, kept={*self._immune, *keep, *tied},
            last_closure=self.last_closure, recent_ratio=self._mem.recent_wm_ratio,
            by_number=self._mem.transfer_sorting_by_weight_id,
        )  # fmt: skip
        for node in gone:
            self._release(node)
        return gone

    def restore(
        self,
        weights: Mapping[int, int],
        working: Collection[int],
        *,
        last_word: int = 0,
        known: Collection[int] | None = None,
    ) -> None:
        """Begin with the nodes of earlier sessions.

        Parameters
        ----------
        weights
            Of nodes that are in the graph.
        working
            Nodes that working memory begins with; with `Mem/InitWMWithAllNodes` all.
        last_word
            Highest number of a word that was given.
        known
            Nodes of the graph; None: those with a weight.
        """
        self._held.weights.update(weights)
        self._num_known = len(weights if known is None else known)
        self.dictionary.last_id = max(self.dictionary.last_id, last_word)
        self._bring_back(sorted(weights if self._mem.init_wm_with_all_nodes else working))
        self._num_added = 0

    def _bring_back(self, ids: Iterable[int]) -> None:
        """Read nodes into working memory."""
        for node in ids:
            if self._store is not None:
                self._held.read_back(node, self._store)
                self._num_added += 1
                self._use(node)

    def _release(self, node: int) -> None:
        self._held.release(node)
        self._working.pop(node, None)
        if node in self._short_term:
            self._short_term.remove(node)
        self.last_closure = 0 if self.last_closure == node else self.last_closure

    def _use(self, node: int) -> None:
        """Note that a node of working memory was used now."""
        self._uses += 1
        self._working[node] = self._uses
