# SPDX-License-Identifier: MIT
"""Closures with nodes that are near, in space or in time, by what the camera saw."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.near_paths import near_paths, nearest_on_path
from slamcli.rtabmap.parameters import RgbdGroup
from slamcli.rtabmap.registration import Registration, refused
from slamcli.rtabmap.signature import Signature

Floats = NDArray[np.float64]
Register = Callable[[Signature, Signature, Floats | None], Registration]
"""From an old place a, the new one b and a guess of ``T_a_b`` to how b lies in a."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProximityMatch:
    """What came of comparing a node with one near it."""

    near_id: int
    kind: LinkKind
    registration: Registration
    """a: the node near by, b: the new one."""


def visual_proximity(
    node: Signature, T_map_base: Mapping[int, Floats], links: Sequence[Link], signature_of: Callable[[int], Signature | None],
    register: Register, settings: RgbdGroup, *, among: Collection[int], last_closure: int = 0,
) -> list[ProximityMatch]:  # fmt: skip
    """Return how a node compares with the nearest node of each path near by (``RGBD/ProximityBySpace``).

    Parameters
    ----------
    node
        The newest; its features are compared.
    T_map_base, links, among, last_closure
        As :func:`~slamcli.rtabmap.near_paths.near_paths` takes them.
    signature_of
        The place of an id, None where memory has it no more.
    register
        Compares two places.

    Notes
    -----
    Nodes that a link ties to this one already are not compared, nor are those farther than
    ``RGBD/ProximityPathFilteringRadius``; a motion longer than that is refused.
    """
    if not settings.proximity_by_space or not len(node.features):
        return []
    tied = _tied(links, node.id)
    matches: list[ProximityMatch] = []
    for path in near_paths(node.id, T_map_base, links, settings, among=among, last_closure=last_closure):
        if settings.proximity_max_paths and len(matches) >= settings.proximity_max_paths:
            break
        nearest = nearest_on_path(path, node.id, T_map_base, settings)
        old = None if nearest is None or nearest in tied else signature_of(nearest)
        if old is None or not len(old.features):
            continue
        guess = se3.inverse(T_map_base[old.id]) @ T_map_base[node.id] if settings.proximity_odom_guess else None
        found = _not_too_far(register(old, node, guess), settings.proximity_path_filtering_radius)
        matches.append(ProximityMatch(near_id=old.id, kind=LinkKind.LOCAL_SPACE_CLOSURE, registration=found))
    return matches


def visual_proximity_in_time(
    node: Signature, links: Sequence[Link], short_term: Sequence[Signature], register: Register, settings: RgbdGroup
) -> list[ProximityMatch]:
    """Return how a node compares with the nodes of short-term memory that no link ties to it (``RGBD/ProximityByTime``)."""
    if not settings.proximity_by_time or not len(node.features):
        return []
    tied = _tied(links, node.id) | {node.id}
    return [
        ProximityMatch(near_id=old.id, kind=LinkKind.LOCAL_TIME_CLOSURE, registration=register(old, node, None))
        for old in sorted(short_term, key=lambda signature: -signature.id)
        if old.id not in tied and len(old.features)
    ]


def _tied(links: Sequence[Link], node_id: int) -> set[int]:
    return {
        link.to_id if link.from_id == node_id else link.from_id
        for link in links
        if node_id in (link.from_id, link.to_id)
    }


def _not_too_far(found: Registration, limit_m: float) -> Registration:
    if found.T_a_b is None or limit_m <= 0:
        return found
    distance = float(np.linalg.norm(found.T_a_b[:3, 3]))
    if distance <= limit_m:
        return found
    return refused(
        f"the motion is {distance:.2f} m long, more than RGBD/ProximityPathFilteringRadius {limit_m:g} m",
        num_matches=found.num_matches, num_inliers=found.num_inliers,
    )  # fmt: skip
