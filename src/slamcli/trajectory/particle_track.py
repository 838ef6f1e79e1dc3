# SPDX-License-Identifier: MIT
"""Where the particles of a filter were over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError

MOST_POSES = 4_000_000
"""Poses in one track, 64 MB: of longer runs only every second, third ... step is kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParticleTrack:
    """The particles of a filter after each step, or, of a very long run, after every so many.

    Poses and weights are those with which the step ended, before it resampled: the spread of what the filter thought possible.
    """

    stamps_ns: NDArray[np.int64]
    """int64 (S,), of the scans that were processed, in their order."""
    poses: NDArray[np.float32]
    """float32 (S, N, 3): x, y (metres) and yaw (radians) in the map frame. Where a step had fewer than N particles, the last are NaN."""
    weights: NDArray[np.float32]
    """float32 (S, N): they sum up to one in each step, and are zero where there is no particle."""

    def __post_init__(self) -> None:
        steps, count = len(self.stamps_ns), self.poses.shape[1] if self.poses.ndim == 3 else -1
        if (
            self.stamps_ns.shape != (steps,)
            or self.poses.shape != (steps, count, 3)
            or self.weights.shape != (steps, count)
        ):
            raise DataError(
                f"particles whose stamps {self.stamps_ns.shape}, poses {self.poses.shape} and weights {self.weights.shape} do not fit"
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)


def particle_track(
    stamps_ns: Sequence[int], poses: Sequence[NDArray[np.float64]], weights: Sequence[NDArray[np.float64]]
) -> ParticleTrack:
    """Return the track of S steps with the particles' poses (N_k, 3) and weights (N_k,), whose numbers may differ.

    Where there are more than `MOST_POSES` poses, every second, third ... step is kept, beginning with the first.
    """
    most = max((len(step) for step in poses), default=0)
    every = max(1, -(-len(poses) * most // MOST_POSES))
    kept = range(0, len(poses), every)
    all_poses = np.full((len(kept), most, 3), np.nan, dtype=np.float32)
    all_weights = np.zeros((len(kept), most), dtype=np.float32)
    for row, k in enumerate(kept):
        all_poses[row, : len(poses[k])] = poses[k]
        all_weights[row, : len(weights[k])] = weights[k]
    stamps = np.array([stamps_ns[k] for k in kept], dtype=np.int64)
    return ParticleTrack(stamps_ns=stamps, poses=all_poses, weights=all_weights)
