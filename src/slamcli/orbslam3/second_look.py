# SPDX-License-Identifier: MIT
"""Frames that had no pose when it was their turn, looked for once more when the map is done."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.frame_track import TrackedFrame, tracked_frame
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.tracking import TrackingSettings, track_keyframe, track_local_map

_MOST_MISSES = 3
"""Frames in a row that are not found, after which a direction is given up."""


def second_look(
    maps: Sequence[SparseMap], tracked: Sequence[TrackedFrame], untracked: Mapping[int, Frame], settings: TrackingSettings,
    least_held: int,
) -> list[TrackedFrame]:  # fmt: skip
    """Return the frames without a pose that are found beside frames that have one, first backwards in time, then forwards.

    Going backwards finds what came before the map began, and before the track was found again. The maps' keyframes and points
    stay as they are.
    """
    known = {one.number: one for one in tracked}
    found: list[TrackedFrame] = []
    for numbers, step in ((sorted(untracked, reverse=True), 1), (sorted(untracked), -1)):
        for one in _along(maps, known, untracked, numbers, step, settings, least_held):
            known[one.number] = one
            found.append(one)
    return found


def _along(
    maps: Sequence[SparseMap], known: Mapping[int, TrackedFrame], untracked: Mapping[int, Frame], numbers: Sequence[int],
    step: int, settings: TrackingSettings, least_held: int,
) -> Iterable[TrackedFrame]:  # fmt: skip
    """Yield frames that are found from the one `step` further on, or from the last that was found."""
    near: TrackedFrame | None = None
    misses, expected = 0, -1
    for number in numbers:
        if number in known:
            continue
        if number + step in known:
            near, misses = known[number + step], 0
        elif number != expected:
            near = None
        expected = number - step
        if near is None or misses >= _MOST_MISSES:
            continue
        sparse_map = maps[near.map_number]
        guess = near.T_frame_reference @ sparse_map.pose_of(near.reference)
        if _locate(sparse_map, near.reference, guess, untracked[number], settings) < least_held:
            misses += 1
            continue
        near, misses = tracked_frame(sparse_map, near.map_number, untracked[number]), 0
        yield near


def _locate(
    sparse_map: SparseMap, reference: int, guess: NDArray[np.float64], frame: Frame, settings: TrackingSettings
) -> int:
    """Set a frame's pose from the keyframe beside its neighbour; return how many points hold."""
    while not sparse_map.keyframe_alive[reference]:
        reference = int(sparse_map.parent[reference])
    frame.points[:] = -1
    if not track_keyframe(sparse_map, reference, guess, frame, settings):
        return 0
    return track_local_map(sparse_map, frame, settings).held
