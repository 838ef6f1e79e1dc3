# SPDX-License-Identifier: MIT
"""What config check says of Cartographer's files."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from slamcli.cartographer import CartographerParameters
from slamcli.native.checks.files import check_file
from slamcli.native.ros_parameters.declare import row
from slamcli.parameters import declarations

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
TABLES = {"gmapping": (), "cartographer": declarations(CartographerParameters)}
SOUND = {
    "map_builder": "MAP_BUILDER",
    "trajectory_builder": "TRAJECTORY_BUILDER",
    "map_frame": "'map'",
    "tracking_frame": "'base_link'",
    "published_frame": "'base_link'",
    "odom_frame": "'odom'",
    "provide_odom_frame": "true",
    "publish_frame_projected_to_2d": "false",
    "use_odometry": "false",
    "use_nav_sat": "false",
    "use_landmarks": "false",
    "num_laser_scans": "1",
    "num_multi_echo_laser_scans": "0",
    "num_subdivisions_per_laser_scan": "1",
    "num_point_clouds": "0",
    "lookup_transform_timeout_sec": "0.2",
    "submap_publish_period_sec": "0.3",
    "pose_publish_period_sec": "5e-3",
    "trajectory_publish_period_sec": "30e-3",
    "rangefinder_sampling_ratio": "1.",
    "odometry_sampling_ratio": "1.",
    "fixed_frame_pose_sampling_ratio": "1.",
    "imu_sampling_ratio": "1.",
    "landmarks_sampling_ratio": "1.",
}
FIRST = 7  # the line of the first statement after the options


def findings(path: Path) -> list[tuple[str, int, str]]:
    return [(f.severity, f.line, f.message) for f in check_file(path, TABLES)]


def check(folder: Path, body: str = "", two: str = "true", **options: str) -> list[tuple[str, int, str]]:
    """Return the findings for a sound file with other options and more statements."""
    path = folder / "x.lua"
    table = ", ".join(f"{key} = {value}" for key, value in {**SOUND, **options}.items() if value)
    path.write_text(
        'include "map_builder.lua"\ninclude "trajectory_builder.lua"\n'
        f"options = {{ {table} }}\n\n\nMAP_BUILDER.use_trajectory_builder_2d = {two}\n"
        f"{body}\nTRAJECTORY_BUILDER_2D.use_imu_data = false\nreturn options\n"
    )
    return findings(path)


def has(found: list[tuple[str, int, str]], severity: str, text: str, line: int | None = None) -> bool:
    return any(s == severity and text in message and line in (None, n) for s, n, message in found)


def test_a_sound_file_has_no_findings(tmp_path):
    assert check(tmp_path) == []
    assert check(tmp_path, "TRAJECTORY_BUILDER_2D.max_range = 20.") == []
    assert findings(CONFIGS / "pose_graph.lua") == []


def test_the_missions_files():
    found = findings(CONFIGS / "backpack_2d.lua")
    missing = next(message for severity, _, message in found if severity == "error")
    assert missing.startswith(
        "Cartographer aborts: options lacks lookup_transform_timeout_sec, submap_publish_period_sec"
    )
    assert missing.count("sampling_ratio") == 5
    assert "publish_to_tf" not in missing
    assert has(found, "warning", "that frame has two parents")
    assert has(found, "note", "inf and NaN are dropped before", 27)
    assert has(found, "note", "min_score 0.65 is stricter than the default 0.55", 35)
    assert sum(severity == "error" for severity, _, _ in found) == 1
    found = findings(CONFIGS / "cartographer_2d.launch")
    assert has(found, "note", "backpack_2d.lua is taken", 6)
    assert missing in [message for _, _, message in found]


def test_shipped_files_would_run():
    for name in ("backpack_3d", "backpack_3d_localization", "pr2", "revo_lds", "taurob_tracker"):
        assert not has(findings(CONFIGS / f"{name}.lua"), "error", ""), name


@pytest.mark.parametrize(
    ("options", "severity", "text"),
    [
        ({"map_frame": ""}, "error", "options lacks map_frame"),
        ({"imu_sampling_ratio": "", "tracking_frame": ""}, "error", "options lacks tracking_frame, imu_sampling_ratio"),
        ({"trajectory_builder": ""}, "error", "options.trajectory_builder is missing"),
        ({"num_laser_scans": "0"}, "error", "num_laser_scans, num_multi_echo_laser_scans, num_point_clouds are all 0"),
        ({"num_laser_scans": "-1"}, "error", "must be between 0 and"),
        ({"num_subdivisions_per_laser_scan": "0"}, "error", "must be between 1 and"),
        (
            {"num_subdivisions_per_laser_scan": "10"},
            "warning",
            "set TRAJECTORY_BUILDER_2D.num_accumulated_range_data to 10",
        ),
        ({"imu_sampling_ratio": "1.5"}, "error", "must be between 0 and 1"),
        ({"rangefinder_sampling_ratio": "0/0"}, "error", "not a number"),
        ({"map_frame": "'/map'"}, "error", "tf2 refuses names with a leading slash"),
        ({"odom_frame": "''"}, "error", "odom_frame is empty"),
        ({"published_frame": "'odom'"}, "error", "a frame above itself"),
        ({"use_odometry": "true"}, "warning", "two parents"),
        ({"map_frame": "'odom'"}, "error", "is also published_frame or odom_frame"),
        ({"use_odometry": "'yes'"}, "error", "is no truth value: Cartographer aborts"),
        ({"use_odometry": "1"}, "error", "is no truth value: Cartographer aborts"),
        ({"num_lasers": "1"}, "error", "did you mean num_laser_scans"),
        ({"lookup_transform_timeout_sec": "3."}, "note", "has no effect: how long to wait"),
    ],
)
def test_options(tmp_path, options, severity, text):
    found = check(tmp_path, **options)
    assert has(found, severity, text), found
    assert sum(s == "error" for s, _, _ in found) == (severity == "error")


@pytest.mark.parametrize(
    ("body", "severity", "text"),
    [
        ("TRAJECTORY_BUILDER_2D.max_rage = 3", "error", "did you mean TRAJECTORY_BUILDER_2D.max_range"),
        ("TRAJECTORY_BUILDER_2D.min_range = 40.", "error", "min_range 40 is not below max_range 30"),
        ("TRAJECTORY_BUILDER_2D.max_range = 1/0", "error", "must be between"),
        ("TRAJECTORY_BUILDER_2D.max_range = -0/0", "error", "not a number"),
        ("TRAJECTORY_BUILDER_2D.max_range = 'far'", "error", "not a number"),
        ("TRAJECTORY_BUILDER_2D.missing_data_ray_length = 31", "warning", "free space is drawn where walls may be"),
        ("TRAJECTORY_BUILDER_2D.voxel_filter_size = 0.7", "warning", "the filter does nothing"),
        (
            "TRAJECTORY_BUILDER_2D.real_time_correlative_scan_matcher.linear_search_window = 1",
            "warning",
            "use_online_correlative_scan_matching is false",
        ),
        ("TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.grid_type = 'TSDF'", "error", "does not go with grid_type TSDF"),
        ("TRAJECTORY_BUILDER_2D.submaps.grid_options_2d.grid_type = 'OCTREE'", "error", "choose one of"),
        (
            "TRAJECTORY_BUILDER_2D.submaps.range_data_inserter.probability_grid_range_data_inserter.hit_probability = 0.4",
            "error",
            "must be between 0.500001",
        ),
        ("POSE_GRAPH.constraint_builder.min_score = 0.9", "warning", "few loop closures fit so well"),
        ("POSE_GRAPH.constraint_builder.min_score = 0.3", "warning", "wrong loop closures fit as well"),
        ("POSE_GRAPH.constraint_builder.min_score = 1.3", "error", "must be between 0 and 1"),
        ("POSE_GRAPH.constraint_builder.sampling_ratio = 0", "warning", "no loop closure is looked for"),
        ("POSE_GRAPH.optimize_every_n_nodes = 0", "warning", "optimised at the end only"),
        ("POSE_GRAPH.max_num_final_iterations = 0", "error", "must be between 1"),
        ("TRAJECTORY_BUILDER_2D.motion_filter.max_angle_radians = 1.5", "warning", "turned by 86°"),
        ("TRAJECTORY_BUILDER_3D.max_range = 70", "warning", "has no effect: the map is built in 2D"),
        ("POSE_GRAPH = {optimize_every_n_nodes = 3}", "warning", "POSE_GRAPH was replaced after options"),
        ("MAP_BUILDER.use_trajectory_builder_3d = true", "error", "both use_trajectory_builder_2d and _3d"),
        ("MAP_BUILDER.use_trajectory_builder_2d = false", "error", "neither MAP_BUILDER.use_trajectory_builder_2d"),
        ("TRAJECTORY_BUILDER.pure_localization_trimmer = {max_submaps_to_keep = 1}", "error", "must be between 2"),
        ("POSE_GRAPH.overlapping_submaps_trimmer_2d = {fresh_submaps_count = 1}", "error", "overlapping_submaps_trimmer_2d.min_covered_area"),
        ("TRAJECTORY_BUILDER_2D.submaps.num_range_data = nil", "error", "TRAJECTORY_BUILDER_2D lacks submaps.num_range_data"),
    ],
)  # fmt: skip
def test_tables(tmp_path, body, severity, text):
    found = check(tmp_path, body)
    assert has(found, severity, text), found
    assert sum(s == "error" for s, _, _ in found) == (severity == "error")
    if " = nil" not in body and "replaced" not in text and "MAP_BUILDER" not in body and "trimmer_2d" not in body:
        assert has(found, severity, text, FIRST), found


def test_in_three_dimensions_an_imu_is_needed(tmp_path):
    body = "MAP_BUILDER.use_trajectory_builder_3d = true"
    found = check(tmp_path, body, two="false", imu_sampling_ratio="0.")
    assert has(found, "warning", "imu_sampling_ratio 0: no IMU message is used", 3)
    assert has(found, "note", "tracking_frame 'base_link' is at the IMU's place")
    assert has(check(tmp_path, body, two="false"), "note", "3D: Cartographer maps nothing without an IMU")


def test_scans_cut_across(tmp_path):
    body = "TRAJECTORY_BUILDER_2D.num_accumulated_range_data = 15"
    assert has(check(tmp_path, body, num_subdivisions_per_laser_scan="10"), "warning", "is no multiple of the 10 parts")
    body = "TRAJECTORY_BUILDER_2D.num_accumulated_range_data = 20"
    assert check(tmp_path, body, num_subdivisions_per_laser_scan="10") == []


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        ("return {", 1, "unexpected symbol"),
        ("--\nwhile true do end", 2, "it does not end"),
        ("include 'nowhere.lua'", 1, "not found in"),
        ("", 0, "sets nothing of Cartographer's"),
        ("return {a = {1}}", 0, "holds a value without a name"),
    ],
)
def test_a_file_that_cannot_be_evaluated_is_one_error(tmp_path, text, line, expected):
    path = tmp_path / "x.lua"
    path.write_text(text)
    (finding,) = check_file(path, TABLES)
    assert (finding.severity, finding.file, finding.line) == ("error", str(path), line)
    assert expected in finding.message


def test_a_launch_file_without_its_lua_file_is_one_error(tmp_path):
    path = tmp_path / "x.launch"
    path.write_text('<launch><node pkg="cartographer_ros" type="cartographer_node" name="n"/></launch>')
    (finding,) = check_file(path, TABLES)
    assert (finding.severity, finding.line) == ("error", 1)
    assert "has no argument -configuration_basename" in finding.message


def test_what_is_slamclis_own_would_stop_cartographer(tmp_path):
    own = dataclasses.replace(row("POSE_GRAPH.own_way", 3, "Ours."), extension=True)
    table = (*TABLES["cartographer"], own)
    path = tmp_path / "x.lua"
    path.write_text("POSE_GRAPH = {own_way = 5}")
    (finding,) = check_file(path, {"gmapping": (), "cartographer": table})
    assert (finding.severity, finding.line) == ("warning", 1)
    assert finding.message == "POSE_GRAPH.own_way is slamcli's own: Cartographer aborts on it"


@pytest.mark.parametrize(
    ("topic", "options", "text"),
    [
        ("scan", {}, ""),
        ("/scan", {}, ""),
        ("scan_1", {"num_laser_scans": "2"}, ""),
        ("map", {}, ""),
        ("odom", {"use_odometry": "true", "provide_odom_frame": "false"}, ""),
        ("scan", {"num_laser_scans": "2"}, "num_laser_scans is 2, so that it takes scan_1, scan_2"),
        ("scan_3", {"num_laser_scans": "2"}, "so that it takes scan_1, scan_2"),
        ("scan_1", {}, "num_laser_scans is 1, so that it takes scan"),
        ("points2", {}, "num_point_clouds is 0, so that it takes none"),
        ("echoes", {"num_multi_echo_laser_scans": "0/0"}, "so that it takes none"),
        ("echoes", {"num_multi_echo_laser_scans": "-1/0"}, "so that it takes none"),
        ("points2_7", {"num_point_clouds": "1/0"}, ""),
        ("odom", {}, "use_odometry is not true"),
        ("imu", {}, "use_imu_data is not true"),
        ("fix", {}, "use_nav_sat is not true"),
    ],
)
def test_topics_that_are_remapped_and_not_subscribed_to(tmp_path, topic, options, text):
    check(tmp_path, **options)
    path = tmp_path / "x.launch"
    path.write_text(
        '<launch>\n<node pkg="cartographer_ros" type="cartographer_node" name="n" '
        f'args="-configuration_directory {tmp_path} -configuration_basename x.lua">\n'
        f'<remap from="{topic}" to="/other"/></node></launch>'
    )
    found = [message for severity, line, message in findings(path) if severity == "warning" and line == 2]
    assert len(found) == bool(text)
    assert all(text in message for message in found), found
