# SPDX-License-Identifier: MIT
"""The Rao-Blackwellised particle filter of gmapping (Grisetti, Stachniss and Burgard, T-RO 2007)."""

from __future__ import annotations

from typing import Any

from slamcli.gmapping.parameters import GmappingParameters
from slamcli.mapper import Mapper, Setup


class GmappingTier:
    """Entry point of the tier; the mapper and its kernels are imported when it is built."""

    name = "gmapping"
    parameters: type = GmappingParameters

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""
        from slamcli.gmapping.mapper import GmappingMapper

        return GmappingMapper(parameters, setup)


TIER = GmappingTier()

__all__ = ["TIER", "GmappingParameters", "GmappingTier"]
