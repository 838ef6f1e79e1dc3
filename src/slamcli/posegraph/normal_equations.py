# SPDX-License-Identifier: MIT
"""Sparse normal equations of a graph of residuals: the structure is found once, then filled and factorised repeatedly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csgraph
from scipy.sparse.linalg import splu

from slamcli.posegraph import _block_kernels as kernels

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class NormalEquations:
    """J'WJ and J'Wr of residuals between variables of three numbers each, in blocks of 3 x 3.

    The elimination order is a minimum degree order of the graph of variables (SuperLU's, on A + A'); the factor is
    Cholesky's, so that one symbolic analysis serves every iteration and every call on the same graph.

    Parameters
    ----------
    held : bool (V,), variables that do not move, or (V, 3), which of their numbers.
    groups : int64 (N, K) each: the variables of the residuals of a group, -1 where a residual has none.
    together : variables of a pose, which follow each other: they are eliminated together.
    """

    def __init__(self, held: NDArray[np.bool_], groups: Sequence[Integers], together: int = 1) -> None:
        parts = np.broadcast_to(held if held.ndim == 2 else held[:, None], (len(held), 3))
        free = np.flatnonzero(~parts.all(axis=1))
        place = np.full(len(held) + 1, -1, np.int64)  # the last serves variable -1
        place[free] = free // together
        turn = _elimination_turns(-(-len(held) // together), [place[group] for group in groups])
        self.variables: Integers = free[np.argsort(turn[free // together], kind="stable")]
        """int64 (F,), the variables that move, in the order of their elimination."""
        place[self.variables] = np.arange(len(free))
        self._groups = [np.ascontiguousarray(place[group]) for group in groups]
        self._set_pattern(len(free))
        self._slots = [self._slots_of(group) for group in self._groups]
        self._held_parts = np.nonzero(parts[self.variables])
        self._held_columns = [_held_columns(group, parts) for group in groups]
        self.gradient = np.zeros((len(free), 3))
        self.diagonal = np.zeros((len(free), 3, 3))
        self._blocks = np.zeros((len(self._rows), 3, 3))
        self.clear()

    def _set_pattern(self, size: int) -> None:
        """Set the pattern of the matrix above its diagonal and of its factor."""
        self._keys = _pair_keys(self._groups, size)
        columns, self._rows = np.divmod(self._keys, max(size, 1))
        self._pointers = np.searchsorted(columns, np.arange(size + 1)).astype(np.int64)
        self._parents, counts = kernels.elimination_tree(self._pointers, self._rows)
        self._starts = np.concatenate([[0], np.cumsum(counts - 1)]).astype(np.int64)
        self._factor_rows = np.zeros(self._starts[-1], np.int64)
        self._factor = np.zeros((self._starts[-1], 3, 3))
        self._inverses = np.zeros((size, 3, 3))

    def _slots_of(self, group: Integers) -> Integers:
        """Where the block of each pair of variables of each residual lies, int64 (N, K, K); -1 for none."""
        size = len(self.variables)
        a, b = group[:, :, None], group[:, None, :]
        wanted = (a >= 0) & (a < b)
        slots = np.full(wanted.shape, -1, np.int64)
        slots[wanted] = np.searchsorted(self._keys, (b * size + a)[wanted])
        return slots

    @property
    def fill(self) -> int:
        """The number of blocks of the factor below its diagonal."""
        return len(self._factor_rows)

    def clear(self) -> None:
        """Set the sums to zero, and to one where a number of a variable is held."""
        self.gradient[:] = 0.0
        self.diagonal[:] = 0.0
        variables, axes = self._held_parts
        self.diagonal[variables, axes, axes] = 1.0
        self._blocks[:] = 0.0

    def add(self, group: int, jacobians: Floats, residuals: Floats, weights: Floats) -> None:
        """Add the residuals (N, M) of a group with their Jacobians (N, M, 3 K) and weights (N,) to the sums.

        Columns of `jacobians` that belong to held numbers are set to zero.
        """
        residual, column = self._held_columns[group]
        if len(residual):
            jacobians[residual, :, column] = 0.0
        slots, variables = self._slots[group], self._groups[group]
        kernels.accumulate(jacobians, residuals, weights, variables, slots, self._blocks, self.diagonal, self.gradient)

    def factorise(self, damping: Floats) -> bool:
        """Factorise the sum plus `damping` (F, 3) on its diagonal; whether it is positive definite."""
        diagonal = self.diagonal.copy()
        for i in range(3):
            diagonal[:, i, i] += damping[:, i]
        failed = kernels.factorise(
            self._pointers, self._rows, self._blocks, diagonal, self._parents,
            self._starts, self._factor_rows, self._factor, self._inverses,
        )  # fmt: skip
        return bool(failed < 0)

    def solve(self, right: Floats) -> Floats:
        """Return the solution (F, 3) for a right side (F, 3), with the last factor."""
        solution = np.array(right, np.float64)
        kernels.solve(self._starts, self._factor_rows, self._factor, self._inverses, solution)
        return solution

    def inverse_columns(self, place: int) -> Floats:
        """Return the blocks (F, 3, 3) of the inverse of what was factorised last, in the block column `place`."""
        columns = np.zeros_like(self.diagonal)
        for axis in range(3):
            unit = np.zeros_like(self.gradient)
            unit[place, axis] = 1.0
            columns[:, :, axis] = self.solve(unit)
        return columns

    def inverse_diagonal(self) -> Floats:
        """Return the blocks (F, 3, 3) on the diagonal of the inverse of what was factorised last."""
        selected, out = np.zeros_like(self._factor), np.zeros_like(self.diagonal)
        kernels.invert_diagonal(self._starts, self._factor_rows, self._factor, self._inverses, selected, out)
        return out


def _held_columns(group: Integers, parts: NDArray[np.bool_]) -> tuple[Integers, Integers]:
    """Residuals and columns of their Jacobians that belong to single held numbers of variables that move otherwise."""
    partly = parts & ~parts.all(axis=1, keepdims=True)
    wanted = partly[group] & (group >= 0)[:, :, None]
    residual, column = np.nonzero(wanted.reshape(len(group), 3 * group.shape[1]))
    return residual.astype(np.int64), column.astype(np.int64)


def components(count: int, groups: Sequence[Integers]) -> Integers:
    """Return the number of the connected component of each of `count` variables, int64 (count,)."""
    keys = _pair_keys(groups, count)
    matrix = coo_matrix((np.ones(len(keys)), np.divmod(keys, max(count, 1))), shape=(count, count))
    return csgraph.connected_components(matrix, directed=False)[1].astype(np.int64)


def _pair_keys(groups: Sequence[Integers], size: int) -> Integers:
    """Return the pairs of variables that meet in a residual, as larger * size + smaller, in increasing order."""
    keys = [np.zeros(0, np.int64)]
    for group in groups:
        for i in range(group.shape[1]):
            for j in range(i + 1, group.shape[1]):
                low, high = np.minimum(group[:, i], group[:, j]), np.maximum(group[:, i], group[:, j])
                keys.append((high * size + low)[(low >= 0) & (low < high)])
    every = np.sort(np.concatenate(keys))
    return every[np.diff(every, prepend=-1) > 0]  # as np.unique, which is several times slower


def _elimination_turns(size: int, groups: Sequence[Integers]) -> Integers:
    """Return when each node is eliminated, int64 (size,), in an order that keeps the factor sparse."""
    keys = _pair_keys(groups, size)
    if len(keys) == 0:
        return np.arange(size)
    i, j = np.divmod(keys, size)
    degree = np.bincount(i, minlength=size) + np.bincount(j, minlength=size) + 1.0
    diagonal = np.arange(size)
    entries = np.concatenate(
        [-np.ones(2 * len(keys)), degree]
    )  # diagonally dominant: no pivoting, order by degree only
    rows, columns = np.concatenate([i, j, diagonal]), np.concatenate([j, i, diagonal])
    matrix = coo_matrix((entries, (rows, columns)), shape=(size, size)).tocsc()
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.perm_c.astype(np.int64)
