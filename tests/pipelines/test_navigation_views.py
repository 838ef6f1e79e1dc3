# SPDX-License-Identifier: MIT
"""The Foxglove layout and the RViz configuration name topics that recordings have, with displays that fit their types."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from scripted_loop import START_NS, play

from slamcli.pipelines.navigation_recording import NavigationRecording
from slamcli.recordings import open_recording

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DISPLAYS = {
    "Map": "nav_msgs/msg/OccupancyGrid", "LaserScan": "sensor_msgs/msg/LaserScan", "PoseArray": "geometry_msgs/msg/PoseArray",
    "PoseWithCovariance": "geometry_msgs/msg/PoseWithCovarianceStamped", "Path": "nav_msgs/msg/Path",
    "Pose": "geometry_msgs/msg/PoseStamped", "MarkerArray": "visualization_msgs/msg/MarkerArray", "Odometry": "nav_msgs/msg/Odometry",
}  # fmt: skip


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("views") / "run.mcap"
    with NavigationRecording(path, start_ns=START_NS, T_base_laser=np.zeros(3)) as listener:
        play([listener], seconds=2.0)
    return path


@pytest.fixture(scope="module")
def types(recording):
    with open_recording(recording) as opened:
        return {topic.name: topic.msgtype for topic in opened.contents.topics}


def test_rviz_shows_each_topic_as_what_it_is(types):
    document = yaml.safe_load((CONFIGS / "navigation.rviz").read_text())
    shown = [d for d in document["Visualization Manager"]["Displays"] if "Topic" in d]
    assert len(shown) == 11
    for display in shown:
        name = display["Class"].rpartition("/")[2]
        assert types[display["Topic"]["Value"]] == DISPLAYS[name], display["Name"]


def test_foxglove_shows_topics_that_are_there(types):
    layout = json.loads((CONFIGS / "foxglove_navigation.json").read_text())
    panels = layout["configById"]
    assert set(panels["3D!navigation"]["topics"]) <= set(types)
    for panel in panels.values():
        for path in panel.get("paths", ()):
            assert path["value"].partition(".")[0] in types

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def test_every_path_that_foxglove_plots_is_a_field(recording):
    layout = json.loads((CONFIGS / "foxglove_navigation.json").read_text())
    with open_recording(recording) as opened:
        first = {}
        for message in opened.raw.messages(None, None, None):
            first.setdefault(message.topic, message)
        for panel in layout["configById"].values():
            for path in panel.get("paths", ()):
                topic, *fields = path["value"].split(".")
                value = opened.raw.decode(first[topic])
                for field in fields:
                    value = getattr(value, field)
                assert isinstance(value, (float, str))
