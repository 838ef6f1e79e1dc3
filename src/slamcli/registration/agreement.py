# SPDX-License-Identifier: MIT
"""Whether a scan can have been seen from where it was placed: its beams end on surfaces, and pass none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.grids.tiles import TiledMaps
from slamcli.registration import _agreement_kernels as _kernels


@dataclass(frozen=True, slots=True)
class BeamAgreement:
    """How many beams of a scan a map confirms and contradicts."""

    on_surface: int
    """Beams that end within two cells of a surface."""
    in_free: int
    """Beams that end where other beams passed."""
    unknown: int
    """Beams that end where nothing is known."""
    through: int
    """Beams that passed a cell at which others ended, well before their own end."""

    @property
    def num_beams(self) -> int:
        """All of them."""
        return self.on_surface + self.in_free + self.unknown

    @property
    def share_on_surface(self) -> float:
        """0 to 1, of all beams."""
        return self.on_surface / max(self.num_beams, 1)

    @property
    def share_contradicting(self) -> float:
        """0 to 1: of the beams that end where the map knows something, those in free space."""
        return self.in_free / max(self.on_surface + self.in_free, 1)

    @property
    def share_through(self) -> float:
        """0 to 1, of all beams."""
        return self.through / max(self.num_beams, 1)

    def __add__(self, other: BeamAgreement) -> BeamAgreement:
        """Return the counts of both."""
        return BeamAgreement(
            self.on_surface + other.on_surface,
            self.in_free + other.in_free,
            self.unknown + other.unknown,
            self.through + other.through,
        )


def compare_beams(
    maps: TiledMaps,
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    pose: NDArray[np.float64],
    *,
    fullness: float = 0.1,
) -> BeamAgreement:
    """Return how a scan seen from `pose` agrees with map 0 of `maps`.

    Parameters
    ----------
    points : float64 (N, 2), ends of beams that hit something, base frame, metres.
    start : float64 (2,), where the beams start, base frame.
    pose : float64 (3,), x, y, yaw of the base in the map.
    fullness : share of hits over which a cell is an obstacle.
    """
    counts = np.zeros(4, np.int64)
    _kernels.compare(maps.cells, maps.tables[0], *maps.origin, maps.delta, points, start, pose, fullness, counts)
    return BeamAgreement(*counts.tolist())


def warm() -> None:
    """Compile the kernel of this module with one beam."""
    maps = TiledMaps(1, 0.05, (-1.0, -1.0, 1.0, 1.0))
    compare_beams(maps, np.array([[0.5, 0.0]]), np.zeros(2), np.zeros(3))
