# SPDX-License-Identifier: MIT
"""What is said of frames that have no pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def gap_sentence(stamps_ns: NDArray[np.int64], has_pose: NDArray[np.bool_], what: str = "frame") -> str:
    """Return how many frames have no pose, when the first of them came and how long the longest gap is; empty if all have one.

    Parameters
    ----------
    stamps_ns
        int64 (F,), of all frames, as they were given.
    has_pose
        Bool (F,).
    what
        What a frame is called.
    """
    missing = np.flatnonzero(~has_pose)
    if not len(missing):
        return ""
    seconds = (stamps_ns - stamps_ns[0]) / 1e9
    runs = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
    spans = [float(seconds[min(run[-1] + 1, len(seconds) - 1)] - seconds[run[0]]) for run in runs]
    longest = int(np.argmax(spans))
    return (
        f"{len(missing)} of {len(stamps_ns)} {what}s ({100 * len(missing) / len(stamps_ns):.2g} %) have no pose: "
        f"the first {seconds[missing[0]]:.2f} s after the recording's first {what}, the longest gap {spans[longest]:.2f} s from"
        f" {seconds[runs[longest][0]]:.2f} s on"
    )
