# SPDX-License-Identifier: MIT
"""Compiled loops of stereo matching; see `slamcli.vision.stereo_matching`."""

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


@njit(cache=True, nogil=True)
def _distance(a, b):
    """Hamming distance of two descriptors, uint64 (4,)."""
    total = _bits_of_bytes(a[0] ^ b[0]) + _bits_of_bytes(a[1] ^ b[1])
    total = total + _bits_of_bytes(a[2] ^ b[2]) + _bits_of_bytes(a[3] ^ b[3])
    total = (total & BYTES) + ((total >> U8) & BYTES)
    total = total + (total >> U16)
    return np.int64((total + (total >> U32)) & LAST)


@njit(cache=True, nogil=True)
def in_row_bands(
    pixels, octaves, descriptors, pixels_right, octaves_right, sigmas_right, descriptors_right,
    height, band, max_disparity, max_distance,
):  # fmt: skip
    """Return the right feature with the nearest descriptor of each left one, int64 (N,) or -1.

    Its row differs by at most `band` of its sigma, its octave by at most 1, its disparity lies in [0, max_disparity].
    """
    best = np.full(len(pixels), -1, np.int64)
    if len(pixels_right) == 0:
        return best
    rows = np.empty(len(pixels_right), np.int64)
    starts = np.zeros(height + 1, np.int64)
    for j in range(len(pixels_right)):
        rows[j] = min(max(int(pixels_right[j, 1]), 0), height - 1)
        starts[rows[j] + 1] += 1
    for row in range(height):
        starts[row + 1] += starts[row]
    places = starts.copy()
    members = np.empty(len(pixels_right), np.int64)
    for j in range(len(pixels_right)):
        members[places[rows[j]]] = j
        places[rows[j]] += 1
    reach = band * sigmas_right.max()
    for i in range(len(pixels)):
        x, y = pixels[i, 0], pixels[i, 1]
        first, last = max(int(y - reach), 0), min(int(y + reach), height - 1)
        near = max_distance + 1
        for place in range(starts[first], starts[last + 1]):
            j = members[place]
            disparity = x - pixels_right[j, 0]
            if abs(pixels_right[j, 1] - y) > band * sigmas_right[j] or disparity < 0.0 or disparity > max_disparity:
                continue
            if abs(octaves_right[j] - octaves[i]) > 1:
                continue
            d = _distance(descriptors[i], descriptors_right[j])
            if d < near:
                near, best[i] = d, j
    return best


@njit(cache=True, nogil=True)
def _mean_difference(left, right, x, y, x_right, half):
    """Mean of the left window less the right one's, rounded."""
    total = np.int64(0)
    for v in range(y - half, y + half + 1):
        one, two = left[v, x - half : x + half + 1], right[v, x_right - half : x_right + half + 1]
        row = np.int32(0)
        for u in range(len(one)):
            row += np.int32(one[u]) - np.int32(two[u])
        total += np.int64(row)
    return round(total / ((2 * half + 1) * (2 * half + 1)))


@njit(cache=True, nogil=True)
def _difference(left, right, x, y, x_right, half, shift):
    """Sum of absolute differences of two windows, the right one made brighter by `shift`."""
    differences = np.int64(0)
    brighter = np.int32(shift)
    for v in range(y - half, y + half + 1):
        one, two = left[v, x - half : x + half + 1], right[v, x_right - half : x_right + half + 1]
        row = np.int32(0)
        for u in range(len(one)):
            row += abs(np.int32(one[u]) - np.int32(two[u]) - brighter)
        differences += np.int64(row)
    return differences


@njit(cache=True, nogil=True)
def window_search(left, right, columns, rows, starts, half, search):
    """Return where windows of the left image lie in the same rows of the right one, float64 (N,).

    Around `starts`, up to `search` pixels each way, the least sum of absolute differences (each window less its mean) is
    refined by a parabola. NaN where the least lies at an end, or a window leaves the image.
    """
    found = np.full(len(columns), math.nan)
    sums = np.empty(2 * search + 1, np.int64)
    height, width = left.shape
    for i in range(len(columns)):
        x, y, start = columns[i], rows[i], starts[i]
        if y < half or y >= height - half or x < half or x >= width - half:
            continue
        if start - search < half or start + search >= right.shape[1] - half:
            continue
        least = 0
        for k in range(2 * search + 1):
            place = start + k - search
            shift = _mean_difference(left, right, x, y, place, half)
            sums[k] = _difference(left, right, x, y, place, half, shift)
            if sums[k] < sums[least]:
                least = k
        if least == 0 or least == 2 * search:
            continue
        before, here, after = float(sums[least - 1]), float(sums[least]), float(sums[least + 1])
        bend = before + after - 2.0 * here
        found[i] = start + least - search + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)
    return found


@njit(cache=True, nogil=True)
def _left_row(row):
    """Sums over the inner pixels of a row: values, slopes, values squared, values by slopes; a slope is that of two pixels."""
    p1, g1, pp, pg = np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    for u in range(len(row) - 2):
        p, g = np.int32(row[u + 1]), np.int32(row[u + 2]) - np.int32(row[u])
        p1 += p
        g1 += g
        pp += p * p
        pg += p * g
    return p1, g1, pp, pg


@njit(cache=True, nogil=True)
def _right_row(row, two):
    """Sums over a row: right values, squared, by their neighbours, by the left values, by the left slopes."""
    q1, qq, qr, pq, gq = np.int32(0), np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    for u in range(len(row) - 2):
        p, g = np.int32(row[u + 1]), np.int32(row[u + 2]) - np.int32(row[u])
        q, r = np.int32(two[u]), np.int32(two[u + 1])
        q1 += q
        qq += q * q
        qr += q * r
        pq += p * q
        gq += g * q
    return q1, qq, qr, pq, gq


@njit(cache=True, nogil=True)
def _left_moments(left, x, y, half, out):
    """Fill `out` (4,) with sums over the left window: values, slopes; and moments: values, values by slopes."""
    p1, g1, pp, pg = 0, 0, 0, 0
    for v in range(y - half, y + half + 1):
        a, b, c, d = _left_row(left[v, x - half - 1 : x + half + 2])
        p1 += np.int64(a)
        g1 += np.int64(b)
        pp += np.int64(c)
        pg += np.int64(d)
    n = (2 * half + 1) * (2 * half + 1)
    out[0], out[1], out[2], out[3] = float(p1), float(g1), float(n * pp - p1 * p1), float(n * pg - p1 * g1)


@njit(cache=True, nogil=True)
def _moments(left, right, x, y, place, half, mine, out):
    """Fill `out` (4,) with moments about the mean, as `mine` n^2-fold, of the right window at `place`.

    With itself, with the one a pixel further, with the left window, with the slopes of the left window.
    """
    q1, qq, qr, pq, gq = 0, 0, 0, 0, 0
    edge = 0
    for v in range(y - half, y + half + 1):
        two = right[v, place - half : place + half + 2]
        a, b, c, d, e = _right_row(left[v, x - half - 1 : x + half + 2], two)
        q1 += np.int64(a)
        qq += np.int64(b)
        qr += np.int64(c)
        pq += np.int64(d)
        gq += np.int64(e)
        edge += np.int64(two[len(two) - 1]) - np.int64(two[0])
    n = (2 * half + 1) * (2 * half + 1)
    out[0], out[1] = float(n * qq - q1 * q1), float(n * qr - q1 * (q1 + edge))
    out[2], out[3] = n * float(pq) - mine[0] * q1, n * float(gq) - mine[1] * q1


@njit(cache=True, nogil=True)
def _between(mine, here, there):
    """Where from one place (0) to the next (1) the windows agree, outside [0, 1] if elsewhere, and how well they correlate."""
    rise = there[3] - here[3]
    t, correlation = 0.5, -1.0
    if rise <= 0.0:
        return math.nan, correlation
    for _ in range(2):
        variance = (1.0 - t) * (1.0 - t) * here[0] + 2.0 * t * (1.0 - t) * here[1] + t * t * there[0]
        covariance = (1.0 - t) * here[2] + t * there[2]
        if not (variance > 0.0 and covariance > 0.0 and mine[2] > 0.0):
            return math.nan, -1.0
        correlation = covariance / math.sqrt(variance * mine[2])
        t = min(max((mine[3] * variance / covariance - here[3]) / rise, -1.0), 2.0)
    return t, correlation


@njit(cache=True, nogil=True)
def refine(left, right, columns, rows, places, halves, reaches):
    """Return `places` (N,) moved along the row to where windows agree, and their correlations (N,).

    Windows reach `halves` (N,) pixels each way. With the slopes g of the left window, the condition of Gauss-Newton is
    sum g (left - gain right(shift) - offset) = 0; for a right image read linearly between pixels it is linear in the shift, with
    coefficients that are sums of integers. Slopes of the right window would be taken in by its noise, which is less between
    pixels. NaN where the place lies more than `reaches` (N,) pixels away, at an end of the image, or nowhere.
    """
    found = np.full(len(columns), math.nan)
    correlations = np.full(len(columns), -1.0)
    mine, here, there = np.zeros(4), np.zeros(4), np.zeros(4)
    height, width = right.shape
    for i in range(len(columns)):
        x, y, half = columns[i], rows[i], halves[i]
        if not math.isfinite(places[i]) or y < half or y >= height - half or x < half + 1 or x >= width - half - 1:
            continue
        place = math.floor(places[i])
        reach = math.ceil(reaches[i])
        if place - 1 - reach < half or place + 2 + reach + half >= width:
            continue
        _left_moments(left, x, y, half, mine)
        _moments(left, right, x, y, place, half, mine, here)
        _moments(left, right, x, y, place + 1, half, mine, there)
        direction = 0
        for _ in range(reach + 1):
            t, correlation = _between(mine, here, there)
            if -0.001 <= t <= 1.001:
                found[i], correlations[i] = place + t, correlation
                break
            if t < 0.0 and direction <= 0:
                place, direction = place - 1, -1
                there[:] = here
                _moments(left, right, x, y, place, half, mine, here)
            elif t > 1.0 and direction >= 0:
                place, direction = place + 1, 1
                here[:] = there
                _moments(left, right, x, y, place + 1, half, mine, there)
            else:
                break
        if not abs(found[i] - places[i]) <= reaches[i]:
            found[i] = math.nan
    return found, correlations
