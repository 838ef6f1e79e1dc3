# SPDX-License-Identifier: MIT
"""How much each place in memory looks like what the robot sees now.

References
----------
M. Labbé, F. Michaud, IEEE T-RO 29(3), 2013, doi:10.1109/TRO.2013.2242375, section III-D.
A. Angeli, D. Filliat, S. Doncieux, J.-A. Meyer, IEEE T-RO 24(5), 2008, doi:10.1109/TRO.2008.2004514.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError
from slamcli.rtabmap import _place_kernels as kernels

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]

_EPSILON = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class WordBag:
    """The words of a place, each once."""

    words: Ids
    """int64 (N,), increasing."""
    counts: Ids
    """int64 (N,), key points of the place that show the word."""

    @property
    def total(self) -> int:
        """Key points with a word."""
        return int(self.counts.sum())


def word_bag(word_ids: Ids) -> WordBag:
    """Return the words of key points, of which those without one (0) do not count."""
    words, counts = np.unique(word_ids[word_ids > 0], return_counts=True)
    return WordBag(words, counts.astype(np.int64))


def similarity(a: WordBag, b: WordBag) -> float:
    """Return the share of key points that pair with one of the same word: 0 to 1; 0 if one place has no words."""
    total = max(a.total, b.total)
    if total == 0:
        return 0.0
    _, in_a, in_b = np.intersect1d(a.words, b.words, assume_unique=True, return_indices=True)
    return int(np.minimum(a.counts[in_a], b.counts[in_b]).sum()) / total


class InvertedFile:
    """For each word the places that show it, and how often."""

    def __init__(self) -> None:
        self._rows = _Rows()
        self._places = _Rows()
        self._bags: dict[int, Ids] = {}
        self._lists = np.full(0, -1, np.int64)
        self._totals = np.zeros(0, np.int64)
        self._following = np.zeros(0, np.int64)
        self._entry_places = np.zeros(0, np.int64)
        self._values = np.zeros(0, np.int64)
        self._free = np.zeros(0, np.int64)
        self._num_free = 0

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self._bags)

    def __contains__(self, place: int) -> bool:
        """Return whether a place is in the file."""
        return place in self._bags

    def add(self, place: int, bag: WordBag) -> None:
        """Put a place into the file.

        Raises
        ------
        DataError
            If it is there already.
        """
        if place in self._bags:
            raise DataError(f"inverted file: place {place} is there already")
        rows = self._rows.take(bag.words.tolist())
        slot = int(self._places.take([place])[0])
        self._lists = _grown(self._lists, self._rows.room, -1)
        self._totals = _grown(self._totals, self._places.room, 0)
        self._totals[slot] = bag.total
        if len(rows) > self._num_free:
            self._make_room(len(rows))
        self._num_free = int(
            kernels.insert(
                rows, bag.counts, slot, self._lists, self._following, self._entry_places, self._values, self._free,
                self._num_free,
            )
        )  # fmt: skip
        self._bags[place] = bag.words

    def remove(self, place: int) -> None:
        """Take a place out of the file; one that is not there is no error."""
        words = self._bags.pop(place, None)
        if words is None:
            return
        numbers = words.tolist()
        rows, slot = self._rows.find(numbers), int(self._places.find([place])[0])
        self._num_free = int(
            kernels.remove(
                rows, slot, self._lists, self._following, self._entry_places, self._free, self._num_free
            )
        )  # fmt: skip
        self._places.give_back([place])
        self._rows.give_back([word for word, row in zip(numbers, rows.tolist(), strict=True) if self._lists[row] < 0])

    def scores(self, bag: WordBag, places: Ids) -> tuple[Floats, Floats]:
        """Return how much places look like a query.

        Parameters
        ----------
        bag
            Words of the query, which is in the file itself, so that N and N_w count it (as RTAB-Map does).
        places
            int64 (M,), of the file.

        Returns
        -------
        The tf-idf sum over the words of the query of (n_wi / n_i) log10(N / N_w), and the share of key points that pair with one
        of the same word (`similarity`), float64 (M,) each.
        """
        known = np.array([word in self._rows for word in bag.words.tolist()], np.bool_)
        rows = self._rows.find(bag.words[known].tolist())
        sums, common = np.zeros(self._places.room), np.zeros(self._places.room, np.int64)
        kernels.score(
            rows, bag.counts[known], self._lists, self._following, self._entry_places, self._values, self._totals,
            float(len(self._bags)), sums, common,
        )  # fmt: skip
        slots = self._places.find(places.tolist())
        most = np.maximum(self._totals[slots], bag.total)
        return sums[slots], common[slots] / np.maximum(most, 1)

    def _make_room(self, need: int) -> None:
        size = len(self._following)
        more = max(need - self._num_free, size, 1024)
        self._following = _grown(self._following, size + more, -1)
        self._entry_places = _grown(self._entry_places, size + more, 0)
        self._values = _grown(self._values, size + more, 0)
        self._free = _grown(self._free, size + more, 0)
        self._free[self._num_free : self._num_free + more] = np.arange(size + more - 1, size - 1, -1)
        self._num_free += more


class _Rows:
    """Rows of arrays for numbers that come and go; rows are given away again."""

    def __init__(self) -> None:
        self._rows: dict[int, int] = {}
        self._free: list[int] = []
        self.room = 0

    def __contains__(self, number: int) -> bool:
        return number in self._rows

    def take(self, numbers: list[int]) -> Ids:
        """Return the rows of numbers; those without one get one."""
        for number in numbers:
            if number not in self._rows:
                if self._free:
                    self._rows[number] = self._free.pop()
                else:
                    self._rows[number] = self.room
                    self.room += 1
        return self.find(numbers)

    def find(self, numbers: list[int]) -> Ids:
        return np.array([self._rows[number] for number in numbers], np.int64)

    def give_back(self, numbers: list[int]) -> None:
        self._free.extend(self._rows.pop(number) for number in numbers)


def _grown(array: NDArray[Any], size: int, fill: int) -> NDArray[Any]:
    """Return the array with at least `size` entries, doubled where it has to grow."""
    if size <= len(array):
        return array
    grown = np.full(max(size, 2 * len(array)), fill, array.dtype)
    grown[: len(array)] = array
    return grown


def adjusted(scores: Floats, *, ratio: int = 0) -> Floats:
    """Return likelihoods that stand out, after those of the virtual place that none of them is meant.

    Parameters
    ----------
    scores
        float64 (M,), of `InvertedFile.scores`.
    ratio
        `Rtabmap/VirtualPlaceLikelihoodRatio`.

    Returns
    -------
    float64 (M + 1,), the virtual place first. With mean and standard deviation of the scores above 0, a score above mean +
    deviation becomes (score - (deviation - 0.0001)) / mean, or (score - mean) / deviation if `ratio` is 1; all others 1. The virtual
    place has mean / deviation + 1, or deviation / (maximum - mean) + 1; 2 where all scores are alike.
    """
    shown = scores[scores > 0.0]
    mean = float(shown.mean()) if len(shown) else 0.0
    deviation = float(shown.std(ddof=1)) if len(shown) > 1 else 0.0
    highest = float(scores.max(initial=0.0))
    values = np.ones(len(scores) + 1)
    high = scores > mean + deviation
    if ratio == 0 and mean > 0.0:
        values[1:][high] = (scores[high] - (deviation - _EPSILON)) / mean
    elif ratio != 0 and deviation > 0.0:
        values[1:][high] = (scores[high] - mean) / deviation
    values[0] = 2.0
    if deviation > _EPSILON and highest > 0.0:
        if ratio == 0:
            values[0] = mean / deviation + 1.0
        elif highest > mean:
            values[0] = deviation / (highest - mean) + 1.0
    return values


def warm() -> None:
    """Compile the kernels of this module."""
    file, bag = InvertedFile(), word_bag(np.array([1, 2], np.int64))
    file.add(1, bag)
    file.add(2, bag)
    file.scores(bag, np.array([1], np.int64))
    file.remove(1)
