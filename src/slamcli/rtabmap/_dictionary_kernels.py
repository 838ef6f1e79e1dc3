# SPDX-License-Identifier: MIT
"""Compiled loops of the visual dictionary; see `slamcli.rtabmap.dictionary`."""

from __future__ import annotations

import numpy as np
from numba import njit

ONES = np.uint64(0x5555555555555555)
TWOS = np.uint64(0x3333333333333333)
FOURS = np.uint64(0x0F0F0F0F0F0F0F0F)
BYTES = np.uint64(0x0101010101010101)
U1, U2, U4, U56 = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(56)


@njit(cache=True, nogil=True, inline="always")
def _bits(x):
    """The number of bits set, in the form that compilers know and turn into one instruction."""
    x = x - ((x >> U1) & ONES)
    x = (x & TWOS) + ((x >> U2) & TWOS)
    return (((x + (x >> U4)) & FOURS) * BYTES) >> U56


@njit(cache=True, nogil=True, inline="always")
def _distance(a, b):
    return np.int64(_bits(a[0] ^ b[0]) + _bits(a[1] ^ b[1]) + _bits(a[2] ^ b[2]) + _bits(a[3] ^ b[3]))


@njit(cache=True, nogil=True)
def assign(queries, rows, distances, ratio, together, chosen, new):
    """Give each descriptor, in their order, the word that is much nearer than any other, or make it a new one.

    `chosen` becomes the row of a word, or -1 - k for the k-th new word, whose descriptor is `queries[new[k]]`. Returns the number
    of new words.
    """
    count = 0
    for i in range(len(queries)):
        best, near, far = rows[i, 0], distances[i, 0], distances[i, 1]
        known = np.int64(rows[i, 0] >= 0) + np.int64(rows[i, 1] >= 0)
        if together:
            for k in range(count):
                d = _distance(queries[i], queries[new[k]])
                known += 1
                if d < near:
                    far, near, best = near, d, -1 - k
                elif d < far:
                    far = d
        if known < 2 or near > ratio * far:
            new[count] = i
            best = -1 - count
            count += 1
        chosen[i] = best
    return count
