# SPDX-License-Identifier: MIT
"""A tree of binary words that turns ORB descriptors into words (Galvez-Lopez and Tardos, T-RO 2012)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _vocabulary_kernels as kernels

Weighting = Literal["tf-idf", "tf", "idf", "binary"]
WEIGHTINGS: tuple[Weighting, ...] = ("tf-idf", "tf", "idf", "binary")
"""In the order in which DBoW2 numbers them."""
_MATCHING_NODES = 32
"""At most so many groups of features for matching. ORB-SLAM has 100 (4 levels above the words of 6); with 10, a sixth more matches
are found between neighbouring frames for 0.9 instead of 0.3 ms of 1,000 features."""


class Words(NamedTuple):
    """What a vocabulary says of N descriptors."""

    words: NDArray[np.int64]
    """(N,), in [0, num_words)."""
    weights: NDArray[np.float64]
    """(N,), weight of the word; 0: a word that tells nothing."""
    nodes: NDArray[np.int64]
    """(N,), node of the vocabulary's `matching_level`: features of one node are worth comparing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vocabulary:
    """A tree of M nodes in breadth-first order, so that the children of a node follow each other; made by `vocabulary`."""

    branching: int
    """At most so many children has a node."""
    depth: int
    """At most so many levels lie below the root."""
    weighting: Weighting
    descriptors: NDArray[np.uint8]
    """(M, 32), C-contiguous; that of the root means nothing."""
    num_children: NDArray[np.int64]
    """(M,), 0: the node is a word."""
    first_child: NDArray[np.int64]
    """(M + 1,), index of the first child; the children end where those of the next node begin."""
    levels: NDArray[np.int64]
    """(M,), 0 is the root's."""
    weights: NDArray[np.float64]
    """(M,), of words (0 elsewhere), not negative."""
    word_of_node: NDArray[np.int64]
    """(M,), number of the word, -1 for inner nodes."""

    @property
    def num_words(self) -> int:
        """Number of leaves."""
        return int(np.count_nonzero(self.num_children == 0))

    @property
    def matching_level(self) -> int:
        """Level of `Words.nodes`: the deepest with at most 32 nodes, but below the root."""
        level = 1
        while level < self.depth and 0 < np.searchsorted(self.levels, level + 2) - np.searchsorted(self.levels, level + 1) <= _MATCHING_NODES:  # fmt: skip
            level += 1
        return level

    def words(self, descriptors: NDArray[np.uint8]) -> Words:
        """Return word, weight and matching node of descriptors.

        Parameters
        ----------
        descriptors
            uint8 (N, 32).

        Raises
        ------
        DataError
            If they have another shape or type.
        """
        given = as_words64(descriptors)
        leaves, nodes = np.empty(len(given), np.int64), np.empty(len(given), np.int64)
        kernels.descend(given, self.descriptors.view(np.uint64), self.first_child, self.matching_level, leaves, nodes)
        return Words(self.word_of_node[leaves], self.weights[leaves], nodes)


def vocabulary(
    *,
    branching: int,
    depth: int,
    weighting: Weighting,
    descriptors: NDArray[np.uint8],
    num_children: NDArray[np.int64],
    weights: NDArray[np.float64],
) -> Vocabulary:
    """Return the vocabulary of nodes in breadth-first order, the root first.

    Parameters
    ----------
    descriptors, num_children, weights
        uint8 (M, 32), int (M,), float (M,); weights of inner nodes are ignored.

    Raises
    ------
    DataError
        If these are no tree with words, or weights are negative or not finite.
    """
    count = len(num_children)
    if descriptors.shape != (count, 32) or descriptors.dtype != np.uint8 or weights.shape != (count,) or count < 2:
        raise DataError(
            f"vocabulary: {count} nodes with descriptors {descriptors.dtype} {descriptors.shape} and weights {weights.shape}"
        )
    num_children = np.ascontiguousarray(num_children, dtype=np.int64)
    if num_children.min() < 0 or num_children[0] == 0 or int(num_children.sum()) != count - 1:
        raise DataError(f"vocabulary: the numbers of children do not add up to {count - 1} nodes below the root")
    first_child = 1 + np.concatenate([[0], np.cumsum(num_children)])
    levels = _levels(num_children)
    if int(levels[-1]) > depth or int(num_children.max()) > branching:
        raise DataError(
            f"vocabulary: {int(num_children.max())} children and {int(levels[-1])} levels where {branching} and {depth} are declared"
        )
    is_word = num_children == 0
    weights = np.where(is_word, weights.astype(np.float64), 0.0)
    if not (np.isfinite(weights).all() and weights.min() >= 0.0):
        raise DataError("vocabulary: a weight is negative or not a number")
    return Vocabulary(
        branching=branching, depth=depth, weighting=weighting, descriptors=np.array(descriptors, order="C"),
        num_children=num_children, first_child=first_child.astype(np.int64), levels=levels, weights=weights,
        word_of_node=np.where(is_word, np.cumsum(is_word) - 1, -1),
    )  # fmt: skip


def breadth_first(parents: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the nodes of a tree in breadth-first order, and the number of children of each in that order.

    Parameters
    ----------
    parents
        int64 (M,); that of node 0, the root, is ignored. Children keep the order of their numbers.

    Raises
    ------
    DataError
        If a parent is no node, or a node does not hang together with the root.
    """
    count = len(parents)
    below = parents[1:]
    if count < 2 or below.min() < 0 or below.max() >= count:
        raise DataError("vocabulary: a node's parent does not exist")
    sizes = np.bincount(below, minlength=count)
    children = 1 + np.argsort(below, kind="stable")
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    order, level = [np.zeros(1, np.int64)], np.zeros(1, np.int64)
    reached = 1
    while len(level):
        many = sizes[level]
        within = np.arange(int(many.sum())) - np.repeat(np.cumsum(many) - many, many)
        level = children[np.repeat(starts[level], many) + within]
        reached += len(level)
        order.append(level)
    if reached != count:
        raise DataError(f"vocabulary: {count - reached} nodes do not hang together with the root")
    nodes = np.concatenate(order)
    return nodes, sizes[nodes]


def as_words64(descriptors: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return descriptors (N, 32) as the (N, 4) uint64 that kernels take: contiguous, aligned and writeable.

    Raises
    ------
    DataError
        If they have another shape or type.
    """
    if descriptors.ndim != 2 or descriptors.shape[1] != 32 or descriptors.dtype != np.uint8:
        raise DataError(f"descriptors are {descriptors.dtype} {descriptors.shape}, not uint8 (N, 32)")
    words = np.ascontiguousarray(descriptors).view(np.uint64)
    return np.require(words, requirements=["C", "A", "W"])  # one type for the compiler


def _levels(num_children: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the level of each node; the nodes are in breadth-first order.

    Raises
    ------
    DataError
        If a level is empty before the last node: then some nodes hang in the air.
    """
    levels = np.empty(len(num_children), np.int64)
    begin, end, level = 0, 1, 0
    while begin < len(levels):
        if begin == end:
            raise DataError("vocabulary: nodes hang in the air")
        levels[begin:end] = level
        begin, end, level = end, end + int(num_children[begin:end].sum()), level + 1
    return levels


def warm() -> None:
    """Compile the kernel of this module."""
    tiny = vocabulary(
        branching=2, depth=1, weighting="tf-idf", descriptors=np.zeros((3, 32), np.uint8),
        num_children=np.array([2, 0, 0]), weights=np.ones(3),
    )  # fmt: skip
    tiny.words(np.zeros((1, 32), np.uint8))
