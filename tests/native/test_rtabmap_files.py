# SPDX-License-Identifier: MIT
"""RTAB-Map's .ini files, launch files and parameter YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from slamcli.errors import ConfigError
from slamcli.native.rtabmap_ini import format_rtabmap_ini, read_rtabmap_ini
from slamcli.native.rtabmap_names import NOT_HERE, REMOVED, RENAMED, of_today
from slamcli.native.settings import Setting, find_native
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.config import NativeConfig, load_native
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.runtime import RunLog

NAMES = {entry.name for entry in declarations(RtabmapParameters)}


def load(tmp_path: Path, name: str, text: str, log: RunLog | None = None) -> NativeConfig:
    file = tmp_path / name
    file.write_text(text)
    return load_native("rtabmap", [file], log=log)


def value(config: NativeConfig, name: str) -> Any:
    return as_dict(config.parameters)[name]


def test_the_missions_launch_file_holds_its_values() -> None:
    log = RunLog()
    config = load_native("rtabmap", [find_native(Path("rtabmap_rgbd.launch"))], log=log)
    p = config.parameters
    assert (p.rgbd.angular_update, p.rgbd.linear_update, p.rgbd.optimize_from_graph_end) == (0.05, 0.05, False)
    assert (p.kp.max_features, p.mem.rehearsal_similarity) == (500, 0.3)
    assert (p.node.frame_id, p.node.subscribe_depth, p.node.subscribe_rgb, p.node.subscribe_odom) == (
        "base_link",
        True,
        True,
        True,
    )
    assert (p.node.queue_size, p.node.wait_for_transform_duration) == (10, 0.2)
    assert config.topics("rgb") == ("/camera/rgb/image_raw",)
    assert config.topics("depth") == ("/camera/depth/image_raw",)
    assert config.topics("odometry") == ("/odom",)
    assert log.warnings == []


def test_ini_keys_and_values(tmp_path: Path) -> None:
    file = tmp_path / "a.ini"
    file.write_text(
        "; a comment\n[Core]\nVersion = 0.23.8\nKp\\MaxFeatures = 800\nRGBD/LinearUpdate=0.05\n# another\n"
        'Kp\\RoiRatios="0.0 0.0 0.1 0.0"\nMem%2FSTMSize=20\nRtabmap\\WorkingDirectory=C:/a=b\n\n'
        "[Gui]\ngeometry=@ByteArray(x)\n[Camera]\nx=1\n"
    )
    found = read_rtabmap_ini(file)
    assert {setting.name: setting.value for setting in found.settings} == {
        "Kp/MaxFeatures": "800", "RGBD/LinearUpdate": "0.05", "Kp/RoiRatios": "0.0 0.0 0.1 0.0", "Mem/STMSize": "20",
        "Rtabmap/WorkingDirectory": "C:/a=b",
    }  # fmt: skip
    assert found.settings[0].source == f"{file}:4"
    assert found.skipped == ("Gui", "Camera")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[Core]\nKp/MaxFeatures 800\n", r"a\.ini:2: .*neither a \[section\] nor KEY = VALUE"),
        ("Kp/MaxFeatures=800\n", "before any section"),
        ("[Gui]\na=1\n", r"no section \[Core\].*\[Gui\]"),
        ("", r"no section \[Core\].*none"),
        ("[Core]\n=1\n", "neither"),
        (
            "[Core]\nKp/MaxFeature=800\n",
            r"unknown parameter 'Kp/MaxFeature' in .*a\.ini:2; did you mean Kp/MaxFeatures",
        ),
        ("[Core]\nKp/MaxFeatures=many\n", r"a\.ini:2: Kp/MaxFeatures='many': not a whole number"),
        ("[Core]\nKp/DetectorStrategy=0\n", r"a\.ini:2: .*SURF is not available here: choose 8"),
    ],
)
def test_wrong_ini_files_are_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load(tmp_path, "a.ini", text)


def test_ini_files_are_read_as_they_were_written(tmp_path: Path) -> None:
    values = as_dict(
        load_native(
            "rtabmap", sets=["Kp/MaxFeatures=321", "Optimizer/Epsilon=1e-7", "Mem/BinDataKept=false"]
        ).parameters
    )
    text = format_rtabmap_ini(values)
    assert text.startswith("[Core]\nBRIEF\\Bytes = 32\n")
    assert "\nKp\\MaxFeatures = 321\n" in text
    assert "frame_id" not in text
    assert as_dict(load(tmp_path, "b.ini", text).parameters) == values


def test_a_complete_ini_gives_what_differs_from_the_default(tmp_path: Path) -> None:
    text = format_rtabmap_ini(as_dict(load_native("rtabmap", sets=["Mem/STMSize=30"]).parameters))
    log = RunLog()
    config = load(tmp_path, "b.ini", text + "KAZE\\Upright = false\nMem\\OfTomorrow = 1\n", log)
    assert list(config.sources) == ["Mem/STMSize"]
    assert [note for note in log.notes if "KAZE/" in note] == []
    assert log.warnings == [f"{tmp_path / 'b.ini'}: unknown here and left out: Mem/OfTomorrow"]


def test_names_of_older_versions(tmp_path: Path) -> None:
    log = RunLog()
    config = load(
        tmp_path,
        "a.ini",
        "[Core]\nKp\\WordsPerImage=300\nGrid\\FromDepth=false\nLccIcp2\\Iterations=7\nLccBow\\MinInliers=9\nRGBD\\PoseScanMatching=true\n",
        log,
    )
    assert value(config, "Kp/MaxFeatures") == 300
    assert value(config, "Grid/Sensor") == 0
    assert value(config, "Icp/Iterations") == 7
    assert value(config, "RGBD/NeighborLinkRefining") is True
    assert value(config, "Vis/MinInliers") == 20
    assert any("Kp/WordsPerImage is called Kp/MaxFeatures today" in note for note in log.notes)
    assert any("LccBow/MinInliers is of an older version" in note and "Vis/MinInliers" in note for note in log.notes)


def test_old_names_lead_to_names_of_today() -> None:
    assert {new for new in RENAMED.values() if new not in NAMES} == set()
    assert {near for near in REMOVED.values() if near and near not in NAMES} == set()
    assert not NAMES & (RENAMED.keys() | REMOVED.keys())
    assert not {name.partition("/")[0] for name in NAMES} & NOT_HERE
    assert of_today(Setting("Icp/PM", "true", "x", 1)).setting == Setting("Icp/Strategy", 1, "x", 1)


def test_set_takes_old_names_and_refuses_what_is_gone() -> None:
    log = RunLog()
    config = load_native("rtabmap", sets=["Odom/MinInliers=15", "Optimizer/Slam2D=true"], log=log)
    assert value(config, "Vis/MinInliers") == 15
    assert value(config, "Reg/Force3DoF") is True
    assert log.notes[0] == "--set: Odom/MinInliers is called Vis/MinInliers today"
    with pytest.raises(ConfigError, match="belongs to a part that is not here"):
        load_native("rtabmap", sets=["KAZE/Upright=true"])
    with pytest.raises(ConfigError, match="not read any more; Reg/Strategy comes near"):
        load_native("rtabmap", sets=["LccIcp/Type=1"])


LAUNCH = """<launch>
  <arg name="rtabmap_args" default="--delete_db_on_start --Kp/MaxFeatures 700 --Vis/RoiRatios 0,0,0.1,0 --uinfo"/>
  <group ns="rtabmap">
    <node pkg="rtabmap_ros" type="rgbd_odometry" name="rgbd_odometry" args="$(arg rtabmap_args)">
      <param name="frame_id" value="base_footprint"/>
      <param name="Odom/Strategy" value="1"/>
      <param name="Odom/ResetCountdown" type="string" value="3"/>
      <param name="Vis/MinInliers" value="12"/>
      <param name="RGBD/LinearUpdate" value="0.3"/>
    </node>
    <node pkg="nodelet" type="nodelet" name="rtabmap" args="load rtabmap_slam/rtabmap manager $(arg rtabmap_args)">
      <param name="subscribe_scan" value="true"/>
      <param name="subscribe_odom_info" value="true"/>
      <param name="Vis/MinInliers" value="18"/>
      <param name="config_path" value="own.ini"/>
      <remap from="scan" to="/base_scan"/>
      <remap from="scan_cloud" to="/cloud"/>
      <remap from="odom" to="/odom"/>
      <remap from="rgb/image" to="/cam/rgb"/>
    </node>
  </group>
</launch>
"""


def test_both_nodes_of_a_launch_file(tmp_path: Path) -> None:
    (tmp_path / "own.ini").write_text("[Core]\nMem\\STMSize=17\nKp\\MaxFeatures=100\n")
    log = RunLog()
    config = load(tmp_path, "a.launch", LAUNCH, log)
    wanted = {
        "Kp/MaxFeatures": 700, "Vis/RoiRatios": "0 0 0.1 0", "Odom/Strategy": 1, "Odom/ResetCountdown": 3,
        "Vis/MinInliers": 18, "RGBD/LinearUpdate": 0.1, "frame_id": "base_footprint", "subscribe_scan": True,
        "subscribe_odom": False, "Mem/STMSize": 17,
    }  # fmt: skip
    assert {name: value(config, name) for name in wanted} == wanted
    assert config.topics("scans") == ("/base_scan",)
    assert config.topics("points") == ()
    assert config.topics("odometry") == ()
    assert config.topics("rgb") == ("/cam/rgb",)
    assert any("rgbd_odometry does not read RGBD/LinearUpdate: left out" in note for note in log.notes)
    assert any("odometry is computed" in note for note in log.notes)
    assert any(note.endswith("no effect here: subscribe_odom_info") for note in log.notes)


def test_odometry_from_transforms_ignores_its_topic(tmp_path: Path) -> None:
    text = """<launch><node pkg="rtabmap_slam" type="rtabmap" name="r"><param name="odom_frame_id" value="odom"/>
      <remap from="odom" to="/odom"/></node></launch>"""
    config = load(tmp_path, "a.launch", text)
    assert config.topics("odometry") == ()
    assert value(config, "odom_frame_id") == "odom"


def test_images_in_one_message_are_colour_and_depth(tmp_path: Path) -> None:
    text = """<launch><node pkg="rtabmap_ros" type="rtabmap" name="r"><param name="subscribe_rgbd" value="true"/>
      <param name="subscribe_depth" value="false"/></node></launch>"""
    assert value(load(tmp_path, "a.launch", text), "subscribe_depth") is True


def test_a_launch_file_without_rtabmap_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"starts no node of rtabmap \(rtabmap, rgbd_odometry.*nodes: gmapping/slam_gmapping"
    ):
        load(tmp_path, "a.launch", '<launch><node pkg="gmapping" type="slam_gmapping" name="g"/></launch>')


def test_parameter_yaml_of_both_ros(tmp_path: Path) -> None:
    log = RunLog()
    config = load(
        tmp_path,
        "a.yaml",
        "/**:\n  ros__parameters:\n    use_sim_time: true\n    Mem/STMSize: '12'\n"
        "rgbd_odometry:\n  ros__parameters:\n    Odom/ResetCountdown: '1'\n"
        "rtabmap:\n  ros__parameters:\n    Kp/MaxFeatures: '900'\n",
        log,
    )
    assert (value(config, "Mem/STMSize"), value(config, "Odom/ResetCountdown"), value(config, "Kp/MaxFeatures")) == (
        12,
        1,
        900,
    )
    assert any(note.endswith("no effect here: use_sim_time") for note in log.notes)
    ros1 = load(tmp_path, "b.yaml", "rtabmap:\n  Kp:\n    MaxFeatures: 321\n  subscribe_depth: true\n")
    assert (value(ros1, "Kp/MaxFeatures"), value(ros1, "subscribe_depth")) == (321, True)
    plain = load(tmp_path, "c.yaml", "Kp/MaxFeatures: 5\n")
    assert value(plain, "Kp/MaxFeatures") == 5


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="copy the parameters of a Python launch file"):
        load(tmp_path, "a.launch.py", "x = 1\n")
    with pytest.raises(ConfigError, match=r"reads \.ini files"):
        load(tmp_path, "a.lua", "x = 1\n")


@pytest.mark.parametrize(("kind", "odometry"), [("rgbd_odometry", "auto"), ("icp_odometry", "scan")])
def test_a_launch_file_that_starts_odometry_has_it_computed(tmp_path: Path, kind: str, odometry: str) -> None:
    text = f"""<launch><node pkg="rtabmap_odom" type="{kind}" name="o"/><node pkg="rtabmap_slam" type="rtabmap" name="r">
      <param name="subscribe_odom" value="true"/></node></launch>"""
    config = load(tmp_path, "a.launch", text)
    assert (value(config, "subscribe_odom"), value(config, "slamcli.odometry")) == (False, odometry)


def test_a_database_says_what_it_was_made_with(tmp_path: Path) -> None:
    file = tmp_path / "map.db"
    with Database.create(file, "Kp/MaxFeatures:640;Mem/STMSize:10;Kp/RoiRatios:0.0 0.0 0.0 0.0;KAZE/Upright:false"):
        pass
    log = RunLog()
    config = load_native("rtabmap", [file], log=log)
    assert dict(config.sources) == {"Kp/MaxFeatures": str(file)}
    assert value(config, "Kp/MaxFeatures") == 640
    with pytest.raises(ConfigError, match="no such file"):
        load_native("rtabmap", [tmp_path / "other.db"])
