# SPDX-License-Identifier: MIT
"""How far off one submap may be seen from another, by the best known way between them (after Olson, ICRA 2009)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.posegraph import _drift_kernels as kernels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ways:
    """What is known between pairs of submaps, in both directions."""

    first: NDArray[np.int64]
    """int64 (K,), index of a submap."""
    second: NDArray[np.int64]
    """int64 (K,)."""
    distance_m: NDArray[np.float64]
    """float64 (K,), how far apart they are."""
    translation_m2: NDArray[np.float64]
    """float64 (K,), variance of their relative position."""
    rotation_rad2: NDArray[np.float64]
    """float64 (K,), variance of their relative heading."""


def relative_sigmas(num_submaps: int, ways: Ways) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return standard deviations (S, S) of position (m) and heading (rad) of each submap seen from each other one.

    Only the best way counts, which is an upper bound of what all ways together tell; infinite where there is none.
    """
    source = np.concatenate([ways.first, ways.second]).astype(np.int64)
    order = np.argsort(source, kind="stable")
    starts = np.searchsorted(source[order], np.arange(num_submaps + 1))
    neighbours = np.concatenate([ways.second, ways.first]).astype(np.int64)[order]
    distances, translations, rotations = (
        np.concatenate([values, values])[order].astype(np.float64)
        for values in (ways.distance_m, ways.translation_m2, ways.rotation_rad2)
    )
    translation, rotation = np.empty((num_submaps, num_submaps)), np.empty((num_submaps, num_submaps))
    for submap in range(num_submaps):
        kernels.variances_from(
            submap, starts, neighbours, distances, translations, rotations, translation[submap], rotation[submap]
        )
    return np.sqrt(translation), np.sqrt(rotation)


def warm() -> None:
    """Compile the kernel of this module."""
    one = np.ones(1)
    relative_sigmas(
        2, Ways(first=np.array([0]), second=np.array([1]), distance_m=one, translation_m2=one, rotation_rad2=one)
    )
