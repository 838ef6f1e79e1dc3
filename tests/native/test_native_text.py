# SPDX-License-Identifier: MIT
"""What is written in each system's own format is read back the same."""

from __future__ import annotations

import pytest

from slamcli.mapper import find_tier
from slamcli.native import read_launch
from slamcli.native.native_text import format_cartographer_lua, format_launch, format_opencv_yaml
from slamcli.parameters import as_dict, convert, declarations
from slamcli.pipelines.config import check, load_native
from slamcli.pipelines.sweep_best import FoundInput, native_text


def other_values(algo):
    """Return a value for every parameter that differs from its default, if there is one that a file of the system can hold."""
    found = {}
    for entry in declarations(find_tier(algo).parameters):
        default, low, high = entry.default, entry.minimum, entry.maximum
        if entry.kind is bool:
            other = default is not True
            found |= {} if str(other) in entry.unavailable else {entry.name: other}
        elif entry.choices:
            usual = [c for c in entry.choices if c not in ("NUMBER", default) and c not in entry.unavailable]
            found |= {entry.name: entry.kind(usual[0])} if usual else {}
        elif entry.kind in (int, float):
            middle = default if default is not None else (1 if low is None else low)
            step = 1 if entry.kind is int else 0.1234567890123
            value = middle + step if high is None or middle + step <= high else middle - step
            if low is None or value >= low:
                found[entry.name] = entry.kind(value)
    return found


@pytest.mark.parametrize("algo", ["gmapping", "cartographer", "rtabmap", "orbslam3"])
def test_every_parameter_of_every_system_comes_back(algo, tmp_path):
    wanted = other_values(algo)
    assert len(wanted) > 25
    wanted.pop("MAP_BUILDER.use_trajectory_builder_3d", None)  # one of the two builders can be on
    if algo == "rtabmap":
        wanted = {name: value for name, value in wanted.items() if "/" in name}
    declared = {entry.name: entry for entry in declarations(find_tier(algo).parameters)}
    kept = {name: convert(declared[name], value) for name, value in wanted.items()}
    config = load_native(algo)
    file = native_text(config, kept, FoundInput(), {}, "a test -- of --things")
    path = tmp_path / f"best{file.suffix}"
    path.write_text(file.text)
    back = load_native(algo, [path])
    values = as_dict(back.parameters)
    assert {name: values[name] for name in kept} == kept


def test_a_launch_file_holds_what_xml_and_roslaunch_take_for_signs(tmp_path):
    path = tmp_path / "a.launch"
    text = format_launch(
        "p", "k", {"a": '<"&>', "b": True, "c": 1e-07, "d": -3}, {"scan": "/front/scan"}, ["no -- dashes"]
    )
    path.write_text(text)
    node = read_launch(path).nodes[0]
    assert {name: setting.value for name, setting in node.params.items()} == {
        "a": '<"&>',
        "b": True,
        "c": 1e-07,
        "d": -3,
    }
    assert node.remaps == {"scan": "/front/scan"}
    assert (node.package, node.type, node.name) == ("p", "k", "k")


def test_parameters_of_rtabmaps_node_need_a_launch_file(tmp_path):
    config = load_native("rtabmap", sets=["frame_id=base", "Kp/MaxFeatures=300"])
    file = native_text(config, {"Rtabmap/DetectionRate": 2.0}, FoundInput(), {}, "")
    assert file.suffix == ".launch"
    (tmp_path / "best.launch").write_text(file.text)
    values = as_dict(load_native("rtabmap", [tmp_path / "best.launch"]).parameters)
    assert (values["frame_id"], values["Kp/MaxFeatures"], values["Rtabmap/DetectionRate"]) == ("base", 300, 2.0)


def test_a_lua_file_is_whole_and_has_tables_that_the_defaults_lack(tmp_path):
    config = load_native("cartographer", sets=["TRAJECTORY_BUILDER.pure_localization_trimmer.max_submaps_to_keep=3"])
    found = FoundInput(
        parameters={
            "use_odometry": True, "use_nav_sat": False, "use_landmarks": False, "num_laser_scans": 1, "num_point_clouds": 0,
            "num_multi_echo_laser_scans": 0, "TRAJECTORY_BUILDER_2D.use_imu_data": False,
        },
        base_frame="base_footprint", odom_frame="odom",
    )  # fmt: skip
    file = native_text(config, {"POSE_GRAPH.optimize_every_n_nodes": 45}, found, {}, "a set")
    path = tmp_path / "best.lua"
    path.write_text(file.text)
    back = as_dict(load_native("cartographer", [path]).parameters)
    assert back["TRAJECTORY_BUILDER.pure_localization_trimmer.max_submaps_to_keep"] == 3
    assert back["POSE_GRAPH.optimize_every_n_nodes"] == 45
    assert (back["tracking_frame"], back["published_frame"], back["provide_odom_frame"]) == (
        "base_footprint",
        "odom",
        False,
    )
    assert [f for f in check([path]) if f.severity != "note"] == []


def test_lua_strings_and_infinities_are_escaped():
    text = format_cartographer_lua({"map_frame": 'a"\\b'}, {"POSE_GRAPH.x": float("inf")})
    assert 'map_frame = "a\\"\\\\b",' in text
    assert "POSE_GRAPH.x = math.huge" in text


def test_settings_tell_real_numbers_from_whole_ones():
    text = format_opencv_yaml(
        {"a": 3, "b": 3, "c": 1e-07, "d": True, "e": "x", "T": "1 0 0 1"}, real=["b"], matrices={"T": (2, 2)}
    )
    lines = text.splitlines()
    assert lines[0] == "%YAML:1.0"
    assert lines[2:7] == ["a: 3", "b: 3.0", "c: 1.0e-07", "d: 1", 'e: "x"']
    assert lines[-1] == "   data: [1.0, 0.0, 0.0, 1.0]"


def test_settings_with_the_recordings_camera_are_what_orb_slam3_wants(tmp_path):
    camera = {
        "Camera.type": "PinHole", "Camera1.fx": 500.0, "Camera1.fy": 501.0, "Camera1.cx": 320.0, "Camera1.cy": 240.0,
        "Camera.width": 640, "Camera.height": 480, "Camera.RGB": 1, "Camera.fps": 30.0, "RGBD.DepthMapFactor": 1000.0,
        "Stereo.b": 0.08,
    }  # fmt: skip
    config = load_native("orbslam3", sets=["ORBextractor.nLevels=6"])
    file = native_text(config, {"ORBextractor.nFeatures": 800}, FoundInput(), camera, "a set")
    path = tmp_path / "best.yaml"
    path.write_text(file.text)
    assert [f for f in check([path]) if f.severity != "note"] == []
    back = as_dict(load_native("orbslam3", [path]).parameters)
    assert (back["ORBextractor.nFeatures"], back["ORBextractor.nLevels"], back["Camera.fps"]) == (800, 6, 30.0)
