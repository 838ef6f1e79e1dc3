# SPDX-License-Identifier: MIT
"""What became of every frame: columns for the report, figures for the summary, and words where poses are missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.runtime import RunLog
from slamcli.trajectory.gaps import gap_sentence

Steps = Mapping[str, NDArray[Any]]


def step_columns(
    stamps_ns: Sequence[int], tracked: Sequence[int], steps: Mapping[int, tuple[int, int, int]]
) -> dict[str, NDArray[np.int64]]:
    """Return columns (N,), a row per frame.

    Parameters
    ----------
    stamps_ns
        Of all N frames.
    tracked
        Numbers of the frames that have a pose in the result.
    steps
        Per frame, by number: points of the map that hold, keyframes and points of the map.
    """
    columns = np.array([steps.get(number, (0, 0, 0)) for number in range(len(stamps_ns))], dtype=np.int64)
    held, keyframes, points = columns.reshape(-1, 3).T
    has_pose = np.zeros(len(stamps_ns), dtype=np.int64)
    has_pose[list(tracked)] = 1
    return {
        "stamp_ns": np.array(stamps_ns, dtype=np.int64), "tracked": has_pose, "points_held": held.copy(),
        "keyframes": keyframes.copy(), "map_points": points.copy(),
    }  # fmt: skip


def untracked_share(steps: Steps) -> float:
    """Return the share of the recording's time without poses: each frame stands for the time until the next."""
    stamps, has_pose = steps["stamp_ns"], steps["tracked"] > 0
    spans = np.diff(stamps).astype(np.float64)
    spans = np.append(np.maximum(spans, 0.0), max(float(np.median(spans)), 0.0) if len(spans) else 1.0)
    return float(spans[~has_pose].sum() / max(spans.sum(), 1e-9)) if spans.any() else float(1.0 - has_pose.mean())


def tell_gaps(steps: Steps, in_other_maps: int, log: RunLog) -> None:
    """Warn of frames without a pose: how many, the first, the longest gap.

    Parameters
    ----------
    in_other_maps
        How many of them were tracked in maps that could not be joined with that of the result.
    """
    message = gap_sentence(steps["stamp_ns"], steps["tracked"] > 0)
    if not message:
        return
    if in_other_maps:
        message += (
            f"; {in_other_maps} of them were tracked in other maps, which show no place of this one (see atlas.npz)"
        )
    log.warn(message)
