# SPDX-License-Identifier: MIT
"""Native files for --algo cartographer."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError
from slamcli.pipelines.config import load_native
from slamcli.pipelines.config_show import show
from slamcli.runtime import RunLog

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
BUILT = 'include "map_builder.lua"\ninclude "trajectory_builder.lua"\n'


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_the_missions_file_and_launch_file_say_the_same(tmp_path):
    log = RunLog()
    config = load_native("cartographer", [CONFIGS / "backpack_2d.lua"], ["use_nav_sat=true"], log)
    p = config.parameters
    assert (p.options.num_laser_scans, p.options.use_odometry, p.options.use_nav_sat) == (1, True, True)
    assert p.trajectory_builder_2d.min_range == 0.1
    assert p.trajectory_builder_2d.use_imu_data is False
    assert p.pose_graph.constraint_builder.min_score == 0.65
    assert p.map_builder.dimensions == 2
    assert config.sources["POSE_GRAPH.constraint_builder.min_score"] == f"{CONFIGS / 'backpack_2d.lua'}:35"
    assert config.sources["use_nav_sat"] == "--set"
    assert config.sources["tracking_frame"].endswith("backpack_2d.lua:9")
    assert "POSE_GRAPH.constraint_builder.sampling_ratio" not in config.sources  # a default, though written out
    assert log.notes == [
        f"{CONFIGS / 'backpack_2d.lua'}: no effect here: publish_frame_projected_to_2d (`slamcli config show` says why)"
    ]
    launched = load_native("cartographer", [CONFIGS / "cartographer_2d.launch"], ["use_nav_sat=true"])
    assert launched.parameters == p
    assert launched.topics("scans") == ("/scan",)
    assert launched.topics("odometry") == ("/odom",)
    given = {"configuration_basename": "revo_lds.lua"}
    revo = load_native("cartographer", [CONFIGS / "cartographer_2d.launch"], arguments=given).parameters
    assert revo.trajectory_builder_2d.submaps.num_range_data == 35


def test_later_files_and_the_command_line_win(tmp_path):
    first = write(
        tmp_path / "a.lua", BUILT + "TRAJECTORY_BUILDER_2D.max_range = 9\nPOSE_GRAPH.optimize_every_n_nodes = 5"
    )
    later = write(tmp_path / "b.lua", 'include "pose_graph.lua"\nPOSE_GRAPH.optimize_every_n_nodes = 6')
    config = load_native("cartographer", [first, later], ["TRAJECTORY_BUILDER_2D.min_range=0.5"])
    assert config.parameters.trajectory_builder_2d.max_range == 9
    assert config.parameters.trajectory_builder_2d.min_range == 0.5
    assert config.parameters.pose_graph.optimize_every_n_nodes == 6
    assert config.sources["POSE_GRAPH.optimize_every_n_nodes"] == f"{later}:2"


def test_defaults_without_a_file_are_shown_with_all_names():
    rows = {row.declaration.name: row for row in show("cartographer").parameters}
    assert rows["POSE_GRAPH.constraint_builder.min_score"].value == 0.55
    assert rows["num_laser_scans"].value is None
    assert not any(row.changed for row in rows.values())
    shown = show("cartographer", ["pr2.lua"], ["use_odometry=true"])
    changed = {row.declaration.name: row.source for row in shown.parameters if row.changed}
    assert changed["use_odometry"] == "--set"
    search = "TRAJECTORY_BUILDER_2D.real_time_correlative_scan_matcher.linear_search_window"
    assert changed[search] == f"{CONFIGS / 'pr2.lua'}:39"


def test_a_launch_file_names_topics_of_roles_in_use(tmp_path):
    remaps = {
        "scan_2": "/rear", "scan_10": "/roof", "scan_1": "/front", "echoes": "/horizontal", "imu": "/imu/data",
        "points2": "/velodyne", "fix": "/gps", "landmark": "/tags", "odom": "/wheels", "map": "/m",
    }  # fmt: skip
    write(tmp_path / "x.lua", BUILT + "options = {map_builder = MAP_BUILDER, trajectory_builder = TRAJECTORY_BUILDER, "
          "use_odometry = false, use_nav_sat = true}\nTRAJECTORY_BUILDER_2D.use_imu_data = false\nreturn options")  # fmt: skip
    lines = "".join(f'<remap from="{name}" to="{topic}"/>' for name, topic in remaps.items())
    node = (
        f'<node pkg="cartographer_ros" type="cartographer_node" name="n" args="-configuration_basename x.lua">{lines}'
    )
    config = load_native("cartographer", [write(tmp_path / "x.launch", f"<launch>{node}</node></launch>")])
    assert config.topics("scans") == ("/front", "/rear", "/roof", "/horizontal")
    assert config.topics("points") == ("/velodyne",)
    assert config.topics("odometry") == ()
    assert config.topics("imu") == ()
    assert config.topics("fixes") == ("/gps",)
    assert config.topics("landmarks") == ("/tags",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BUILT + "POSE_GRAPH.optimise_every_n_nodes = 3", r"x\.lua:3; did you mean POSE_GRAPH\.optimize_every_n_nodes"),
        (BUILT + "\nTRAJECTORY_BUILDER_2D.max_range = -3", r"x\.lua:4: TRAJECTORY_BUILDER_2D\.max_range=-3: must be"),
        (BUILT + "TRAJECTORY_BUILDER_2D.use_imu_data = 'true'", r"x\.lua:3: .*without quotes"),
        (BUILT + "MAP_BUILDER.use_trajectory_builder_2d = true\nMAP_BUILDER.use_trajectory_builder_3d = true", "set one"),
        (BUILT + "POSE_GRAPH.submaps = {a = 1}", r"unknown parameter 'POSE_GRAPH\.submaps\.a' in .*x\.lua:3"),
        ("options = {map_frame = 'm', use_lidar = true}\nreturn options", r"unknown parameter 'use_lidar' in .*x\.lua:1"),
        ("return 3", "not a table"),
        ("while true do end", "does not end"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_one_line(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_native("cartographer", [write(tmp_path / "x.lua", text)])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("algo", "name", "text", "message"),
    [
        ("cartographer", "x.yaml", "a: 1", r"cartographer reads Lua files \(\.lua\) and launch files"),
        ("gmapping", "x.lua", "return {}", "gmapping reads launch files"),
        ("cartographer", "x.launch", "<launch/>", "starts no node of cartographer"),
        ("cartographer", "nowhere.lua", None, r"nowhere\.lua: no such file"),
    ],
)
def test_files_of_another_system_are_refused(tmp_path, algo, name, text, message):
    if text is not None:
        write(tmp_path / name, text)
    with pytest.raises(ConfigError, match=message):
        load_native(algo, [tmp_path / name])


def test_what_a_file_only_seems_to_do_is_a_warning(tmp_path):
    log = RunLog()
    load_native("cartographer", [write(tmp_path / "x.lua", BUILT + "options = {map_builder = MAP_BUILDER}")], [], log)
    assert len(log.warnings) == 2
    assert "it returns nothing" in log.warnings[0]
    assert "options.trajectory_builder is missing" in log.warnings[1]
