# SPDX-License-Identifier: MIT
"""``slamcli map --algo rtabmap`` and what takes its database: gone on from, mapped again, shown, converted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamcli.cli.main import run
from slamcli.formats.closure_tables import read_closures
from slamcli.formats.g2o import read_g2o
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_trajectory
from slamcli.rtabmap.database import Database

DESK = str(Path(__file__).resolve().parents[2] / "sample_data" / "desk_rgbd.mcap")


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of the sample."""
    output = tmp_path_factory.mktemp("desk") / "desk"
    assert run(["map", "--algo", "rtabmap", DESK, "-o", str(output), "-q"]) == 0
    return output


def nodes(path: Path) -> int:
    with Database.read(path) as database:
        return len(database.nodes())


def test_the_folder(desk: Path) -> None:
    document = json.loads((desk / "run.json").read_text())
    assert "rtabmap.db" in document["outputs"]
    assert document["topics"]["rgb"] == "/camera/color/image_raw/compressed"
    assert nodes(desk / "rtabmap.db") >= 4
    assert len(read_trajectory(desk / "trajectory.tum")) == 31
    assert [path.name for path in desk.parent.iterdir()] == ["desk"]


def test_closures_links_and_figures_are_written(desk: Path) -> None:
    document = json.loads((desk / "run.json").read_text())
    closures = read_closures(desk / "closures.csv")
    tried = document["summary"]["closures_tried"]
    assert len(closures) == sum(sum(counts.values()) for counts in tried.values()) > 0
    links = (desk / "links.csv").read_text().splitlines()[1:]
    number = nodes(desk / "rtabmap.db")
    assert sum(line.split(",")[4] == "odometry" for line in links) == number - 1
    assert sum(one.accepted for one in closures) == len(links) - number + 1
    assert len(read_g2o(desk / "graph.g2o").first) == len(links)
    assert not (desk / "covisibility.csv").exists()
    assert len(document["timing"]["laps_s"]["update"]) == len(document["steps"]["node"]) == number
    page = (desk / "report.html").read_text()
    assert "Places seen again" in page
    assert "Time of each update" in page
    assert len(page) < 1_000_000


def test_a_database_is_drawn(desk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "nodes.png"
    assert run(["view", str(desk / "rtabmap.db"), "-o", str(picture), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == "database"
    assert document["poses"] == nodes(desk / "rtabmap.db")
    assert document["width_cells"] == read_map(desk / "map.yaml").grid.width
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert run(["view", str(desk / "rtabmap.db"), str(desk / "rtabmap.db"), "-o", str(picture)]) == 2


def test_it_is_gone_on_from_and_localised_in(desk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    home = tmp_path / "home.db"
    home.write_bytes((desk / "rtabmap.db").read_bytes())
    first = nodes(home)
    command = [
        "map",
        "--algo",
        "rtabmap",
        DESK,
        "--database",
        str(home),
        "--start",
        "1",
        "-o",
        str(tmp_path / "o"),
        "-q",
    ]
    before = home.read_bytes()
    assert run([*command, "--localise-only"]) == 0
    assert home.read_bytes() == before
    assert run(command) == 0
    assert nodes(home) > first
    assert "--database home.db" in json.loads((tmp_path / "o" / "run.json").read_text())["command"]
    assert run(["info", str(home), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [session["map_id"] for session in found["sessions"]] == [0, 1]
    assert run([*command, "--delete-db-on-start"]) == 0
    assert nodes(home) < found["nodes"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["home.db", "o"]


def test_it_is_mapped_again(desk: Path, tmp_path: Path) -> None:
    output = tmp_path / "again"
    assert run(["map", "--algo", "rtabmap", str(desk / "rtabmap.db"), "-o", str(output), "-q"]) == 0
    assert nodes(output / "rtabmap.db") == nodes(desk / "rtabmap.db")
    first, again = read_trajectory(desk / "keyframes.tum"), read_trajectory(output / "keyframes.tum")
    assert first.stamps_ns.tolist() == again.stamps_ns.tolist()
    assert abs(first.positions_m - again.positions_m).max() < 0.02


def test_info_and_convert(desk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(desk / "rtabmap.db")
    number = nodes(Path(file))
    assert run(["info", file]) == 0
    shown = capsys.readouterr().out
    assert "database of RTAB-Map (version 0.23.8)" in shown
    assert f"  {number} nodes, of them {number} in working memory" in shown
    assert "colour images of 320 x 240 pixels with depth" in shown
    assert "session 0: nodes 1 to" in shown
    assert run(["convert", file, str(tmp_path / "a.tum"), "-q"]) == 0
    assert len(read_trajectory(tmp_path / "a.tum")) == number
    assert run(["convert", f"{file}:odometry", str(tmp_path / "b.tum"), "-q"]) == 0
    assert run(["convert", file, str(tmp_path / "a.g2o"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["poses"] == number
    graph = read_g2o(tmp_path / "a.g2o")
    assert len(graph.ids) == number
    assert len(graph.first) >= number - 1
    assert run(["evaluate", file, str(desk / "trajectory.tum"), "--max", "ate.rmse=0.01", "-q"]) == 0


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["convert", "DB", "x.pbstream"], "a database becomes a trajectory (.tum, .kitti, .csv) or a graph (.g2o)"),
        (["convert", "DB:poses", "x.tum"], "no part 'poses' in a database"),
        (["convert", "DB:truth", "x.tum"], "no node has a pose by ground truth"),
        (["convert", "DB", "DB", "x.tum"], "is a database of RTAB-Map: one at a time"),
        (["info", "DB", DESK], "is a database of RTAB-Map: one at a time"),
        (["map", "DB"], "a database of RTAB-Map, not a recording: slamcli map --algo rtabmap maps from it"),
        (["map", "--algo", "rtabmap", "DB", DESK], "go on from it with --database"),
        (["map", "--algo", "rtabmap", DESK, "--load-atlas", "a.npz"], "--load-atlas: rtabmap keeps maps and words in a database"),
        (["map", "--algo", "orbslam3", DESK, "--database", "a.db"], "--database: orbslam3 keeps no database; --algo rtabmap does"),
        (["map", "--algo", "rtabmap", DESK, "--database", DESK], "it is the recording as well"),
        (["map", "--algo", "rtabmap", DESK, "--localise-only"], "name the database to localise in with --database"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(
    arguments: list[str], why: str, desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    file = str(desk / "rtabmap.db")
    assert (
        run([argument.replace("DB", file, 1) if argument.startswith("DB") else argument for argument in arguments]) == 2
    )
    error = capsys.readouterr().err.strip()
    assert why in error
    assert error.count("\n") == 0
    assert list(tmp_path.iterdir()) == []
