# SPDX-License-Identifier: MIT
"""How a setting of the simulation that is a number is declared."""

from __future__ import annotations

from slamcli.parameters import parameter

_LIMIT = 1e6  # keeps infinities and slips of the finger out where nothing narrower is meant


def number(
    name: str, default: float, unit: str, help: str, minimum: float | None = 0.0, maximum: float = _LIMIT
) -> float:
    """Declare a number; without a `minimum` it may be negative."""
    lowest = -_LIMIT if minimum is None else minimum
    return parameter(default, help, name=name, kind=float, unit=unit, minimum=lowest, maximum=maximum)
