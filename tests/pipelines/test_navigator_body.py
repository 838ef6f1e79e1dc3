# SPDX-License-Identifier: MIT
"""The simulated robot is as large as its costmaps think, whatever the world file says of the robot that records there."""

from __future__ import annotations

from slamcli.pipelines.navigate import Navigator, SlamChoice


def test_body_is_that_of_the_costmaps():
    robot = Navigator(None, start=(2.4, 2.0, 0.0), world="warehouse", slam=SlamChoice(algo="gmapping"))
    assert robot.plant.parameters.robot_radius == robot.config.global_costmap.costmap.robot_radius == 0.18
