# SPDX-License-Identifier: MIT
"""Sparse normal equations of 3 x 3 blocks: their structure, sums and Cholesky factors.

A variable is a vector of three numbers. Row `k` of the factor's structure are the columns `ancestors` that its block row
touches; columns are stored as in CSparse (Davis, Direct Methods for Sparse Linear Systems, 2006), each entry a block.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def elimination_tree(pointers, rows):
    """Parents int64 (V,) and blocks per column of the factor of a symmetric pattern (upper part by columns; Davis 4.1).

    `pointers`, `rows`: for column k the rows above the diagonal, in elimination order.
    """
    size = len(pointers) - 1
    parents, ancestors = np.full(size, -1, np.int64), np.full(size, -1, np.int64)
    counts, flags = np.ones(size, np.int64), np.full(size, -1, np.int64)
    for k in range(size):
        flags[k] = k
        for p in range(pointers[k], pointers[k + 1]):
            i = rows[p]
            while i != -1 and i < k:
                following = ancestors[i]
                ancestors[i] = k
                if following == -1:
                    parents[i] = k
                i = following
        for p in range(pointers[k], pointers[k + 1]):
            i = rows[p]
            while flags[i] != k:
                counts[i] += 1
                flags[i] = k
                i = parents[i]
    return parents, counts


@njit(cache=True, nogil=True)
def accumulate(jacobians, residuals, weights, variables, slots, blocks, diagonal, gradient):
    """Add weight J'J to the blocks and weight J'r to the gradient, residual by residual.

    `jacobians` (N, M, 3 K), `residuals` (N, M), `variables` (N, K) with -1 for what is held, `slots` (N, K, K) where the
    block of a pair (row variable eliminated before the column variable) lies, -1 for none.
    """
    count, size, _ = jacobians.shape
    width = variables.shape[1]
    for n in range(count):
        weight = weights[n]
        if weight == 0.0:
            continue
        for a in range(width):
            va = variables[n, a]
            if va < 0:
                continue
            for i in range(3):
                total = 0.0
                for m in range(size):
                    total += jacobians[n, m, 3 * a + i] * residuals[n, m]
                gradient[va, i] += weight * total
            for b in range(width):
                vb = variables[n, b]
                if vb < 0:
                    continue
                slot = slots[n, a, b]
                if va != vb and slot < 0:
                    continue
                for i in range(3):
                    for j in range(3):
                        total = 0.0
                        for m in range(size):
                            total += jacobians[n, m, 3 * a + i] * jacobians[n, m, 3 * b + j]
                        if va == vb:
                            diagonal[va, i, j] += weight * total
                        else:
                            blocks[slot, i, j] += weight * total


@njit(cache=True, nogil=True)
def factorise(pointers, rows, blocks, diagonal, parents, column_starts, factor_rows, factor, inverses):
    """Compute the Cholesky factor L of a block matrix, row by row (up-looking); return the failing variable or -1.

    `blocks[p]` is the block (rows[p], k) of column k, `diagonal` (V, 3, 3). The factor's strictly lower blocks go to
    `factor` by columns from `column_starts`, `inverses` (V, 3, 3) takes the inverses of its diagonal blocks.
    """
    size = len(pointers) - 1
    work = np.zeros((size, 3, 3))  # block row k of what is left of the matrix: work[i] = A[k, i] - ...
    ends = column_starts[:size].copy()
    flags, stack, path = np.full(size, -1, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for k in range(size):
        top = size
        flags[k] = k
        for p in range(pointers[k], pointers[k + 1]):
            i = rows[p]
            for r in range(3):
                for c in range(3):
                    work[i, r, c] = blocks[p, c, r]
            depth = 0
            while flags[i] != k:
                path[depth] = i
                depth += 1
                flags[i] = k
                i = parents[i]
            while depth > 0:
                depth -= 1
                top -= 1
                stack[top] = path[depth]
        d00, d10, d11 = diagonal[k, 0, 0], diagonal[k, 1, 0], diagonal[k, 1, 1]
        d20, d21, d22 = diagonal[k, 2, 0], diagonal[k, 2, 1], diagonal[k, 2, 2]
        for s in range(top, size):
            j = stack[s]
            i00, i10, i11 = inverses[j, 0, 0], inverses[j, 1, 0], inverses[j, 1, 1]
            i20, i21, i22 = inverses[j, 2, 0], inverses[j, 2, 1], inverses[j, 2, 2]
            w00, w01, w02 = work[j, 0, 0], work[j, 0, 1], work[j, 0, 2]
            w10, w11, w12 = work[j, 1, 0], work[j, 1, 1], work[j, 1, 2]
            w20, w21, w22 = work[j, 2, 0], work[j, 2, 1], work[j, 2, 2]
            # L[k, j] = work[j] L[j, j]^-T
            a00, a01, a02 = w00 * i00, w00 * i10 + w01 * i11, w00 * i20 + w01 * i21 + w02 * i22
            a10, a11, a12 = w10 * i00, w10 * i10 + w11 * i11, w10 * i20 + w11 * i21 + w12 * i22
            a20, a21, a22 = w20 * i00, w20 * i10 + w21 * i11, w20 * i20 + w21 * i21 + w22 * i22
            for r in range(3):
                for c in range(3):
                    work[j, r, c] = 0.0
            for p in range(column_starts[j], ends[j]):
                i = factor_rows[p]
                for c in range(3):
                    l0, l1, l2 = factor[p, c, 0], factor[p, c, 1], factor[p, c, 2]
                    work[i, 0, c] -= a00 * l0 + a01 * l1 + a02 * l2
                    work[i, 1, c] -= a10 * l0 + a11 * l1 + a12 * l2
                    work[i, 2, c] -= a20 * l0 + a21 * l1 + a22 * l2
            d00 -= a00 * a00 + a01 * a01 + a02 * a02
            d10 -= a10 * a00 + a11 * a01 + a12 * a02
            d11 -= a10 * a10 + a11 * a11 + a12 * a12
            d20 -= a20 * a00 + a21 * a01 + a22 * a02
            d21 -= a20 * a10 + a21 * a11 + a22 * a12
            d22 -= a20 * a20 + a21 * a21 + a22 * a22
            p = ends[j]
            ends[j] += 1
            factor_rows[p] = k
            factor[p, 0, 0], factor[p, 0, 1], factor[p, 0, 2] = a00, a01, a02
            factor[p, 1, 0], factor[p, 1, 1], factor[p, 1, 2] = a10, a11, a12
            factor[p, 2, 0], factor[p, 2, 1], factor[p, 2, 2] = a20, a21, a22
        if not d00 > 0.0:
            return k
        l00 = math.sqrt(d00)
        l10, l20 = d10 / l00, d20 / l00
        d11 -= l10 * l10
        if not d11 > 0.0:
            return k
        l11 = math.sqrt(d11)
        l21 = (d21 - l20 * l10) / l11
        d22 -= l20 * l20 + l21 * l21
        if not d22 > 0.0:
            return k
        l22 = math.sqrt(d22)
        inverses[k, 0, 0], inverses[k, 1, 1], inverses[k, 2, 2] = 1.0 / l00, 1.0 / l11, 1.0 / l22
        inverses[k, 1, 0] = -l10 / (l00 * l11)
        inverses[k, 2, 1] = -l21 / (l11 * l22)
        inverses[k, 2, 0] = (l10 * l21 / l11 - l20) / (l00 * l22)
    return -1


@njit(cache=True, nogil=True)
def solve(column_starts, factor_rows, factor, inverses, vector):
    """Replace `vector` (V, 3) in place by the solution of L L' x = vector."""
    size = len(inverses)
    for j in range(size):
        b0, b1, b2 = vector[j, 0], vector[j, 1], vector[j, 2]
        x0 = inverses[j, 0, 0] * b0
        x1 = inverses[j, 1, 0] * b0 + inverses[j, 1, 1] * b1
        x2 = inverses[j, 2, 0] * b0 + inverses[j, 2, 1] * b1 + inverses[j, 2, 2] * b2
        vector[j, 0], vector[j, 1], vector[j, 2] = x0, x1, x2
        for p in range(column_starts[j], column_starts[j + 1]):
            i = factor_rows[p]
            for r in range(3):
                vector[i, r] -= factor[p, r, 0] * x0 + factor[p, r, 1] * x1 + factor[p, r, 2] * x2
    for j in range(size - 1, -1, -1):
        b0, b1, b2 = vector[j, 0], vector[j, 1], vector[j, 2]
        for p in range(column_starts[j], column_starts[j + 1]):
            i = factor_rows[p]
            v0, v1, v2 = vector[i, 0], vector[i, 1], vector[i, 2]
            b0 -= factor[p, 0, 0] * v0 + factor[p, 1, 0] * v1 + factor[p, 2, 0] * v2
            b1 -= factor[p, 0, 1] * v0 + factor[p, 1, 1] * v1 + factor[p, 2, 1] * v2
            b2 -= factor[p, 0, 2] * v0 + factor[p, 1, 2] * v1 + factor[p, 2, 2] * v2
        vector[j, 0] = inverses[j, 0, 0] * b0 + inverses[j, 1, 0] * b1 + inverses[j, 2, 0] * b2
        vector[j, 1] = inverses[j, 1, 1] * b1 + inverses[j, 2, 1] * b2
        vector[j, 2] = inverses[j, 2, 2] * b2


@njit(cache=True, nogil=True, inline="always")
def _add_product(out, left, right, transpose):
    """Add left right, or left' right, to `out` (3, 3)."""
    for r in range(3):
        for c in range(3):
            total = 0.0
            for i in range(3):
                total += (left[i, r] if transpose else left[r, i]) * right[i, c]
            out[r, c] += total


@njit(cache=True, nogil=True)
def invert_diagonal(column_starts, factor_rows, factor, inverses, selected, out):
    """Fill `out` (V, 3, 3) with the diagonal blocks of the inverse of L L' (Takahashi's equations, from the last up).

    `selected` takes the inverse's blocks where the factor has some; Erisman and Tinney, Communications of the ACM 1975.
    """
    size = len(inverses)
    longest = 0
    for j in range(size):
        longest = max(longest, column_starts[j + 1] - column_starts[j])
    scaled, sums = np.zeros((longest, 3, 3)), np.zeros((longest, 3, 3))
    for j in range(size - 1, -1, -1):
        begin, end = column_starts[j], column_starts[j + 1]
        for p in range(begin, end):
            scaled[p - begin] = 0.0
            sums[p - begin] = 0.0
            _add_product(scaled[p - begin], factor[p], inverses[j], False)
        for p in range(begin, end):
            a, row = p - begin, factor_rows[p]
            _add_product(sums[a], out[row], scaled[a], False)
            q, q_end = column_starts[row], column_starts[row + 1]
            for other in range(p + 1, end):
                wanted = factor_rows[other]
                while q < q_end and factor_rows[q] < wanted:
                    q += 1
                _add_product(sums[other - begin], selected[q], scaled[a], False)
                _add_product(sums[a], selected[q], scaled[other - begin], True)
        out[j] = 0.0
        _add_product(out[j], inverses[j], inverses[j], True)
        for p in range(begin, end):
            selected[p] = -sums[p - begin]
            _add_product(out[j], scaled[p - begin], sums[p - begin], True)
