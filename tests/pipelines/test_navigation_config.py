# SPDX-License-Identifier: MIT
"""The configuration of the whole navigation stack: files, --set, places, bad input."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.cli.main import run
from slamcli.errors import ConfigError
from slamcli.pipelines.config_show import show
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.runtime import RunLog

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def written(folder: Path, text: str, name: str = "nav.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows(*args, **kwargs):
    return {row.declaration.name: row for row in show("navigation", *args, **kwargs).parameters}


def test_without_files_slamclis_own_launch_file_is_read():
    config = load_navigation()
    assert [path.name for path in config.files] == ["move_base.launch"]
    assert (config.amcl.min_particles, config.amcl.odom_model_type) == (500, "diff-corrected")
    assert (config.local_planner, config.global_planner) == ("dwa", "navfn")
    assert (config.local_parameters.max_vel_x, config.local_parameters.vth_samples) == (0.5, 20)
    assert (config.global_costmap.costmap.robot_radius, config.local_costmap.costmap.width) == (0.18, 4.0)


def test_the_missions_yaml_files_alone_say_the_same_as_its_launch_file():
    names = ("costmap_common", "global_costmap", "local_costmap", "base_local_planner")
    files = [CONFIGS / f"{name}_params.yaml" for name in names]
    config, launched = load_navigation(files), load_navigation(["slam_navigation_full.launch"])
    assert config.global_costmap == launched.global_costmap
    assert config.local_costmap == launched.local_costmap
    assert config.local_parameters == launched.local_parameters


def test_every_value_has_its_place():
    found = rows()
    places = {
        "amcl/laser_max_range": "move_base.launch:19",
        "global_costmap/robot_radius": "costmap_common_params.yaml:2",
        "local_costmap/robot_radius": "costmap_common_params.yaml:2",
        "local_costmap/inflation_layer.inflation_radius": "costmap_common_params.yaml:4",
        "local_costmap/obstacle_layer/laser_scan/clearing": "costmap_common_params.yaml:14",
        "local_costmap/width": "local_costmap_params.yaml:9",
        "DWAPlannerROS/sim_time": "base_local_planner_params.yaml:20",
        "move_base/base_local_planner": "move_base.launch:42",
    }
    assert {name: found[name].source.rpartition("/")[2] for name in places} == places
    assert found["move_base/planner_patience"].source == "default"
    assert found["collision_monitor/enabled"].value is True
    assert found["recovery/rotate_recovery.frequency"].declaration.effective is False
    assert len(found) == sum(1 for _ in load_navigation().values())


def test_whatever_is_shown_can_be_set_by_that_name():
    for name, row in rows().items():
        if row.value is None or row.declaration.kind is str:
            continue
        again = rows(sets=[f"{name}={row.value}"])[name]
        assert (again.value, again.source) == (row.value, "--set"), name


def test_layers_are_shown_under_their_own_names(tmp_path):
    nav = written(
        tmp_path,
        "global_costmap:\n  plugins:\n    - {name: walls, type: 'costmap_2d::StaticLayer'}\n"
        "    - {name: halo, type: 'costmap_2d::InflationLayer'}\n  halo: {inflation_radius: 0.7}\n",
    )
    found = rows([nav])
    assert (
        found["global_costmap/halo.inflation_radius"].value,
        found["global_costmap/halo.inflation_radius"].source,
    ) == (0.7, f"{nav}:5")
    assert "global_costmap/walls.trinary_costmap" in found
    assert not [
        name for name in found if name.startswith(("local_costmap/static_layer", "global_costmap/static_layer"))
    ]


def test_later_files_win_and_sets_come_last(tmp_path):
    first = written(tmp_path, "DWAPlannerROS: {max_vel_x: 0.3, sim_time: 1.0}\nrobot_radius: 0.2\n", "a.yaml")
    second = written(tmp_path, "DWAPlannerROS:\n  max_vel_x: 0.4\nlocal_costmap: {robot_radius: 0.3}\n", "b.yaml")
    found = rows([first, second], ["DWAPlannerROS/sim_time=1.5"])
    assert (found["DWAPlannerROS/max_vel_x"].value, found["DWAPlannerROS/max_vel_x"].source) == (0.4, f"{second}:2")
    assert (found["DWAPlannerROS/sim_time"].value, found["DWAPlannerROS/sim_time"].source) == (1.5, "--set")
    assert (found["global_costmap/robot_radius"].value, found["local_costmap/robot_radius"].value) == (0.2, 0.3)
    assert rows([second, first])["local_costmap/robot_radius"].value == 0.2


def test_old_names_and_nodes_before_the_section(tmp_path):
    old = written(tmp_path, "DWAPlannerROS: {max_trans_vel: 0.3}\nmove_base: {controller_frequency: 10.0}\n")
    config = load_navigation([old])
    assert (config.local_parameters.max_vel_trans, config.move_base.controller_frequency) == (0.3, 10.0)
    assert config.local_costmap.costmap.width == 4.0  # nothing is said of costmaps: slamcli's own


@pytest.mark.parametrize(
    ("text", "section", "field", "value"),
    [
        ("min_particles=200", "amcl", "min_particles", 200),
        ("amcl/min_particles=200", "amcl", "min_particles", 200),
        ("planner_frequency=1", "move_base", "planner_frequency", 1.0),
        ("move_base/planner_frequency=1", "move_base", "planner_frequency", 1.0),
        ("use_dijkstra=false", "planner", "use_dijkstra", False),
        ("NavfnROS/default_tolerance=0.5", "planner", "default_tolerance", 0.5),
        ("vth_samples=7", "local_parameters", "vth_samples", 7),
        ("rotate_recovery/sim_granularity=0.1", "recovery", "sim_granularity", 0.1),
        ("TrajectoryPlannerROS/max_vel_theta=0.7", "recovery", "max_rotational_vel", 0.7),
        ("clear_costmap.layer_names=[obstacles]", "recovery", "layer_names", "obstacles"),
        ("collision_monitor.enabled=no", "monitor", "enabled", False),
    ],
)
def test_sets_find_their_part(text, section, field, value):
    assert getattr(getattr(load_navigation(sets=[text]), section), field) == value


def test_sets_of_the_world_and_of_both_costmaps():
    config = load_navigation(sets=["laser.beams=720", "robot_radius=0.3", "global_costmap/inflation_radius=0.9"])
    assert config.simulation == {"laser.beams": 720}
    assert (config.global_costmap.costmap.robot_radius, config.local_costmap.costmap.robot_radius) == (0.3, 0.3)
    assert (config.global_costmap.costmap.inflation_radius, config.local_costmap.costmap.inflation_radius) == (0.9, 0.5)


def test_planners_are_chosen_by_file_or_option(tmp_path):
    nav = written(
        tmp_path,
        "base_local_planner: teb_local_planner/TebLocalPlannerROS\nbase_global_planner: global_planner/GlobalPlanner\n",
    )
    config = load_navigation([nav])
    assert (config.local_planner, config.global_planner) == ("teb", "global_planner")
    config = load_navigation([nav], local_planner="pursuit", global_planner="theta_star")
    assert (config.local_planner, config.global_planner) == ("pursuit", "theta_star")


def test_launch_arguments_reach_the_files(tmp_path):
    written(tmp_path, '<launch><arg name="speed" default="0.2"/><node pkg="move_base" type="move_base" name="m">'
        '<param name="DWAPlannerROS/max_vel_x" value="$(arg speed)"/></node></launch>', "n.launch")  # fmt: skip
    assert load_navigation([tmp_path / "n.launch"]).local_parameters.max_vel_x == 0.2
    assert load_navigation([tmp_path / "n.launch"], arguments={"speed": "0.3"}).local_parameters.max_vel_x == 0.3


LISTED = """\
near: {reset_distance: 2.0, layer_names: [obstacle_layer, voxel_layer]}
recovery_behaviors:
  - {name: near, type: clear_costmap_recovery/ClearCostmapRecovery}
  - {name: turn, type: rotate_recovery/RotateRecovery}
  - {name: aggressive_reset, type: clear_costmap_recovery/ClearCostmapRecovery}
  - {name: creep, type: move_slow_and_clear/MoveSlowAndClear}
creep: {limited_trans_speed: 0.1}
turn: {sim_granularity: 0.1}
rotate_recovery: {sim_granularity: 0.2}
"""


def test_recovery_behaviours_have_namespaces_of_their_own(tmp_path):
    config = load_navigation([written(tmp_path, LISTED)])
    own = config.behaviours
    assert sorted(own) == ["aggressive_reset", "creep", "near", "turn"]
    assert (own["near"].reset_distance, own["near"].layer_names) == (2.0, "obstacle_layer voxel_layer")
    assert own["aggressive_reset"].reset_distance == 3.0  # in a list of ROS's the name says nothing
    assert (own["creep"].limited_trans_speed, own["creep"].limited_rot_speed) == (0.1, 0.45)
    assert (own["turn"].sim_granularity, config.recovery.sim_granularity) == (0.1, 0.2)
    assert rows([tmp_path / "nav.yaml"])["near/reset_distance"].source.endswith("nav.yaml:1")


def test_the_usual_behaviours_keep_their_widths():
    config = load_navigation(sets=["conservative_reset/reset_distance=1.5"])
    assert {name: own.reset_distance for name, own in config.behaviours.items()} == {"conservative_reset": 1.5}
    assert config.recovery.reset_distance is None
    text = load_navigation(sets=["recovery_behaviors=near:ClearCostmapRecovery back_up", "near/affected_maps=local"])
    assert text.behaviours["near"].affected_maps == "local"


def test_what_has_no_effect_is_said_once(tmp_path):
    log = RunLog()
    load_navigation(
        [written(tmp_path, "amcl: {gui_publish_rate: 1.0}\nTrajectoryPlannerROS: {sim_time: 1.0}\n")], log=log
    )
    notes = "\n".join(log.notes)
    assert "amcl/gui_publish_rate" in notes
    assert "TrajectoryPlannerROS/sim_time (TrajectoryPlannerROS is not one of the local planners here" in notes


BAD = [
    ("amcl: {min_particels: 100}", "nav.yaml:1, amcl; did you mean min_particles or max_particles?"),
    ("amcl:\n  min_particles: 900\n  max_particles: 100", "nav.yaml:2, {}nav.yaml:3: min_particles=900 is more than"),
    ("amcl:\n  laser_z_hit: .nan", "nav.yaml:2: laser_z_hit=nan: not a number"),
    ("amcl: {update_min_d: .inf}", "nav.yaml:1: update_min_d=inf: not a finite number"),
    ("DWAPlannerROS:\n  max_vel_x: fast", "nav.yaml:2: max_vel_x='fast': not a number"),
    ("DWAPlannerROS: {vx_samples: 2.5}", "not a whole number"),
    ("DWAPlannerROS: {max_vel_x: [0.1, 0.2]}", "one value, not a list"),
    ("DWAPlannerROS: {min_vel_x: 0.7, max_vel_x: 0.3}", "nav.yaml:1: min_vel_x=0.7 is above max_vel_x=0.3"),
    ("DWAPlannerROS: {sim_tme: 1.0}", "DWAPlannerROS; did you mean sim_time"),
    ("latch_xy: true", "nav.yaml:1"),
    ("local_costmap:\n  widht: 3", "nav.yaml:2; did you mean width"),
    ("local_costmap: {width: .inf}", "nav.yaml:1: width=inf: must be between"),
    ("local_costmap: {width: -3}", "nav.yaml:1: width=-3: must be between"),
    ("global_costmap:\n  footprint: [[0, 0], [1, 1]]", "nav.yaml:2: footprint="),
    ("global_costmap:\n  footprint: [[0, 0], [1, .nan], [1, 1]]", "nav.yaml:2: footprint="),
    ("global_costmap: {plugins: [{name: a}]}", "each entry of plugins needs a name and a type"),
    ("global_costmap: {obstacle_layer: {observation_sources: s, s: {markin: 1}}}", "source 's'; did you mean marking"),
    ("local_costmap: {obstacle_layer: {observation_sources: s, s: {min_obstacle_height: 3}}}", "nav.yaml:1: source 's': min_obstacle_height=3 is above"),
    ("recovery_behaviors: [{name: x, type: my/Own}]", "nav.yaml:1: recovery_behaviors: 'x' of type 'my/Own'"),
    ("recovery_behaviors: [{name: x}]", "nav.yaml:1: recovery_behaviors: each entry needs a name and a type"),
    ("recovery_behaviors: spin", "nav.yaml:1: recovery_behaviors: no behaviour 'spin'"),
    ("recovery_behaviors: [{name: a, type: rotate_recovery/RotateRecovery}, {name: a, type: rotate_recovery/RotateRecovery}]", "stands there twice"),
    ("conservative_reset: {reset_distanc: 3}", "nav.yaml:1, conservative_reset; did you mean reset_distance"),
    ("base_local_planner: my/Planner", "nav.yaml:1: base_local_planner 'my/Planner': choose one of dwa"),
    ("base_global_planner: carrot_planner/CarrotPlanner", "nav.yaml:1: base_global_planner 'carrot_planner/CarrotPlanner': choose"),
    ("collision_monitor: {margin: -1}", "must be between 0 and 5"),
    ("- 1", "expected `name: value` pairs"),
    ("a: [", "not YAML"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD)
def test_bad_files_are_one_line_with_the_place(tmp_path, capsys, text, message):
    path = written(tmp_path, text + "\n")
    with pytest.raises(ConfigError) as error:
        load_navigation([path])
    assert message.format(f"{tmp_path}/") in str(error.value)
    assert run(["config", "show", "--algo", "navigation", "--config", str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len([line for line in said.err.splitlines() if line.startswith("slamcli: ")]) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max_vel_x=0.4", "several parts have a parameter of that name: write DWAPlannerROS/max_vel_x, TebLocalPlannerROS/max_vel_x"),
        ("transform_tolerance=1", "FollowPath/transform_tolerance, global_costmap/transform_tolerance, local_costmap/transform_tolerance"),
        ("max_vel_zz=1", "unknown parameter 'max_vel_zz'"),
        ("max_vel_x", "write KEY=VALUE"),
        ("=1", "write KEY=VALUE"),
        ("amcl/=1", "--set"),
        ("DWAPlannerROS/sim_time=", "sim_time='': not a number"),
        ("DWAPlannerROS/sim_time=inf", "must be between 0.01 and 60 s"),
        ("local_costmap/resolution=nan", "not a number"),
        ("laser.beams=many", "--set: laser.beams='many': not a whole number"),
        ("recovery_behaviors=[{name: x", "not YAML"),
    ],
)  # fmt: skip
def test_bad_sets_are_one_line(text, message):
    with pytest.raises(ConfigError) as error:
        load_navigation(sets=[text])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("n.lua", "", "navigation reads launch files"),
        ("n.launch", '<launch><node pkg="rviz" type="rviz" name="r"/></launch>', "starts neither move_base nor amcl (nodes: rviz/rviz)"),
        ("n.launch", "<launch>", "n.launch"),
    ],
)  # fmt: skip
def test_files_that_are_not_of_navigation(tmp_path, name, content, message):
    with pytest.raises(ConfigError) as error:
        load_navigation([written(tmp_path, content, name)])
    assert message in str(error.value)


def test_a_file_that_is_not_there():
    with pytest.raises(ConfigError, match=r"nowhere.yaml: no such file"):
        load_navigation([Path("nowhere.yaml")])
