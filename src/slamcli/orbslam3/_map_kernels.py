# SPDX-License-Identifier: MIT
"""Compiled loops over the table of observations; see `slamcli.orbslam3.sparse_map`.

`seen` (K, F) holds the point that feature i of keyframe k sees, or -1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def count_shared(seen, num_keyframes, marked):
    """Return int64 (K,): how many features of each keyframe see a marked point; `marked` bool (P,)."""
    counts = np.zeros(num_keyframes, np.int64)
    for k in range(num_keyframes):
        n = 0
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0 and marked[p]:
                n += 1
        counts[k] = n
    return counts


@njit(cache=True, nogil=True)
def count_all_shared(offsets, keyframes, num_keyframes):
    """Return int64 (K, K): how many points each two keyframes share, from who sees each point (`list_observations`)."""
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


@njit(cache=True, nogil=True)
def count_observations(seen, right, num_keyframes, num_points):
    """Return int64 (P,): how often each point is seen, twice where a right column (K, F) tells its depth (NaN: it does not)."""
    counts = np.zeros(num_points, np.int64)
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0:
                counts[p] += 1 if math.isnan(right[k, i]) else 2
    return counts


@njit(cache=True, nogil=True)
def list_observations(seen, num_keyframes, row_of_point, num_rows):
    """Return the observations of chosen points as rows: offsets (R + 1,), keyframes (M,), features (M,).

    `row_of_point` (P,) is the row of a point or -1; within a row keyframes stand in increasing order.
    """
    offsets = np.zeros(num_rows + 1, np.int64)
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0 and row_of_point[p] >= 0:
                offsets[row_of_point[p] + 1] += 1
    for r in range(num_rows):
        offsets[r + 1] += offsets[r]
    filled = offsets[:-1].copy()
    keyframes = np.empty(offsets[num_rows], np.int64)
    features = np.empty(offsets[num_rows], np.int64)
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0 and row_of_point[p] >= 0:
                at = filled[row_of_point[p]]
                keyframes[at] = k
                features[at] = i
                filled[row_of_point[p]] = at + 1
    return offsets, keyframes, features


@njit(cache=True, nogil=True)
def replace_points(seen, num_keyframes, target):
    """Let every observation of p be one of target[p] (-1: of none); a keyframe that sees the target already keeps that one."""
    owner = np.full(len(target), -1, np.int64)  # last keyframe that was found to see a point
    for k in range(num_keyframes):
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p >= 0 and target[p] == p:
                owner[p] = k
        for i in range(seen.shape[1]):
            p = seen[k, i]
            if p < 0 or target[p] == p:
                continue
            q = target[p]
            if q >= 0 and owner[q] != k:
                seen[k, i] = q
                owner[q] = k
            else:
                seen[k, i] = -1


@njit(cache=True, nogil=True)
def _distance(a, b, popcount):
    """Return the Hamming distance of two rows of bytes."""
    d = 0
    for j in range(a.shape[0]):
        d += popcount[a[j] ^ b[j]]
    return d


@njit(cache=True, nogil=True)
def refresh_points(
    offsets, keyframes, features, ids, positions, centres, octaves, all_descriptors, scales, popcount, reference, normals, near, far, descriptors
):  # fmt: skip
    """Set viewing direction, range of distances and descriptor of points `ids` (R,) from their observations.

    The descriptor is the one with the least median distance to the others (ORB-SLAM, section V-C).
    """
    most = 1
    for r in range(len(ids)):
        most = max(most, offsets[r + 1] - offsets[r])
    apart = np.zeros((most, most), np.int64)
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
        best, least = 0, 1 << 30
        for a in range(n):
            for b in range(a + 1, n):
                d = _distance(
                    all_descriptors[keyframes[first + a], features[first + a]],
                    all_descriptors[keyframes[first + b], features[first + b]],
                    popcount,
                )
                apart[a, b] = d
                apart[b, a] = d
            apart[a, a] = 0
        for a in range(n):
            median = np.sort(apart[a, :n])[(n - 1) // 2]
            if median < least:
                least = median
                best = a
        k, i = keyframes[first + best], features[first + best]
        for j in range(32):
            descriptors[p, j] = all_descriptors[k, i, j]


@njit(cache=True, nogil=True)
def count_redundant(
    seen, keyframe, octaves, observations, close, least, row_of_point, offsets, keyframes, features, alive
):  # fmt: skip
    """Return (redundant, total) of the points that a keyframe sees closely: seen by `least` others at the same or a finer scale.

    `close` bool (F,) says which features count; `observations` (P,) how often a point is seen; the rest is who sees each point
    (`list_observations`), of which only living keyframes count.
    """
    total, redundant = 0, 0
    for i in range(seen.shape[1]):
        p = seen[keyframe, i]
        if p < 0 or not close[i]:
            continue
        total += 1
        if observations[p] <= least:
            continue
        finer = 0
        r = row_of_point[p]
        for m in range(offsets[r], offsets[r + 1]):
            k = keyframes[m]
            if k != keyframe and alive[k] and octaves[k, features[m]] <= octaves[keyframe, i] + 1:
                finer += 1
        if finer >= least:
            redundant += 1
    return redundant, total
