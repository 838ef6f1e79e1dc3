# SPDX-License-Identifier: MIT
"""Parameters of the global planners under the names of navfn and global_planner."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.navigation.hybrid_parameters import HybridParameters
from slamcli.parameters import group, parameter

ORIENTATION_MODES = (
    "none",
    "forward",
    "interpolate",
    "forward_then_interpolate",
    "backward",
    "leftward",
    "rightward",
)
"""In global_planner's order: the number of a mode is its place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerParameters:
    """What a planner does with the costmap."""

    allow_unknown: bool | None = parameter(
        None,
        "Plan through unknown cells, at the greatest cost that is not an obstacle (navfn's default is true). auto: only"
        " where no way through known cells exists, and said so.",
        kind=bool,
    )
    default_tolerance: float = parameter(
        0.0,
        "How far from the goal the path may end, in x and in y, if the goal itself cannot be reached.",
        unit="m",
        minimum=0.0,
        maximum=1000.0,
    )
    neutral_cost: float = parameter(50.0, "Cost of crossing a free cell; navfn's constant.", minimum=1.0, maximum=250.0)
    cost_factor: float | None = parameter(
        None,
        "What a costmap value adds to it: a cell costs neutral_cost + cost_factor * value, relative to neutral_cost."
        " 0 looks for the shortest way and takes the costmap only as free or not. auto: 0.8, navfn's constant;"
        " 3 with the planner global_planner.",
        kind=float,
        minimum=0.0,
        maximum=1000.0,
    )
    lethal_cost: int = parameter(
        253, "global_planner: costmap value that blocks (with use_dijkstra one less does).", minimum=1, maximum=255
    )
    use_dijkstra: bool = parameter(True, "global_planner: Dijkstra's wave, otherwise its A*.")
    use_quadratic: bool = parameter(True, "global_planner: quadratic fit of the potential, otherwise the plain sum.")
    use_grid_path: bool = parameter(False, "global_planner: the path follows cells, otherwise the gradient.")
    old_navfn_behavior: bool = parameter(
        False, "global_planner: the wave begins at the middle of the start's cell, as navfn's does."
    )
    outline_map: bool = parameter(True, "global_planner: the outermost cells of the map block.")
    orientation_mode: str = parameter(
        "forward",
        "Heading along the path; a goal with yaw ends in it.",
        choices=(*ORIENTATION_MODES, *(str(i) for i in range(len(ORIENTATION_MODES)))),
    )
    orientation_window_size: int = parameter(
        1, "Poses before and after over which a heading is taken.", minimum=1, maximum=10000
    )
    simplify: bool = parameter(
        False, "Replace stretches by straight lines where these are free and cost no more.", extension=True
    )
    smooth: bool = parameter(
        False,
        "Move the path's points towards the middle of their neighbours where that is free and costs no more.",
        extension=True,
    )
    hybrid: HybridParameters = group(HybridParameters(), name="")
    visualize_potential: bool = parameter(False, "Accepted; no meaning offline.", effective=False)
    publish_potential: bool = parameter(True, "Accepted; no meaning offline.", effective=False)
    publish_scale: int = parameter(100, "Accepted; no meaning offline.", minimum=0, effective=False)
    planner_window_x: float = parameter(0.0, "Accepted; navfn ignores it, too.", unit="m", effective=False)
    planner_window_y: float = parameter(0.0, "Accepted; navfn ignores it, too.", unit="m", effective=False)

    @property
    def factor(self) -> float:
        """`cost_factor` as all planners but global_planner use it."""
        return 0.8 if self.cost_factor is None else self.cost_factor

    @property
    def orientation(self) -> str:
        """The orientation mode by name."""
        mode = self.orientation_mode
        return ORIENTATION_MODES[int(mode)] if mode.isdigit() else mode
