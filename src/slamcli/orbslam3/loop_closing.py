# SPDX-License-Identifier: MIT
"""What place recognition leads to: after each keyframe, run to its end at once."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.loop_correction import correct_loop
from slamcli.orbslam3.map_merging import merge_maps
from slamcli.orbslam3.place_index import Place, PlaceIndex
from slamcli.orbslam3.place_recognition import PlaceMatch, PlaceRecognition
from slamcli.orbslam3.place_settings import PlaceSettings
from slamcli.orbslam3.sparse_map import SparseMap

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Closure:
    """A correction that was made: what the caller's own numbers and lengths are to be changed by."""

    stamp_ns: int
    """Of the keyframe that saw the place again, and of the one that it resembles."""
    other_stamp_ns: int
    num_matches: int
    """Points of the old region that the keyframe shows."""
    num_fused: int
    cost_before: float
    """Per observation of the whole map, as shares of the 95 % bounds."""
    cost_after: float
    length_factor: float
    """By which lengths around the newest keyframe were multiplied (1 unless mono)."""
    merged_map: int = -1
    """Number of the map that was taken into the newest; its keyframes and points keep their numbers. -1: a loop."""
    keyframe_offset: int = 0
    """Added to the numbers of the newest map's keyframes."""
    point_offset: int = 0
    """Added to the numbers of its points."""

    def figures(self) -> dict[str, Any]:
        """Return what ``run.json`` says of it."""
        return {
            "kind": "loop" if self.merged_map < 0 else "merge",
            "stamp_ns": self.stamp_ns,
            "other_stamp_ns": self.other_stamp_ns,
            "matches": self.num_matches,
            "points_fused": self.num_fused,
            "cost_before": round(self.cost_before, 4),
            "cost_after": round(self.cost_after, 4),
            "length_factor": round(self.length_factor, 6),
        }


_PAUSE = 5
"""Keyframes without a search after one whose result was undone; twice as many after the next, up to eight times."""


class LoopClosing:
    """Looks for known places, closes loops and joins maps."""

    def __init__(self, index: PlaceIndex, settings: PlaceSettings, counts: Counter[str]) -> None:
        self._settings, self._counts = settings, counts
        self._index = index
        self._recognition = PlaceRecognition(self._index, settings, counts)
        self._pause, self._waiting = _PAUSE, 0

    def insert(self, maps: list[SparseMap], keyframe: int, *, up: list[Floats | None] | None = None) -> Closure | None:
        """Put the newest keyframe of the newest map into the index; correct the maps if its place is known.

        When maps are joined, the result takes the last place of `maps`, and an empty map the place of the older one.

        Parameters
        ----------
        up
            Of each map, the unit vector against gravity float64 (3,), or None where it is unknown.

        Returns
        -------
        Closure or None
            What was done; None: nothing.
        """
        up = [None] * len(maps) if up is None else up
        self._index.add(maps, Place(len(maps) - 1, keyframe))
        if self._waiting:
            self._waiting -= 1
            return None
        return self._correct(maps, *self._recognition.look(maps, keyframe), up)

    def finish(self, maps: list[SparseMap], *, up: list[Floats | None] | None = None) -> Closure | None:
        """Correct the maps by what was recognised, but not by enough keyframes before the last one came; as `insert`."""
        return self._correct(maps, *self._recognition.remaining(maps), [None] * len(maps) if up is None else up)

    def _correct(
        self, maps: list[SparseMap], merge: PlaceMatch | None, loop: PlaceMatch | None, up: list[Floats | None]
    ) -> Closure | None:
        if merge is not None and (closure := self._merge(maps, merge, up)) is not None:
            return closure
        return None if loop is None else self._close(maps, loop, up[-1])

    def join(self, maps: list[SparseMap]) -> Closure | None:
        """Look at every keyframe of the newest map, which the index holds, and join the map with the first that surely shows one's place."""
        for keyframe in maps[-1].living_keyframes.tolist():
            match = self._recognition.elsewhere(maps, keyframe)
            if match is not None and (closure := self._merge(maps, match, [None] * len(maps))) is not None:
                return closure
        return None

    def settle_scale(self) -> None:
        """From now on maps are in metres: places that ask for another scale are refused."""
        self._settings = replace(self._settings, fix_scale=True)
        self._recognition.use(self._settings)

    def forget(self) -> None:
        """Begin another map."""
        self._recognition.forget()

    def _wait(self) -> None:
        """Let a place that looks like another, and is not, go by."""
        self._recognition.forget()
        self._waiting = self._pause
        self._pause = min(2 * self._pause, 8 * _PAUSE)

    def _close(self, maps: list[SparseMap], match: PlaceMatch, up: Floats | None) -> Closure | None:
        outcome = correct_loop(maps[-1], match, self._settings, up_map=up)
        if not outcome.closed:
            self._counts["loops undone"] += 1
            self._wait()
            return None
        self._pause = _PAUSE
        self._recognition.forget()
        self._counts["loops closed"] += 1
        return Closure(
            stamp_ns=int(maps[-1].stamp_ns[match.keyframe]), other_stamp_ns=int(maps[-1].stamp_ns[match.place.keyframe]),
            num_matches=int(np.count_nonzero(match.points >= 0)), num_fused=outcome.num_fused,
            cost_before=outcome.cost_before, cost_after=outcome.cost_after, length_factor=outcome.length_factor,
        )  # fmt: skip

    def _merge(self, maps: list[SparseMap], match: PlaceMatch, up: list[Floats | None]) -> Closure | None:
        number, newest = match.place.map_number, len(maps) - 1
        outcome = merge_maps(maps[number], maps[newest], match, self._settings, up_old=up[number], up_newer=up[newest])
        if outcome.sparse_map is None:
            self._counts["merges undone"] += 1
            self._wait()
            return None
        self._pause = _PAUSE
        merged = outcome.sparse_map
        self._index.renumber(
            [
                Place(newest, place.keyframe) if place.map_number == number
                else Place(newest, place.keyframe + outcome.keyframe_offset) if place.map_number == newest
                else place
                for place in self._index.places
            ]
        )  # fmt: skip
        maps[number] = SparseMap(merged.camera, merged.scales)
        maps[newest] = merged
        self._recognition.forget()
        self._counts["maps merged"] += 1
        keyframe = match.keyframe + outcome.keyframe_offset
        return Closure(
            stamp_ns=int(merged.stamp_ns[keyframe]), other_stamp_ns=int(merged.stamp_ns[match.place.keyframe]),
            num_matches=int(np.count_nonzero(match.points >= 0)), num_fused=outcome.num_fused,
            cost_before=outcome.cost_before, cost_after=outcome.cost_after, length_factor=outcome.length_factor,
            merged_map=number, keyframe_offset=outcome.keyframe_offset, point_offset=outcome.point_offset,
        )  # fmt: skip
