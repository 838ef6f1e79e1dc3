# SPDX-License-Identifier: MIT
"""Compiled loops over a tree of binary words; see `slamcli.vision.vocabulary` and `slamcli.vision.vocabulary_training`.

Descriptors are rows of four uint64 (the 32 bytes of ORB's 256 bits). Bits are counted in parallel without a multiplication,
so that nothing overflows where the kernels run as plain Python.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_PAIRS = np.uint64(0x5555555555555555)
_FOURS = np.uint64(0x3333333333333333)
_EIGHTS = np.uint64(0x0F0F0F0F0F0F0F0F)
_SIXTEENS = np.uint64(0x00FF00FF00FF00FF)
_LOW = np.uint64(0xFFFF)
_ONE, _TWO, _FOUR, _EIGHT = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(8)
_HALF_WORD, _WORD = np.uint64(16), np.uint64(32)


@njit(cache=True, nogil=True)
def distance(a, i, b, j):
    """Return in how many bits row `i` of `a` and row `j` of `b` differ."""
    total = np.uint64(0)
    for word in range(4):
        bits = a[i, word] ^ b[j, word]
        bits = bits - ((bits >> _ONE) & _PAIRS)
        bits = (bits & _FOURS) + ((bits >> _TWO) & _FOURS)
        total = total + ((bits + (bits >> _FOUR)) & _EIGHTS)  # at most 32 in each byte
    total = (total & _SIXTEENS) + ((total >> _EIGHT) & _SIXTEENS)
    total = total + (total >> _HALF_WORD)
    total = total + (total >> _WORD)
    return np.int64(total & _LOW)


@njit(cache=True, nogil=True)
def descend(descriptors, nodes, first_child, level, leaves, at_level):
    """Write for each descriptor the leaf it comes to, and the node of `level` (or the leaf, if that is higher) it passes.

    The children of a node are those from its `first_child` up to the next node's. At each node the child with the least
    distance is next, the first of several. All descriptors go down together, level by level: so the memory of many is
    waited for at once.
    """
    leaves[:] = 0
    at_level[:] = 0
    depth, moving = 0, True
    while moving:
        moving = False
        depth += 1
        for i in range(len(descriptors)):
            first, end = first_child[leaves[i]], first_child[leaves[i] + 1]
            if first == end:
                continue
            best, least = first, distance(descriptors, i, nodes, first)
            for child in range(first + 1, end):
                bits = distance(descriptors, i, nodes, child)
                if bits < least:
                    best, least = child, bits
            leaves[i] = best
            if depth <= level:
                at_level[i] = best
            moving = True


@njit(cache=True, nogil=True)
def _seed(descriptors, rows, uniforms, centres):
    """Choose centres among the rows, each with a chance in proportion to its distance from those before; return how many."""
    n = len(rows)
    nearest = np.full(n, 257, np.int64)
    chosen = min(np.int64(uniforms[0] * n), n - 1)
    count = 0
    while True:
        for word in range(4):
            centres[count, word] = descriptors[rows[chosen], word]
        count += 1
        total = 0
        for i in range(n):
            nearest[i] = min(nearest[i], distance(descriptors, rows[i], centres, count - 1))
            total += nearest[i]
        if count == len(centres) or total == 0:
            return count
        mark, passed = uniforms[count] * total, 0
        for i in range(n):
            passed += nearest[i]
            if passed > mark:
                chosen = i
                break


@njit(cache=True, nogil=True)
def _assign(descriptors, rows, centres, count, labels):
    """Give each row the nearest centre, the first of several; return whether any changed."""
    changed = False
    for i in range(len(rows)):
        best, least = 0, 257
        for c in range(count):
            bits = distance(descriptors, rows[i], centres, c)
            if bits < least:
                best, least = c, bits
        if labels[i] != best:
            labels[i] = best
            changed = True
    return changed


@njit(cache=True, nogil=True)
def _vote(descriptors, rows, labels, count, centres):
    """Set each bit of a centre as the majority of its rows has it; a tie sets it. A centre without rows stays."""
    ones = np.zeros((count, 256), np.int64)
    sizes = np.zeros(count, np.int64)
    for i in range(len(rows)):
        label = labels[i]
        sizes[label] += 1
        for word in range(4):
            bits = descriptors[rows[i], word]
            for bit in range(64):
                ones[label, 64 * word + bit] += np.int64((bits >> np.uint64(bit)) & _ONE)
    for c in range(count):
        if sizes[c] == 0:
            continue
        for word in range(4):
            bits = np.uint64(0)
            for bit in range(64):
                if 2 * ones[c, 64 * word + bit] >= sizes[c]:
                    bits = bits | (_ONE << np.uint64(bit))
            centres[c, word] = bits


@njit(cache=True, nogil=True)
def cluster(descriptors, rows, uniforms, iterations, centres, labels):
    """Split rows into at most ``len(centres)`` clusters about majority centres; return how many centres there are.

    k-means in the Hamming metric: seeded as k-means++ does, then assignment and majority vote in turn until nothing
    changes or `iterations` are done. ``labels`` is the assignment to ``centres[:count]`` as they are returned.
    """
    labels[:] = -1
    count = _seed(descriptors, rows, uniforms, centres)
    changed = _assign(descriptors, rows, centres, count, labels)
    done = 0
    while changed and done < iterations:
        _vote(descriptors, rows, labels, count, centres)
        changed = _assign(descriptors, rows, centres, count, labels)
        done += 1
    return count
