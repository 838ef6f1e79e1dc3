# SPDX-License-Identifier: MIT
"""Vocabularies from the descriptors of images: hierarchical k-majority (Galvez-Lopez and Tardos, T-RO 2012, III)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _vocabulary_kernels as kernels
from slamcli.vision.vocabulary import Vocabulary, as_words64, vocabulary


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingSettings:
    """Shape of the tree and how it is found."""

    branching: int = 10
    """Children of a node, 2 to 256."""
    depth: int = 4
    """Levels below the root, 1 to 10."""
    iterations: int = 50
    """At most so many rounds of assignment and vote at a node."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not (2 <= self.branching <= 256 and 1 <= self.depth <= 10 and self.iterations >= 0 and self.seed >= 0):
            raise DataError(
                f"vocabulary: branching {self.branching} must be 2 to 256, levels {self.depth} 1 to 10, and iterations and seed not negative"
            )


def train_vocabulary(images: Sequence[NDArray[np.uint8]], settings: TrainingSettings) -> Vocabulary:
    """Return a vocabulary of the descriptors of images, weighted by tf-idf.

    Parameters
    ----------
    images
        For each image uint8 (N_i, 32).

    Raises
    ------
    DataError
        If there are fewer than two different descriptors, or every word occurs in every image.

    Notes
    -----
    Words that occur in every image weigh 0 and are ignored from then on, as in DBoW2. A node whose descriptors are all
    the same is not split.
    """
    counts = [len(image) for image in images]
    everything = np.concatenate([np.zeros((0, 32), np.uint8), *images])
    descriptors = as_words64(everything)
    nodes, num_children = _grow(descriptors, settings)
    tree = vocabulary(
        branching=settings.branching, depth=settings.depth, weighting="tf-idf", descriptors=nodes,
        num_children=num_children, weights=np.ones(len(num_children)),
    )  # fmt: skip
    weights = np.zeros(len(num_children))
    weights[tree.num_children == 0] = _inverse_document_frequencies(tree, everything, counts)
    if not weights.any():
        raise DataError(
            f"vocabulary: every word occurs in every image, so none tells images apart: give more than {len(counts)} image{'s' if len(counts) != 1 else ''}, or ask for more words"
        )
    return vocabulary(
        branching=settings.branching, depth=settings.depth, weighting="tf-idf", descriptors=nodes,
        num_children=num_children, weights=weights,
    )  # fmt: skip


def _grow(descriptors: NDArray[np.uint64], settings: TrainingSettings) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return descriptors (M, 32) and numbers of children (M,) of the nodes, in breadth-first order."""
    generator = np.random.default_rng(settings.seed)
    nodes = [np.zeros((1, 4), np.uint64)]
    num_children: list[NDArray[np.int64]] = []
    level = [np.arange(len(descriptors))]
    for _ in range(settings.depth):
        split, below = np.zeros(len(level), np.int64), []
        for i, rows in enumerate(level):
            uniforms = generator.random(settings.branching)
            if len(rows) < 2:
                continue
            centres, groups = _split(descriptors, rows, uniforms, settings.iterations)
            if len(groups) > 1:
                split[i] = len(groups)
                nodes.append(centres)
                below.extend(groups)
        num_children.append(split)
        level = below
    num_children.append(np.zeros(len(level), np.int64))
    if num_children[0][0] == 0:
        raise DataError(
            f"vocabulary: {len(descriptors)} descriptors, of which fewer than two differ, are none to learn from"
        )
    return np.concatenate(nodes).view(np.uint8), np.concatenate(num_children)


def _split(
    descriptors: NDArray[np.uint64], rows: NDArray[np.int64], uniforms: NDArray[np.float64], iterations: int
) -> tuple[NDArray[np.uint64], list[NDArray[np.int64]]]:
    """Return the centres (C, 4) that have descriptors, and the rows of each."""
    centres, labels = np.zeros((len(uniforms), 4), np.uint64), np.empty(len(rows), np.int64)
    count = kernels.cluster(descriptors, rows, uniforms, iterations, centres, labels)
    groups = [rows[labels == label] for label in range(count)]
    kept = [label for label, group in enumerate(groups) if len(group)]
    return centres[kept], [groups[label] for label in kept]


def _inverse_document_frequencies(
    tree: Vocabulary, descriptors: NDArray[np.uint8], counts: Sequence[int]
) -> NDArray[np.float64]:
    """Return log(images / images with the word) of each word; 0 for a word that no descriptor comes to."""
    words = tree.words(descriptors).words
    image = np.repeat(np.arange(len(counts)), counts)
    seen = np.unique(words * len(counts) + image) // len(counts)
    documents = np.bincount(seen, minlength=tree.num_words)
    return np.where(documents > 0, np.log(len(counts) / np.maximum(documents, 1)), 0.0)


def warm() -> None:
    """Compile the kernels of this module."""
    ramp = np.arange(128, dtype=np.uint8).reshape(4, 32)
    train_vocabulary([ramp[:2], ramp[2:]], TrainingSettings(branching=2, depth=1))
