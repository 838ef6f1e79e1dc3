# SPDX-License-Identifier: MIT
"""Grids over the plane: occupancy, and what is built on it."""

from slamcli.grids.occupancy import OccupancyGrid

__all__ = ["OccupancyGrid"]
