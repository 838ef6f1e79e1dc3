# SPDX-License-Identifier: MIT
"""Timed elastic bands: ROS' teb_local_planner."""

from slamcli.navigation.teb.parameters import TebParameters
from slamcli.navigation.teb.planner import TebPlanner

__all__ = ["TebParameters", "TebPlanner"]
