# SPDX-License-Identifier: MIT
"""Compiled lists of who sees each point; see `slamcli.orbslam3.sightings`.

`seen` (K, F) holds the point that feature i of keyframe k sees, or -1. The cells (k, i) that see one point are linked:
`heads` (P,) is the first of them, `before` and `after` (K, F) are the neighbours of a cell, -1 for none, in no order.
A cell is written as one number, k times 2^20 plus i, so that cells sort by keyframe and feature.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SHIFT = 20
FEATURE = (1 << SHIFT) - 1


@njit(cache=True, nogil=True)
def _link(seen, before, after, heads, k, i, p):
    """Let a cell that sees nothing see point p."""
    cell, follower = (k << SHIFT) | i, heads[p]
    if follower >= 0:
        before[follower >> SHIFT, follower & FEATURE] = cell
    before[k, i] = -1
    after[k, i] = follower
    heads[p] = cell
    seen[k, i] = p


@njit(cache=True, nogil=True)
def _unlink(seen, before, after, heads, k, i):
    """Let a cell that sees a point see nothing."""
    leader, follower = before[k, i], after[k, i]
    if leader < 0:
        heads[seen[k, i]] = follower
    else:
        after[leader >> SHIFT, leader & FEATURE] = follower
    if follower >= 0:
        before[follower >> SHIFT, follower & FEATURE] = leader
    seen[k, i] = -1


@njit(cache=True, nogil=True)
def write(seen, before, after, heads, changed, keyframes, features, points):
    """Let cells (N,) see points (N,), -1 for none, one after another; `changed` (P,) tells of which points that is news."""
    for n in range(len(keyframes)):
        k, i, p = keyframes[n], features[n], points[n]
        if seen[k, i] == p:
            continue
        if seen[k, i] >= 0:
            changed[seen[k, i]] = True
            _unlink(seen, before, after, heads, k, i)
        if p >= 0:
            changed[p] = True
            _link(seen, before, after, heads, k, i, p)


@njit(cache=True, nogil=True)
def link_all(seen, num_keyframes, before, after, heads):
    """Make the lists of a table anew."""
    heads[:] = -1
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            if seen[k, i] >= 0:
                _link(seen, before, after, heads, k, i, seen[k, i])


@njit(cache=True, nogil=True)
def list_cells(after, heads, points):
    """Return the cells that see each of some points (R,), sorted, as rows: offsets (R + 1,), cells (M,)."""
    offsets = np.zeros(len(points) + 1, np.int64)
    for r in range(len(points)):
        n, cell = 0, heads[points[r]]
        while cell >= 0:
            n += 1
            cell = after[cell >> SHIFT, cell & FEATURE]
        offsets[r + 1] = offsets[r] + n
    cells = np.empty(offsets[len(points)], np.int64)
    for r in range(len(points)):
        # The newest cell stands first in the list: filled from the end, a row is nearly sorted.
        first, at, cell = offsets[r], offsets[r + 1], heads[points[r]]
        while cell >= 0:
            at -= 1
            cells[at] = cell
            cell = after[cell >> SHIFT, cell & FEATURE]
        for a in range(first + 1, offsets[r + 1]):
            cell, b = cells[a], a
            while b > first and cells[b - 1] > cell:
                cells[b] = cells[b - 1]
                b -= 1
            cells[b] = cell
    return offsets, cells


@njit(cache=True, nogil=True)
def count_cells(after, heads, right, points):
    """Return int64 (R,): how many cells see each of some points, twice where a right column (K, F) tells its depth (NaN: it does not)."""
    counts = np.zeros(len(points), np.int64)
    for r in range(len(points)):
        cell = heads[points[r]]
        while cell >= 0:
            k, i = cell >> SHIFT, cell & FEATURE
            counts[r] += 1 if math.isnan(right[k, i]) else 2
            cell = after[k, i]
    return counts


@njit(cache=True, nogil=True)
def count_shared(after, heads, points, num_keyframes):
    """Return int64 (K,): how many cells of each keyframe see one of some points, each given once."""
    counts = np.zeros(num_keyframes, np.int64)
    for r in range(len(points)):
        cell = heads[points[r]]
        while cell >= 0:
            counts[cell >> SHIFT] += 1
            cell = after[cell >> SHIFT, cell & FEATURE]
    return counts


@njit(cache=True, nogil=True)
def follow(replaced_by, alive, points):
    """Turn points (N,), -1 for none, into those that stand for them now; -1 where there is none."""
    for n in range(len(points)):
        p = points[n]
        if p < 0:
            continue
        while replaced_by[p] >= 0:
            p = replaced_by[p]
        points[n] = p if alive[p] else -1


@njit(cache=True, nogil=True)
def join(old, new, replaced_by, alive, visible, found):
    """Note that each new point (N,) takes over from the old one (N,), both as they stand now, and return which went.

    Pairs hold one after another; one with a point that is gone (-1) is left out.
    """
    gone, num_gone = np.empty(len(old), np.int64), 0
    for n in range(len(old)):
        p, q = old[n], new[n]
        if p < 0 or q < 0:
            continue
        while replaced_by[p] >= 0:
            p = replaced_by[p]
        while replaced_by[q] >= 0:
            q = replaced_by[q]
        if p == q:
            continue
        replaced_by[p] = q
        alive[p] = False
        visible[q] += visible[p]
        found[q] += found[p]
        gone[num_gone] = p
        num_gone += 1
    return gone[:num_gone]


@njit(cache=True, nogil=True)
def move(seen, before, after, heads, changed, cells, replaced_by):
    """Let cells (M,), sorted, see what stands for their points; a keyframe that sees that already keeps the cell it has."""
    for n in range(len(cells)):
        k, i = cells[n] >> SHIFT, cells[n] & FEATURE
        q = seen[k, i]
        changed[q] = True
        while replaced_by[q] >= 0:
            q = replaced_by[q]
        _unlink(seen, before, after, heads, k, i)
        other = heads[q]
        while other >= 0 and other >> SHIFT != k:
            other = after[other >> SHIFT, other & FEATURE]
        if other < 0:
            changed[q] = True
            _link(seen, before, after, heads, k, i, q)
