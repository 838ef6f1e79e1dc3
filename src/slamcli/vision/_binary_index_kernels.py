# SPDX-License-Identifier: MIT
"""Compiled loops over an index of 256 bit descriptors; see `slamcli.vision.binary_index`.

Descriptors are uint64 (N, 4). Multiplications of uint64 wrap around on purpose.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FAR = 257
"""More than any Hamming distance of 256 bits."""
TABLES = 16
"""Parts of a descriptor, of 16 bits each; every part has a table."""
BUCKETS = 65536
ONES = np.uint64(0x5555555555555555)
TWOS = np.uint64(0x3333333333333333)
FOURS = np.uint64(0x0F0F0F0F0F0F0F0F)
BYTES = np.uint64(0x0101010101010101)
PART = np.uint64(0xFFFF)
U1, U2, U4, U16, U56 = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(16), np.uint64(56)


@njit(cache=True, nogil=True, inline="always")
def _bits(x):
    """The number of bits set, in the form that compilers know and turn into one instruction."""
    x = x - ((x >> U1) & ONES)
    x = (x & TWOS) + ((x >> U2) & TWOS)
    return (((x + (x >> U4)) & FOURS) * BYTES) >> U56


@njit(cache=True, nogil=True, inline="always")
def _distance(a, b):
    return np.int64(_bits(a[0] ^ b[0]) + _bits(a[1] ^ b[1]) + _bits(a[2] ^ b[2]) + _bits(a[3] ^ b[3]))


@njit(cache=True, nogil=True, inline="always")
def _key(descriptor, table):
    """The bits of a descriptor that say its bucket in a table."""
    return np.int64((descriptor[table >> 2] >> np.uint64(16 * (table & 3))) & PART)


@njit(cache=True, nogil=True)
def build(descriptors, rows, starts, members, sketches):
    """Sort rows into the buckets of each table: bucket k of table t has the entries from starts[t, k] to starts[t, k + 1].

    An entry is a row and its sketch: 64 bits of the descriptor that are not among those that name the bucket.
    """
    for table in range(TABLES):
        ends = starts[table]
        ends[:] = 0
        for i in range(len(rows)):
            ends[_key(descriptors[rows[i]], table) + 1] += 1
        for bucket in range(BUCKETS):
            ends[bucket + 1] += ends[bucket]
        other = ((table >> 2) + 1) & 3
        for i in range(len(rows)):
            bucket = _key(descriptors[rows[i]], table)
            place = ends[bucket]
            members[table, place] = rows[i]
            sketches[table, place] = descriptors[rows[i], other]
            ends[bucket] += 1
        for bucket in range(BUCKETS, 0, -1):  # filling moved each start to the next one
            ends[bucket] = ends[bucket - 1]
        ends[0] = 0


@njit(cache=True, nogil=True, inline="always")
def _offer(row, d, nearest, distances):
    """Take a row among the two nearest if it is nearer, or as near and of a lower row; a row is taken once."""
    if d > distances[1] or (d == distances[1] and row >= nearest[1]) or row == nearest[0]:
        return
    if d < distances[0] or (d == distances[0] and row < nearest[0]):
        distances[1], nearest[1] = distances[0], nearest[0]
        distances[0], nearest[0] = d, row
    else:
        distances[1], nearest[1] = d, row


@njit(cache=True, nogil=True)
def search_all(queries, descriptors, rows, nearest, distances):
    """Compare queries with each of some rows; better ones replace those in `nearest` and `distances`."""
    for i in range(len(queries)):
        for j in range(len(rows)):
            d = _distance(queries[i], descriptors[rows[j]])
            if d <= distances[i, 1]:
                _offer(rows[j], d, nearest[i], distances[i])


@njit(cache=True, nogil=True)
def search(queries, descriptors, alive, starts, members, sketches, limits, enough, nearest, distances):
    """Look into the buckets that differ from a query in no bit, then in bit 0, then in bit 1 and so on.

    `limits` says, for the distance to beat, how far a sketch may be off for the row to be looked at; `enough`, for the number of
    rounds done, up to which distance of the second nearest the search ends.
    """
    for i in range(len(queries)):
        query, near, far = queries[i], nearest[i], distances[i]
        limit = np.uint64(limits[far[1]])
        for round_ in range(17):
            if far[1] <= enough[round_]:
                break
            flip = 0 if round_ == 0 else 1 << (round_ - 1)
            for table in range(TABLES):
                bucket = _key(query, table) ^ flip
                part = query[((table >> 2) + 1) & 3]
                for place in range(np.int64(starts[table, bucket]), np.int64(starts[table, bucket + 1])):
                    if _bits(sketches[table, place] ^ part) > limit:
                        continue
                    row = np.int64(members[table, place])
                    d = _distance(query, descriptors[row])
                    if d <= far[1] and alive[row]:
                        _offer(row, d, near, far)
                        limit = np.uint64(limits[far[1]])
