# SPDX-License-Identifier: MIT
"""The tier's mapper: in the plane or in space, as the parameters say."""

from __future__ import annotations

from slamcli.cartographer.parameters import CartographerParameters
from slamcli.cartographer.trimming import trimmed
from slamcli.mapper import Mapper, MappingResult, Setup
from slamcli.measurements import Measurement


class CartographerMapper:
    """Hands everything to the mapper in 2D, or in 3D where MAP_BUILDER.use_trajectory_builder_3d is set."""

    def __init__(self, parameters: CartographerParameters, setup: Setup) -> None:
        self._parameters, self._setup = parameters, setup
        self._mapper: Mapper
        if parameters.map_builder.dimensions == 3:
            from slamcli.cartographer.mapper_3d import Mapper3D

            self._mapper = Mapper3D(parameters, setup)
        else:
            from slamcli.cartographer.mapper_2d import Mapper2D

            self._mapper = Mapper2D(parameters, setup)

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement."""
        self._mapper.process(measurement)

    def finish(self) -> MappingResult:
        """End the run and return its result."""
        return trimmed(self._mapper.finish(), self._parameters, self._setup)
