# SPDX-License-Identifier: MIT
"""The Foxglove layout and the RViz configuration name topics that results have, with displays that fit their types."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from slamcli.cli.main import run
from slamcli.measurements import PointCloud
from slamcli.pipelines.replay import load_replay
from slamcli.recordings import open_recording
from slamcli.reports.mcap import LATCHED, write_replay

sys.path.append(str(Path(__file__).parents[1] / "pipelines"))
from small_result import write_images_result

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
DISPLAYS = {
    "Map": "nav_msgs/msg/OccupancyGrid", "PoseArray": "geometry_msgs/msg/PoseArray", "Path": "nav_msgs/msg/Path",
    "Pose": "geometry_msgs/msg/PoseStamped", "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PointCloud2": "sensor_msgs/msg/PointCloud2", "Image": "sensor_msgs/msg/CompressedImage",
}  # fmt: skip
STEPS = {"working": [3], "points_held": [100]}
"""Figures of tiers that are too slow for a test; see `test_plotted_figures_are_those_of_tiers`."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return recordings of gmapping, of cartographer, and of a result with images and clouds."""
    place = tmp_path_factory.mktemp("views")
    made = []
    for algo in ("gmapping", "cartographer"):
        output = place / algo
        arguments = ["map", str(ROOT / "sample_data/office.bag"), "--algo", algo, "--duration", "8", "-o", str(output)]
        assert run([*arguments, "--mcap", "-q", "--truth", str(ROOT / "sample_data/office.truth.tum")]) == 0
        assert "result.mcap" in json.loads((output / "run.json").read_text())["outputs"]
        made.append(output / "result.mcap")
    folder = write_images_result(place / "desk", {"stamp_ns": [1_700_000_000_000_000_000], **STEPS})
    replay = load_replay(folder, recording=[ROOT / "sample_data/desk_rgbd.mcap"])
    cloud = PointCloud(stamp_ns=0, frame_id="", points_m=np.ones((4, 3), np.float32), colours=np.ones((4, 3), np.uint8))
    write_replay(place / "desk.mcap", replace(replay, cloud=cloud, dense=cloud))
    return (*made, place / "desk.mcap")


@pytest.fixture(scope="module")
def types(recordings):
    found = {}
    for path in recordings:
        with open_recording(path) as opened:
            found |= {topic.name: topic.msgtype for topic in opened.contents.topics if topic.count}
    return found


def test_rviz_shows_each_topic_as_what_it_is(types):
    document = yaml.safe_load((CONFIGS / "mapping.rviz").read_text())
    shown = [d for d in document["Visualization Manager"]["Displays"] if "Topic" in d]
    assert len(shown) == 13
    for display in shown:
        name, topic = display["Class"].rpartition("/")[2], display["Topic"]["Value"]
        assert types[topic] == DISPLAYS[name], display["Name"]
        is_latched = topic in LATCHED or name == "Map"
        assert display["Topic"]["Durability Policy"] == ("Transient Local" if is_latched else "Volatile"), topic
    assert document["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"


def test_foxglove_shows_topics_that_are_there(types):
    layout = json.loads((CONFIGS / "foxglove_mapping.json").read_text())
    panels = layout["configById"]
    shown = panels["3D!map"]["topics"]
    assert set(shown) <= set(types)
    assert {name for name, kind in types.items() if kind in DISPLAYS.values()} - set(shown) == {
        "/camera/image/compressed"
    }
    camera = panels["Image!camera"]["imageMode"]
    assert types[camera["imageTopic"]] == "sensor_msgs/msg/CompressedImage"
    assert types[camera["calibrationTopic"]] == "sensor_msgs/msg/CameraInfo"
    assert types[panels["RosOut!log"]["topicToRender"]] == "rcl_interfaces/msg/Log"
    plotted = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(plotted) == 6
    for value in plotted:
        topic, field = value.split(".")
        assert (types[topic], field) == ("std_msgs/msg/Float64", "data")

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)


@pytest.mark.parametrize(("name", "room"), [("working", "rtabmap"), ("points_held", "orbslam3")])
def test_plotted_figures_are_those_of_tiers(name, room):
    sources = (path.read_text(encoding="utf-8") for path in sorted((ROOT / "src/slamcli" / room).rglob("*.py")))
    assert any(f'"{name}"' in text or f"{name}: " in text for text in sources)


def test_the_tiers_own_recordings_are_whole(recordings):
    for path in recordings[:2]:
        with open_recording(path) as opened:
            counts = {topic.name: topic.count for topic in opened.contents.topics}
            times = [message.log_time_ns for message in opened.raw.messages()]
            tree = opened.frames()
        assert times == sorted(times)
        assert counts["/pose"] == counts["/scan_in_map"] == 80
        assert counts["/ground_truth"] == 1
        assert counts["/map"] > 5
        assert [edge.child for edge in tree.edges] == ["laser", "odom", "base_link"]
        assert path.stat().st_size < 400_000
    with open_recording(recordings[0]) as opened:
        assert len(next(iter(opened.measurements(["/particles"])))) == 30


def test_the_same_run_gives_the_same_recording(recordings, tmp_path):
    folder = recordings[0].parent
    replay = load_replay(
        folder, recording=[ROOT / "sample_data/office.bag"], truth=ROOT / "sample_data/office.truth.tum"
    )
    write_replay(tmp_path / "again.mcap", replay)
    assert (tmp_path / "again.mcap").read_bytes() == recordings[0].read_bytes()
