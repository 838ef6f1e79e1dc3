# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.errors import UsageError
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import read_tum
from slamcli.grids import OccupancyGrid
from slamcli.recordings import open_recording
from slamcli.recordings.adapters.path import StampedPath


@pytest.fixture
def map_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two rooms, 6 x 4 m, with a door; the lower left corner is at -3, -2."""
    cells = np.zeros((40, 60), dtype=np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    cells[:28, 30] = 100
    cells[36:39, 55:59] = -1
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.1, (-3.0, -2.0, 0.0)))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "map.yaml"


def answer(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> dict:
    assert run(["plan", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    "arguments",
    [
        ["-1.5,1.0", "1.5,-1.0", "--map", "map.yaml"],
        ["--map", "map.yaml", "-1.5,1.0", "1.5,-1.0"],
        ["-1.5,1.0", "--map", "map.yaml", "1.5,-1.0"],
        ["--map", "map.yaml", "-1.5,1.0", "+1.5,-1.0"],
        ["--map=map.yaml", "-1.5,1", "+1.5,-1e0"],
    ],
)
def test_negative_numbers_are_points_wherever_they_stand(
    map_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    document = answer(capsys, *arguments)
    assert document["status"] == "ok"
    assert document["start"] == [-1.5, 1.0]
    assert document["goal"] == [1.5, -1.0]
    assert math.hypot(3, 2) < document["length_m"] < 5
    assert document["path"][0][:2] == [-1.5, 1.0]
    assert document["path"][-1][:2] == [1.5, -1.0]


@pytest.mark.parametrize("planner", ["navfn", "dijkstra", "astar"])
def test_planners_and_figures(map_path: Path, capsys: pytest.CaptureFixture[str], planner: str) -> None:
    options = ["--planner", planner, "--robot-radius", "0.2", "--inflation-radius", "0.5"]
    document = answer(capsys, "-2,-1", "2,-1,1.57", "--map", "map.yaml", *options)
    assert document["planner"] == planner
    assert document["clearance_m"] >= 0.1
    assert document["cost"] >= document["length_m"] * 0.9
    assert document["path"][-1][2] == pytest.approx(1.57)
    assert document["parameters"]["robot_radius"] == 0.2
    assert document["outputs"] == []
    assert (
        list(map_path.parent.iterdir()) == [map_path.with_name("map.pgm"), map_path]
        or len(list(map_path.parent.iterdir())) == 2
    )


def test_default_draws_the_path_here(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "-2,-1", "2,-1", "--map", "map.yaml"]) == 0
    shown = capsys.readouterr()
    assert "length" in shown.out
    assert "clearance" in shown.out
    assert "no robot given" in shown.err
    assert Path("path.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    rows = np.genfromtxt("path.csv", delimiter=",", names=True)
    assert rows.dtype.names == ("x", "y", "yaw")
    assert (rows["x"][0], rows["y"][-1]) == (-2.0, -1.0)
    record = json.loads(Path("path.run.json").read_text())
    assert record["summary"]["status"] == "ok"
    assert [len(i["sha256"]) for i in record["inputs"]] == [64, 64]


def test_all_formats_in_a_folder(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "-2,-1", "2,-1", "--map", "map.yaml", "-o", "out"]) == 0
    names = sorted(p.name for p in Path("out").iterdir())
    assert names == ["path.csv", "path.json", "path.mcap", "path.png", "path.tum", "run.json"]
    document = json.loads(Path("out/path.json").read_text())
    points = np.array(document["path"])
    tum = read_tum("out/path.tum")
    np.testing.assert_allclose(tum.poses_se2, points, atol=1e-9)
    assert tum.stamps_ns[-1] == pytest.approx(document["length_m"] * 1e9, rel=1e-6)
    with open_recording(["out/path.mcap"]) as recording:
        topics = recording.topics(StampedPath)
        assert [topic.name for topic in topics] == ["/plan"]
        (path,) = recording.measurements(topics)
    np.testing.assert_allclose(path.path.poses_se2, points, atol=1e-9)
    assert path.path.frame_id == "map"


def test_single_files_and_bag(map_path: Path) -> None:
    assert run(["plan", "-2,-1", "2,-1", "--map", "map.yaml", "-o", "a.bag", "-o", "sub/b.tum", "-q"]) == 0
    assert Path("a.bag").stat().st_size > 1000
    assert len(Path("sub/b.tum").read_text().splitlines()) > 10
    assert Path("a.run.json").exists()


@pytest.mark.parametrize(
    ("start", "goal", "status", "text"),
    [
        ("-2,-1", "0.05,-1", "goal_blocked", "in an obstacle"),
        ("-2,-1", "-0.15,-1", "goal_blocked", "inscribed radius"),
        ("-2,-1", "9,9", "goal_outside", "outside the map"),
        ("-2.95,-1", "2,-1", "start_blocked", "in an obstacle"),
        ("50,50", "2,-1", "start_outside", "outside the map"),
    ],
)
def test_no_path_is_one_line_that_says_what_is_nearest(
    map_path: Path, capsys: pytest.CaptureFixture[str], start: str, goal: str, status: str, text: str
) -> None:
    arguments = ["plan", start, goal, "--map", "map.yaml", "--robot-radius", "0.25"]
    assert run(arguments) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1
    assert text in shown.err
    assert "nearest point" in shown.err
    assert run([*arguments, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["status"] == status
    assert document["length_m"] is None
    retry = [f"{document['nearest'][0]:.6f},{document['nearest'][1]:.6f}"]
    ends = [*retry, goal] if status.startswith("start") else [start, *retry]
    assert run(["plan", *ends, "--map", "map.yaml", "--robot-radius", "0.25", "--json"]) == 0
    assert not Path("path.png").exists()


def test_unreachable(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = answer(capsys, "-2,-1", "2,-1", "--map", "map.yaml", "--robot-radius", "0.7", code=1)
    assert document["status"] == "unreachable"
    assert "cannot be reached" in document["message"]


def test_default_tolerance(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    document = answer(
        capsys, "-2,-1", "0.05,-1", "--map", "map.yaml", "--default-tolerance", "0.3", "--robot-radius", "0"
    )
    assert 0.05 <= document["goal_offset_m"] <= 0.3


def test_costmap_files_work_unchanged(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("common.yaml").write_text(
        "robot_radius: 0.18\ninflation_layer:\n  inflation_radius: 0.50\n  cost_scaling_factor: 10.0\n"
        "obstacle_layer:\n  observation_sources: laser_scan\n  laser_scan:\n    sensor_frame: laser_link\n    topic: /scan\n"
    )
    Path("global.yaml").write_text(
        "global_costmap:\n  global_frame: map\n  static_map: true\n  rolling_window: false\n"
    )
    arguments = ["-2,-1", "2,-1", "--map", "map.yaml", "--costmap", "common.yaml", "--costmap", "global.yaml"]
    document = answer(capsys, *arguments)
    assert document["parameters"]["robot_radius"] == 0.18
    assert document["parameters"]["inflation_layer.inflation_radius"] == 0.5
    assert any("obstacle_layer" in note for note in document["notes"])
    document = answer(capsys, *arguments, "--robot-radius", "0.3", "--set", "cost_scaling_factor=3")
    assert document["parameters"]["robot_radius"] == 0.3
    assert document["parameters"]["inflation_layer.cost_scaling_factor"] == 3.0


def test_pairs_answer_one_json_line_each(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("pairs.csv").write_text(
        "start_x,start_y,goal_x,goal_y\n-2,-1,-2,1\n\n# a comment\n-2,-1,0.05,-1\n-2,-1,2,-1\n"
    )
    arguments = ["plan", "--pairs", "pairs.csv", "--map", "map.yaml", "--robot-radius", "0", "--planner", "astar"]
    assert run(arguments) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["status"] for line in lines] == ["ok", "goal_blocked", "ok"]
    assert lines[0]["length_m"] == pytest.approx(2.0)
    assert lines[0]["cost"] == pytest.approx(2.0)
    assert [line["index"] for line in lines] == [0, 1, 2]
    assert all(line["time_ms"] >= 0 for line in lines)
    assert run([*arguments, "--strict"]) == 1


def test_many_pairs_equal_single_plans(map_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(3)
    pairs = random.uniform([-2.8, -1.8, -2.8, -1.8], [2.8, 1.8, 2.8, 1.8], (60, 4))
    np.savetxt("pairs.csv", pairs, delimiter=",")
    found = {}
    for planner in ("astar", "dijkstra"):
        assert run(["plan", "--pairs", "pairs.csv", "--map", "map.yaml", "--planner", planner]) == 0
        found[planner] = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for a, b in zip(found["astar"], found["dijkstra"], strict=True):
        assert a["status"] == b["status"]
        assert (a["cost"] is None) == (b["cost"] is None)
        assert a["cost"] is None or a["cost"] == pytest.approx(b["cost"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n", "pairs.csv:1"),
        ("1,2,3,4\n1,2,x,4\n", "pairs.csv:2"),
        ("1,2,3,nan\n", "finite"),
        ("", "no pairs"),
        ("x,y,a,b\n1,2,3,4\n", "missing: start_x"),
        ("\x00\xff\n", "pairs.csv"),
    ],
)
def test_bad_pairs(map_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str) -> None:
    Path("pairs.csv").write_text(text, encoding="latin-1")
    assert run(["plan", "--pairs", "pairs.csv", "--map", "map.yaml"]) == 2
    shown = capsys.readouterr()
    assert message in shown.err
    assert shown.out == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["0,0", "--map", "map.yaml"], "START and GOAL"),
        (["0,0", "1,1"], "--map"),
        (["0,0", "1", "--map", "map.yaml"], "X,Y"),
        (["0,0", "1,x", "--map", "map.yaml"], "X,Y"),
        (["0,0", "1,2,3,4", "--map", "map.yaml"], "X,Y"),
        (["0,0", "1,nan", "--map", "map.yaml"], "X,Y"),
        (["0,0", "1,1", "--map", "none.yaml"], "no such map"),
        (["0,0", "1,1", "--map", "map.pgm"], "name the .yaml"),
        (["0,0", "1,1", "--map", "map.yaml", "--planer", "navfn"], "--planer"),
        (["0,0", "1,1", "--map", "map.yaml", "--planner", "rrt"], "rrt"),
        (["0,0", "1,1", "--map", "map.yaml", "--set", "robot_radus=1"], "robot_radius"),
        (["0,0", "1,1", "--map", "map.yaml", "--set", "robot_radius"], "KEY=VALUE"),
        (["0,0", "1,1", "--map", "map.yaml", "--robot-radius", "-1"], "robot_radius"),
        (["0,0", "1,1", "--map", "map.yaml", "--footprint", "[[0,0]]"], "footprint"),
        (["0,0", "1,1", "--map", "map.yaml", "--costmap", "none.yaml"], "none.yaml"),
        (["0,0", "1,1", "--map", "map.yaml", "-o", "x.svg"], "x.svg"),
        (["0,0", "1,1", "--map", "map.yaml", "--pairs", "p.csv"], "not both"),
        (["0,0", "1,1", "--map", "map.yaml", "--strict"], "--pairs"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(
    map_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert run(["plan", *arguments]) == 2
    shown = capsys.readouterr()
    assert message in shown.err
    assert len(shown.err.splitlines()) == 1
    assert shown.out == ""


def test_same_input_same_bytes(map_path: Path) -> None:
    for folder in ("a", "b"):
        assert run(["plan", "-2,-1", "2,-1", "--map", "map.yaml", "-o", folder, "-q"]) == 0
    for name in ("path.csv", "path.tum", "path.png", "path.mcap", "path.json"):
        assert Path("a", name).read_bytes() == Path("b", name).read_bytes()


def test_points_after_two_dashes(map_path: Path) -> None:
    assert run(["plan", "--map", "map.yaml", "-q", "--", "-1.5,1.0", "1.5,-1.0"]) == 0


def test_list_settings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "--list-settings"]) == 0
    assert "inflation_layer.cost_scaling_factor=10.0" in capsys.readouterr().out


def test_yaws_are_radians_or_say_deg():
    from slamcli.cli.points import parse_point

    assert parse_point("start", "1,-2,90deg") == pytest.approx((1.0, -2.0, 1.5707963267948966))
    assert parse_point("start", "1,-2,-1.5") == (1.0, -2.0, -1.5)
    with pytest.raises(UsageError, match="more than a turn; write 90deg for degrees"):
        parse_point("start", "1,-2,90")
