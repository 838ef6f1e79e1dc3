# SPDX-License-Identifier: MIT
"""``slamcli explore``: what it finds, what it leaves, that it does so twice, and what it says to wrong input."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map, write_map
from slamcli.formats.trajectories import read_trajectory
from slamcli.grids import OccupancyGrid

START = "-1.5,0.5,-1.57"


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


@pytest.fixture(scope="module", params=["gmapping", "cartographer"])
def explored(request, room, tmp_path_factory):
    """Return the folder of an exploration, and the arguments that made it."""
    folder = tmp_path_factory.mktemp(request.param) / "out"
    arguments = ["explore", str(room), "--slam", request.param, "--start", START, "--seed", "4", "-q", "--lean",
                 "--set", "laser.range_max=2.5", "--set", "explore/goal_distance=0.5"]  # fmt: skip
    assert run([*arguments, "-o", str(folder)]) == 0
    return folder, arguments


def test_all_of_the_room_is_explored_and_the_robot_is_home(explored):
    folder, _ = explored
    document = json.loads((folder / "run.json").read_text())
    summary = document["summary"]
    assert summary["status"] == "done"
    assert summary["coverage"] >= 0.98
    assert summary["reachable_m2"] == pytest.approx(
        (78 * 118 - 49 - 20 * 19) * 0.0025
    )  # without the wall and the closet
    assert (summary["collisions"], summary["frontiers_left"]) == (0, 0)
    assert summary["localisation_rmse_m"] < 0.06
    assert document["parameters"]["explore.potential_scale"] == 20.0
    assert document["command"].startswith("slamcli explore ")
    truth = read_trajectory(folder / "trajectory.tum")
    np.testing.assert_allclose(truth.positions_m[-1, :2], [-1.5, 0.5], atol=0.3)


def test_the_folder_has_everything(explored):
    folder, _ = explored
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "map.yaml",
        "map.pgm",
        "map.png",
        "coverage.csv",
        "trajectory.tum",
        "estimate.tum",
        "report.html",
        "run.json",
    }
    assert set(json.loads((folder / "run.json").read_text())["outputs"]) == names
    page = (folder / "report.html").read_text()
    assert "of the reachable area covered" in page
    assert "parameters" in page


def test_coverage_over_time_grows_to_what_is_told(explored):
    folder, _ = explored
    with (folder / "coverage.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    times, shares, ways = (np.array([float(row[name]) for row in rows]) for name in ("time_s", "coverage", "driven_m"))
    summary = json.loads((folder / "run.json").read_text())["summary"]
    assert (np.diff(times) > 0.0).all()
    assert np.diff(times)[:-1].max() <= 2.5
    assert (np.diff(ways) >= 0.0).all()
    assert shares[0] < 0.8 < 0.98 <= shares[-1]
    assert shares[-1] == pytest.approx(summary["coverage"], abs=1e-5)
    assert ways[-1] == pytest.approx(summary["path_length_m"], rel=0.01)


def test_the_map_lies_where_the_world_lies_and_can_be_driven_on(explored, room, tmp_path):
    folder, arguments = explored
    found, truth = read_map(folder / "map.yaml").grid, read_map(room).grid
    assert found.origin[2] == 0.0
    walls = found.cell_to_map(np.argwhere(found.cells == 100))
    true_walls = truth.cell_to_map(np.argwhere(truth.cells == 100))
    far = np.hypot(*(walls[:, None, :] - true_walls[None]).transpose(2, 0, 1)).min(axis=1)
    assert np.quantile(far, 0.95) < 0.11
    if "gmapping" in arguments:
        drive = ["navigate", "1.5,1.0", "--map", str(folder / "map.yaml"), "--world", str(room), "--start", START, "-q"]
        assert run(drive) == 0


def test_the_same_seed_gives_the_same_bytes(explored, tmp_path):
    folder, arguments = explored
    assert run([*arguments, "-o", str(tmp_path / "again")]) == 0
    for name in ("map.pgm", "map.yaml", "trajectory.tum", "estimate.tum", "coverage.csv", "map.png"):
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_without_enough_time_the_map_so_far_is_kept(room, tmp_path, capsys):
    arguments = [
        "explore",
        str(room),
        "--slam",
        "cartographer",
        "--start",
        START,
        "--timeout",
        "6",
        "--set",
        "laser.range_max=2.5",
    ]
    assert run([*arguments, "-o", str(tmp_path / "out"), "--json", "-q"]) == 1
    told = capsys.readouterr()
    assert told.err.strip().splitlines()[-1].startswith("slamcli: not done after 6 simulated s")
    assert "the map so far is saved" in told.err
    summary = json.loads(told.out)["summary"]
    assert summary["status"] == "timeout"
    assert 0.1 < summary["coverage"] < 0.98
    assert (tmp_path / "out" / "map.yaml").exists()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--start", "nan,0"], "not finite"),
        (["--start", "-3.0,-2.0"], "wall"),
        (["--start", "70,0"], "outside"),
        (["--start", "1"], "write it as X,Y or X,Y,YAW"),
        ([], "give --start"),
        (["--start", START, "--timeout", "0"], "above 0"),
        (["--start", START, "--timeout", "nan"], "above 0"),
        (["--start", START, "--set", "explore/gain=nothing"], "gain"),
        (["--start", START, "--set", "explore/min_size=1"], "min_frontier_size"),
        (["--start", START, "--slam-set", "no_such=1"], "no_such"),
        (["--start", START, "--animation", "film.txt"], "film.txt"),
    ],
)
def test_wrong_input_is_one_line(room, tmp_path, capsys, more, told):
    assert run(["explore", str(room), "--slam", "gmapping", "-o", str(tmp_path / "out"), *more]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert len([line for line in error.splitlines() if line.startswith("slamcli: ")]) == 1
    assert not (tmp_path / "out").exists()


def test_a_world_that_is_not_there_and_no_slam(capsys):
    assert run(["explore", "nowhere", "--slam", "gmapping"]) == 2
    assert "nowhere" in capsys.readouterr().err
    assert run(["explore", "office"]) == 2
    assert "--slam" in capsys.readouterr().err
