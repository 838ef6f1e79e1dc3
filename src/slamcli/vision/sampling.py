# SPDX-License-Identifier: MIT
"""Minimal samples for RANSAC, drawn beforehand: a compiled loop that takes them needs no random numbers of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def draw_samples(count: int, size: int, iterations: int, seed: int) -> NDArray[np.int64]:
    """Return int64 (iterations, size): in each row different indices below `count`, all equally likely.

    Parameters
    ----------
    count
        Number of things to choose from, at least `size`.
    seed
        The same seed gives the same rows.
    """
    rng = np.random.default_rng(seed)
    out = np.empty((iterations, size), np.int64)
    for k in range(size):
        draw = rng.integers(0, count - k, iterations)
        for taken in np.sort(out[:, :k], axis=1).T:  # the draw counts what is left: step over what is taken
            draw += draw >= taken
        out[:, k] = draw
    return out
