# SPDX-License-Identifier: MIT
"""``slamcli navigate``: what it leaves, and what it says to wrong input."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map, write_map
from slamcli.formats.trajectories import read_trajectory
from slamcli.grids import OccupancyGrid
from slamcli.recordings import open_recording


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return a room of 6 by 4 m around the origin, with a closet that has no door, and a wall in its middle."""
    cells = np.zeros((80, 120), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[30:, 60] = 100
    cells[:21, 100] = cells[20, 100:] = 100
    path = tmp_path_factory.mktemp("room") / "room.yaml"
    write_map(path, OccupancyGrid(cells, 0.05, (-3.0, -2.0, 0.0)))
    return path


@pytest.fixture(scope="module")
def tour(room, tmp_path_factory):
    """Return the folder of a run around the wall and back, and the arguments that made it."""
    folder = tmp_path_factory.mktemp("tour") / "out"
    arguments = ["navigate", "1.0,0.5,1.57", "-1.0,-1.0", "--map", str(room), "--start", "-1.5,0.5,-1.57", "--people", "1",
                 "--seed", "4", "-q"]  # fmt: skip
    assert run([*arguments, "-o", str(folder)]) == 0
    return folder, arguments


def test_the_folder_has_everything(tour):
    folder, _ = tour
    names = {path.name for path in folder.iterdir()}
    assert names == {"trajectory.tum", "estimate.tum", "map.png", "report.html", "run.json", "run.mcap", "run.gif"}
    document = json.loads((folder / "run.json").read_text())
    assert set(document["outputs"]) == names
    summary = document["summary"]
    assert (summary["goals"], summary["reached"], summary["collisions_caused"]) == (2, 2, 0)
    assert 0.9 < summary["ratio"] < 1.3
    assert summary["localisation_rmse_m"] < 0.08
    assert document["command"].startswith(
        "slamcli navigate 1.0,0.5,1.57 -1.0,-1.0 --map room.yaml --start -1.5,0.5,-1.57"
    )
    assert document["parameters"]["DWAPlannerROS.max_vel_x"] == 0.5
    assert document["seed"] == 4


def test_trajectories_end_where_the_goal_is(tour):
    folder, _ = tour
    truth, estimate = (read_trajectory(folder / name) for name in ("trajectory.tum", "estimate.tum"))
    np.testing.assert_allclose(truth.positions_m[-1, :2], [-1.0, -1.0], atol=0.25)
    off = (truth.positions_m[-len(estimate) :] - estimate.positions_m)[
        :, :2
    ]  # the localiser speaks with the first scan
    assert np.hypot(*off.T).max() < 0.2


def test_the_recording_maps_localises_and_scores(tour, tmp_path, capsys):
    folder, _ = tour
    recording = folder / "run.mcap"
    with open_recording(recording) as opened:
        held = {topic.name for topic in opened.contents.topics}
    assert {"/map", "/scan", "/odom", "/tf", "/tf_static", "/particlecloud", "/amcl_pose", "/plan", "/local_plan", "/cmd_vel",
            "/ground_truth", "/people", "/goal", "/move_base/status"} <= held  # fmt: skip
    assert (
        run(["map", "--algo", "gmapping", str(recording), "-o", str(tmp_path / "map"), "--set", "particles=3", "-q"])
        == 0
    )
    assert run(["evaluate", f"{recording}:/odom", f"{recording}:/ground_truth", "--json"]) == 0
    scored = json.loads(capsys.readouterr().out)
    assert scored


def test_the_same_seed_gives_the_same_bytes(tour, tmp_path):
    folder, arguments = tour
    assert run([*arguments, "-o", str(tmp_path / "again")]) == 0
    for name in ("trajectory.tum", "estimate.tum", "map.png", "run.mcap", "run.gif"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


def test_a_mission_with_names_and_a_recording_of_its_own(room, tmp_path, capsys):
    mission = tmp_path / "m.yaml"
    mission.write_text("start: [-1.5, 0.5, 0]\nwaypoints:\n  - {name: charger, pose: [-1.5, -0.5], wait: 1}\n")
    bag = tmp_path / "r.bag"
    assert (
        run(
            [
                "navigate",
                "--mission",
                str(mission),
                "--map",
                str(room),
                "--bag",
                str(bag),
                "--localization",
                "truth",
                "--json",
            ]
        )
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert document["summary"]["by_goal"][0]["name"] == "charger"
    assert document["topics"]["/scan"] > 10
    assert bag.is_file()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.yaml", "r.bag"]


@pytest.mark.parametrize("algo", ["gmapping", "cartographer"])
def test_slam_makes_the_map_on_the_way(room, tmp_path, algo):
    folder = tmp_path / "out"
    arguments = [
        "navigate",
        "1.0,0.5",
        "--slam",
        algo,
        "--world",
        str(room),
        "--start",
        "-1.5,0.5,-1.57",
        "--lean",
        "-q",
    ]
    config = ["--config", "slam_navigation_full.launch", "--slam-set", "particles=5"] if algo == "gmapping" else []
    assert run([*arguments, *config, "-o", str(folder)]) == 0
    document = json.loads((folder / "run.json").read_text())
    assert document["summary"]["reached"] == 1
    assert (document["summary"]["slam"], document["summary"]["map"]) == (algo, None)
    assert {"map.yaml", "map.pgm", "trajectory.tum"} <= set(document["outputs"])
    made = read_map(folder / "map.yaml").grid
    cells = made.map_to_cell([[0.02, 1.5], [0.0, -1.0], [1.0, 0.5]])
    assert made.cells[cells[1:, 0], cells[1:, 1]].tolist() == [0, 0]
    near = made.cells[cells[0, 0] - 2 : cells[0, 0] + 3, cells[0, 1] - 2 : cells[0, 1] + 3]
    assert (near == 100).any()


@pytest.mark.parametrize("how", ["upside_down", "clockwise"])
def test_a_scanner_that_sees_the_other_way_round(room, tmp_path, how):
    folder = tmp_path / "out"
    arguments = [
        "navigate",
        "1.0,0.5",
        "--map",
        str(room),
        "--start",
        "-1.5,0.5,-1.57",
        "--set",
        f"laser.{how}=true",
        "-q",
    ]
    assert run([*arguments, "-o", str(folder)]) == 0
    summary = json.loads((folder / "run.json").read_text())["summary"]
    assert summary["localisation_rmse_m"] < 0.08
    with open_recording(folder / "run.mcap") as recording:  # the recording says how it hangs
        T = recording.frames().lookup("base_link", "laser", 1_700_000_002_000_000_000)
    assert (T[2, 2] < 0) == (how == "upside_down")


def test_the_start_of_a_world_is_the_default(tmp_path, capsys):
    assert (
        run(["navigate", "2.6,8.75", "--slam", "gmapping", "--world", "office", "--slam-set", "particles=2", "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["summary"]["start"][:2] == pytest.approx([2.0, 8.8])


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("0.02,1.0", "goal 1 (0.02,1) unreachable: goal 0.020,1.000 is in an obstacle"),
        ("9,0", "goal 1 (9,0) unreachable: goal 9.000,0.000 is outside"),
        ("2.5,-1.5", "goal 1 (2.5,-1.5) unreachable: goal 2.500,-1.500 cannot be reached"),
    ],
)  # fmt: skip
def test_a_goal_without_a_way_is_one_line_and_exit_code_1(room, capsys, goal, message):
    assert run(["navigate", goal, "--map", str(room), "--start", "-1.5,0.5"]) == 1
    said = capsys.readouterr()
    assert said.err.strip().splitlines()[-1].startswith(f"slamcli: {message}")


def test_a_robot_that_does_not_set_out_leaves_a_report_and_no_film(room, tmp_path, capsys):
    folder = tmp_path / "out"
    assert run(["navigate", "9,0", "--map", str(room), "--start", "-1.5,0.5", "-o", str(folder)]) == 1
    said = capsys.readouterr().err
    assert "the robot did not set out: there is no animation" in said
    assert said.strip().splitlines()[-1].startswith("slamcli: goal 1 (9,0) unreachable")
    assert {path.name for path in folder.iterdir()} == {"report.html", "run.json", "run.mcap"}
    assert "unreachable" in (folder / "report.html").read_text()


def test_a_goal_that_fails_does_not_keep_the_robot_from_the_next(room, capsys):
    code = run(["navigate", "9,0", "-1.5,0.2", "8,0", "--map", str(room), "--start", "-1.5,0.5,-1.5"])
    said = capsys.readouterr()
    assert code == 1
    assert "succeeded" in said.out
    assert said.err.strip().splitlines()[-1].endswith("(and 1 of 3 more)")


def test_time_runs_out(room, capsys):
    assert run(["navigate", "1,0.5", "--map", str(room), "--start", "-1.5,0.5", "--timeout", "1"]) == 1
    assert "timeout: not there after 1 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nan,1", "--start", "0,1"], "goal nan,1: write it as X,Y or X,Y,YAW"),
        (["1", "--start", "0,1"], "goal 1: write it as X,Y or X,Y,YAW"),
        (["hello", "--start", "0,1"], "goal hello: write it as X,Y"),
        (["1,1"], "where does the robot stand? give --start"),
        (["1,1", "--slam", "gmapping", "--world", "office"], "give --map FILE, or --slam"),
        (["--start", "0,1"], "no goal: give x,y"),
        (["1,1", "--start", "0.02,1"], "start 0.02,1: the robot does not fit there"),
        (["1,1", "--start", "-9,-9"], "start -9,-9 is outside the map"),
        (["1,1", "--start", "nan,0"], "start nan,0: not finite"),
        (["1,1", "--start", "-1.5,0", "--timeout", "nan"], "--timeout nan: give seconds above 0"),
        (["1,1", "--start", "-1.5,0", "--slam-set", "particles=3"], "--slam-set particles=3: there is nothing that maps"),
        (["1,1", "--start", "-1.5,0", "--set", "DWAPlannerROS/max_vel_x=nan"], "max_vel_x='nan'"),
        (["1,1", "--start", "-1.5,0", "--set", "DWAPlannerROS/max_vel_xx=1"], "did you mean"),
        (["1,1", "--start", "-1.5,0", "--animation", "a.webm"], "a.webm: an animation is a .gif or an .mp4"),
        (["1,1", "--start", "-1.5,0", "--bag", "a.foo"], "a.foo: cannot tell the format"),
        (["1,1", "--start", "-1.5,0", "--animation", "a.gif", "--bag", "a.gif"], "named twice"),
        (["1,1", "--start", "-1.5,0", "--arg", "x"], "--arg x: write it as NAME=VALUE"),
        (["1,1", "--start", "-1.5,0", "--mission", "m.yaml"], "give goals or --mission, not both"),
    ],
)  # fmt: skip
def test_wrong_usage_is_one_line_and_exit_code_2(room, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert run(["navigate", *arguments, "--map", str(room), "-q"]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_slam_needs_a_world(capsys):
    assert run(["navigate", "1,1", "--slam", "gmapping", "--start", "0,0"]) == 2
    assert "--slam gmapping: say where: --world WORLD" in capsys.readouterr().err


def test_with_slam_the_robot_cannot_know_where_it_is(capsys):
    assert run(["navigate", "1,1", "--slam", "gmapping", "--world", "office", "--localization", "truth"]) == 2
    assert "--localization truth needs --map" in capsys.readouterr().err


def test_a_map_without_room_is_refused(tmp_path, capsys):
    write_map(tmp_path / "full.yaml", OccupancyGrid(np.full((20, 20), 100, np.int8), 0.1))
    assert run(["navigate", "1,1", "--map", str(tmp_path / "full.yaml"), "--start", "0.5,0.5", "-q"]) == 2
    assert "the robot does not fit there" in capsys.readouterr().err


def test_a_run_that_is_broken_off_leaves_nothing(room, tmp_path, monkeypatch):
    from slamcli.pipelines.closed_loop import ClosedLoop

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ClosedLoop, "drive_to", stop)
    target = tmp_path / "out"
    code = run(
        [
            "navigate",
            "1,0.5",
            "--map",
            str(room),
            "--start",
            "-1.5,0.5",
            "-o",
            str(target),
            "--bag",
            str(tmp_path / "r.mcap"),
        ]
    )
    assert code == 130
    assert not list(tmp_path.iterdir())
