# SPDX-License-Identifier: MIT
"""Visual words that are made while the robot drives, and forgotten when no place shows them any more.

References
----------
M. Labbé, F. Michaud, "Appearance-based loop closure detection for online large-scale and long-term operation", IEEE T-RO 29(3),
2013, doi:10.1109/TRO.2013.2242375, section III-A.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError, DataError
from slamcli.rtabmap import _dictionary_kernels as kernels
from slamcli.rtabmap.parameters.vision import KpGroup
from slamcli.vision.binary_index import BinaryIndex, pack

Ids = NDArray[np.int64]
Descriptors = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True)
class DictionarySettings:
    """``Kp/...``."""

    incremental: bool = True
    """Whether words are made and forgotten (`Kp/IncrementalDictionary`); else they are those that were given."""
    nndr_ratio: float = 0.8
    """A descriptor is of the nearest word if that is nearer than this share of the distance to the next (`Kp/NndrRatio`)."""
    new_words_compared_together: bool = True
    """Whether the words that an image makes are compared with its later descriptors (`Kp/NewWordsComparedTogether`)."""
    exact: bool = False
    """Whether all words are compared with (`Kp/NNStrategy` 0, 3 and 4), not only those that the index finds (1 and 2)."""


def dictionary_settings(kp: KpGroup) -> DictionarySettings:
    """Return how words are made and found."""
    return DictionarySettings(
        incremental=kp.incremental_dictionary, nndr_ratio=kp.nndr_ratio, exact=kp.nn_strategy in (0, 3),
        new_words_compared_together=kp.new_words_compared_together,
    )  # fmt: skip


class Dictionary:
    """Words, numbered from 1 in the order in which they were made; a number is never given twice.

    A word is the descriptor that made it. Each use of a word by a place in memory is a reference.
    """

    def __init__(self, settings: DictionarySettings | None = None) -> None:
        self.settings = settings or DictionarySettings()
        self._index = BinaryIndex()
        self._rows: dict[int, int] = {}
        self._ids = np.zeros(0, np.int64)
        self._references = np.zeros(0, np.int64)
        self._unused: dict[int, None] = {}
        self._made: list[Ids] = []
        self.last_id = 0
        """The highest number that was given; set it when a database with words is continued."""

    def __len__(self) -> int:
        """Return the number of words."""
        return len(self._rows)

    def __contains__(self, word: int) -> bool:
        """Return whether a word is there."""
        return word in self._rows

    def quantise(self, descriptors: Descriptors) -> Ids:
        """Return the word of each descriptor, int64 (N,); words that are missing are made.

        Parameters
        ----------
        descriptors
            uint8 (N, 32), the best first: of a pair that makes a word, the first is the word.

        Raises
        ------
        ConfigError
            If the dictionary is fixed and empty.
        DataError
            If the descriptors are not uint8 (N, 32).
        """
        found = self._index.nearest_two(descriptors, exact=self.settings.exact)
        if not self.settings.incremental:
            if len(descriptors) and not self._rows:
                raise ConfigError(
                    "Kp/IncrementalDictionary is false, but there are no words: Kp/DictionaryPath names the file"
                )
            return self._ids[found.rows[:, 0]]
        queries = pack(descriptors)
        chosen, new = np.zeros(len(queries), np.int64), np.zeros(len(queries), np.int64)
        together = self.settings.new_words_compared_together
        with np.errstate(over="ignore"):
            count = int(
                kernels.assign(
                    queries, found.rows, found.distances, float(self.settings.nndr_ratio), together, chosen, new
                )
            )
        ids = np.arange(self.last_id + 1, self.last_id + 1 + count)
        self.last_id += count
        words, made = np.zeros(len(queries), np.int64), chosen < 0
        words[made] = ids[-1 - chosen[made]]
        words[~made] = self._ids[chosen[~made]]
        self.add_words(ids, descriptors[new[:count]])
        if count:
            self._made.append(ids)
        return words

    def nearest(self, descriptors: Descriptors) -> Ids:
        """Return the word of each descriptor as `quantise` would, 0 where it would make one; nothing changes."""
        found = self._index.nearest_two(descriptors, exact=self.settings.exact)
        if not len(self._ids):
            return np.zeros(len(descriptors), np.int64)
        clear = found.rows[:, 0] >= 0
        if self.settings.incremental:
            clear = found.rows[:, 1] >= 0
            clear &= found.distances[:, 0] <= self.settings.nndr_ratio * found.distances[:, 1]
        return np.where(clear, self._ids[found.rows[:, 0]], 0)

    def add_words(self, ids: Ids, descriptors: Descriptors) -> None:
        """Take words in that no place refers to yet: of a file, of an earlier session, or of a place that is retrieved.

        Raises
        ------
        DataError
            If a number is not positive, or there already.
        """
        numbers = np.asarray(ids, np.int64).tolist()
        if len(set(numbers)) < len(numbers) or any(word < 1 or word in self._rows for word in numbers):
            raise DataError("dictionary: words have numbers from 1 on, and each is there once")
        rows = self._index.add(descriptors)
        highest = int(rows.max(initial=-1)) + 1
        if highest > len(self._ids):
            room = max(highest, 2 * len(self._ids)) - len(self._ids)
            self._ids = np.concatenate([self._ids, np.zeros(room, np.int64)])
            self._references = np.concatenate([self._references, np.zeros(room, np.int64)])
        self._ids[rows] = ids
        self._references[rows] = 0
        self._rows.update(zip(numbers, rows.tolist(), strict=True))
        self._unused.update(dict.fromkeys(numbers))
        self.last_id = max(self.last_id, max(numbers, default=0))

    def refer(self, words: Ids) -> None:
        """Count a reference for each word of a place; 0 stands for key points without a word."""
        self._count(words, 1)

    def release(self, words: Ids) -> None:
        """Take the references of a place back."""
        self._count(words, -1)

    def _count(self, words: Ids, step: int) -> None:
        used, times = np.unique(words[words > 0], return_counts=True)
        numbers = used.tolist()
        rows = np.array([self._rows[word] for word in numbers], np.int64)
        self._references[rows] += step * times
        for word, left in zip(numbers, self._references[rows].tolist(), strict=True):
            if left > 0:
                self._unused.pop(word, None)
            else:
                self._unused[word] = None

    def drop_unused(self) -> int:
        """Forget the words that no place in memory refers to, and return how many they were; a fixed dictionary keeps all."""
        if not self.settings.incremental or not self._unused:
            return 0
        numbers = sorted(self._unused)
        self._index.remove(np.array([self._rows.pop(word) for word in numbers], np.int64))
        self._unused.clear()
        return len(numbers)

    def take_made(self) -> tuple[Ids, Descriptors]:
        """Return the words that were made since the last call and are still there: their numbers and descriptors, to be stored."""
        made = np.concatenate([np.zeros(0, np.int64), *self._made])
        self._made = []
        numbers = [word for word in made.tolist() if word in self._rows]
        return np.array(numbers, np.int64), self.descriptors(np.array(numbers, np.int64))

    def descriptors(self, words: Ids) -> Descriptors:
        """Return uint8 (N, 32), what some words look like.

        Raises
        ------
        KeyError
            If one of them is not there.
        """
        return self._index.descriptors(np.array([self._rows[word] for word in words.tolist()], np.int64))


def warm() -> None:
    """Compile the kernels of this module."""
    dictionary = Dictionary()
    dictionary.quantise(np.zeros((2, 32), np.uint8))
