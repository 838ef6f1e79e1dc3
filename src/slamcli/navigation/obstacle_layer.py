# SPDX-License-Identifier: MIT
"""The obstacle layer of costmap_2d: beams clear, points mark, the robot stands on free cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _master_kernels as master
from slamcli.navigation import _obstacle_kernels as kernels
from slamcli.navigation.cell_bounds import Extent, shifted
from slamcli.navigation.costmap import FREE, NO_INFORMATION
from slamcli.navigation.layered_parameters import LayerParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_parameters import ObservationSource

Box = NDArray[np.int64]


class ObservationBuffer:
    """What one source has said lately, newest first: one observation, or those of its persistence before the newest."""

    def __init__(self, source: ObservationSource) -> None:
        self.source = source
        self.observations: list[Observation] = []

    def add(self, observation: Observation) -> None:
        """Take the newest observation and forget those that are too old beside it."""
        kept = self.source.observation_persistence
        self.observations.insert(0, observation)
        oldest = observation.time_s - kept
        count = 1 if kept == 0.0 else sum(o.time_s >= oldest - 1e-9 for o in self.observations)
        del self.observations[count:]

    def is_current(self, time_s: float) -> bool:
        """Return whether it has been heard of within its expected time, which begins at 0 s."""
        rate = self.source.expected_update_rate
        last_s = self.observations[0].time_s if self.observations else 0.0
        return rate == 0.0 or time_s - last_s <= rate + 1e-9


class ObstacleLayer:
    """Obstacles that sensors saw, on the cells of a costmap.

    Parameters
    ----------
    layer
        Name, parameters, sources.
    extent
        Where the costmap lies.
    default
        Cost of a cell that no beam has met: 0, or 255 where unknown space is tracked.
    """

    def __init__(self, layer: LayerParameters, extent: Extent, default: int) -> None:
        self.name = layer.name
        self.parameters = layer.obstacle
        tracked = self.parameters.track_unknown_space
        self.default = default if tracked is None else (NO_INFORMATION if tracked else FREE)
        self.extent = extent
        self.costs = np.full(extent.shape, self.default, dtype=np.uint8)
        self.buffers = [ObservationBuffer(source) for source in layer.sources]

    def observe(self, observation: Observation) -> bool:
        """Take an observation if it is from a source of this layer; return whether it is."""
        for buffer in self.buffers:
            if buffer.source.name == observation.source:
                buffer.add(observation)
                return True
        return False

    def update(self, polygon: NDArray[np.float64], pose: NDArray[np.float64], touched: Box) -> None:
        """Apply what the sources say: all clear, then all mark, then the cells under the robot are free.

        Parameters
        ----------
        polygon
            float64 (N, 2), base frame.
        pose
            float64 (3,), of the robot.
        touched
            int64 (4,), the box to be grown by the cells that were written.
        """
        if not self.parameters.enabled:
            return
        for buffer in self.buffers:
            if buffer.source.clearing:
                for observation in buffer.observations:
                    self._clear(observation, self.parameters.raytrace_ranges(buffer.source), touched)
        for buffer in self.buffers:
            if buffer.source.marking:
                for observation in buffer.observations:
                    self._mark(observation, self.parameters.obstacle_ranges(buffer.source), touched)
        if self.parameters.footprint_clearing_enabled:
            self._clear_footprint(polygon, pose, touched)

    def put(self, box: Box, out: NDArray[np.uint8]) -> None:
        """Put the layer on those below within a box."""
        if not self.parameters.enabled:
            return
        if self.parameters.combination_method == 1:
            master.put_maximum(self.costs, box, out)
        elif self.parameters.combination_method == 0:
            master.put_known(self.costs, box, out)

    def place(self, extent: Extent) -> None:
        """Move to another extent; what lies on both is kept where the resolution is the same."""
        offset = extent.offset_from(self.extent)
        if offset is None:
            self.costs = np.full(extent.shape, self.default, dtype=np.uint8)
        else:
            self.costs = shifted(self.costs, *offset, extent.shape, self.default)
        self.extent = extent

    def forget(self, cells: NDArray[np.bool_]) -> None:
        """Forget what is known of the cells that are true in `cells`, bool (H, W)."""
        self.costs[cells] = NO_INFORMATION

    def _clear(self, observation: Observation, ranges: tuple[float, float], touched: Box) -> None:
        least, most = ranges
        corner, resolution = self.extent.corner, self.extent.resolution_m
        for ends in (observation.points, observation.clear_points):
            kernels.clear_beams(self.costs, observation.origin, ends, corner, resolution, most, least, touched)

    def _mark(self, observation: Observation, ranges: tuple[float, float], touched: Box) -> None:
        least, most = ranges
        low, high = self.parameters.min_obstacle_height, self.parameters.max_obstacle_height
        corner, resolution = self.extent.corner, self.extent.resolution_m
        kernels.mark_points(
            self.costs, observation.origin, observation.points, corner, resolution, most, least, low, high, touched
        )

    def _clear_footprint(self, polygon: NDArray[np.float64], pose: NDArray[np.float64], touched: Box) -> None:
        cells = np.empty(polygon.shape, dtype=np.int64)
        corner, resolution = self.extent.corner, self.extent.resolution_m
        if kernels.outline_cells(polygon, pose, corner, resolution, self.extent.height, self.extent.width, cells):
            kernels.fill_outline(self.costs, cells, FREE, touched)


def warm() -> None:
    """Compile the kernels of this module and of the static layer's sampling."""
    extent = Extent(np.zeros(2), 0.1, 8, 8)
    source = ObservationSource(clearing=True)
    layer = ObstacleLayer(LayerParameters(name="obstacles", kind="obstacle", sources=(source,)), extent, FREE)
    points = np.array([[0.5, 0.4, 0.0]])
    layer.observe(
        Observation(source=source.name, time_s=0.0, origin=np.full(3, 0.1), points=points, clear_points=points)
    )
    layer.update(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]), np.array([0.3, 0.3, 0.0]), extent.nothing())
    out = np.zeros(extent.shape, dtype=np.uint8)
    kernels.sample(layer.costs, extent.corner, 0.1, np.zeros(3), extent.corner, 0.1, False, extent.everything(), out)
