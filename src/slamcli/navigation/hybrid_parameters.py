# SPDX-License-Identifier: MIT
"""Parameters of hybrid A* under the names of nav2's Smac planner."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class HybridParameters:
    """How a robot with a turning radius drives."""

    minimum_turning_radius: float = parameter(
        0.4, "Least radius of a curve the robot can drive.", unit="m", minimum=0.01, maximum=1000.0
    )
    motion_model_for_search: str = parameter(
        "REEDS_SHEPP", "DUBIN drives forward only, REEDS_SHEPP in reverse, too.", choices=("DUBIN", "REEDS_SHEPP")
    )
    angle_quantization_bins: int = parameter(72, "Headings that the search tells apart.", minimum=8, maximum=720)
    reverse_penalty: float = parameter(
        2.0, "What a metre in reverse costs in metres forward.", minimum=1.0, maximum=1000.0
    )
    non_straight_penalty: float = parameter(
        1.2, "What a metre in a curve costs in metres straight on.", minimum=1.0, maximum=1000.0
    )
    cusp_penalty: float = parameter(
        0.2,
        "What changing between forward and reverse costs.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
        extension=True,
    )
    analytic_expansion_ratio: float = parameter(
        3.5, "How often a curve straight to the goal is tried; larger is more often.", minimum=0.1, maximum=100.0
    )
    max_iterations: int = parameter(
        200_000, "States after which the search gives up.", minimum=1000, maximum=20_000_000
    )
