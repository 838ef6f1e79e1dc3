# SPDX-License-Identifier: MIT
"""Which new closures stay: those that the rest of the graph can live with (Labbé and Michaud, JFR 2019, section 3.3.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import EstimationError
from slamcli.rtabmap.graph import OptimisedGraph
from slamcli.rtabmap.links import CLOSURES, Link, LinkKind
from slamcli.rtabmap.parameters import RgbdGroup
from slamcli.rtabmap.registration import Registration

Floats = NDArray[np.float64]
Optimise = Callable[[Sequence[Link]], OptimisedGraph]
"""From links to the graph where they agree best."""

ALONG = (LinkKind.NEIGHBOR, LinkKind.NEIGHBOR_MERGED)
MOST_REPAIRS = 10
"""Old closures that are dropped for one new one, at most."""
KIND_NAMES = {
    LinkKind.GLOBAL_CLOSURE: "loop", LinkKind.LOCAL_SPACE_CLOSURE: "near in space", LinkKind.LOCAL_TIME_CLOSURE: "near in time",
    LinkKind.USER_CLOSURE: "by hand", LinkKind.VIRTUAL_CLOSURE: "between sessions", LinkKind.LANDMARK: "landmark",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosureRecord:
    """A closure that was tried, for the report."""

    stamp_ns: int
    """Of the newer node."""
    from_id: int
    to_id: int
    kind: LinkKind
    accepted: bool
    reason: str
    """Why it was refused, a sentence; empty where it was accepted."""
    posterior: float = 0.0
    """Of the hypothesis; 0 for proximity."""
    num_matches: int = 0
    num_inliers: int = 0
    ratio: float = 0.0
    """Largest error of a link over its standard deviation with this closure in the graph; 0 where it did not come to that."""


def closure_record(
    link_or_ids: Link | tuple[int, int, LinkKind], stamp_ns: int, found: Registration, *, reason: str = "",
    posterior: float = 0.0, ratio: float = 0.0,
) -> ClosureRecord:  # fmt: skip
    """Return the record of a registration: refused if it gave no motion or there is a reason, accepted otherwise."""
    from_id, to_id, kind = (
        (link_or_ids.from_id, link_or_ids.to_id, link_or_ids.kind) if isinstance(link_or_ids, Link) else link_or_ids
    )
    why = found.reason if found.T_a_b is None else reason
    return ClosureRecord(
        stamp_ns=stamp_ns, from_id=from_id, to_id=to_id, kind=kind, accepted=not why, reason=why, posterior=posterior,
        num_matches=found.num_matches, num_inliers=found.num_inliers, ratio=ratio,
    )  # fmt: skip


def closure_link(from_id: int, to_id: int, kind: LinkKind, found: Registration) -> Link:
    """Return the link of a registration with a (`from_id`) and b (`to_id`).

    Raises
    ------
    EstimationError
        If the registration gave no motion.
    """
    if found.T_a_b is None:
        raise EstimationError(f"nodes {from_id} and {to_id} are not registered: {found.reason}")
    information = np.asarray(np.linalg.inv(found.covariance), np.float64)
    return Link(
        from_id=from_id, to_id=to_id, kind=kind, T_from_to=found.T_a_b,
        information=0.5 * (information + information.T),
    )  # fmt: skip


def least_variances(links: Sequence[Link]) -> Floats | None:
    """Return the least variance of odometry links by axis, float64 (6,), for ``RGBD/LoopCovLimited``; None without any."""
    matrices = [link.information for link in links if link.kind in ALONG]
    if not matrices:
        return None
    covariances = np.linalg.pinv(np.array(matrices), hermitian=True)
    least: Floats = np.diagonal(covariances, axis1=1, axis2=2).min(axis=0)
    return least


def limited(link: Link, least: Floats | None) -> Link:
    """Return a closure no more certain along any axis than `least` (6,)."""
    if least is None:
        return link
    covariance = np.linalg.pinv(link.information, hermitian=True)
    have = np.maximum(np.diagonal(covariance), 1e-18)
    scale = np.sqrt(np.maximum(least / have, 1.0))
    if np.all(scale == 1.0):
        return link
    return replace(link, information=np.linalg.inv(covariance * np.outer(scale, scale)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """What became of new closures."""

    graph: OptimisedGraph | None
    """With those that stay; None if none does: the graph is as it was."""
    accepted: tuple[Link, ...]
    refused: tuple[tuple[Link, str], ...]
    """With why, a sentence."""
    dropped: tuple[Link, ...] = ()
    """Old closures that are taken out, as they contradict the new ones (``RGBD/OptimizeMaxErrorRepairRadius``)."""
    ratio: float = 0.0
    """Of the graph with all new closures that were tried."""


class ClosureCheck:
    """Judges closures one update after the other; remembers which old one the last refused ones disagreed with."""

    def __init__(self, settings: RgbdGroup, *, robust: bool, localising: bool = False) -> None:
        self._settings, self._robust, self._localising = settings, robust, localising
        self._blamed: Link | None = None

    def judge(self, optimise: Optimise, links: Sequence[Link], new: Sequence[Link]) -> Verdict:
        """Return which of the new links stay in the graph.

        Parameters
        ----------
        optimise
            Optimises the graph with the links it is given.
        links
            Those of the graph.
        new
            Closures (and landmarks) of this update, as they were measured.

        Notes
        -----
        With one link over ``RGBD/OptimizeMaxError`` all new ones are refused, as in RTAB-Map: which of them is wrong cannot
        be told. With ``Optimizer/Robust`` the optimisation itself takes weight from the wrong ones.
        """
        near, far = self._by_distance(new)
        if self._settings.loop_cov_limited:
            least = least_variances(links)
            near = [limited(link, least) for link in near]
        if not near:
            return Verdict(graph=None, accepted=(), refused=tuple(far))
        verdict = self._strained(optimise, links, near)
        return replace(verdict, refused=(*far, *verdict.refused))

    def _by_distance(self, new: Sequence[Link]) -> tuple[list[Link], list[tuple[Link, str]]]:
        limit = self._settings.max_loop_closure_distance
        near: list[Link] = []
        far: list[tuple[Link, str]] = []
        for link in new:
            distance = float(np.linalg.norm(link.T_from_to[:3, 3]))
            if limit > 0 and distance > limit and link.kind in CLOSURES:
                far.append((link, f"it is {distance:.2f} m long, more than RGBD/MaxLoopClosureDistance {limit:g} m"))
            else:
                near.append(link)
        return near, far

    def _strained(self, optimise: Optimise, links: Sequence[Link], new: Sequence[Link]) -> Verdict:
        """Judge by how the graph would be strained."""
        limit = self._settings.optimize_max_error
        try:
            graph = optimise([*links, *new])
        except EstimationError as problem:
            return Verdict(graph=None, accepted=(), refused=tuple((link, str(problem)) for link in new))
        if self._robust:
            lost = [link for link in new if any(link is one for one in graph.outvoted)]
            why = "the other closures contradict it: the robust optimisation gave it no weight"
            return Verdict(
                graph=graph, accepted=tuple(link for link in new if not any(link is one for one in lost)),
                refused=tuple((link, why) for link in lost), ratio=graph.max_ratio,
            )  # fmt: skip
        if limit <= 0 or graph.max_ratio <= limit:
            self._blamed = None
            return Verdict(graph=graph, accepted=tuple(new), refused=(), ratio=graph.max_ratio)
        try:
            mended = self._repaired(optimise, links, new, graph) or self._without_proximity(optimise, links, new, graph)
        except EstimationError:
            mended = None
        if mended is not None:
            self._blamed = None
            return mended
        self._blamed = graph.worst if graph.worst is not None and _is_old_closure(graph.worst, links) else None
        return Verdict(
            graph=None, accepted=(), refused=tuple((link, self.sentence(graph)) for link in new), ratio=graph.max_ratio
        )

    def sentence(self, graph: OptimisedGraph) -> str:
        """Return why a graph is strained too much."""
        worst = graph.worst
        if worst is None:
            return "the graph has no links"
        name = "odometry" if worst.kind in ALONG else KIND_NAMES.get(worst.kind, worst.kind.name.lower())
        what = "rotation" if graph.worst_is_rotation else "translation"
        return (
            f"with it the {what} of the link between {worst.from_id} and {worst.to_id} ({name}) would be wrong by "
            f"{graph.max_ratio:.1f} standard deviations, more than RGBD/OptimizeMaxError {self._settings.optimize_max_error:g}"
        )

    def _without_proximity(
        self, optimise: Optimise, links: Sequence[Link], new: Sequence[Link], strained: OptimisedGraph
    ) -> Verdict | None:
        """Try again without proximity links, where a localisation was refused and something else is left."""
        if not (self._localising and self._settings.localization_second_try_without_proximity_links):
            return None
        kept = [link for link in new if link.kind not in (LinkKind.LOCAL_SPACE_CLOSURE, LinkKind.LOCAL_TIME_CLOSURE)]
        if not kept or len(kept) == len(new):
            return None
        graph = optimise([*links, *kept])
        if graph.max_ratio > self._settings.optimize_max_error:
            return None
        why = self.sentence(strained)
        refused = tuple((link, why) for link in new if not any(link is one for one in kept))
        return Verdict(graph=graph, accepted=tuple(kept), refused=refused, ratio=strained.max_ratio)

    def _repaired(
        self, optimise: Optimise, links: Sequence[Link], new: Sequence[Link], strained: OptimisedGraph
    ) -> Verdict | None:
        """Drop the old closure that was in the way twice in a row, and others around it while they are too.

        None where that is off, or does not help.
        """
        radius, limit = self._settings.optimize_max_error_repair_radius, self._settings.optimize_max_error
        first = strained.worst
        if radius <= 0 or first is None or first is not self._blamed or not _is_old_closure(first, links):
            return None
        dropped, graph, left = [first], strained, list(links)
        for _ in range(MOST_REPAIRS):
            left = [link for link in left if link is not dropped[-1]]
            graph = optimise([*left, *new])
            if graph.max_ratio <= limit:
                return Verdict(
                    graph=graph, accepted=tuple(new), refused=(), dropped=tuple(dropped), ratio=graph.max_ratio
                )
            worst = graph.worst
            if worst is None or not _is_old_closure(worst, left) or not _near(graph, worst, first, radius):
                return None
            dropped.append(worst)
        return None


def _near(graph: OptimisedGraph, a: Link, b: Link, radius_m: float) -> bool:
    """Whether two links begin within a radius of each other."""
    places = [graph.pose(link.from_id)[:3, 3] for link in (a, b)]
    return float(np.linalg.norm(places[0] - places[1])) <= radius_m


def _is_old_closure(link: Link, links: Sequence[Link]) -> bool:
    return link.kind in CLOSURES and any(link is one for one in links)
