# SPDX-License-Identifier: MIT
"""A costmap made ready for search: which cells a path may use, what they cost, and which hang together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from slamcli.errors import PlanningError
from slamcli.grids import OccupancyGrid
from slamcli.grids.distance import nearest_cell
from slamcli.navigation.costmap import INSCRIBED, LETHAL, NO_INFORMATION, Costmap, compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.planner_parameters import PlannerParameters

Cell = tuple[int, int]


class UnreachableError(PlanningError):
    """Two free cells do not hang together."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchGrid:
    """What searches read: costs with a border of one blocked cell all around; positions in it are those of the grid plus one."""

    parameters: PlannerParameters
    levels: NDArray[np.uint8]
    """uint8 (H + 2, W + 2), C-contiguous: costmap values, 254 on the border. A live planner changes them between queries."""
    blocked: NDArray[np.bool_]
    """bool (256,): which costmap values a path must not touch."""
    weight: NDArray[np.float64]
    """float64 (256,): cost of a unit of length by costmap value, 1 on free cells."""

    @classmethod
    def over(cls, levels: NDArray[np.uint8], parameters: PlannerParameters, *, allow_unknown: bool) -> SearchGrid:
        """Return the grid over bordered costs."""
        return cls(
            parameters=parameters,
            levels=levels,
            blocked=_blocked(allow_unknown=allow_unknown),
            weight=_weight(parameters),
        )

    @property
    def stride(self) -> int:
        """Number of columns of `levels`."""
        return int(self.levels.shape[1])

    def flat(self, cell: Cell) -> int:
        """Return the position of a grid cell in the flattened `levels`."""
        return (cell[0] + 1) * self.stride + cell[1] + 1

    def cells(self, flat: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return row and column (N, 2) on the grid of flat positions (N,)."""
        return np.column_stack([flat // self.stride - 1, flat % self.stride - 1])


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchSpace(SearchGrid):
    """The search grid of a costmap that does not change, with the regions that hang together."""

    costmap: Costmap

    @cached_property
    def regions(self) -> NDArray[np.int32]:
        """int32 (H, W): 0 on blocked cells, else a number that cells share if a path joins them; found when first asked for."""
        # A diagonal step needs both cells beside it, so what hangs together does so by its sides.
        regions: NDArray[np.int32] = ndimage.label(~self.blocked[self.costmap.costs], output=np.int32)[0]
        return regions

    @property
    def knows_regions(self) -> bool:
        """Whether `regions` were asked for already."""
        return "regions" in vars(self)

    @classmethod
    def build(cls, costmap: Costmap, parameters: PlannerParameters, *, allow_unknown: bool = True) -> SearchSpace:
        """Prepare a costmap for any number of searches."""
        return cls(
            parameters=parameters,
            levels=np.pad(costmap.costs, 1, constant_values=LETHAL),
            blocked=_blocked(allow_unknown=allow_unknown),
            weight=_weight(parameters),
            costmap=costmap,
        )

    def nearest_free(self, point_rc: tuple[float, float], region: int | None = None) -> Cell | None:
        """Return the nearest cell that a path may use, of one region or of any; None if there is none."""
        return nearest_cell(self.regions > 0 if region is None else self.regions == region, point_rc)


def _weight(parameters: PlannerParameters) -> NDArray[np.float64]:
    value = np.arange(256, dtype=np.float64)
    weight = (parameters.neutral_cost + parameters.factor * value) / parameters.neutral_cost
    weight[NO_INFORMATION] = weight[INSCRIBED]
    return weight


def _blocked(*, allow_unknown: bool) -> NDArray[np.bool_]:
    blocked = np.arange(256) >= INSCRIBED
    blocked[NO_INFORMATION] = not allow_unknown
    return blocked


def sample_space(parameters: PlannerParameters | None = None) -> SearchSpace:
    """Return a space of four by four cells with one obstacle, to compile kernels on."""
    cells = np.zeros((4, 4), dtype=np.int8)
    cells[1, 2] = OccupancyGrid.OCCUPIED
    return SearchSpace.build(
        compute_costmap(OccupancyGrid(cells, 0.1), CostmapParameters()), parameters or PlannerParameters()
    )
