# SPDX-License-Identifier: MIT
"""Sparse Cholesky factors of symmetric matrices of 6 x 6 blocks, row by row.

Davis, Direct Methods for Sparse Linear Systems, 2006, sections 4.1 and 4.7.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SIZE = 6


@njit(cache=True, nogil=True)
def elimination_tree(pointers, rows):
    """Parents (V,) and blocks below the diagonal per column (V,) of the factor; `rows` above the diagonal by columns."""
    size = len(pointers) - 1
    parents, roots = np.full(size, -1, np.int64), np.full(size, -1, np.int64)
    counts, flags = np.zeros(size, np.int64), np.full(size, -1, np.int64)
    for k in range(size):
        for p in range(pointers[k], pointers[k + 1]):
            i = rows[p]
            while i != -1 and i < k:
                following = roots[i]
                roots[i] = k
                if following == -1:
                    parents[i] = k
                i = following
        flags[k] = k
        for p in range(pointers[k], pointers[k + 1]):
            i = rows[p]
            while flags[i] != k:
                counts[i] += 1
                flags[i] = k
                i = parents[i]
    return parents, counts


@njit(cache=True, nogil=True)
def _factorise_block(block, factor):
    """Cholesky factor of a symmetric block (6, 6), its lower part, with inverted diagonal; False if not definite."""
    for i in range(SIZE):
        for j in range(i + 1):
            total = block[i, j]
            for t in range(j):
                total -= factor[i, t] * factor[j, t]
            if i == j:
                if not total > 0.0:
                    return False
                factor[i, i] = 1.0 / math.sqrt(total)
            else:
                factor[i, j] = total * factor[j, j]
    return True


@njit(cache=True, nogil=True)
def _subtract_product(left, right, out):
    """Subtract left right' from `out`, with `right` given transposed; all (6, 6)."""
    for r in range(SIZE):
        o0, o1, o2, o3, o4, o5 = out[r, 0], out[r, 1], out[r, 2], out[r, 3], out[r, 4], out[r, 5]
        for t in range(SIZE):
            a = left[r, t]
            o0 -= a * right[t, 0]
            o1 -= a * right[t, 1]
            o2 -= a * right[t, 2]
            o3 -= a * right[t, 3]
            o4 -= a * right[t, 4]
            o5 -= a * right[t, 5]
        out[r, 0], out[r, 1], out[r, 2], out[r, 3], out[r, 4], out[r, 5] = o0, o1, o2, o3, o4, o5


@njit(cache=True, nogil=True)
def factorise(pointers, rows, blocks, parents, starts, factor_rows, factor, diagonal):
    """Factorise; return the variable at which the matrix is not positive definite, or -1.

    Column k holds the blocks (rows[p], k) = blocks[p], rows ascending up to the diagonal, of whose block only the upper
    part counts. `factor` takes the transposed blocks below the diagonal by columns from `starts`,
    `diagonal` (V, 6, 6) the factors of the diagonal blocks with inverted diagonals.
    """
    size = len(pointers) - 1
    work, left = np.zeros((size, SIZE, SIZE)), np.empty((SIZE, SIZE))
    ends = starts[:size].copy()
    flags, stack, path = np.full(size, -1, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    for k in range(size):
        top = size
        flags[k] = k
        for p in range(pointers[k], pointers[k + 1] - 1):
            i = rows[p]
            block = blocks[p]
            for r in range(SIZE):
                for c in range(SIZE):
                    work[i, r, c] = block[c, r]
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
        own = blocks[pointers[k + 1] - 1]
        for r in range(SIZE):
            for c in range(SIZE):
                work[k, r, c] = own[c, r] if c < r else own[r, c]
        for s in range(top, size):
            j = stack[s]
            triangle = diagonal[j]
            for r in range(SIZE):  # L[k, j] = work[j] L[j, j]^-T
                for c in range(SIZE):
                    total = work[j, r, c]
                    for t in range(c):
                        total -= left[r, t] * triangle[c, t]
                    left[r, c] = total * triangle[c, c]
            work[j] = 0.0
            for p in range(starts[j], ends[j]):
                _subtract_product(left, factor[p], work[factor_rows[p]])
            p = ends[j]
            ends[j] += 1
            factor_rows[p] = k
            for r in range(SIZE):
                for c in range(SIZE):
                    factor[p, c, r] = left[r, c]
            _subtract_product(left, factor[p], work[k])
        if not _factorise_block(work[k], diagonal[k]):
            return k
        work[k] = 0.0
    return -1


@njit(cache=True, nogil=True)
def solve(starts, factor_rows, factor, diagonal, vector):
    """Replace `vector` (V, 6) by the solution of L L' x = vector."""
    size = len(diagonal)
    for j in range(size):
        for r in range(SIZE):
            total = vector[j, r]
            for t in range(r):
                total -= diagonal[j, r, t] * vector[j, t]
            vector[j, r] = total * diagonal[j, r, r]
        for p in range(starts[j], starts[j + 1]):
            i = factor_rows[p]
            for r in range(SIZE):
                total = 0.0
                for t in range(SIZE):
                    total += factor[p, t, r] * vector[j, t]
                vector[i, r] -= total
    for j in range(size - 1, -1, -1):
        for p in range(starts[j], starts[j + 1]):
            i = factor_rows[p]
            for t in range(SIZE):
                total = 0.0
                for r in range(SIZE):
                    total += factor[p, t, r] * vector[i, r]
                vector[j, t] -= total
        for r in range(SIZE - 1, -1, -1):
            total = vector[j, r]
            for t in range(r + 1, SIZE):
                total -= diagonal[j, t, r] * vector[j, t]
            vector[j, r] = total * diagonal[j, r, r]
