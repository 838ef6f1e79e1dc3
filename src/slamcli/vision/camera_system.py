# SPDX-License-Identifier: MIT
"""The reduced system of cameras: which pairs share points, in which order they are eliminated, and the solution."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from slamcli.vision import _camera_system_kernels as kernels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
SMALL = 32  # cameras up to which the order does not matter
DENSE = 0.7  # share of pairs from which on it does not matter either


class CameraSystem:
    """A symmetric matrix of 6 x 6 blocks, one row for each of F cameras, most pairs empty in a large map.

    Blocks are stored by columns of the elimination order, the diagonal last.
    """

    def __init__(self, pairs: NDArray[np.bool_], *, shared: bool = False) -> None:
        """Take the pairs (F, F) that share points, upper part with the diagonal, in the order of cameras.

        With `shared` the last row is not a camera but what all have in common; it is eliminated last.
        """
        size = len(pairs)
        self.size = size
        whole = pairs | pairs.T
        cameras = size - 1 if shared else size
        order = np.append(_elimination_order(whole[:cameras, :cameras]), np.arange(cameras, size))
        self.ranks: Integers = np.empty(size, np.int64)
        """int64 (F,), when each camera is eliminated."""
        self.ranks[order] = np.arange(size)
        upper = np.triu(whole[np.ix_(order, order)])
        columns, rows = np.nonzero(upper.T)
        self.rows: Integers = rows.astype(np.int64)
        self.columns: Integers = columns.astype(np.int64)
        self.pointers: Integers = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=size))]).astype(
            np.int64
        )
        self.slots: Integers = np.full((size, size), -1, np.int64)
        """int64 (F, F), where the block of ranks [row, column] lies, row <= column; -1 for none."""
        self.slots[rows, columns] = np.arange(len(rows))
        self.diagonal_slots: Integers = self.pointers[1:] - 1
        self._parents, counts = kernels.elimination_tree(self.pointers, self.rows)
        self._starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self._factor_rows = np.empty(self._starts[-1], np.int64)
        self._factor = np.empty((self._starts[-1], 6, 6))
        self._triangles = np.zeros((size, 6, 6))

    def factorise(self, blocks: Floats) -> bool:
        """Factorise the matrix of blocks (B, 6, 6), of the diagonal ones the upper parts; whether it is definite."""
        failed = kernels.factorise(
            self.pointers, self.rows, blocks, self._parents, self._starts, self._factor_rows, self._factor,
            self._triangles,
        )  # fmt: skip
        return bool(failed < 0)

    def solve(self, right: Floats) -> Floats:
        """Return the solution (F, 6) for a right side (F, 6), both by rank."""
        solution = np.array(right, np.float64, order="C")
        kernels.solve(self._starts, self._factor_rows, self._factor, self._triangles, solution)
        return solution

    def last_information(self) -> Floats:
        """Return what the last row knows by itself, float64 (6, 6): the inverse of its covariance, of what was factorised."""
        triangle = np.tril(self._triangles[-1], -1) + np.diag(1.0 / np.diag(self._triangles[-1]))
        return triangle @ triangle.T

    def dense(self, blocks: Floats) -> Floats:
        """Return the matrix (6 F, 6 F) with rows in the order of cameras."""
        whole = np.zeros((self.size, 6, self.size, 6))
        whole[self.rows, :, self.columns] = blocks
        whole[self.columns, :, self.rows] = blocks.transpose(0, 2, 1)
        upper = np.triu(blocks[self.diagonal_slots])
        own = np.arange(self.size)
        whole[own, :, own] = upper + np.triu(upper, 1).transpose(0, 2, 1)
        return whole[self.ranks][:, :, self.ranks].reshape(6 * self.size, 6 * self.size)


def _elimination_order(pairs: NDArray[np.bool_]) -> Integers:
    """Return an order int64 (F,) of cameras that keeps the factor sparse: approximate minimum degree."""
    size = len(pairs)
    if size <= SMALL or pairs.mean() > DENSE:
        return np.arange(size)
    weights = csc_matrix(np.where(pairs, -1.0, 0.0) + np.diag(pairs.sum(axis=1) + 1.0))  # dominant: no pivoting
    factor = splu(weights, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return np.argsort(factor.perm_c).astype(np.int64)


def warm() -> None:
    """Compile the kernels of this module with two cameras."""
    system = CameraSystem(np.triu(np.ones((2, 2), np.bool_)))
    blocks = np.zeros((3, 6, 6))
    blocks[system.diagonal_slots] = np.eye(6)
    system.factorise(blocks)
    system.solve(np.ones((2, 6)))
