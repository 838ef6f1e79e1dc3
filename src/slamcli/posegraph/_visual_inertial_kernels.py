# SPDX-License-Identifier: MIT
"""Sums of visual and inertial terms in one matrix of 6 x 6 blocks."""

from __future__ import annotations

from numba import njit

SIZE = 6


@njit(cache=True, nogil=True)
def add_visual(rows, columns, blocks, ranks, slots, out):
    """Add blocks (B, 6, 6) between cameras `rows` and `columns` to `out`, where the cameras have other `ranks`."""
    for b in range(len(rows)):
        row, column = ranks[rows[b]], ranks[columns[b]]
        if row <= column:
            out[slots[row, column]] += blocks[b]
        else:
            out[slots[column, row]] += blocks[b].T


@njit(cache=True, nogil=True)
def add_links(nodes, derivatives, residuals, weights, ranks, slots, blocks, gradient):
    """Add weighted J'J to `blocks` and J'r to `gradient` (N, 6).

    `nodes` (K, 7) are variables or -1, `derivatives` (K, R, 42) six columns for each of them, `residuals` (K, R).
    """
    height = residuals.shape[1]
    for k in range(len(nodes)):
        for a in range(nodes.shape[1]):
            if nodes[k, a] < 0:
                continue
            row = ranks[nodes[k, a]]
            for i in range(SIZE):
                total = 0.0
                for m in range(height):
                    total += derivatives[k, m, SIZE * a + i] * residuals[k, m]
                gradient[row, i] += weights[k] * total
            for b in range(nodes.shape[1]):
                if nodes[k, b] < 0 or ranks[nodes[k, b]] < row:
                    continue
                block = blocks[slots[row, ranks[nodes[k, b]]]]
                for i in range(SIZE):
                    for j in range(SIZE):
                        total = 0.0
                        for m in range(height):
                            total += derivatives[k, m, SIZE * a + i] * derivatives[k, m, SIZE * b + j]
                        block[i, j] += weights[k] * total
