# SPDX-License-Identifier: MIT
"""Which local planners there are, what ROS calls them, and how each is built."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from slamcli.errors import ConfigError
from slamcli.navigation.dwa import DwaPlanner
from slamcli.navigation.dwa_parameters import ALIASES, DwaParameters
from slamcli.navigation.local_planner import LocalPlanner
from slamcli.navigation.pursuit import RegulatedPurePursuit
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.teb import TebParameters, TebPlanner

LocalPlannerKind = Literal["dwa", "teb", "pursuit"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalPlannerEntry:
    """One local planner."""

    section: str
    """What its parameters stand under in ROS's files."""
    parameters: type
    build: Callable[[Any, float, str], LocalPlanner]
    """From its parameters, the control period in seconds, and the scaling of DWA's weights."""
    plugins: tuple[str, ...] = ()
    """What base_local_planner calls it."""
    aliases: Mapping[str, str] = field(default_factory=dict)
    """Older names of parameters."""
    lent: Mapping[str, str] = field(default_factory=dict)
    """Parameters that take the value of one of DWAPlannerROS where its own section has none: the robot is the same."""

    def borrow(self, from_dwa: Mapping[str, Any]) -> dict[str, Any]:
        """Return the robot's limits and the goal's tolerances as this planner calls them, from what DWA was given."""
        borrowed = {own: from_dwa[name] for own, name in self.lent.items() if name in from_dwa}
        if "max_vel_x_backwards" in borrowed:  # DWA has it as a negative bound
            borrowed["max_vel_x_backwards"] = -borrowed["max_vel_x_backwards"]
        return {own: value for own, value in borrowed.items() if value > 0.0}

    def today(self, name: str) -> str:
        """Return today's name of a parameter."""
        return self.aliases.get(name, name)


_LENT_TO_TEB = {
    "max_vel_x_backwards": "min_vel_x",
    **{
        name: name
        for name in (
            *("max_vel_x", "max_vel_y", "max_vel_trans", "max_vel_theta", "acc_lim_x", "acc_lim_y", "acc_lim_theta"),
            *("xy_goal_tolerance", "yaw_goal_tolerance", "trans_stopped_vel", "theta_stopped_vel"),
        )
    },
}

LOCAL_PLANNERS: Mapping[LocalPlannerKind, LocalPlannerEntry] = {
    "dwa": LocalPlannerEntry(
        section="DWAPlannerROS",
        parameters=DwaParameters,
        build=lambda parameters, period_s, scaling: DwaPlanner(
            parameters, control_period_s=period_s, scaling="kinetic" if scaling == "kinetic" else "noetic"
        ),
        plugins=("dwa_local_planner/DWAPlannerROS", "base_local_planner/TrajectoryPlannerROS"),
        aliases=ALIASES,
    ),
    "teb": LocalPlannerEntry(
        section="TebLocalPlannerROS",
        parameters=TebParameters,
        build=lambda parameters, period_s, _: TebPlanner(parameters, control_period_s=period_s),
        plugins=("teb_local_planner/TebLocalPlannerROS",),
        lent=_LENT_TO_TEB,
    ),
    "pursuit": LocalPlannerEntry(
        section="FollowPath",
        parameters=PursuitParameters,
        build=lambda parameters, period_s, _: RegulatedPurePursuit(parameters, control_period_s=period_s),
        plugins=("nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",),
    ),
}


def find_local_planner(name: str) -> LocalPlannerKind:
    """Return the planner that a name or a ROS plugin means.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    for kind, entry in LOCAL_PLANNERS.items():
        if name == kind or name in entry.plugins or name == entry.section:
            return kind
    raise ConfigError(f"base_local_planner {name!r}: choose one of {', '.join(LOCAL_PLANNERS)}")


def build_local_planner(
    kind: LocalPlannerKind, parameters: Any, control_period_s: float, scaling: str = "noetic"
) -> LocalPlanner:
    """Return a local planner; `scaling` is of DWA's weights: noetic or kinetic."""
    return LOCAL_PLANNERS[kind].build(parameters, control_period_s, scaling)
