# SPDX-License-Identifier: MIT
"""What `config check` says of files of the navigation stack whose parts do not fit each other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamcli.cli.main import run
from slamcli.native.checks.files import check_file

TABLES = {"gmapping": (), "cartographer": (), "orbslam3": (), "rtabmap": ()}
LAUNCH = '<launch>\n<node pkg="move_base" type="move_base" name="m">\n<rosparam>\n{}</rosparam>\n</node>\n</launch>\n'
FITTING = """\
global_costmap: {robot_radius: 0.2, static_map: true, inflation_layer: {inflation_radius: 0.5}}
local_costmap: {robot_radius: 0.2, global_frame: odom, width: 4.0, height: 4.0, update_frequency: 5.0}
conservative_reset: {layer_names: [obstacle_layer]}
aggressive_reset: {layer_names: [obstacle_layer]}
DWAPlannerROS: {max_vel_trans: 0.5, sim_time: 2.0, xy_goal_tolerance: 0.1}
"""


def findings(folder: Path, text: str, name: str = "nav.yaml", **options) -> list[tuple[str, int, str]]:
    path = folder / name
    path.write_text(text)
    return [(f.severity, f.line, f.message) for f in check_file(path, TABLES, **options)]


def has(found, severity: str, line: int, text: str) -> bool:
    return any(s == severity and n == line and text in message for s, n, message in found)


def test_parts_that_fit_have_no_warnings(tmp_path):
    assert [f for f in findings(tmp_path, FITTING) if f[0] != "note"] == []
    assert [f for f in findings(tmp_path, LAUNCH.format(FITTING), "n.launch") if f[0] != "note"] == []


CHANGES = [
    ("local_costmap: {robot_radius: 0.2,", "local_costmap: {", "warning", 2, "local_costmap has neither robot_radius nor footprint: a radius of 0.46 m"),
    ("local_costmap: {robot_radius: 0.2,", "local_costmap: {robot_radius: 0.3,", "warning", 2, "the robot is 0.3 in local_costmap and 0.2 in global"),
    ("inflation_radius: 0.5", "inflation_radius: 0.1", "warning", 1, "inflation_radius 0.1 is below robot_radius 0.2"),
    ("width: 4.0", "width: 1.5", "warning", 2, "DWA looks 1 m ahead (max_vel_trans times sim_time), and the window ends 0.75 m"),
    ("sim_time: 2.0", "sim_time: 5.0", "warning", 2, "DWA looks 2.5 m ahead"),
    ("update_frequency: 5.0", "update_frequency: 30.0", "warning", 2, "update_frequency 30 of local_costmap is above the controller's 20 Hz"),
    ("global_frame: odom", "global_frame: map", "warning", 2, "usual is odom"),
    ("xy_goal_tolerance: 0.1", "xy_goal_tolerance: 0.01", "warning", 5, "below a cell of the local costmap (0.05 m)"),
    ("aggressive_reset: {layer", "aggressive_reset: {reset_distance: 1.0, layer", "warning", 4, "four circumscribed radii unless there is a list"),
    ("conservative_reset: {layer_names: [obstacle_layer]}\naggressive_reset: {layer_names: [obstacle_layer]}", "a: 1\nb: 1", "warning", 1, "both default recoveries clear nothing"),
    ("width: 4.0", "width: .inf", "error", 2, "not a finite number"),
    ("sim_time: 2.0", "sim_time: .nan", "error", 5, "not a number"),
    ("sim_time: 2.0", "sim_time: soon", "error", 5, "not a number"),
    ("sim_time: 2.0", "vtheta_samples: 20", "warning", 5, "belongs to TrajectoryPlannerROS"),
    ("sim_time: 2.0", "path_distance_bias: 32.0", "warning", 5, "--dwa-scaling kinetic"),
    ("sim_time: 2.0", "follow_progress: false", "note", 5, "follow_progress is slamcli's own: the real DWAPlannerROS ignores it"),
    ("sim_time: 2.0", "sim_tiem: 2.0", "error", 5, "did you mean sim_time"),
    ("layer_names: [obstacle_layer]}\nagg", "reset_distanc: 1}\nagg", "error", 3, "did you mean reset_distance"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "severity", "line", "text"), CHANGES, ids=[change[-1][:30] for change in CHANGES]
)
def test_parts_that_do_not_fit(tmp_path, old, new, severity, line, text):
    assert old in FITTING
    found = findings(tmp_path, FITTING.replace(old, new, 1))
    assert has(found, severity, line, text), found
    assert not has(findings(tmp_path, FITTING), severity, line, text)


def test_a_footprint_that_is_wider_than_its_inflation(tmp_path):
    square = "footprint: [[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]]"
    text = FITTING.replace("robot_radius: 0.2", square)
    assert not any("inscribed" in message for _, _, message in findings(tmp_path, text))
    found = findings(tmp_path, text.replace("inflation_radius: 0.5", "inflation_radius: 0.25"))
    assert has(found, "warning", 1, "inflation_radius 0.25 is below the inscribed radius 0.3 of the footprint")


def test_a_robot_that_no_costmap_knows(tmp_path):
    text = FITTING.replace("robot_radius: 0.2, ", "")
    assert not any(
        "neither robot_radius" in message for _, _, message in findings(tmp_path, text)
    )  # another file may say
    assert has(findings(tmp_path, LAUNCH.format(text), "n.launch"), "warning", 4, "global_costmap has neither")


def test_layers_that_recoveries_clear(tmp_path):
    plugins = "plugins: [{name: seen, type: 'costmap_2d::ObstacleLayer'}]"
    text = f"local_costmap: {{{plugins}}}\n"
    assert has(
        findings(tmp_path, text),
        "warning",
        1,
        "here there is seen, so that recoveries clear nothing: set layer_names: [seen]",
    )
    assert not any(
        "clear nothing" in m for _, _, m in findings(tmp_path, text + "aggressive_reset: {layer_names: [seen]}\n")
    )
    listed = "recovery_behaviors: [{name: r, type: clear_costmap_recovery/ClearCostmapRecovery}]\n"
    found = findings(tmp_path, text + listed + "r: {layer_names: [walls]}\n")
    assert has(found, "warning", 1, "is told to clear 'walls'; here there is seen")


def test_lists_of_behaviours(tmp_path):
    turn = "{name: t, type: rotate_recovery/RotateRecovery}"
    found = findings(tmp_path, f"recovery_behaviors: [{turn}, {turn}, {{name: s, type: my/Spin}}, 3]\n")
    assert has(found, "error", 1, "has 't' twice")
    assert has(found, "note", 1, "type 'my/Spin' is not checked; slamcli has none")
    assert has(found, "error", 1, "each entry of recovery_behaviors needs a name and a type")


def test_teb_and_the_scanner(tmp_path):
    found = findings(tmp_path, "TebLocalPlannerROS: {min_obstacle_dist: 0.5, inflation_dist: 0.4}\n")
    assert has(found, "warning", 1, "inflation_dist is not above min_obstacle_dist")
    amcl = "amcl: {laser_max_range: 12.0}\n"
    assert has(findings(tmp_path, amcl, range_m=8.0), "warning", 1, "beyond the scanner's 8 m")
    assert not has(findings(tmp_path, amcl, range_m=12.0), "warning", 1, "beyond")
    layer = "local_costmap: {obstacle_layer: {raytrace_range: 9.0}}\n"
    assert has(findings(tmp_path, layer, range_m=8.0), "note", 1, "raytrace_range 9 is beyond the scanner's 8 m")


def test_slamclis_own_parameters_are_checked_too(tmp_path):
    found = findings(tmp_path, "amcl:\n  slamcli.refine_beams: 0\n  min_particles: .inf\n")
    assert has(found, "error", 2, "must be between 2 and 100000")
    assert has(found, "note", 2, "slamcli's own")
    assert has(found, "error", 3, "not a finite number")


def test_one_file_for_all_of_it(tmp_path):
    text = "amcl: {min_particels: 9}\nmove_base:\n  controler_frequency: 5.0\n  DWAPlannerROS: {sim_tme: 1.0}\n"
    found = findings(tmp_path, text)
    assert has(found, "error", 1, "did you mean min_particles")
    assert has(found, "error", 3, "did you mean controller_frequency")
    assert has(found, "error", 4, "did you mean sim_time")
    assert len([f for f in found if f[0] == "error"]) == 3


def test_files_of_nav2(tmp_path):
    text = """\
amcl:
  ros__parameters: {max_particles: many, laser_max_range: 100.0}
controller_server:
  ros__parameters:
    FollowPath: {plugin: "dwb_core::DWBLocalPlanner", vx_samples: 0, critics: [PathDist]}
local_costmap:
  local_costmap:
    ros__parameters: {robot_radius: 0.2, update_frequency: 50.0, widht: 3}
global_costmap:
  global_costmap:
    ros__parameters: {robot_radius: 0.3}
bt_navigator:
  ros__parameters: {odom_topic: /odom}
"""
    found = findings(tmp_path, text, range_m=10.0)
    assert has(found, "error", 2, "not a whole number")
    assert has(found, "warning", 2, "beyond the scanner's 10 m")
    assert has(found, "error", 5, "must be between 1 and 1000")
    assert has(found, "warning", 8, "the robot is 0.2 in local_costmap and 0.3 in global_costmap")
    assert has(found, "warning", 8, "above the controller's 20 Hz")
    assert has(found, "error", 8, "did you mean width")
    assert has(found, "note", 0, "not read: controller_server/FollowPath/critics, bt_navigator")


def test_the_command_counts_each_finding_once(tmp_path, capsys):
    path = tmp_path / "nav.yaml"
    path.write_text(FITTING.replace("sim_time: 2.0", "sim_time: .nan"))
    assert run(["config", "check", str(path), str(path), "--range", "5", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    errors = [(f["line"], f["message"]) for f in document["findings"] if f["severity"] == "error"]
    assert errors == [(5, "sim_time=nan: not a number")]
    assert document["counts"]["error"] == 1
    assert run(["config", "check", str(path), "--range", "0"]) == 2
