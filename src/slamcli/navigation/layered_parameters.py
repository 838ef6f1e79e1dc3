# SPDX-License-Identifier: MIT
"""What a layered costmap is made of: its own parameters and its layers in their order."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.obstacle_parameters import ObservationSource, ObstacleParameters

Kind = Literal["static", "obstacle", "voxel", "inflation"]
CostmapName = Literal["global", "local"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerParameters:
    """One layer."""

    name: str
    kind: Kind
    obstacle: ObstacleParameters = field(default_factory=ObstacleParameters)
    """Of obstacle and voxel layers."""
    sources: tuple[ObservationSource, ...] = ()
    """Of obstacle and voxel layers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayeredParameters:
    """A whole costmap; the parameters of its static layer and its inflation layer stand in `costmap`."""

    costmap: CostmapParameters
    layers: tuple[LayerParameters, ...] = field(default=())

    @property
    def sources(self) -> tuple[ObservationSource, ...]:
        """Every sensor of every layer."""
        return tuple(source for layer in self.layers for source in layer.sources)

    @classmethod
    def standard(
        cls, name: CostmapName, *, obstacle: ObstacleParameters | None = None, **values: Any
    ) -> LayeredParameters:
        """Return the usual costmap without a file: one laser scanner `laser_scan` that marks and clears.

        The global one has the static map below in frame map, the local one is a rolling window of 4 by 4 m in frame odom.

        Parameters
        ----------
        name
            Which of the two.
        obstacle
            Parameters of the obstacle layer.
        values
            Fields of `CostmapParameters`.
        """
        if name == "local":
            values = {"global_frame": "odom", "rolling_window": True, "width": 4.0, "height": 4.0} | values
        else:
            values = {"update_frequency": 1.0} | values
        scanner = ObservationSource(data_type="LaserScan", topic="/scan", marking=True, clearing=True)
        sensing = LayerParameters(
            name="obstacle_layer", kind="obstacle", obstacle=obstacle or ObstacleParameters(), sources=(scanner,)
        )
        layers: tuple[LayerParameters, ...] = (sensing, LayerParameters(name="inflation_layer", kind="inflation"))
        if name == "global":
            layers = (LayerParameters(name="static_layer", kind="static"), *layers)
        return cls(costmap=CostmapParameters(**values), layers=layers)

    def replaced(self, **values: Any) -> LayeredParameters:
        """Return it with other fields of `CostmapParameters`."""
        return dataclasses.replace(self, costmap=dataclasses.replace(self.costmap, **values))
