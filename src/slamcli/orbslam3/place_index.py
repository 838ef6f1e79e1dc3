# SPDX-License-Identifier: MIT
"""Keyframes of all maps that may show the place of another: by bags of words, or by descriptors where there is no vocabulary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.sparse_map import Ids, SparseMap, neighbours_in
from slamcli.vision.bag_of_words import BagOfWords
from slamcli.vision.keyframe_database import KeyframeDatabase
from slamcli.vision.matching import match_brute_force
from slamcli.vision.vocabulary import Vocabulary

_SKETCH = 150
"""Descriptors of a keyframe that are compared where there is no vocabulary: those of its strongest features with a point."""
_LEAST_ALIKE = 8
"""Of them, as many must match."""
_TH_LOW = 50


class Place(NamedTuple):
    """A keyframe of one of the maps."""

    map_number: int
    keyframe: int


class PlaceIndex:
    """All keyframes of a session, in the order in which they came: the key of a keyframe is its position in that order."""

    def __init__(self, vocabulary: Vocabulary | None) -> None:
        self._database = None if vocabulary is None else KeyframeDatabase(vocabulary)
        self._places: list[Place] = []
        self._keys: dict[int, NDArray[np.int64]] = {}
        """By map: the key of each of its keyframes, -1 for those that have none."""
        self._sketches: list[NDArray[np.uint8]] = []
        self._known: dict[int, int] = {}
        """Keyframes of each map that are in the index: those below."""

    def add(self, maps: Sequence[SparseMap], place: Place) -> None:
        """Put a keyframe into the index, with what it sees now, and those before it that are not there yet."""
        sparse_map = maps[place.map_number]
        for keyframe in range(self._known.get(place.map_number, 0), place.keyframe + 1):
            key = len(self._places)
            self._places.append(Place(place.map_number, keyframe))
            self._note(self._places[-1], key)
            if self._database is None:
                self._sketches.append(_sketch(sparse_map, keyframe))
            else:
                self._database.add(key, sparse_map.words[keyframe])
        self._known[place.map_number] = place.keyframe + 1

    def candidates(self, maps: Sequence[SparseMap], place: Place, *, limit: int = 3) -> tuple[list[Place], list[Place]]:
        """Return the keyframes most likely to show the place of one that is in the index: of its own map, and of others.

        Keyframes that share points with it are left out.
        """
        own = np.array([other.map_number == place.map_number for other in self._places])
        usable = np.array([bool(maps[other.map_number].keyframe_alive[other.keyframe]) for other in self._places])
        connected, _ = maps[place.map_number].covisible(place.keyframe)
        usable[self._keys_of(place.map_number, np.append(connected, place.keyframe))] = False
        return (
            self._best(maps, place, usable & own, limit),
            self._best(maps, place, usable & ~own, limit) if not own.all() else [],
        )

    def resembling(self, maps: Sequence[SparseMap], number: int, words: BagOfWords | None, limit: int) -> list[int]:
        """Return the keyframes of a map in which a frame with such words may be found again; none without a vocabulary."""
        if self._database is None or words is None:
            return []
        usable = np.array(
            [place.map_number == number and bool(maps[number].keyframe_alive[place.keyframe]) for place in self._places],
            dtype=np.bool_,
        )  # fmt: skip
        found = self._database.relocalisation_candidates(words, lambda key: self._neighbours(maps, key), allowed=usable)
        return [self._places[candidate.key].keyframe for candidate in found[:limit]]

    def renumber(self, places: Sequence[Place]) -> None:
        """Give the keyframes other places: maps were joined. `places` has one for each key."""
        self._places = list(places)
        self._keys, self._known = {}, {}
        for key, place in enumerate(self._places):
            self._note(place, key)
            self._known[place.map_number] = max(self._known.get(place.map_number, 0), place.keyframe + 1)

    @property
    def places(self) -> list[Place]:
        """Where each keyframe is, by key."""
        return list(self._places)

    def _best(self, maps: Sequence[SparseMap], place: Place, usable: NDArray[np.bool_], limit: int) -> list[Place]:
        if not usable.any():
            return []
        if self._database is None:
            return self._alike(maps, place, usable, limit)
        bag = maps[place.map_number].words[place.keyframe]
        shared: dict[int, NDArray[np.int64]] = {}

        def neighbours(key: int) -> Ids:
            """Look it up in one table for each map: nearly every keyframe is asked for."""
            number, keyframe = self._places[key]
            if number not in shared:
                shared[number] = maps[number].all_shared()
            return self._keys_of(number, neighbours_in(shared[number], keyframe))

        found = self._database.place_candidates(bag, neighbours, excluded=~usable, limit=limit)
        return [self._places[candidate.key] for candidate in found]

    def _neighbours(self, maps: Sequence[SparseMap], key: int) -> Ids:
        """Return the keys of the keyframes that share most points with one, the best first."""
        place = self._places[key]
        return self._keys_of(place.map_number, maps[place.map_number].covisible(place.keyframe)[0])

    def _keys_of(self, number: int, keyframes: Ids) -> Ids:
        """Return the keys of keyframes of a map that are in the index."""
        known = self._keys.get(number, np.empty(0, dtype=np.int64))
        keys = known[keyframes[keyframes < len(known)]]
        return keys[keys >= 0]

    def _note(self, place: Place, key: int) -> None:
        known = self._keys.get(place.map_number, np.empty(0, dtype=np.int64))
        if place.keyframe >= len(known):
            known = np.pad(known, (0, place.keyframe + 1), constant_values=-1)
        known[place.keyframe] = key
        self._keys[place.map_number] = known

    def _alike(self, maps: Sequence[SparseMap], place: Place, usable: NDArray[np.bool_], limit: int) -> list[Place]:
        """Return the keyframes with most matching descriptors, no two that share points."""
        sketch = self._sketches[self._keys[place.map_number][place.keyframe]]
        counts = np.zeros(len(usable), np.int64)
        for key in np.flatnonzero(usable).tolist():
            matched = match_brute_force(sketch, self._sketches[key], max_distance=_TH_LOW, ratio=0.9)
            counts[key] = np.count_nonzero(matched >= 0)
        found: list[Place] = []
        beside: set[int] = set()
        for key in np.lexsort((np.arange(len(counts)), -counts)).tolist():
            if len(found) == limit or counts[key] < _LEAST_ALIKE:
                break
            if key not in beside:
                found.append(self._places[key])
                beside.update(self._neighbours(maps, key).tolist())
        return found


def _sketch(sparse_map: SparseMap, keyframe: int) -> NDArray[np.uint8]:
    """Return descriptors (N, 32) of a keyframe's strongest features that see a point."""
    count = sparse_map.counts[keyframe]
    rows = np.flatnonzero(sparse_map.seen[keyframe, :count] >= 0)
    order = np.lexsort((rows, -sparse_map.responses[keyframe, rows]))[:_SKETCH]
    return sparse_map.key_descriptors[keyframe, rows[order]].copy()
