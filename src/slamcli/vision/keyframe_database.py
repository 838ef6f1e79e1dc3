# SPDX-License-Identifier: MIT
"""Keyframes by the words they show: candidates for relocalisation and for places seen before.

Mur-Artal and Tardos, T-RO 2017 (VI-A of Mur-Artal et al., T-RO 2015), and Campos et al., T-RO 2021, V-A.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.vision import _inverted_file_kernels as kernels
from slamcli.vision.bag_of_words import BagOfWords
from slamcli.vision.vocabulary import Vocabulary

Neighbours = Callable[[int], NDArray[np.int64]]
"""Gives the keyframes that share most points with one, the best first; the first ten count."""
_GROUP = 10
_COMMON_SHARE = 0.8
"""Of the most common words that any keyframe has: fewer, and a keyframe is not scored."""
_SCORE_SHARE = 0.75
"""Of the best accumulated score: less, and a group is no candidate for relocalisation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A keyframe that may show the same place."""

    key: int
    score: float
    """Of the keyframe itself, 0 to 1."""
    group_score: float
    """Sum of the scores of the keyframe that led here and of those that share most points with it."""
    num_words: int
    """Words in common."""


class KeyframeDatabase:
    """An inverted file: for each word the keyframes that show it.

    Keys are whole numbers from 0, such as the rows of keyframes in a map; memory goes with the largest key. Results depend
    on what is in the file and the order of the keys only, not on the order in which keyframes came and went.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self._heads = np.full(vocabulary.num_words, -1, np.int64)
        self._alive = np.zeros(0, np.bool_)
        self._lengths = np.zeros(0, np.int64)
        self._following = np.zeros(0, np.int64)
        self._terms = np.zeros(0, np.int64)
        self._keys = np.zeros(0, np.int64)
        self._values = np.zeros(0)
        self._size = 0
        self._dead = 0

    def __len__(self) -> int:
        """Return the number of keyframes."""
        return int(np.count_nonzero(self._alive))

    def __contains__(self, key: int) -> bool:
        """Whether a keyframe is in the file."""
        return 0 <= key < len(self._alive) and bool(self._alive[key])

    def add(self, key: int, bag: BagOfWords) -> None:
        """Put a keyframe into the file.

        Raises
        ------
        DataError
            If the key is negative or there already.
        """
        if key < 0 or key in self:
            raise DataError(f"keyframe database: key {key} is negative or there already")
        if self._dead and key < len(self._lengths) and self._lengths[key]:
            self._compact()  # the key was erased: its old entries must not come back to life
        missing = max(0, key + 1 - len(self._alive))
        self._alive, self._lengths = np.pad(self._alive, (0, missing)), np.pad(self._lengths, (0, missing))
        need = self._size + len(bag.words)
        self._following, self._terms = _grown(self._following, need), _grown(self._terms, need)
        self._keys, self._values = _grown(self._keys, need), _grown(self._values, need)
        lists = (self._heads, self._following, self._terms, self._keys, self._values)
        self._size = int(kernels.insert(bag.words, bag.weights, key, self._size, *lists))
        self._alive[key] = True
        self._lengths[key] = len(bag.words)

    def erase(self, key: int) -> None:
        """Take a keyframe out of the file; one that is not there is no error."""
        if key not in self:
            return
        self._alive[key] = False
        self._dead += int(self._lengths[key])
        if 2 * self._dead > self._size:
            self._compact()

    def scores(self, bag: BagOfWords) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return for each key the number of words in common with a bag, and `bag_of_words.similarity`; 0 for keys not there."""
        common, scores = np.zeros(len(self._alive), np.int64), np.zeros(len(self._alive))
        kernels.compare(
            bag.words, bag.weights, self._heads, self._following, self._keys, self._values, self._alive, common, scores
        )
        return common, scores

    def relocalisation_candidates(
        self, bag: BagOfWords, neighbours: Neighbours, *, allowed: NDArray[np.bool_] | None = None
    ) -> list[Candidate]:
        """Return keyframes in which a frame may be found again, the best group first.

        Those with at least 0.8 of the most common words are scored; scores are added up over keyframes that share points;
        of each group with at least 0.75 of the best sum, the keyframe with the best score is returned, once.

        Parameters
        ----------
        allowed
            bool (K,) by key: keyframes that may be returned (those of one map); None: all. Others do not count at all.
        """
        groups = self._groups(bag, neighbours, self._mask(allowed))
        best = max((group.group_score for group in groups), default=0.0)
        return _unique(group for group in groups if group.group_score >= _SCORE_SHARE * best)

    def place_candidates(
        self, bag: BagOfWords, neighbours: Neighbours, *, excluded: NDArray[np.bool_] | None = None, limit: int = 3
    ) -> list[Candidate]:
        """Return the `limit` keyframes most likely to show the place of a bag, the best group first.

        Parameters
        ----------
        excluded
            bool (K,) by key: those connected with the keyframe that asks, the keyframe itself, and those of maps that are
            not asked about. They do not count at all.
        """
        allowed = None if excluded is None else ~self._padded(excluded)
        return _unique(self._groups(bag, neighbours, self._mask(allowed)))[:limit]

    def _mask(self, allowed: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        return self._alive if allowed is None else self._alive & self._padded(allowed)

    def _padded(self, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        padded = np.zeros(len(self._alive), np.bool_)
        known = min(len(mask), len(padded))
        padded[:known] = mask[:known]
        return padded

    def _groups(self, bag: BagOfWords, neighbours: Neighbours, mask: NDArray[np.bool_]) -> list[Candidate]:
        """Return for each scored keyframe the best of its group, by falling sum of the group; ties by key."""
        common, scores = self.scores(bag)
        common = np.where(mask, common, 0)
        if not common.any():
            return []
        scored = common >= max(1.0, _COMMON_SHARE * int(common.max()))
        groups = []
        for key in np.flatnonzero(scored).tolist():
            members = np.array(
                [key, *(k for k in neighbours(key)[:_GROUP].tolist() if k != key and k < len(scored) and scored[k])]
            )
            best = int(members[np.argmax(scores[members])])
            groups.append(
                Candidate(
                    key=best,
                    score=float(scores[best]),
                    group_score=float(scores[members].sum()),
                    num_words=int(common[best]),
                )
            )
        return sorted(groups, key=lambda group: (-group.group_score, group.key))

    def _compact(self) -> None:
        self._size = int(
            kernels.drop(self._alive, self._size, self._heads, self._following, self._terms, self._keys, self._values)
        )
        self._lengths[~self._alive] = 0
        self._dead = 0


def _unique(groups: Iterable[Candidate]) -> list[Candidate]:
    found: dict[int, Candidate] = {}
    for group in groups:
        found.setdefault(group.key, group)
    return list(found.values())


def _grown(array: NDArray[Any], size: int) -> NDArray[Any]:
    """Return the array with room for `size` entries, doubled where it has to grow."""
    if size <= len(array):
        return array
    grown = np.zeros(max(size, 2 * len(array)), array.dtype)
    grown[: len(array)] = array
    return grown


def warm() -> None:
    """Compile the kernels of this module."""
    from slamcli.vision.vocabulary import vocabulary

    tiny = vocabulary(
        branching=2, depth=1, weighting="tf-idf", descriptors=np.zeros((3, 32), np.uint8),
        num_children=np.array([2, 0, 0]), weights=np.ones(3),
    )  # fmt: skip
    database = KeyframeDatabase(tiny)
    bag = BagOfWords(words=np.array([0, 1]), weights=np.array([0.5, 0.5]), nodes=np.zeros(2, np.int64))
    database.add(0, bag)
    database.scores(bag)
    database.erase(0)
