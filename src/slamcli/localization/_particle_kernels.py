# SPDX-License-Identifier: MIT
"""Compiled loops of `slamcli.localization.particles`: drawing anew, counting bins, grouping.

Bins are 0.5 m x 0.5 m x 10 degrees and stand in a hash table with open addressing; its size is a power of two, at least twice
the number of particles. Headings go round: the bin after the last is the first.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_BIN_M = 0.5
_BINS_ROUND = 36
_HALF = 1 << 24  # bins on either side of the origin; beyond, positions share the last one
_EMPTY = -1


@njit(cache=True, nogil=True)
def _bin(x, y, yaw):
    """Return the three indices of a pose's bin, none negative."""
    i = min(max(math.floor(x / _BIN_M), -_HALF + 1), _HALF - 2) + _HALF
    j = min(max(math.floor(y / _BIN_M), -_HALF + 1), _HALF - 2) + _HALF
    k = math.floor((yaw + math.pi) * (_BINS_ROUND / (2.0 * math.pi))) % _BINS_ROUND
    return i, j, k


@njit(cache=True, nogil=True)
def _slot(keys, i, j, k):
    """Return where bin (i, j, k) stands in the table `keys` (T,), or the free place for it, and its key."""
    mask = len(keys) - 1
    key = (i * (2 * _HALF) + j) * _BINS_ROUND + k
    at = (i * 73856093 + j * 19349663 + k * 83492791) & mask
    while keys[at] != _EMPTY and keys[at] != key:
        at = (at + 1) & mask
    return at, key


@njit(cache=True, nogil=True)
def kld_limit(bins, error, quantile, least, most):
    """Return how many particles `bins` bins need; Fox, Adapting the sample size in particle filters, IJRR 2003, eq. 12."""
    if bins <= 1:
        return most
    k = bins - 1.0
    x = 1.0 - 2.0 / (9.0 * k) + math.sqrt(2.0 / (9.0 * k)) * quantile
    needed = k / (2.0 * error) * x * x * x
    if needed >= most:
        return most
    return max(np.int64(math.ceil(needed)), least)


@njit(cache=True, nogil=True)
def draw(poses, cumulative, others, share, uniforms, keys, limits, drawn):
    """Fill `drawn` (M, 3) from `poses` (N, 3) by weight, or with `others` (O, 3) at a probability of `share`; return how many.

    `cumulative` (N,) are the summed weights, `uniforms` (M, 2) numbers in [0, 1), `keys` an empty table of bins, `limits`
    kld_err, kld_z, the least and the most particles.
    """
    bins, num, taken, last = 0, 0, 0, len(poses) - 1
    most = drawn.shape[0]
    enough = kld_limit(0, limits[0], limits[1], np.int64(limits[2]), np.int64(limits[3]))
    while num < most:
        if taken < len(others) and uniforms[num, 0] < share:
            drawn[num] = others[taken]
            taken += 1
        else:
            wanted = uniforms[num, 1] * cumulative[last]
            low, high = 0, last
            while low < high:
                middle = (low + high) // 2
                if cumulative[middle] > wanted:
                    high = middle
                else:
                    low = middle + 1
            drawn[num] = poses[low]
        i, j, k = _bin(drawn[num, 0], drawn[num, 1], drawn[num, 2])
        at, key = _slot(keys, i, j, k)
        if keys[at] == _EMPTY:
            keys[at] = key
            bins += 1
            enough = kld_limit(bins, limits[0], limits[1], np.int64(limits[2]), np.int64(limits[3]))
        num += 1
        if num > enough:
            break
    return num


@njit(cache=True, nogil=True)
def group(poses, keys, slots, labels):
    """Set `labels` (N,) to the group of each pose (N, 3), counted by first member; return how many there are.

    Bins that touch, also at an edge or a corner, are one group. `keys` (T,) is an empty table, `slots` (T,) room beside it.
    """
    cells = np.empty((len(poses), 3), dtype=np.int64)  # bins in the order of their first pose
    group_of = np.full(len(poses), -1, dtype=np.int64)
    num = 0
    for n in range(len(poses)):
        i, j, k = _bin(poses[n, 0], poses[n, 1], poses[n, 2])
        at, key = _slot(keys, i, j, k)
        if keys[at] == _EMPTY:
            keys[at] = key
            slots[at] = num
            cells[num, 0], cells[num, 1], cells[num, 2] = i, j, k
            num += 1
        labels[n] = slots[at]
    stack = np.empty(num, dtype=np.int64)
    groups = 0
    for first in range(num):
        if group_of[first] >= 0:
            continue
        group_of[first] = groups
        stack[0] = first
        waiting = 1
        while waiting > 0:
            waiting -= 1
            b = stack[waiting]
            for di in range(-1, 2):
                for dj in range(-1, 2):
                    for dk in range(-1, 2):
                        turned = (cells[b, 2] + dk) % _BINS_ROUND
                        at, key = _slot(keys, cells[b, 0] + di, cells[b, 1] + dj, turned)
                        if keys[at] != _EMPTY and group_of[slots[at]] < 0:
                            group_of[slots[at]] = groups
                            stack[waiting] = slots[at]
                            waiting += 1
        groups += 1
    for n in range(len(poses)):
        labels[n] = group_of[labels[n]]
    return groups


@njit(cache=True, nogil=True)
def sum_groups(poses, weights, labels, sums):
    """Add to `sums` (G, 5) weight, weighted x and y from the first pose, cosine and sine of the heading of each group."""
    x0, y0 = poses[0, 0], poses[0, 1]
    for n in range(len(poses)):
        w, g = weights[n], labels[n]
        sums[g, 0] += w
        sums[g, 1] += w * (poses[n, 0] - x0)
        sums[g, 2] += w * (poses[n, 1] - y0)
        sums[g, 3] += w * math.cos(poses[n, 2])
        sums[g, 4] += w * math.sin(poses[n, 2])


@njit(cache=True, nogil=True)
def scatter_about(poses, weights, labels, wanted, mean, out):
    """Add to `out` (3, 3) the weighted scatter of the poses of group `wanted` (all if negative) about `mean` (3,)."""
    total = 0.0
    for n in range(len(poses)):
        if wanted >= 0 and labels[n] != wanted:
            continue
        w = weights[n]
        dx, dy = poses[n, 0] - mean[0], poses[n, 1] - mean[1]
        turn = poses[n, 2] - mean[2] + math.pi
        da = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi)) - math.pi
        total += w
        out[0, 0] += w * dx * dx
        out[0, 1] += w * dx * dy
        out[0, 2] += w * dx * da
        out[1, 1] += w * dy * dy
        out[1, 2] += w * dy * da
        out[2, 2] += w * da * da
    if total > 0.0:
        out /= total
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
