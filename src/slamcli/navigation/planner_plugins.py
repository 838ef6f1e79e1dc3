# SPDX-License-Identifier: MIT
"""What ROS and nav2 call the global planners."""

from __future__ import annotations

from collections.abc import Mapping

from slamcli.errors import ConfigError
from slamcli.navigation.planner_methods import METHODS, Method

PLUGINS: Mapping[str, Method] = {
    "navfn/NavfnROS": "navfn",
    "NavfnROS": "navfn",
    "global_planner/GlobalPlanner": "global_planner",
    "GlobalPlanner": "global_planner",
    "nav2_navfn_planner/NavfnPlanner": "navfn",
    "nav2_smac_planner/SmacPlanner2D": "astar",
    "nav2_smac_planner/SmacPlannerHybrid": "hybrid_astar",
    "nav2_smac_planner/SmacPlanner": "hybrid_astar",
    "nav2_theta_star_planner/ThetaStarPlanner": "theta_star",
}


def find_global_planner(name: str) -> Method:
    """Return the planner that a name or a plugin means.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    for method in METHODS:
        if name == method:
            return method
    method_of_plugin = PLUGINS.get(name.replace("::", "/"))
    if method_of_plugin is None:
        raise ConfigError(f"base_global_planner {name!r}: choose one of {', '.join(METHODS)}")
    return method_of_plugin
