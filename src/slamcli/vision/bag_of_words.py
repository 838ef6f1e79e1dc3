# SPDX-License-Identifier: MIT
"""Images as bags of words, and how alike two of them are (Galvez-Lopez and Tardos, T-RO 2012, III and IV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.vision.vocabulary import Vocabulary


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BagOfWords:
    """What an image looks like, in the words of a vocabulary."""

    words: NDArray[np.int64]
    """(W,), increasing."""
    weights: NDArray[np.float64]
    """(W,), positive; they add up to 1 (W > 0)."""
    nodes: NDArray[np.int64]
    """(N,), node of the vocabulary's matching level for each of the image's features; see `Words.nodes`."""


def bag_of_words(vocabulary: Vocabulary, descriptors: NDArray[np.uint8]) -> BagOfWords:
    """Return the bag of an image's descriptors, uint8 (N, 32).

    A word that occurs n times weighs n times as much where the vocabulary's weighting counts terms ("tf-idf", "tf").
    Words of weight 0 are left out.

    Raises
    ------
    DataError
        If the descriptors have another shape or type.
    """
    found = vocabulary.words(descriptors)
    useful = found.weights > 0.0
    words, first, counts = np.unique(found.words[useful], return_index=True, return_counts=True)
    weights = found.weights[useful][first]
    if vocabulary.weighting in ("tf-idf", "tf"):
        weights = weights * counts
    if len(words):
        weights = weights / weights.sum()
    return BagOfWords(words=words, weights=weights, nodes=found.nodes)


def similarity(a: BagOfWords, b: BagOfWords) -> float:
    """Return how alike two bags are: 1 - |a - b|_1 / 2, from 0 (no word in common) to 1 (the same).

    Notes
    -----
    Equation 2 of the paper. As the weights of a bag add up to 1, this is the sum of the smaller weight over common words.
    """
    _, in_a, in_b = np.intersect1d(a.words, b.words, assume_unique=True, return_indices=True)
    return float(np.minimum(a.weights[in_a], b.weights[in_b]).sum())
