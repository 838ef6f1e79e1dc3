# SPDX-License-Identifier: MIT
"""Which place the robot most likely sees again, and whether that is worth a closer look.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-E.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamcli.rtabmap.map_graph import MapGraph
from slamcli.rtabmap.memory import Memory
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import Signature, is_bad
from slamcli.vision.two_view_models import FUNDAMENTAL_LIMIT, fit_models


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """The likeliest place."""

    node: int = 0
    """0: there is none."""
    posterior: float = 0.0
    """Probability that the robot is at a known place, 0 to 1."""
    accepted: bool = False
    """Whether it is to be verified by registration."""
    reason: str = ""
    """Why it is not."""


class LoopDetector:
    """Looks for the place of each new node, and remembers how sure it was last."""

    def __init__(self, parameters: RtabmapParameters, memory: Memory, *, seed: int) -> None:
        self._rtabmap, self._rgbd, self._vhep = parameters.rtabmap, parameters.rgbd, parameters.vhep
        self._mem = parameters.mem
        self._memory, self._seed = memory, seed
        self._before = 0.0

    def hypothesis(self, signature: Signature, graph: MapGraph) -> Hypothesis:
        """Return the likeliest place of a node that was just added.

        A bad image says nothing: the posterior stays as it was.
        """
        likelihood = self._memory.likelihood(signature)
        if likelihood is None:
            return Hypothesis(reason="no words" if is_bad(signature) else "no places in working memory")
        node, posterior = self._memory.posterior(likelihood, graph).best
        reason = self._refusal(node, posterior, len(likelihood.ids), signature, graph)
        self._before = posterior
        return Hypothesis(node=node, posterior=posterior, accepted=not reason, reason=reason)

    def _refusal(self, node: int, posterior: float, count: int, signature: Signature, graph: MapGraph) -> str:
        """Why a hypothesis is not verified; empty if it is."""
        threshold, ratio = self._rtabmap.loop_thr, self._rtabmap.loop_ratio
        if posterior < threshold or count < 2:
            threshold = self._eager(node, count, signature, graph)
        if posterior < threshold:
            return f"posterior {posterior:.3f} below {threshold:g}"
        if count < 2 and threshold > 0.0:
            return "the only place in working memory"
        if self._vhep.enabled and not self._fits(signature, self._memory.signature(node)):
            return "epipolar geometry"
        if ratio > 0.0 and (self._before == 0.0 or posterior < ratio * self._before):
            return f"posterior {posterior:.3f} below {ratio:g} of the one before, {self._before:.3f}"
        return ""

    def _eager(self, node: int, count: int, signature: Signature, graph: MapGraph) -> float:
        """`Rtabmap/LoopThr`, or less while a session is not tied to the map of the hypothesis."""
        usual = self._rtabmap.loop_thr
        held = {*self._memory.short_term, *self._memory.working}
        if not self._rgbd.enabled or node in graph.component(signature.id, among=held):
            return usual
        waits = self._rtabmap.start_new_map_on_loop_closure or not self._mem.incremental_memory
        if waits and count <= self._mem.stm_size and not graph.neighbours(signature.id):
            return 0.0  # a map so small leaves no choice
        return min(self._rgbd.aggressive_loop_thr, usual)

    def _fits(self, a: Signature, b: Signature | None) -> bool:
        """Whether enough key points of words that each node shows once lie on each other's epipolar lines."""
        if b is None:
            return False
        rows_a, rows_b = (_shown_once(one) for one in (a, b))
        common = sorted(rows_a.keys() & rows_b.keys())
        least = max(8, self._vhep.match_count_min)
        if len(common) < least:
            return False
        pixels = [
            np.array([one.features.pixels[rows[word]] for word in common]) for one, rows in ((a, rows_a), (b, rows_b))
        ]
        # So many samples of eight that one is free of outliers with the confidence asked for, where half of the matches are right.
        iterations = math.ceil(math.log(1.0 - self._vhep.ransac_param_2) / math.log(1.0 - 0.5**8))
        sigma = self._vhep.ransac_param_1 / math.sqrt(FUNDAMENTAL_LIMIT)
        _, fundamental = fit_models(pixels[0], pixels[1], sigma_px=sigma, seed=self._seed, iterations=iterations)
        return int(fundamental.inliers.sum()) >= self._vhep.match_count_min


def _shown_once(signature: Signature) -> dict[int, int]:
    """The key point of each word that a node shows once."""
    words, first, counts = np.unique(signature.word_ids, return_index=True, return_counts=True)
    once = (counts == 1) & (words > 0)
    return dict(zip(words[once].tolist(), first[once].tolist(), strict=True))
