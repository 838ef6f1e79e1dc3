# SPDX-License-Identifier: MIT
from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.cartographer import CartographerParameters
from slamcli.native.checks.files import check_file
from slamcli.native.ros_parameters.declare import row
from slamcli.parameters import declarations
from slamcli.rtabmap.parameters import RtabmapParameters

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
GMAPPING = (
    row("minimumScore", 0.0, "Score below which a match is discarded.", minimum=0),
    row("lskip", 0, "Beams skipped.", minimum=0),
    row("particles", 30, "Number of particles.", minimum=1),
    row("srr", 0.1, ""),
    row("srt", 0.2, ""),
    row("str", 0.1, ""),
    row("stt", 0.2, ""),
    row("maxUrange", 80.0, "", minimum=0),
    row("maxRange", 80.0, "", minimum=0),
    row("base_frame", "base_link", ""),
    row("xmin", -100.0, ""),
    row("xmax", 100.0, ""),
)

TABLES = {
    "gmapping": GMAPPING,
    "cartographer": declarations(CartographerParameters),
    "rtabmap": declarations(RtabmapParameters),
}


def findings(path: Path, beams: int | None = None) -> list[tuple[str, int, str]]:
    return [(f.severity, f.line, f.message) for f in check_file(path, TABLES, beams)]


def node(tmp_path: Path, body: str, kind: str = 'pkg="gmapping" type="slam_gmapping"') -> Path:
    path = tmp_path / "a.launch"
    path.write_text(f'<launch>\n<node {kind} name="n">\n{body}\n</node>\n</launch>\n')
    return path


def has(found: list[tuple[str, int, str]], severity: str, line: int, text: str) -> bool:
    return any(s == severity and n == line and text in message for s, n, message in found)


def test_the_traps_of_the_missions_gmapping_launch():
    found = findings(CONFIGS / "gmapping.launch")
    assert has(found, "error", 10, "in package 'gmapping'")
    assert has(found, "warning", 20, "fewer than 200 beams can never reach it")
    assert has(found, "warning", 25, "srr, srt, str, stt is 10 times below the default")
    assert has(found, "note", 15, "first extent only")
    assert has(findings(CONFIGS / "gmapping.launch", beams=180), "error", 20, "this one has 180")
    assert has(findings(CONFIGS / "gmapping.launch", beams=220), "warning", 20, "needs 91 % of 220 beams")
    assert not any("minimumScore" in message for _, _, message in findings(CONFIGS / "gmapping.launch", beams=1081))


def test_names_types_and_ranges(tmp_path):
    found = findings(
        node(
            tmp_path,
            '<param name="minimumscore" value="50"/>\n<param name="particles" value="0"/>\n'
            '<param name="particels" value="30"/>\n<param name="srr" value="much"/>\n'
            '<param name="stt" type="string" value="0.2"/>\n<param name="lskip" value="1.5"/>\n'
            '<param name="xmin" value="5"/>\n<param name="xmax" value="-5"/>',
        )
    )
    assert has(found, "error", 3, "did you mean minimumScore?")
    assert has(found, "error", 4, "must be at least 1")
    assert has(found, "error", 5, "did you mean particles?")
    assert has(found, "error", 6, "not a number")
    assert has(found, "error", 7, "is text: ROS ignores it and takes the default 0.2")
    assert has(found, "error", 8, "not a whole number")
    assert has(found, "error", 9, "the extent is empty")


def test_a_sound_file_has_no_findings(tmp_path):
    assert (
        findings(node(tmp_path, '<param name="minimumScore" value="50"/><param name="maxUrange" value="20."/>')) == []
    )


def test_the_map_savers_package(tmp_path):
    found = findings(node(tmp_path, "", 'pkg="map_saver" type="map_saver"'))
    assert has(found, "error", 2, "is in package 'map_server'")


def test_the_traps_of_the_missions_navigation_files():
    found = findings(CONFIGS / "move_base.launch")
    assert has(found, "warning", 23, "suggested for this model: 0.005, 0.005, 0.010, 0.005")
    assert has(found, "warning", 23, "vtheta_samples belongs to TrajectoryPlannerROS")
    assert has(found, "warning", 25, "obstacles weigh ten times more")
    assert has(found, "note", 7, "static_layer, obstacle_layer, inflation_layer")
    assert has(found, "warning", 7, "both default recoveries clear nothing")
    assert not any(severity == "error" for severity, _, _ in found)
    assert [s for s, _, _ in findings(CONFIGS / "costmap_common_params.yaml")] == ["note"]


def test_navigation_names_and_structures(tmp_path):
    path = tmp_path / "nav.yaml"
    path.write_text(
        "global_costmap:\n"
        "  robot_radius: 0.3\n"
        "  inflation_layer: {inflation_radius: 0.2, cost_scaling: 3.0}\n"
        "  obstacle_layer:\n"
        "    observation_sources: scan ghost\n"
        "    scan: {topic: /scan, markin: true}\n"
        "local_costmap:\n"
        "  plugins: [{name: obst, type: 'costmap_2d::ObstacleLayer'}, {name: own, type: 'my::Layer'}]\n"
        "  obst: {obstacle_range: 5.0, raytrace_range: 3.0}\n"
        "  inflater: {inflation_radius: 1.0}\n"
        "DWAPlannerROS: {max_trans_vel: 0.5, sim_tme: 2.0, min_vel_x: 1.0, max_vel_x: 0.5}\n"
        "TebLocalPlannerROS: {max_vel_x: 0.4, footprint_model: {type: point, vertices: [[0, 0]]}}\n"
        "base_local_planner: dwa_local_planner/DWAPlannerROS\n"
        "controler_frequency: 10.0\n"
        "recovery_behaviors: [{name: slow, type: move_slow_and_clear/MoveSlowAndClear}]\n"
        "slow: {clearing_distance: -1.0}\n"
        "latch: {x: 1}\n"
    )
    found = findings(path)
    assert has(found, "warning", 3, "inflation_radius 0.2 is below robot_radius 0.3")
    assert has(found, "error", 3, "did you mean cost_scaling_factor")
    assert has(found, "error", 5, "'ghost' is named here and described nowhere")
    assert has(found, "error", 6, "did you mean marking")
    assert has(found, "warning", 6, "PointCloud is assumed")
    assert has(found, "note", 8, "'my::Layer' is not checked")
    assert has(found, "warning", 9, "far obstacles are never cleared")
    assert has(found, "error", 10, "no such layer")
    assert has(found, "warning", 11, "later it is max_vel_trans")
    assert has(found, "error", 11, "did you mean sim_time")
    assert has(found, "error", 11, "min_vel_x is above max_vel_x")
    assert has(found, "warning", 12, "not read")
    assert has(found, "note", 13, "navfn/NavfnROS plans")
    assert has(found, "error", 14, "did you mean controller_frequency")
    assert has(found, "error", 16, "must be at least 0")
    assert has(found, "error", 17, "move_base has no such part")


def test_amcl(tmp_path):
    path = tmp_path / "amcl.yaml"
    path.write_text(
        "amcl:\n  min_particles: 9000\n  odom_alpha9: 1\n  laser_z_hit: 0.99\n  odom_model_type: car\n  tf_broadcast: 1\n  gui_publish_rate: 1e1\n"
    )
    found = findings(path)
    assert has(found, "error", 2, "min_particles is above max_particles")
    assert has(found, "error", 3, "did you mean odom_alpha")
    assert has(found, "warning", 4, "add up to 1")
    assert has(found, "error", 5, "choose one of diff, omni")
    assert has(found, "warning", 6, "is no truth value")
    assert has(found, "error", 7, "is text")


def test_map_yaml(tmp_path):
    path = tmp_path / "m.yaml"
    path.write_text(
        "image: m.pgm\nresolution: 0.05\norigin: [0, 0]\nnegate: 2\nfree_thresh: 0.25\noccupied_thresh: 0.65\n"
    )
    found = findings(path)
    assert has(found, "error", 1, "does not exist")
    assert has(found, "error", 3, "[x, y, yaw]")
    assert has(found, "error", 4, "0 or 1")
    assert has(found, "warning", 5, "read as free")
    (tmp_path / "m.pgm").write_bytes(b"")
    path.write_text(
        "image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\nfree_thresh: 0.196\noccupied_thresh: 0.65\n"
    )
    assert findings(path) == []


@pytest.mark.parametrize(
    ("name", "content", "line", "text"),
    [
        ("x.launch", "<launch>\n<nod/></launch>", 2, "is not a launch element"),
        ("x.yaml", "a: [1\nb: 2", 2, "not YAML"),
        ("x.txt", "", 0, "launch files (.launch, .xml), .yaml, .lua and .ini are checked"),
        ("missing.yaml", None, 0, "no such file"),
    ],
)
def test_a_file_that_cannot_be_read_is_one_error(tmp_path, name, content, line, text):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    (finding,) = check_file(path, TABLES)
    assert (finding.severity, finding.file, finding.line) == ("error", str(path), line)
    assert text in finding.message


def test_what_no_node_reads_is_said_and_not_guessed(tmp_path):
    path = tmp_path / "other.yaml"
    path.write_text("kettle: {temperature: 95.0, cups: 2, brand: none}\n")
    assert [s for s, _, _ in findings(path)] == ["note"]
