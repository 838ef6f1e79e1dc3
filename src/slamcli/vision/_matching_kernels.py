# SPDX-License-Identifier: MIT
"""Compiled loops of descriptor matching; see `slamcli.vision.matching`.

Descriptors are uint64 (N, 4). A search gives, for each query, the row of the best candidate or -1, and its distance.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FAR = 257
"""More than any Hamming distance of 256 bits."""
ONES = np.uint64(0x5555555555555555)
TWOS = np.uint64(0x3333333333333333)
FOURS = np.uint64(0x0F0F0F0F0F0F0F0F)
BYTES = np.uint64(0x00FF00FF00FF00FF)
LAST = np.uint64(0xFFFF)
U1, U2, U4, U8, U16, U32 = np.uint64(1), np.uint64(2), np.uint64(4), np.uint64(8), np.uint64(16), np.uint64(32)


@njit(cache=True, nogil=True, inline="always")
def _bits_of_bytes(x):
    """The number of bits set in each byte of a word."""
    x = x - ((x >> U1) & ONES)
    x = (x & TWOS) + ((x >> U2) & TWOS)
    return (x + (x >> U4)) & FOURS


@njit(cache=True, nogil=True, inline="always")
def _hamming(a0, a1, a2, a3, b0, b1, b2, b3):
    """Hamming distance of four words from four; the counts of bytes, 32 at most, are added before they are folded."""
    total = _bits_of_bytes(a0 ^ b0) + _bits_of_bytes(a1 ^ b1) + _bits_of_bytes(a2 ^ b2) + _bits_of_bytes(a3 ^ b3)
    total = (total & BYTES) + ((total >> U8) & BYTES)
    total = total + (total >> U16)
    return np.int64((total + (total >> U32)) & LAST)


@njit(cache=True, nogil=True)
def distance(a, b):
    """Hamming distance of two descriptors, uint64 (4,)."""
    return _hamming(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3])


@njit(cache=True, nogil=True)
def fill_grid(pixels, limits, num_x, num_y):
    """Return `starts` (num_x num_y + 1,) and `members` (N,): the points of each cell, row after row; beyond the limits in the next cell."""
    cells = np.empty(len(pixels), np.int64)
    starts = np.zeros(num_x * num_y + 1, np.int64)
    for i in range(len(pixels)):
        x = int((pixels[i, 0] - limits[0]) * num_x / (limits[2] - limits[0]))
        y = int((pixels[i, 1] - limits[1]) * num_y / (limits[3] - limits[1]))
        cells[i] = min(max(y, 0), num_y - 1) * num_x + min(max(x, 0), num_x - 1)
        starts[cells[i] + 1] += 1
    for cell in range(num_x * num_y):
        starts[cell + 1] += starts[cell]
    places = starts.copy()
    members = np.empty(len(pixels), np.int64)
    for i in range(len(pixels)):
        members[places[cells[i]]] = i
        places[cells[i]] += 1
    return starts, members


@njit(cache=True, nogil=True, inline="always")
def _cell(value, low, high, number):
    """The cell of a coordinate, the first or last one beyond the limits."""
    place = (value - low) * number / (high - low)
    return int(min(max(place, 0.0), number - 1.0))


@njit(cache=True, nogil=True)
def by_projection(
    predicted, predicted_right, radius, octave_min, octave_max, queries,
    pixels, right, octaves, free, descriptors, starts, members, limits, num_x, num_y, max_distance, ratio,
):  # fmt: skip
    """Search around predicted pixels; the second best counts against the best only if it lies on the same octave."""
    best = np.full(len(predicted), -1, np.int64)
    distances = np.full(len(predicted), FAR, np.int64)
    for p in range(len(predicted)):
        x, y, r = predicted[p, 0], predicted[p, 1], radius[p]
        if not (math.isfinite(x) and math.isfinite(y) and r > 0.0):
            continue
        if x + r < limits[0] or x - r > limits[2] or y + r < limits[1] or y - r > limits[3]:
            continue
        q0, q1, q2, q3 = queries[p]
        near, second, second_octave, chosen = FAR, FAR, -1, -1
        first_x, last_x = _cell(x - r, limits[0], limits[2], num_x), _cell(x + r, limits[0], limits[2], num_x)
        for row in range(_cell(y - r, limits[1], limits[3], num_y), _cell(y + r, limits[1], limits[3], num_y) + 1):
            for place in range(starts[row * num_x + first_x], starts[row * num_x + last_x + 1]):
                i = members[place]
                if not free[i] or octaves[i] < octave_min[p] or octaves[i] > octave_max[p]:
                    continue
                if abs(pixels[i, 0] - x) > r or abs(pixels[i, 1] - y) > r:
                    continue
                if abs(right[i] - predicted_right[p]) > r:  # false where either is NaN
                    continue
                d = _hamming(q0, q1, q2, q3, descriptors[i, 0], descriptors[i, 1], descriptors[i, 2], descriptors[i, 3])
                if d < near:
                    if chosen >= 0:
                        second, second_octave = near, octaves[chosen]
                    near, chosen = d, i
                elif d < second:
                    second, second_octave = d, octaves[i]
        if chosen < 0 or near > max_distance:
            continue
        if second_octave == octaves[chosen] and near > ratio * second:
            continue
        best[p], distances[p] = chosen, near
    return best, distances


@njit(cache=True, nogil=True)
def _distances(query, w0, w1, w2, w3, out):
    q0, q1, q2, q3 = query[0], query[1], query[2], query[3]
    for b in range(len(out)):
        out[b] = _hamming(q0, q1, q2, q3, w0[b], w1[b], w2[b], w3[b])


@njit(cache=True, nogil=True)
def _nearest_two(row):
    near, second, chosen = FAR, FAR, -1
    for b in range(len(row)):
        if row[b] < second:
            if row[b] < near:
                near, second, chosen = row[b], near, b
            else:
                second = row[b]
    return near, second, chosen


@njit(cache=True, nogil=True)
def _remember(row, a, back, back_distance):
    for b in range(len(row)):
        closer = row[b] < back_distance[b]
        back[b] = a if closer else back[b]
        back_distance[b] = row[b] if closer else back_distance[b]


@njit(cache=True, nogil=True)
def brute_force(queries, words, max_distance, ratio, mutual):
    """Compare every query, uint64 (N, 4), with every descriptor, uint64 (4, M).

    The words stand apart and each loop is a function of its own, so that the compiler takes several descriptors at once.
    """
    num, count = len(queries), words.shape[1]
    best = np.full(num, -1, np.int64)
    distances = np.full(num, FAR, np.int64)
    back, back_distance = np.full(count, -1, np.int64), np.full(count, FAR, np.int64)
    row = np.empty(count, np.int64)
    for a in range(num):
        _distances(queries[a], words[0], words[1], words[2], words[3], row)
        near, second, chosen = _nearest_two(row)
        if mutual:
            _remember(row, a, back, back_distance)
        if near <= max_distance and not near > ratio * second:
            best[a], distances[a] = chosen, near
    if mutual:
        for a in range(num):
            if best[a] >= 0 and back[best[a]] != a:
                best[a] = -1
    return best, distances


@njit(cache=True, nogil=True)
def in_groups(queries, first, last, descriptors, members, max_distance, ratio):
    """Compare each query with the descriptors of the rows ``members[first:last]``."""
    best = np.full(len(queries), -1, np.int64)
    distances = np.full(len(queries), FAR, np.int64)
    for a in range(len(queries)):
        q0, q1, q2, q3 = queries[a]
        near, second, chosen = FAR, FAR, -1
        for place in range(first[a], last[a]):
            b = members[place]
            d = _hamming(q0, q1, q2, q3, descriptors[b, 0], descriptors[b, 1], descriptors[b, 2], descriptors[b, 3])
            if d < near:
                near, second, chosen = d, near, b
            elif d < second:
                second = d
        if chosen >= 0 and near <= max_distance and not near > ratio * second:
            best[a], distances[a] = chosen, near
    return best, distances


@njit(cache=True, nogil=True)
def _on_line(a, b, c, x, y, sigma, epipole_x, epipole_y, near_epipole):
    """Whether a pixel lies on a line within its accuracy (chi-square, 95 %), and not where the line says nothing of depth."""
    error = a * x + b * y + c
    if error * error > 3.84 * sigma * sigma * (a * a + b * b):
        return False
    dx, dy = x - epipole_x, y - epipole_y
    return near_epipole or dx * dx + dy * dy >= 100.0 * sigma


@njit(cache=True, nogil=True)
def epipolar_in_groups(
    queries, lines, with_depth, first, last, descriptors, pixels, sigmas, with_depth_b, members, epipole, max_distance, ratio
):  # fmt: skip
    """Compare each query with the rows ``members[first:last]`` that lie on its line."""
    best = np.full(len(queries), -1, np.int64)
    distances = np.full(len(queries), FAR, np.int64)
    for q in range(len(queries)):
        q0, q1, q2, q3 = queries[q]
        a, b, c = lines[q]
        near, second, chosen = FAR, FAR, -1
        for place in range(first[q], last[q]):
            i = members[place]
            anywhere = with_depth[q] or with_depth_b[i]
            if not _on_line(a, b, c, pixels[i, 0], pixels[i, 1], sigmas[i], epipole[0], epipole[1], anywhere):
                continue
            d = _hamming(q0, q1, q2, q3, descriptors[i, 0], descriptors[i, 1], descriptors[i, 2], descriptors[i, 3])
            if d < near:
                near, second, chosen = d, near, i
            elif d < second:
                second = d
        if chosen >= 0 and near <= max_distance and not near > ratio * second:
            best[q], distances[q] = chosen, near
    return best, distances


@njit(cache=True, nogil=True)
def epipolar_in_grid(
    queries, lines, with_depth, free, descriptors, pixels, sigmas, with_depth_b,
    starts, members, limits, num_x, num_y, margin, epipole, max_distance, ratio,
):  # fmt: skip
    """Compare each query with what lies on its line, cell after cell; `margin` (pixels) is the widest a line can be."""
    best = np.full(len(queries), -1, np.int64)
    distances = np.full(len(queries), FAR, np.int64)
    size_x, size_y = (limits[2] - limits[0]) / num_x, (limits[3] - limits[1]) / num_y
    for q in range(len(queries)):
        q0, q1, q2, q3 = queries[q]
        a, b, c = lines[q]
        near, second, chosen = FAR, FAR, -1
        flat = abs(b) >= abs(a)
        if a == 0.0 and b == 0.0:
            continue
        for step in range(num_x if flat else num_y):
            # Where the line enters and leaves this column (or row) of cells.
            if flat:
                start = limits[0] + step * size_x
                one, two = -(a * start + c) / b, -(a * (start + size_x) + c) / b
                low, high, number = limits[1], limits[3], num_y
            else:
                start = limits[1] + step * size_y
                one, two = -(b * start + c) / a, -(b * (start + size_y) + c) / a
                low, high, number = limits[0], limits[2], num_x
            one, two = min(one, two) - margin, max(one, two) + margin
            if two < low or one > high:
                continue
            for other in range(_cell(one, low, high, number), _cell(two, low, high, number) + 1):
                cell = other * num_x + step if flat else step * num_x + other
                for place in range(starts[cell], starts[cell + 1]):
                    i = members[place]
                    anywhere = with_depth[q] or with_depth_b[i]
                    if not free[i] or not _on_line(
                        a, b, c, pixels[i, 0], pixels[i, 1], sigmas[i], epipole[0], epipole[1], anywhere
                    ):
                        continue
                    d = _hamming(
                        q0, q1, q2, q3, descriptors[i, 0], descriptors[i, 1], descriptors[i, 2], descriptors[i, 3]
                    )
                    if d < near:
                        near, second, chosen = d, near, i
                    elif d < second:
                        second = d
        if chosen >= 0 and near <= max_distance and not near > ratio * second:
            best[q], distances[q] = chosen, near
    return best, distances


@njit(cache=True, nogil=True)
def give_once(best, distances, count):
    """Leave each of `count` candidates to the query that is nearest to it, the first of equals; changes `best`."""
    owner = np.full(count, -1, np.int64)
    for a in range(len(best)):
        b = best[a]
        if b < 0:
            continue
        if owner[b] < 0:
            owner[b] = a
        elif distances[a] < distances[owner[b]]:
            best[owner[b]] = -1
            owner[b] = a
        else:
            best[a] = -1


@njit(cache=True, nogil=True)
def agree_on_rotation(best, angles_a, angles_b, num_bins):
    """Drop matches whose turn is not among the three commonest; changes `best`. Angles that are NaN are not looked at."""
    turns = np.full(len(best), -1, np.int64)
    counts = np.zeros(num_bins, np.int64)
    for a in range(len(best)):
        if best[a] < 0:
            continue
        turn = (angles_a[a] - angles_b[best[a]]) / (2.0 * math.pi)
        if math.isfinite(turn):
            turns[a] = min(int((turn - math.floor(turn)) * num_bins), num_bins - 1)
            counts[turns[a]] += 1
    order = np.argsort(-counts, kind="mergesort")
    kept = np.zeros(num_bins, np.bool_)
    for place in range(min(3, num_bins)):
        kept[order[place]] = 10 * counts[order[place]] >= counts[order[0]]
    for a in range(len(best)):
        if turns[a] >= 0 and not kept[turns[a]]:
            best[a] = -1


@njit(cache=True, nogil=True)
def medoids(descriptors, starts):
    """Return, for each group of rows ``starts[g]:starts[g + 1]``, the row with the least median distance to its group, or -1."""
    chosen = np.full(len(starts) - 1, -1, np.int64)
    for group in range(len(starts) - 1):
        first, size = starts[group], starts[group + 1] - starts[group]
        between = np.zeros((size, size), np.int64)
        for i in range(size):
            for j in range(i):
                between[i, j] = distance(descriptors[first + i], descriptors[first + j])
                between[j, i] = between[i, j]
        least = FAR
        for i in range(size):
            median = np.sort(between[i])[(size - 1) // 2]
            if median < least:
                least, chosen[group] = median, first + i
    return chosen
