# SPDX-License-Identifier: MIT
"""What a session knows of places: the words of its keyframes, where a lost frame may be, which loops and maps belong together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.loop_closing import Closure, LoopClosing
from slamcli.orbslam3.place_index import Place, PlaceIndex
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.relocalisation import Relocalisation, RelocalisationSettings, alike, relocalise
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.vision.bag_of_words import BagOfWords, bag_of_words
from slamcli.vision.vocabulary import Vocabulary

_BESIDE = 3
"""Neighbours of a candidate that are candidates too."""


class Places:
    """Knows places again, among all maps of a session."""

    def __init__(
        self, vocabulary: Vocabulary | None, closing: PlaceSettings | None, lost: RelocalisationSettings, counts: Counter[str]
    ) -> None:  # fmt: skip
        self._vocabulary, self._lost, self._counts = vocabulary, lost, counts
        self._index = PlaceIndex(vocabulary)
        self._closing = None if closing is None else LoopClosing(self._index, closing, counts)

    def words(self, frame: Frame) -> BagOfWords | None:
        """Return the words of a frame; None without a vocabulary."""
        return None if self._vocabulary is None else bag_of_words(self._vocabulary, frame.features.descriptors)

    def insert(
        self, maps: list[SparseMap], keyframe: int, up: list[NDArray[np.float64] | None] | None = None
    ) -> Closure | None:
        """Learn the newest keyframe of the newest map; correct the maps if its place is known (see `LoopClosing.insert`)."""
        if self._closing is None:
            self._index.add(maps, Place(len(maps) - 1, keyframe))
            return None
        return self._closing.insert(maps, keyframe, up=up)

    def finish(self, maps: list[SparseMap], up: list[NDArray[np.float64] | None] | None = None) -> Closure | None:
        """Correct the maps by what still waits for more keyframes, though no more will come."""
        return None if self._closing is None else self._closing.finish(maps, up=up)

    def join(self, maps: list[SparseMap]) -> Closure | None:
        """Join the newest map with another if any of its keyframes shows a place of that one; all keyframes are known already."""
        return None if self._closing is None else self._closing.join(maps)

    def learn(self, maps: Sequence[SparseMap], number: int) -> None:
        """Learn all living keyframes of a map that came from elsewhere."""
        for keyframe in maps[number].living_keyframes.tolist():
            if self._vocabulary is not None:
                descriptors = maps[number].features(keyframe).descriptors
                maps[number].words[keyframe] = bag_of_words(self._vocabulary, descriptors)
            self._index.add(maps, Place(number, keyframe))

    def settle_scale(self) -> None:
        """From now on maps are in metres: places that ask for another scale are refused."""
        if self._closing is not None:
            self._closing.settle_scale()

    def forget(self) -> None:
        """Begin another map."""
        if self._closing is not None:
            self._closing.forget()

    def swap(self, one: int, other: int) -> None:
        """Two maps changed places in the list."""
        moved = {one: other, other: one}
        self._index.renumber(
            [Place(moved.get(place.map_number, place.map_number), place.keyframe) for place in self._index.places]
        )

    def find(self, maps: Sequence[SparseMap], number: int, frame: Frame, *, thorough: bool = True) -> Relocalisation:
        """Return where a frame is in a map: beside keyframes with the same words, else (`thorough`, slow) with the same descriptors."""
        sparse_map = maps[number]
        if not len(sparse_map.living_keyframes):
            return Relocalisation(found=False, reason="the map is empty")
        resembling = self._index.resembling(maps, number, self.words(frame), self._lost.num_candidates)
        named = _with_neighbours(sparse_map, resembling)
        found = relocalise(sparse_map, frame, named, self._lost)
        if thorough and not found.found:
            others = [keyframe for keyframe in alike(sparse_map, frame, self._lost) if keyframe not in named]
            again = relocalise(sparse_map, frame, others, self._lost)
            found = again if again.found or not named else found
        return found


def _with_neighbours(sparse_map: SparseMap, keyframes: list[int]) -> list[int]:
    """Return keyframes and then, of each, those that share most points with it."""
    beside = [sparse_map.covisible(keyframe)[0][:_BESIDE].tolist() for keyframe in keyframes]
    return list(dict.fromkeys([*keyframes, *(k for neighbours in beside for k in neighbours)]))
