# SPDX-License-Identifier: MIT
"""What local planners take over from DWA's section of the same files."""

from __future__ import annotations

from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.runtime import RunLog


def test_teb_takes_the_limits_of_the_robot():
    teb = LOCAL_PLANNERS["teb"]
    given = {"max_vel_x": 0.5, "min_vel_x": -0.1, "acc_lim_y": 0.0, "max_vel_theta": 1.5, "vx_samples": 10}
    assert teb.borrow(given) == {"max_vel_x": 0.5, "max_vel_x_backwards": 0.1, "max_vel_theta": 1.5}
    assert teb.borrow({"min_vel_x": 0.0}) == {}
    assert LOCAL_PLANNERS["dwa"].borrow(given) == {}


def test_what_its_own_section_says_comes_first():
    log = RunLog()
    config = load_navigation(sets=["TebLocalPlannerROS/max_vel_theta=0.7"], local_planner="teb", log=log)
    assert config.local_parameters.robot.max_vel_theta == 0.7
    assert config.local_parameters.robot.max_vel_x == 0.5
    assert config.local_parameters.max_vel_x == 0.5
    assert config.local_parameters.robot.max_vel_x_backwards == 0.1
    assert any("takes the robot's limits from DWAPlannerROS" in str(note) for note in log.notes)


def test_a_footprint_model_is_found_by_its_name():
    sets = ["TebLocalPlannerROS/footprint_model/type=circular", "TebLocalPlannerROS/footprint_model/radius=0.3"]
    model = load_navigation(sets=sets, local_planner="teb").local_parameters.footprint_model
    assert (model.type, model.radius) == ("circular", 0.3)
