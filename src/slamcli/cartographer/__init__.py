# SPDX-License-Identifier: MIT
"""Submaps, loop closure by branch and bound and a pose graph (Hess et al., ICRA 2016), in 2D and 3D."""

from __future__ import annotations

from typing import Any

from slamcli.cartographer.parameters import CartographerParameters
from slamcli.mapper import Mapper, Setup


class CartographerTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "cartographer"
    parameters: type = CartographerParameters

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from importlib import import_module

        mapper: Mapper = import_module("slamcli.cartographer.mapper").CartographerMapper(parameters, setup)
        return mapper


TIER = CartographerTier()

__all__ = ["TIER", "CartographerParameters", "CartographerTier"]
