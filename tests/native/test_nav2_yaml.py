# SPDX-License-Identifier: MIT
"""Parameter files of nav2 in ROS 1's names."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native.nav2_yaml import is_nav2, translate_nav2
from slamcli.native.ros_yaml import parse_ros_yaml
from slamcli.pipelines.config import load_declared
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.runtime import RunLog

DWB = """\
controller_server:
  ros__parameters:
    controller_frequency: 10.0
    failure_tolerance: 0.5
    progress_checker_plugin: progress_checker
    goal_checker_plugins: [precise]
    controller_plugins: [Drive]
    progress_checker: {plugin: "nav2_controller::SimpleProgressChecker", required_movement_radius: 0.4, movement_time_allowance: 8.0}
    precise: {stateful: true, xy_goal_tolerance: 0.12, yaw_goal_tolerance: 0.2}
    Drive:
      plugin: dwb_core::DWBLocalPlanner
      max_vel_x: 0.3
      max_speed_xy: 0.31
      vtheta_samples: 15
      xy_goal_tolerance: 0.9
      PathDist.scale: 32.0
      GoalDist.scale: 24.0
      BaseObstacle.scale: 0.02
      PathAlign.forward_point_distance: 0.15
      RotateToGoal.scale: 32.0
"""


def translated(text: str):
    settings = parse_ros_yaml(text, "n.yaml")
    assert is_nav2(settings)
    found = translate_nav2(settings)
    return {s.name: s.value for s in found.settings}, found.notes


def loaded(folder: Path, text: str):
    path = folder / "nav2.yaml"
    path.write_text(text)
    log = RunLog()
    return load_navigation([path], log=log), log


def test_dwb_is_dwa_and_the_goal_checker_decides():
    found, notes = translated(DWB)
    section = {name.rpartition("/")[2]: value for name, value in found.items() if name.startswith("DWAPlannerROS/")}
    assert section == {
        "max_vel_x": 0.3, "max_vel_trans": 0.31, "vth_samples": 15, "xy_goal_tolerance": 0.12, "yaw_goal_tolerance": 0.2,
        "latch_xy_goal_tolerance": True, "path_distance_bias": 16.0, "goal_distance_bias": 12.0, "occdist_scale": 0.02,
        "forward_point_distance": 0.15,
    }  # fmt: skip
    assert (found["controller_frequency"], found["controller_patience"]) == (10.0, 0.5)
    assert (found["oscillation_distance"], found["oscillation_timeout"]) == (0.4, 8.0)
    assert found["base_local_planner"] == "dwa"
    assert notes == ("of nav2's parameters these are not read: controller_server/Drive/RotateToGoal.scale",)


@pytest.mark.parametrize(
    ("plugin", "more", "kind", "field", "value"),
    [
        ("nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController", "desired_linear_vel: 0.4", "pursuit", "desired_linear_vel", 0.4),
        ("teb_local_planner::TebLocalPlannerROS", "footprint_model: {type: circular, radius: 0.3}", "teb", "max_vel_x", 0.4),
        ("nav2_mppi_controller::MPPIController", "vx_max: 0.35", "dwa", "max_vel_trans", 0.35),
        ("nav2_rotation_shim_controller::RotationShimController", "primary_controller: dwb_core::DWBLocalPlanner, sim_time: 1.1", "dwa", "sim_time", 1.1),
    ],
)  # fmt: skip
def test_other_controllers(tmp_path, plugin, more, kind, field, value):
    text = f'controller_server:\n  ros__parameters:\n    FollowPath: {{plugin: "{plugin}", {more}}}\n'
    config, log = loaded(tmp_path, text)
    assert ("MPPIController has no counterpart: DWA drives" in "".join(log.notes)) == ("MPPI" in plugin)
    assert (config.local_planner, getattr(config.local_parameters, field)) == (kind, value)
    if kind == "teb":
        assert config.local_parameters.footprint_model.radius == 0.3


@pytest.mark.parametrize(
    ("planner", "method"),
    [
        ("plugin: nav2_navfn_planner/NavfnPlanner", "navfn"),
        ("plugin: nav2_navfn_planner::NavfnPlanner, use_astar: true", "astar"),
        ("plugin: nav2_smac_planner/SmacPlannerHybrid, minimum_turning_radius: 0.7", "hybrid_astar"),
        ("plugin: nav2_theta_star_planner/ThetaStarPlanner", "theta_star"),
        ("plugin: nav2_smac_planner/SmacPlannerLattice", "navfn"),
        ("tolerance: 0.3", "navfn"),
    ],
)
def test_planners(tmp_path, planner, method):
    config, log = loaded(tmp_path, f"planner_server:\n  ros__parameters:\n    GridBased: {{{planner}}}\n")
    assert config.global_planner == method
    assert config.planner.hybrid.minimum_turning_radius == (0.7 if "0.7" in planner else 0.4)
    assert config.planner.default_tolerance == (0.3 if "tolerance" in planner else 0.0)
    assert ("SmacPlannerLattice has no counterpart: NavFn plans" in "".join(log.notes)) == ("Lattice" in planner)


def test_amcl_behaviours_and_what_is_left():
    found, notes = translated(
        "amcl:\n  ros__parameters: {use_sim_time: true, alpha1: 0.1, z_hit: 0.5, pf_err: 0.05, robot_model_type:"
        " 'nav2_amcl::OmniMotionModel', initial_pose: {x: 1.0, y: 2.0, z: 0.0, yaw: 0.5}, scan_topic: scan}\n"
        "behavior_server:\n  ros__parameters: {behavior_plugins: [spin, backup, wait], max_rotational_vel: 0.8}\n"
        "smoother_server:\n  ros__parameters: {a: 1}\nmap_server:\n  ros__parameters: {use_sim_time: true}\n"
    )
    assert found == {
        "amcl/odom_alpha1": 0.1, "amcl/laser_z_hit": 0.5, "amcl/kld_err": 0.05, "amcl/odom_model_type": "omni-corrected",
        "amcl/initial_pose_x": 1.0, "amcl/initial_pose_y": 2.0, "amcl/initial_pose_a": 0.5,
        "recovery_behaviors": "conservative_reset rotate_recovery back_up aggressive_reset",
        "rotate_recovery/max_rotational_vel": 0.8,
    }  # fmt: skip
    assert notes == ("of nav2's parameters these are not read: amcl/initial_pose/z, amcl/scan_topic, smoother_server",)


def test_costmaps_keep_their_names_and_foreign_layers_go(tmp_path):
    text = """\
local_costmap:
  local_costmap:
    ros__parameters:
      use_sim_time: true
      width: 3
      robot_radius: 0.22
      rolling_window: true
      plugins: [seen, denoise_layer, inflation_layer]
      seen: {plugin: "nav2_costmap_2d::VoxelLayer", observation_sources: scan, scan: {data_type: LaserScan, obstacle_max_range: 2.0}}
      denoise_layer: {plugin: "nav2_costmap_2d::DenoiseLayer", minimal_group_size: 2}
      inflation_layer: {plugin: "nav2_costmap_2d::InflationLayer", inflation_radius: 0.6}
"""
    config, log = loaded(tmp_path, text)
    local = config.local_costmap
    assert [layer.name for layer in local.layers] == ["seen", "inflation_layer"]
    assert (local.costmap.width, local.costmap.inflation_radius, local.sources[0].obstacle_range) == (3.0, 0.6, 2.0)
    assert "layer 'denoise_layer' of type 'nav2_costmap_2d::DenoiseLayer' has no counterpart here" in "\n".join(
        log.notes
    )


def test_localize_takes_amcl_of_it(tmp_path):
    path = tmp_path / "nav2.yaml"
    path.write_text("amcl:\n  ros__parameters: {max_beams: 60, scan_topic: s}\n" + DWB)
    log = RunLog()
    parameters = load_declared("amcl", AmclParameters, [path], log=log).parameters
    assert (parameters.laser_max_beams, parameters.odom_model_type) == (60, "diff-corrected")
    assert log.notes == [f"{path}: of nav2's parameters these are not read: amcl/scan_topic"]
    path.write_text(DWB)
    with pytest.raises(ConfigError, match=r"nav2.yaml: says nothing to amcl"):
        load_declared("amcl", AmclParameters, [path])


def test_what_is_no_list_of_plugins():
    with pytest.raises(ConfigError, match=r"n.yaml:3: controller_plugins is no list of names"):
        translated("controller_server:\n  ros__parameters:\n    controller_plugins: [1]\n")
    with pytest.raises(ConfigError, match=r"n.yaml:2: behavior_plugins is no list of names"):
        translated("behavior_server:\n  ros__parameters: {behavior_plugins: spin}\n")
