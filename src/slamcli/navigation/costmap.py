# SPDX-License-Identifier: MIT
"""The global costmap: static layer and inflation, as costmap_2d computes them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.grids.distance import squared_distance
from slamcli.navigation.costmap_parameters import COSTMAP_2D_ROBOT_RADIUS_M, CostmapParameters
from slamcli.navigation.footprint import padded_polygon, parse_footprint, radii

FREE, INSCRIBED, LETHAL, NO_INFORMATION = 0, 253, 254, 255


@dataclass(frozen=True, slots=True, eq=False)
class Costmap:
    """Costs on the cells of a map, and the robot that they are meant for."""

    grid: OccupancyGrid
    costs: NDArray[np.uint8]
    """uint8 (H, W): 0 free, 1 to 252 near obstacles, 253 within the inscribed radius, 254 obstacle, 255 unknown."""
    squared_distance: NDArray[np.int64]
    """int64 (H, W), cells²: from each cell's centre to the nearest lethal cell's; -1 where there is none."""
    inscribed_radius_m: float
    circumscribed_radius_m: float
    inflation_radius_m: float
    warnings: tuple[str, ...] = ()
    footprint: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 2)))
    """float64 (F, 2), metres, base frame: the robot's padded outline; one point at the origin for a robot without extent."""

    @property
    def lethal(self) -> NDArray[np.bool_]:
        """Where the obstacles themselves are, bool (H, W)."""
        return self.costs == LETHAL


def compute_costmap(grid: OccupancyGrid, parameters: CostmapParameters, *, from_file: bool = False) -> Costmap:
    """Return the costmap of a map.

    Costs depend on the distance between cell centres. costmap_2d finds the nearest obstacle by growing waves, which in
    rare corners finds one that is only almost nearest; here it is exact.

    Parameters
    ----------
    grid
        The map.
    parameters
        What to compute.
    from_file
        Whether a costmap file was read: then a robot that nothing describes has costmap_2d's default radius.
    """
    radius = parameters.robot_radius
    footprint = parse_footprint(parameters.footprint)
    if radius is None:
        radius = COSTMAP_2D_ROBOT_RADIUS_M if from_file else 0.0
    polygon = padded_polygon(footprint, radius, parameters.footprint_padding)
    inscribed, circumscribed = radii(polygon)
    inflation = parameters.inflation_radius
    if inflation is None:
        inflation = 0.0 if parameters.robot_radius == 0.0 and not footprint else 0.55
    if not parameters.inflation_enabled:
        inflation = 0.0
    costs = static_costs(grid, parameters)
    squared = squared_distance(costs == LETHAL)
    costs = inflate(
        costs,
        squared,
        grid.resolution_m,
        inscribed,
        inflation,
        parameters.cost_scaling_factor,
        inflate_unknown=parameters.inflate_unknown,
    )
    warnings = []
    if inflation < inscribed:
        warnings.append(
            f"inflation radius {inflation:g} m is below the robot's inscribed radius {inscribed:.3f} m: the path may pass"
            " obstacles closer than the robot's body"
        )
    return Costmap(grid, costs, squared, inscribed, circumscribed, inflation, tuple(warnings), polygon)


def static_costs(grid: OccupancyGrid, parameters: CostmapParameters) -> NDArray[np.uint8]:
    """Return uint8 (H, W), the costs of the static layer."""
    if not parameters.static_enabled:
        return np.zeros(grid.cells.shape, dtype=np.uint8)
    value = np.arange(256)
    lethal = min(max(parameters.lethal_cost_threshold, 0), 100)
    scaled = (value / max(lethal, 1) * LETHAL).astype(np.int64)
    table = np.where(value >= lethal, LETHAL, FREE if parameters.trinary_costmap else scaled)
    table[parameters.unknown_cost_value & 255] = NO_INFORMATION if parameters.track_unknown_space else FREE
    return table.astype(np.uint8)[grid.cells.view(np.uint8)]


def inflate(
    costs: NDArray[np.uint8],
    squared: NDArray[np.int64],
    resolution_m: float,
    inscribed_radius_m: float,
    inflation_radius_m: float,
    cost_scaling_factor: float,
    *,
    inflate_unknown: bool = False,
) -> NDArray[np.uint8]:
    """Return `costs` with the inflation layer on top.

    A cell at distance d from an obstacle costs 253 up to the inscribed radius, and 252 * exp(-factor * (d - inscribed))
    beyond, cut to whole numbers, up to the inflation radius (rounded up to whole cells). Costs below never shrink;
    unknown cells take 253 only, or any cost if `inflate_unknown`.
    """
    reach = math.ceil(inflation_radius_m / resolution_m)
    diagonal = math.hypot(*costs.shape)
    reach = int(min(reach, math.ceil(diagonal)))
    if reach == 0:
        return costs
    table = cost_by_squared_distance(reach, resolution_m, inscribed_radius_m, cost_scaling_factor)
    near = (squared >= 0) & (squared <= reach * reach)
    cost = np.zeros(costs.shape, dtype=np.uint8)
    cost[near] = table[squared[near]]
    unknown = costs == NO_INFORMATION
    inflated = np.maximum(costs, cost)
    least = FREE + 1 if inflate_unknown else INSCRIBED
    inflated[unknown] = np.where(cost[unknown] >= least, cost[unknown], NO_INFORMATION)
    return inflated


def cost_by_squared_distance(reach: int, resolution_m: float, inscribed_m: float, factor: float) -> NDArray[np.uint8]:
    """Return uint8 (reach² + 1,): the cost at a squared distance in cells from the nearest obstacle."""
    distance_m = np.sqrt(np.arange(reach * reach + 1, dtype=np.float64)) * resolution_m
    decay = np.exp(-factor * np.maximum(distance_m - inscribed_m, 0.0))
    cost = np.floor((INSCRIBED - 1) * decay)
    cost[distance_m <= inscribed_m] = INSCRIBED
    cost[0] = LETHAL
    return cost.astype(np.uint8)
