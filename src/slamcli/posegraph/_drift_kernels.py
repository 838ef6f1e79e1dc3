# SPDX-License-Identifier: MIT
"""Compiled search for the best known way between submaps; see `slamcli.posegraph.drift`."""

from __future__ import annotations

import numpy as np
from numba import njit

_ARM = 100.0
"""Squared lever arm in metres by which a variance of heading counts when ways are compared."""


@njit(cache=True, nogil=True)
def variances_from(source, starts, neighbours, distances, translations, rotations, out_translation, out_rotation):
    """Least variances of every submap seen from `source` over all ways through the graph (Dijkstra 1959).

    The graph is given by rows: the neighbours of i are at starts[i] to starts[i + 1]. Along a way the variance of heading
    adds up, and moves what lies ahead sideways.
    """
    count = len(out_translation)
    done = np.zeros(count, np.bool_)
    out_translation[:], out_rotation[:] = np.inf, np.inf
    out_translation[source], out_rotation[source] = 0.0, 0.0
    for _ in range(count):
        best, least = -1, np.inf
        for i in range(count):
            cost = out_translation[i] + _ARM * out_rotation[i]
            if not done[i] and cost < least:
                best, least = i, cost
        if best < 0:
            break
        done[best] = True
        for k in range(starts[best], starts[best + 1]):
            other = neighbours[k]
            translation = out_translation[best] + translations[k] + out_rotation[best] * distances[k] * distances[k]
            rotation = out_rotation[best] + rotations[k]
            if translation + _ARM * rotation < out_translation[other] + _ARM * out_rotation[other]:
                out_translation[other], out_rotation[other] = translation, rotation
