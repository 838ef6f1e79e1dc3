# SPDX-License-Identifier: MIT
"""The grid of a 2D submap, of either of Cartographer's types."""

from __future__ import annotations

from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid

SubmapGrid = ProbabilityGrid | TsdfGrid
"""Both have `cells` (0 where nothing is known), `resolution_m`, `origin`, `with_room` and `cropped`."""


def shown(grid: SubmapGrid) -> ProbabilityGrid:
    """Return the probabilities that a map shows of a grid."""
    return grid.as_probabilities() if isinstance(grid, TsdfGrid) else grid
