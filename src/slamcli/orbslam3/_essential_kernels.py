# SPDX-License-Identifier: MIT
"""Compiled covisibility of all keyframes; see `slamcli.orbslam3.essential_graph`."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def shared_points(seen, num_keyframes, num_points):
    """Return int64 (K, K), 0 on the diagonal: how many points keyframes a and b both see; `seen` (K, F) is -1 for none.

    Keyframes of a point stand in a list of their own; a point that a keyframe sees twice counts once.
    """
    starts = np.zeros(num_points + 1, np.int64)
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            if seen[k, i] >= 0:
                starts[seen[k, i] + 1] += 1
    for p in range(num_points):
        starts[p + 1] += starts[p]
    filled = starts[:-1].copy()
    keyframes = np.empty(starts[num_points], np.int64)
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0 and (filled[p] == starts[p] or keyframes[filled[p] - 1] != k):
                keyframes[filled[p]] = k
                filled[p] += 1
    shared = np.zeros((num_keyframes, num_keyframes), np.int64)
    for p in range(num_points):
        for a in range(starts[p], filled[p]):
            for b in range(a + 1, filled[p]):
                shared[keyframes[a], keyframes[b]] += 1
                shared[keyframes[b], keyframes[a]] += 1
    return shared
