# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.errors import ConfigError
from slamcli.native import read_launch
from slamcli.native.launch import plain

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def write(tmp_path: Path, body: str, name: str = "a.launch") -> Path:
    path = tmp_path / name
    path.write_text(f"<launch>\n{body}\n</launch>\n")
    return path


def test_the_missions_gmapping_launch_loads_as_it_is():
    launch = read_launch(CONFIGS / "gmapping.launch", {"scan_topic": "/base_scan"})
    (node,) = launch.nodes
    assert (node.package, node.type, node.name) == ("slam_gmapping", "slam_gmapping", "slam_gmapping")
    values = plain(node.params)
    assert len(values) == 21
    assert values["base_frame"] == "base_link"
    assert values["minimumScore"] == 200
    assert isinstance(values["minimumScore"], int)
    assert values["xmin"] == -25.0
    assert dict(node.remaps) == {"scan": "/base_scan"}
    assert node.params["lstep"].source.endswith("gmapping.launch:29")


def test_every_launch_file_of_the_mission_loads():
    counts = {path.name: len(read_launch(path).nodes) for path in sorted(CONFIGS.glob("*.launch"))}
    assert counts == {
        "cartographer_2d.launch": 2,
        "gmapping.launch": 1,
        "move_base.launch": 3,
        "orb_slam3_stereo.launch": 1,
        "rtabmap_rgbd.launch": 2,
        "slam_navigation_full.launch": 3,
    }
    full = read_launch(CONFIGS / "slam_navigation_full.launch")
    assert [note.split(": ")[1].split(" ")[-3] for note in full.notes]
    assert len(full.notes) == 2  # urdf.launch and sensors.launch of a package that is not here
    (move_base,) = full.find("move_base")
    values = plain(move_base.params)
    assert values["local_costmap/robot_radius"] == 0.18
    assert values["global_costmap/static_map"] is True
    assert values["DWAPlannerROS/vtheta_samples"] == 20


def test_arguments_conditions_groups_and_includes(tmp_path):
    write(
        tmp_path,
        '<arg name="n"/><arg name="m" default="5"/>'
        '<node pkg="p" type="t" name="inner"><param name="n" value="$(arg n)"/><param name="m" value="$(arg m)"/></node>',
        "inner.launch",
    )
    path = write(
        tmp_path,
        """<arg name="use" default="true"/>
  <group ns="robot" if="$(arg use)">
    <remap from="scan" to="laser"/>
    <node pkg="p" type="t" name="first"><remap from="odom" to="wheel"/></node>
    <include file="$(dirname)/inner.launch" ns="deep"><arg name="n" value="7"/></include>
  </group>
  <node unless="$(arg use)" pkg="p" type="t" name="never"/>
  <node if="$(eval arg('use') and 2 > 1)" pkg="p" type="t" name="last"/>
  <param name="/use_sim_time" value="true"/>""",
    )
    launch = read_launch(path)
    assert [(n.namespace, n.name) for n in launch.nodes] == [("robot", "first"), ("robot/deep", "inner"), ("", "last")]
    assert dict(launch.nodes[0].remaps) == {"scan": "laser", "odom": "wheel"}
    assert dict(launch.nodes[1].remaps) == {"scan": "laser"}
    assert dict(launch.nodes[2].remaps) == {}
    assert plain(launch.nodes[1].params) == {"n": 7, "m": 5}
    assert plain(launch.params) == {"use_sim_time": True}
    assert [n.name for n in read_launch(path, {"use": "false"}).nodes] == ["never"]


def test_parameters_are_typed_as_roslaunch_types_them(tmp_path):
    (tmp_path / "p.yaml").write_text("a: {b: 1, c: [1, 2]}\n")
    path = write(
        tmp_path,
        """<node pkg="p" type="t" name="n">
  <param name="i" value="5"/><param name="f" value="5."/><param name="b" value="True"/><param name="s" value="5 m"/>
  <param name="text" type="string" value="5"/><param name="d" type="double" value="5"/>
  <param name="y" type="yaml" value="[1, x]"/>
  <rosparam file="p.yaml" ns="space"/>
  <rosparam>i: 6
q: deg(180)</rosparam>
  <rosparam param="whole">[1, 2]</rosparam>
  <param name="space/a/b" value="2"/>
</node>""",
    )
    (node,) = read_launch(path).nodes
    values = plain(node.params)
    assert values == {
        "i": 6,
        "f": 5.0,
        "b": True,
        "s": "5 m",
        "text": "5",
        "d": 5.0,
        "y": [1, "x"],
        "space/a/b": 2,
        "space/a/c": [1, 2],
        "q": pytest.approx(3.141592653589793),
        "whole": [1, 2],
    }
    assert isinstance(values["d"], float)
    assert node.params["q"].line == 8


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<arg name="x"/>', "a.launch:2: argument 'x' needs a value"),
        ('<node pkg="p" type="t"/>', "a.launch:2: <node> has no name"),
        ('<node pkg="p" type="t" name="$(arg y)"/>', r"a.launch:2: \$\(arg y\): no such argument"),
        ('<nod pkg="p"/>', "a.launch:2: <nod> is not a launch element"),
        ('<param name="x" type="int" value="1.5"/>', "a.launch:2: value '1.5' is not of type int"),
        ('<param name="x" value="$(eval __import__(\'os\'))"/>', "a.launch:2: cannot evaluate"),
        ('<param name="x" value="$(shell ls)"/>', "a.launch:2: .* unknown substitution"),
        ('<group if="maybe"/>', "a.launch:2: if='maybe' is neither true nor false"),
        ("<rosparam>\na: [1</rosparam>", "a.launch:3: not YAML"),
        ('<include file="a.launch"/>', "includes do not end"),
        ("<group>" * 100 + "</group>" * 100, "nested more than 60 deep"),
        ("<node", "a.launch:3: not XML"),
    ],
)
def test_errors_name_file_and_line(tmp_path, body, message):
    with pytest.raises(ConfigError, match=message):
        read_launch(write(tmp_path, body))


def test_entities_are_refused_before_they_expand(tmp_path):
    path = tmp_path / "bomb.launch"
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    path.write_text(f'<!DOCTYPE launch [<!ENTITY e0 "x">{levels}]><launch><param name="a" value="&e9;"/></launch>')
    with pytest.raises(ConfigError, match=r"bomb\.launch:1: document types and entities"):
        read_launch(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"\x00\x01", b"\xff\xfe<", b"#ROSBAG V2.0", b"<a/>", b"<launch>&x;</launch>"],
)
def test_what_is_no_launch_file_is_one_error(tmp_path, content):
    path = tmp_path / "x.launch"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"x\.launch"):
        read_launch(path)


def test_an_argument_the_file_does_not_have_is_an_error():
    with pytest.raises(ConfigError, match="has no argument 'scan'; it has base_frame"):
        read_launch(CONFIGS / "gmapping.launch", {"scan": "/x"})
