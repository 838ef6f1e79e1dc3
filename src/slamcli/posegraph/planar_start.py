# SPDX-License-Identifier: MIT
"""Where the adjustment of a planar graph begins when dead reckoning is far off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph.levenberg_marquardt import minimise
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges, checked, held_poses, rows, terms_of

Floats = NDArray[np.float64]
ITERATIONS = 10  # of each of the two problems; without a robust loss both are linear and one is enough


def start_planar(
    poses: Floats,
    fixed: NDArray[np.bool_],
    edges: PlanarEdges,
    *,
    loss: Loss,
    more: Sequence[tuple[PlanarEdges, Loss]] = (),
) -> Floats:
    """Return poses (P, 3) near the minimum of :func:`~slamcli.posegraph.planar.optimise_planar`, whose input this takes.

    First the headings are adjusted alone, then the positions under these headings. Both are linear apart from the loss, so
    that a loop of any length closes as long as headings are off by less than half a turn; descending from dead reckoning
    may end in another minimum, or take hundreds of iterations, once headings are off by about one radian.

    References
    ----------
    .. [1] L. Carlone, R. Aragues, J. Castellanos, B. Bona: A fast and accurate approximation for planar pose graph
       optimization, IJRR 2014, doi:10.1177/0278364914523689.
    """
    groups = [(edges, loss), *more]
    poses = checked(poses, [group for group, _ in groups])
    held = held_poses(np.asarray(fixed, np.bool_), [rows(group) for group, _ in groups])
    for part in (np.array([False, False, True]), np.array([True, True, False])):
        terms = [terms_of(_only(group, part), of) for group, of in groups]
        poses = minimise(poses, terms, held[:, None] | ~part, np.add, ITERATIONS, 1e-6).state
    return poses


def _only(edges: PlanarEdges, part: NDArray[np.bool_]) -> PlanarEdges:
    """Return the edges without what they say about the other part."""
    if edges.information is not None:
        return replace(edges, information=edges.information * (part[:, None] & part))
    zero = np.zeros(len(edges))
    return replace(edges, rotation_weight=zero) if part[0] else replace(edges, translation_weight=zero)
