# SPDX-License-Identifier: MIT
"""costmap_2d's layered costmap: static map, obstacles and inflation, brought up to date where something changed."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slamcli.errors import ConfigError
from slamcli.grids import OccupancyGrid
from slamcli.navigation import _master_kernels as kernels
from slamcli.navigation.cell_bounds import CellBounds, Extent
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import FREE, NO_INFORMATION
from slamcli.navigation.costmap_parameters import COSTMAP_2D_ROBOT_RADIUS_M
from slamcli.navigation.footprint import padded_polygon, parse_footprint, radii
from slamcli.navigation.inflation_layer import InflationLayer
from slamcli.navigation.layered_parameters import CostmapName, LayeredParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_layer import ObstacleLayer
from slamcli.navigation.static_layer import StaticLayer
from slamcli.navigation.voxel_layer import VoxelLayer

COSTMAP_2D_INFLATION_RADIUS_M = 0.55


class LayeredCostmap:
    """Costs around a robot that moves, from a map and from what its sensors see.

    Call `observe` with what sensors say, `update` at the costmap's update frequency, and look at it through `window`.

    Parameters
    ----------
    parameters
        The costmap and its layers.
    name
        ``global`` or ``local``, for messages.
    static
        The map, which a static layer needs.

    Raises
    ------
    ConfigError
        If a static layer has no map, the window has no cells, or the robot is wider than the window that moves with it.
    """

    def __init__(
        self, parameters: LayeredParameters, *, name: CostmapName, static: OccupancyGrid | None = None
    ) -> None:
        self.name = name
        self.parameters = parameters
        own = parameters.costmap
        radius = COSTMAP_2D_ROBOT_RADIUS_M if own.robot_radius is None else own.robot_radius
        self.footprint = padded_polygon(parse_footprint(own.footprint), radius, own.footprint_padding)
        self.inscribed_radius_m, self.circumscribed_radius_m = radii(self.footprint)
        self._default = NO_INFORMATION if own.track_unknown else FREE
        self._static = self._static_layer(static)
        self._extent = self._first_extent()
        self._obstacles = [
            (VoxelLayer if layer.kind == "voxel" else ObstacleLayer)(layer, self._extent, self._default)
            for layer in parameters.layers
            if layer.kind in ("obstacle", "voxel")
        ]
        self._inflation = self._inflation_layer()
        self._below = np.full(self._extent.shape, self._default, dtype=np.uint8)
        self._is_new = True
        self._is_stale = False
        self._next_map: OccupancyGrid | None = None
        self.time_s = 0.0
        """Of the last update, simulated seconds."""

    @property
    def frame(self) -> str:
        """The frame it lies in."""
        return self.parameters.costmap.global_frame

    @property
    def extent(self) -> Extent:
        """Where it lies at present."""
        return self._extent

    def observe(self, observation: Observation) -> None:
        """Take what a sensor says, in the costmap's frame; it is applied by the next update.

        Raises
        ------
        ConfigError
            If no layer has a source of that name.
        """
        taken = [layer.observe(observation) for layer in self._obstacles]
        if not any(taken):
            known = ", ".join(source.name for source in self.parameters.sources) or "none"
            raise ConfigError(f"{self.name} costmap: no source {observation.source!r} (there is: {known})")

    def out_of_date(self, time_s: float) -> tuple[str, ...]:
        """Return the sources that have not been heard of for longer than their expected_update_rate."""
        return tuple(
            buffer.source.name for layer in self._obstacles for buffer in layer.buffers if not buffer.is_current(time_s)
        )

    def update(self, pose: ArrayLike, time_s: float = 0.0, T_map_frame: ArrayLike | None = None) -> CellBounds:
        """Bring the costs up to date and return the box of cells that changed.

        Parameters
        ----------
        pose
            float64 (3,): the robot in the costmap's frame; a rolling window follows it.
        time_s
            Simulated seconds; what the layers hold does not depend on it.
        T_map_frame
            float64 (3,): the costmap's frame in the map's, for a rolling window with a static layer. Default: the same frame.
        """
        self.time_s = time_s
        pose = np.ascontiguousarray(pose, dtype=np.float64)
        if self._static is not None and self._next_map is not None:
            self._take_map(self._static, self._next_map)
        if self.parameters.costmap.rolling_window:
            self._follow(pose)
        touched = self._extent.nothing()
        for layer in self._obstacles:
            layer.update(self.footprint, pose, touched)
        if self._is_new or self._is_stale or (self._static is not None and self.parameters.costmap.rolling_window):
            touched = self._extent.everything()
        if touched[0] < touched[1]:
            self._stack(touched, None if T_map_frame is None else np.ascontiguousarray(T_map_frame, dtype=np.float64))
        changed = self._extent.nothing()
        if self._is_new:
            self._inflation.recompute(self._below, changed)
            changed = self._extent.everything()
        else:
            self._inflation.advance(self._below, touched, changed)
        self._is_new = self._is_stale = False
        bounds = CellBounds(*(int(v) for v in changed))
        return CellBounds(0, 0, 0, 0) if bounds.empty else bounds

    def window(self) -> CostWindow:
        """Return the costs as the last update left them, a view; free before the first one."""
        x, y = self._extent.corner
        return CostWindow(
            costs=self._inflation.costs,
            origin_m=(float(x), float(y)),
            resolution_m=self._extent.resolution_m,
            frame=self.frame,
            footprint=self.footprint,
            inscribed_radius_m=self.inscribed_radius_m,
            circumscribed_radius_m=self.circumscribed_radius_m,
        )

    def set_map(self, grid: OccupancyGrid) -> None:
        """Take another map for the static layer, of any size and origin, with the next update; obstacles stay where both lie.

        Nothing happens without a static layer, or with first_map_only.
        """
        if self._static is not None and not self.parameters.costmap.first_map_only:
            self._next_map = grid

    def start_over(self) -> None:
        """Let the next update compute everything anew from what the layers know; that changes nothing but its duration."""
        self._is_new = True

    def clear_outside(self, pose: ArrayLike, half_width_m: float, layer_names: Collection[str]) -> tuple[str, ...]:
        """Forget what layers know outside a square around the robot; return the names of those that were found.

        As costmap_2d's ClearCostmapRecovery: the layer says nothing of these cells any more, and the next update looks at all of them.

        Parameters
        ----------
        pose
            float64 (3,), the robot in the costmap's frame.
        half_width_m
            Half of reset_distance.
        layer_names
            Compared with what follows the last ``/`` of a layer's name.
        """
        return self._forget(pose, half_width_m, layer_names, inside=False)

    def clear_inside(self, pose: ArrayLike, half_width_m: float, layer_names: Collection[str]) -> tuple[str, ...]:
        """Forget what layers know inside a square around the robot; see `clear_outside`."""
        return self._forget(pose, half_width_m, layer_names, inside=True)

    def _forget(
        self, pose: ArrayLike, half_width_m: float, layer_names: Collection[str], *, inside: bool
    ) -> tuple[str, ...]:
        x, y = np.asarray(pose, dtype=np.float64)[:2] - self._extent.corner
        resolution = self._extent.resolution_m
        # The border cells of the square do not belong to it, as in costmap_2d.
        first_row, last_row = (int(np.floor((y + s * half_width_m) / resolution)) for s in (-1, 1))
        first_column, last_column = (int(np.floor((x + s * half_width_m) / resolution)) for s in (-1, 1))
        cells = np.zeros(self._extent.shape, dtype=np.bool_)
        cells[max(0, first_row + 1) : max(0, last_row), max(0, first_column + 1) : max(0, last_column)] = True
        if not inside:
            cells = ~cells
        layers: list[ObstacleLayer | StaticLayer] = list(self._obstacles)
        if self._static is not None and not self.parameters.costmap.rolling_window:
            layers.insert(0, self._static)
        found = [layer for layer in layers if layer.name.rpartition("/")[2] in layer_names]
        for layer in found:
            layer.forget(cells)
            self._is_stale = True
        return tuple(layer.name for layer in found)

    def _follow(self, pose: NDArray[np.float64]) -> None:
        rows, columns = self._extent.steps_to_centre(float(pose[0]), float(pose[1]))
        if rows == 0 and columns == 0:
            return
        self._extent = self._extent.moved(rows, columns)
        for layer in self._obstacles:
            layer.place(self._extent)
        self._is_new = True

    def _take_map(self, static: StaticLayer, grid: OccupancyGrid) -> None:
        static.set_map(grid)
        self._next_map = None
        if not self.parameters.costmap.rolling_window:
            self._place(static.extent)
        self._is_stale = True

    def _place(self, extent: Extent) -> None:
        offset = extent.offset_from(self._extent)
        if offset == (0, 0) and extent.shape == self._extent.shape:
            return
        self._extent = extent
        for layer in self._obstacles:
            layer.place(extent)
        self._inflation.place(extent)
        self._is_new = True
        self._below = np.full(extent.shape, self._default, dtype=np.uint8)

    def _stack(self, box: NDArray[np.int64], T_map_frame: NDArray[np.float64] | None) -> None:
        """Put all layers below inflation on each other within a box."""
        kernels.put_value(self._default, box, self._below)
        by_name = {layer.name: layer for layer in self._obstacles}
        for layer in self.parameters.layers:
            if layer.kind == "static" and self._static is not None:
                if self.parameters.costmap.rolling_window:
                    pose = np.zeros(3) if T_map_frame is None else T_map_frame
                    self._static.put_sampled(pose, self._extent, box, self._below)
                else:
                    self._static.put(box, self._below)
            elif layer.name in by_name:
                by_name[layer.name].put(box, self._below)

    def _static_layer(self, static: OccupancyGrid | None) -> StaticLayer | None:
        for layer in self.parameters.layers:
            if layer.kind == "static":
                if static is None:
                    raise ConfigError(f"{self.name} costmap: layer {layer.name!r} needs a map")
                return StaticLayer(layer.name, self.parameters.costmap, static)
        return None

    def _first_extent(self) -> Extent:
        own = self.parameters.costmap
        if self._static is not None and not own.rolling_window:
            return self._static.extent
        height, width = (int(side / own.resolution + 1e-9) for side in (own.height, own.width))
        if height < 1 or width < 1:
            raise ConfigError(
                f"{self.name} costmap: {own.width:g} x {own.height:g} m has no cell of {own.resolution:g} m"
            )
        if height * width > 1 << 28:
            raise ConfigError(
                f"{self.name} costmap: {own.width:g} x {own.height:g} m has too many cells of {own.resolution:g} m"
            )
        least = min(height, width) * own.resolution
        if own.rolling_window and 2.0 * self.circumscribed_radius_m > least:
            raise ConfigError(
                f"{self.name} costmap: the robot ({2.0 * self.circumscribed_radius_m:.2f} m across) is wider than the window"
                f" of {own.width:g} x {own.height:g} m: make width and height larger"
            )
        return Extent(np.array([own.origin_x, own.origin_y], dtype=np.float64), own.resolution, height, width)

    def _inflation_layer(self) -> InflationLayer:
        own = self.parameters.costmap
        wanted = own.inflation_enabled and any(layer.kind == "inflation" for layer in self.parameters.layers)
        radius = COSTMAP_2D_INFLATION_RADIUS_M if own.inflation_radius is None else own.inflation_radius
        return InflationLayer(
            self._extent,
            self.inscribed_radius_m,
            radius if wanted else 0.0,
            own.cost_scaling_factor,
            inflate_unknown=own.inflate_unknown,
        )
