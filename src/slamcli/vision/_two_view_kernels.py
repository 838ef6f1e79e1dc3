# SPDX-License-Identifier: MIT
"""Compiled hypotheses and scores of two-view geometry; see `slamcli.vision.two_view`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _null_vector(a, out):
    """Fill out (9,) with the unit x of a x = 0, a (8, 9), by elimination with full pivoting; False for a lesser rank."""
    order = np.arange(9)
    largest = 0.0
    for k in range(8):
        row, column, best = k, k, 0.0
        for i in range(k, 8):
            for j in range(k, 9):
                if abs(a[i, j]) > best:
                    best, row, column = abs(a[i, j]), i, j
        largest = max(largest, best)
        if not best > 1e-10 * largest:
            return False
        for j in range(9):
            a[k, j], a[row, j] = a[row, j], a[k, j]
        for i in range(8):
            a[i, k], a[i, column] = a[i, column], a[i, k]
        order[k], order[column] = order[column], order[k]
        for i in range(k + 1, 8):
            factor = a[i, k] / a[k, k]
            for j in range(k, 9):
                a[i, j] -= factor * a[k, j]
    x = np.empty(9)
    x[8] = 1.0
    square = 1.0
    for k in range(7, -1, -1):
        total = 0.0
        for j in range(k + 1, 9):
            total += a[k, j] * x[j]
        x[k] = -total / a[k, k]
        square += x[k] * x[k]
    scale = 1.0 / math.sqrt(square)
    for k in range(9):
        out[order[k]] = x[k] * scale
    return True


@njit(cache=True, nogil=True)
def hypotheses(a, b, samples, homographies, fundamentals):
    """Fill homographies (K, 9) from the first four and fundamentals (K, 9) from all eight matches of each sample.

    Points a, b (N, 2) are normalised (Hartley, PAMI 19(6), 1997). What a degenerate sample leaves open is 0.
    """
    rows = np.empty((8, 9))
    for k in range(samples.shape[0]):
        for i in range(4):
            s = samples[k, i]
            u, v, x, y = a[s, 0], a[s, 1], b[s, 0], b[s, 1]
            rows[2 * i, 0], rows[2 * i, 1], rows[2 * i, 2] = 0.0, 0.0, 0.0
            rows[2 * i, 3], rows[2 * i, 4], rows[2 * i, 5] = -u, -v, -1.0
            rows[2 * i, 6], rows[2 * i, 7], rows[2 * i, 8] = y * u, y * v, y
            rows[2 * i + 1, 0], rows[2 * i + 1, 1], rows[2 * i + 1, 2] = u, v, 1.0
            rows[2 * i + 1, 3], rows[2 * i + 1, 4], rows[2 * i + 1, 5] = 0.0, 0.0, 0.0
            rows[2 * i + 1, 6], rows[2 * i + 1, 7], rows[2 * i + 1, 8] = -x * u, -x * v, -x
        if not _null_vector(rows, homographies[k]):
            homographies[k] = 0.0
        for i in range(8):
            s = samples[k, i]
            u, v, x, y = a[s, 0], a[s, 1], b[s, 0], b[s, 1]
            rows[i, 0], rows[i, 1], rows[i, 2] = x * u, x * v, x
            rows[i, 3], rows[i, 4], rows[i, 5] = y * u, y * v, y
            rows[i, 6], rows[i, 7], rows[i, 8] = u, v, 1.0
        if not _null_vector(rows, fundamentals[k]):
            fundamentals[k] = 0.0


@njit(cache=True, nogil=True)
def _transfer(H, u, v, x, y):
    """Squared distance of (x, y) from H (u, v, 1)."""
    w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    if w == 0.0:
        return math.inf
    du = (H[0, 0] * u + H[0, 1] * v + H[0, 2]) / w - x
    dv = (H[1, 0] * u + H[1, 1] * v + H[1, 2]) / w - y
    return du * du + dv * dv


@njit(cache=True, nogil=True)
def score_homographies(forth, back, a, b, weight, limit, scores):
    """Fill scores (K,): sum over matches and both directions of limit - chi2 where chi2 <= limit in both or one.

    `forth` (K, 3, 3) maps pixels of a to b, `back` is its inverse; `weight` is one over the variance of a pixel.
    """
    for k in range(forth.shape[0]):
        total = 0.0
        for i in range(a.shape[0]):
            first = weight * _transfer(back[k], b[i, 0], b[i, 1], a[i, 0], a[i, 1])
            second = weight * _transfer(forth[k], a[i, 0], a[i, 1], b[i, 0], b[i, 1])
            if first <= limit:
                total += limit - first
            if second <= limit:
                total += limit - second
        scores[k] = total


@njit(cache=True, nogil=True)
def homography_inliers(forth, back, a, b, weight, limit, inliers):
    """Fill inliers (N,): chi2 <= limit in both directions."""
    for i in range(a.shape[0]):
        first = weight * _transfer(back, b[i, 0], b[i, 1], a[i, 0], a[i, 1])
        second = weight * _transfer(forth, a[i, 0], a[i, 1], b[i, 0], b[i, 1])
        inliers[i] = first <= limit and second <= limit


@njit(cache=True, nogil=True)
def _epipolar(F, u, v, x, y, both):
    """Fill both (2,) with the squared distances of (x, y) from F (u, v, 1) and of (u, v) from (x, y, 1) F."""
    l0, l1 = F[0, 0] * u + F[0, 1] * v + F[0, 2], F[1, 0] * u + F[1, 1] * v + F[1, 2]
    l2 = F[2, 0] * u + F[2, 1] * v + F[2, 2]
    m0, m1 = F[0, 0] * x + F[1, 0] * y + F[2, 0], F[0, 1] * x + F[1, 1] * y + F[2, 1]
    product = x * l0 + y * l1 + l2
    length_b, length_a = l0 * l0 + l1 * l1, m0 * m0 + m1 * m1
    both[0] = product * product / length_b if length_b > 0.0 else math.inf
    both[1] = product * product / length_a if length_a > 0.0 else math.inf


@njit(cache=True, nogil=True)
def score_fundamentals(matrices, a, b, weight, limit, gain, scores):
    """Fill scores (K,) of F (K, 3, 3): sum over matches and both images of gain - chi2 where chi2 <= limit."""
    both = np.empty(2)
    for k in range(matrices.shape[0]):
        total = 0.0
        for i in range(a.shape[0]):
            _epipolar(matrices[k], a[i, 0], a[i, 1], b[i, 0], b[i, 1], both)
            for side in range(2):
                chi2 = weight * both[side]
                if chi2 <= limit:
                    total += gain - chi2
        scores[k] = total


@njit(cache=True, nogil=True)
def fundamental_inliers(matrix, a, b, weight, limit, inliers):
    """Fill inliers (N,): chi2 <= limit in both images."""
    both = np.empty(2)
    for i in range(a.shape[0]):
        _epipolar(matrix, a[i, 0], a[i, 1], b[i, 0], b[i, 1], both)
        inliers[i] = weight * both[0] <= limit and weight * both[1] <= limit
