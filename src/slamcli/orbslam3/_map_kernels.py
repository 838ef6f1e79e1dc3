# SPDX-License-Identifier: MIT
"""Compiled loops over the table of observations; see `slamcli.orbslam3.sparse_map`.

`seen` (K, F) holds the point that feature i of keyframe k sees, or -1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

ONES = np.uint64(0x5555555555555555)
TWOS = np.uint64(0x3333333333333333)
FOURS = np.uint64(0x0F0F0F0F0F0F0F0F)
BYTES = np.uint64(0x00FF00FF00FF00FF)
LAST = np.uint64(0xFFFF)
U1, U2, U4, U8, U16, U32 = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(8), np.uint64(16), np.uint64(32)


@njit(cache=True, nogil=True)
def count_all_shared(offsets, keyframes, num_keyframes):
    """Return int64 (K, K): how many points each two keyframes share, from who sees each point (`SparseMap.observations`)."""
    shared = np.zeros((num_keyframes, num_keyframes), np.int64)
    for r in range(len(offsets) - 1):
        for a in range(offsets[r], offsets[r + 1]):
            for b in range(a + 1, offsets[r + 1]):
                shared[keyframes[a], keyframes[b]] += 1
                shared[keyframes[b], keyframes[a]] += 1
    return shared


@njit(cache=True, nogil=True)
def mark_seen(seen, keyframes, num_points):
    """Return bool (P,): which points any of the keyframes sees."""
    marked = np.zeros(num_points, np.bool_)
    for k in keyframes:
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0:
                marked[p] = True
    return marked


@njit(cache=True, nogil=True, inline="always")
def _bits(x):
    """The number of bits set in each byte of a word."""
    x = x - ((x >> U1) & ONES)
    x = (x & TWOS) + ((x >> U2) & TWOS)
    return (x + (x >> U4)) & FOURS


@njit(cache=True, nogil=True)
def _distance(a, b):
    """Return the Hamming distance of two descriptors, uint64 (4,)."""
    total = _bits(a[0] ^ b[0]) + _bits(a[1] ^ b[1]) + _bits(a[2] ^ b[2]) + _bits(a[3] ^ b[3])
    total = (total & BYTES) + ((total >> U8) & BYTES)
    total = total + (total >> U16)
    return np.int64((total + (total >> U32)) & LAST)


@njit(cache=True, nogil=True)
def _lower_median(values, n, work):
    """Return the lower median of the first n values; `work` takes a sorted copy."""
    for a in range(n):
        value, b = values[a], a
        while b > 0 and work[b - 1] > value:
            work[b] = work[b - 1]
            b -= 1
        work[b] = value
    return work[(n - 1) // 2]


@njit(cache=True, nogil=True)
def _central(descriptors, keyframes, features, apart, work):
    """Return which of some features has the descriptor with the least median distance to the others; the first of equals."""
    n = len(keyframes)
    for a in range(n):
        for b in range(a + 1, n):
            d = _distance(descriptors[keyframes[a], features[a]], descriptors[keyframes[b], features[b]])
            apart[a, b] = d
            apart[b, a] = d
        apart[a, a] = 0
    best, least = 0, 1 << 30
    for a in range(n):
        median = _lower_median(apart[a], n, work)
        if median < least:
            least = median
            best = a
    return best


@njit(cache=True, nogil=True)
def refresh_points(
    offsets, keyframes, features, ids, positions, centres, octaves, all_descriptors, scales, changed, reference, normals, near, far, descriptors
):  # fmt: skip
    """Set viewing direction, range of distances and descriptor of points `ids` (R,) from their observations.

    The descriptor, uint64 (4,), is the one with the least median distance to the others (ORB-SLAM, section V-C). It depends on who sees the
    point alone, so it stays where that is not `changed` (P,) since it was computed last; that mark is taken away.
    """
    most = 1
    for r in range(len(ids)):
        most = max(most, offsets[r + 1] - offsets[r])
    apart, work = np.zeros((most, most), np.int64), np.zeros(most, np.int64)
    for r in range(len(ids)):
        p, first, n = ids[r], offsets[r], offsets[r + 1] - offsets[r]
        if n == 0:
            continue
        x, y, z = 0.0, 0.0, 0.0
        anchor = first
        for m in range(first, first + n):
            k = keyframes[m]
            dx = positions[p, 0] - centres[k, 0]
            dy = positions[p, 1] - centres[k, 1]
            dz = positions[p, 2] - centres[k, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
            x += dx / length
            y += dy / length
            z += dz / length
            if k == reference[p]:
                anchor = m
        length = math.sqrt(x * x + y * y + z * z) + 1e-12
        normals[p, 0] = x / length
        normals[p, 1] = y / length
        normals[p, 2] = z / length
        k = keyframes[anchor]
        reference[p] = k
        distance = math.sqrt(
            (positions[p, 0] - centres[k, 0]) ** 2
            + (positions[p, 1] - centres[k, 1]) ** 2
            + (positions[p, 2] - centres[k, 2]) ** 2
        )
        far[p] = distance * scales[octaves[k, features[anchor]]]
        near[p] = far[p] / scales[len(scales) - 1]
        if changed[p]:
            changed[p] = False
            at = first + _central(
                all_descriptors, keyframes[first : first + n], features[first : first + n], apart, work
            )
            for j in range(4):
                descriptors[p, j] = all_descriptors[keyframes[at], features[at], j]


@njit(cache=True, nogil=True)
def count_redundant(
    seen, keyframe, octaves, observations, close, least, row_of_point, offsets, keyframes, features, alive
):  # fmt: skip
    """Return (redundant, total) of the points that a keyframe sees closely: seen by `least` others at the same or a finer scale.

    `close` bool (F,) says which features count; `observations` (R,) how often the point of a row is seen; the rest is who sees each
    point (`SparseMap.sightings`), of which only living keyframes count.
    """
    total, redundant = 0, 0
    for i in range(seen.shape[1]):
        p = seen[keyframe, i]
        if p < 0 or not close[i]:
            continue
        total += 1
        r = row_of_point[p]
        if observations[r] <= least:
            continue
        finer = 0
        for m in range(offsets[r], offsets[r + 1]):
            k = keyframes[m]
            if k != keyframe and alive[k] and octaves[k, features[m]] <= octaves[keyframe, i] + 1:
                finer += 1
        if finer >= least:
            redundant += 1
    return redundant, total
