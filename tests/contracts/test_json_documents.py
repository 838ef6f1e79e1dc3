# SPDX-License-Identifier: MIT
"""What commands print with --json and write as run.json keeps to its schema, made by real small runs, also where something fails."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

from slamcli.cli.main import run
from slamcli.formats.maps import write_map
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.schemas import first_deviation, schema_of

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
OFFICE, CORRIDOR, DESK = (str(SAMPLES / name) for name in ("office.bag", "loop_corridor.mcap", "desk_rgbd.mcap"))
OFFICE_MAP, OFFICE_TRUTH = str(SAMPLES / "office.map.yaml"), str(SAMPLES / "office.truth.tum")
SMALL = ["--set", "particles=2", "--set", "xmin=-10", "--set", "xmax=10", "--set", "ymin=-10", "--set", "ymax=10", "-q"]


def checked(text: str, name: str) -> dict[str, Any]:
    """Return a document after holding it against the schema of this name; NaN and Infinity are no JSON."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    document = json.loads(text, parse_constant=refuse)
    assert next(iter(document)) == "schema"
    assert schema_of(document).name == name
    assert first_deviation(document, schema_of(document)) is None
    return document


def printed(arguments: list[str], name: str, code: int = 0) -> dict[str, Any]:
    """Run a command with --json and return what it printed."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert run([*arguments, "--json"]) == code
    return checked(said.getvalue(), name)


def written(path: Path, name: str = "run") -> dict[str, Any]:
    return checked(path.read_text(), name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("documents")


@pytest.fixture(scope="module")
def mapped(folder):
    """Return the folder of a map by gmapping, and what was printed."""
    arguments = ["map", OFFICE, "-o", str(folder / "mapped"), "--duration", "3", "--truth", OFFICE_TRUTH, *SMALL]
    return folder / "mapped", printed(arguments, "run")


@pytest.fixture(scope="module")
def corridor(folder):
    """Return the folder of a map by cartographer."""
    out = folder / "corridor"
    arguments = ["map", "--algo", "cartographer", CORRIDOR, "-o", str(out), "--duration", "1.5", "-q"]
    assert printed(arguments, "run")["algo"] == "cartographer"
    return out


@pytest.fixture(scope="module")
def desk(folder):
    """Return the folder of a map by rtabmap."""
    out = folder / "desk"
    arguments = ["map", "--algo", "rtabmap", DESK, "-o", str(out), "--duration", "0.6", "-q"]
    assert printed(arguments, "run")["algo"] == "rtabmap"
    return out


@pytest.fixture(scope="module")
def room(folder):
    """Return a map of a room of 4 by 3 m around the origin."""
    cells = np.zeros((60, 80), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    write_map(folder / "room.yaml", OccupancyGrid(cells, 0.05, (-2.0, -1.5, 0.0)))
    return str(folder / "room.yaml")


@pytest.mark.parametrize("bag", [DESK, str(SAMPLES / "cluttered_room")], ids=lambda p: Path(p).name)
def test_info_of_recordings(bag):
    assert printed(["info", bag], "info")["topics"]


def test_info_of_a_state(corridor):
    assert printed(["info", str(corridor / "state.pbstream")], "info-state")["nodes"] > 0


def test_info_of_a_database(desk):
    assert printed(["info", str(desk / "rtabmap.db")], "info-database")["nodes"] > 0


def test_doctor(tmp_path):
    document = printed(["doctor", CORRIDOR], "doctor")
    assert document["errors"] == len([f for f in document["findings"] if f["severity"] == "error"]) == 0
    damaged = tmp_path / "cut.mcap"
    damaged.write_bytes(Path(CORRIDOR).read_bytes()[:200_000])
    assert printed(["doctor", str(damaged)], "doctor", 1)["findings"]


def test_convert(tmp_path, corridor, desk):
    assert printed(["convert", CORRIDOR, str(tmp_path / "a.bag"), "--duration", "1"], "convert")["num_messages"] > 0
    assert written(tmp_path / "a.bag.run.json")["command"] == "convert"
    empty = ["convert", CORRIDOR, str(tmp_path / "b.mcap"), "--topics", "/scan", "--start", "1e6", "--duration", "1"]
    assert run([*empty, "-q"]) in (0, 2)
    assert printed(["convert", DESK, str(tmp_path / "folder"), "--layout", "tum", "--duration", "0.5"], "convert")
    assert written(tmp_path / "folder.run.json")
    printed(["convert", str(corridor / "state.pbstream"), str(tmp_path / "s.tum")], "convert-state")
    assert written(tmp_path / "s.tum.run.json")["summary"]["poses"] > 0
    printed(["convert", str(desk / "rtabmap.db"), str(tmp_path / "d.g2o")], "convert-state")


def test_map(mapped):
    out, document = mapped
    assert document["summary"]["truth"]["ate.rmse"] < 0.1
    record = written(out / "run.json")
    assert {key: value for key, value in record.items() if key not in ("timing", "peak_memory_bytes")} == {
        key: value for key, value in document.items() if key not in ("timing", "peak_memory_bytes")
    }


def test_map_of_systems_with_graphs_and_images(corridor, desk):
    assert written(corridor / "run.json")["summary"]["nodes"] > 0
    assert written(desk / "run.json")["summary"]["frames"] > 0


def test_map_with_a_threshold_that_is_missed_keeps_the_result_and_says_so(tmp_path, capsys):
    out, junit = tmp_path / "out", tmp_path / "map.xml"
    bars = ["--max", "truth.ate.rmse=1e-9", "--min", "poses=10", "--junit", str(junit)]
    arguments = ["map", OFFICE, "-o", str(out), "--duration", "3", "--truth", OFFICE_TRUTH, *SMALL, *bars]
    document = printed(arguments, "run", 1)
    assert [(row["key"], row["passed"]) for row in document["thresholds"]] == [
        ("truth.ate.rmse", False),
        ("poses", True),
    ]
    assert "thresholds" not in written(out / "run.json")
    assert (out / "map.yaml").is_file()
    assert "warning: truth.ate.rmse" in capsys.readouterr().err
    suite = ET.parse(junit).getroot()[0]  # noqa: S314 - our own
    assert [suite.get(key) for key in ("tests", "failures", "errors")] == ["2", "1", "0"]


def test_evaluate(mapped, room, tmp_path):
    estimate = str(mapped[0] / "trajectory.tum")
    document = printed(
        ["evaluate", estimate, OFFICE_TRUTH, "-o", str(tmp_path / "e"), "--max", "ate.rmse=0", "-q"], "evaluate", 1
    )
    assert document["kind"] == "trajectory"
    assert not document["thresholds"][0]["passed"]
    assert written(tmp_path / "e" / "evaluation.json", "evaluate") == document
    assert written(tmp_path / "e" / "run.json")["estimate"] == estimate
    part = ["evaluate", estimate, OFFICE_TRUTH, "--metric", "ape", "--align-type", "none"]
    assert "rpe" not in printed(part, "evaluate")
    relations = tmp_path / "true.relations"
    relations.write_text("1700000000.0 1700000001.0 0.1 0 0 0 0 0\n1700000000.5 1700009999.0 0 0 0 0 0 0\n")
    document = printed(["evaluate", estimate, str(relations), "-q"], "evaluate")
    assert document["relations"]["unmatched"] == 1
    document = printed(["evaluate", room, room, "--map-align", "none", "-o", str(tmp_path / "m"), "-q"], "evaluate")
    assert document["map"]["f_score"] == 1.0
    assert written(tmp_path / "m" / "run.json")["command"] == "evaluate"


def test_plan(room, tmp_path, capsys):
    found = printed(["plan", "-1,0", "1,0.5,1.57", "--map", room, "-o", str(tmp_path / "p"), "-q"], "plan")
    assert len(found["path"]) == found["num_points"]
    assert written(tmp_path / "p" / "run.json")["summary"]["status"] == "ok"
    assert written(tmp_path / "p" / "path.json", "plan-path")["path"] == found["path"]
    reverse = [
        "plan",
        "-1,0,0",
        "-1.5,0,0",
        "--map",
        room,
        "--planner",
        "hybrid_astar",
        "--turning-radius",
        "0.4",
        "-q",
    ]
    assert "directions" in printed(reverse, "plan")
    assert printed(["plan", "-1,0", "99,0", "--map", room, "-q"], "plan", 1)["status"] == "goal_outside"
    capsys.readouterr()
    pairs = tmp_path / "pairs.csv"
    pairs.write_text("-1,0,1,0\n-1,0,99,0\n")
    assert run(["plan", "--map", room, "--pairs", str(pairs), "-q"]) == 0
    answers = [checked(line, "plan-pair") for line in capsys.readouterr().out.splitlines()]
    assert [answer["status"] for answer in answers] == ["ok", "goal_outside"]


def test_localize(tmp_path):
    out = tmp_path / "out"
    arguments = ["localize", OFFICE, "--map", OFFICE_MAP, "--global", "--duration", "2", "--ref", OFFICE_TRUTH,
                 "--set", "max_particles=400", "--set", "min_particles=100", "-o", str(out), "-q"]  # fmt: skip
    document = printed([*arguments, "--min", "poses=5"], "run")
    assert document["thresholds"][0]["passed"]
    assert "truth" in written(out / "run.json")["summary"]


def test_navigate_with_a_goal_that_is_reached_and_one_that_is_not(room, tmp_path):
    out, junit = tmp_path / "out", tmp_path / "n.xml"
    drive = ["navigate", "--map", room, "--start", "-1,0,0", "--localization", "truth", "--lean", "-q", "-o", str(out)]
    document = printed([*drive, "-0.4,0", "--max", "collisions=0"], "run")
    assert document["summary"]["reached"] == 1
    document = printed([*drive, "99,0", "--junit", str(junit)], "run", 1)
    assert document["summary"]["by_goal"][0]["status"] == "unreachable"
    assert written(out / "run.json")["summary"] == document["summary"]
    suite = ET.parse(junit).getroot()[0]  # noqa: S314 - our own
    assert suite.find("testcase/failure") is not None
    assert suite.get("errors") == "0"


def test_explore_that_runs_out_of_time(room, tmp_path):
    out = tmp_path / "out"
    arguments = [
        "explore",
        room,
        "--slam",
        "gmapping",
        "--slam-set",
        "particles=2",
        "--start",
        "0,0,0",
        "--timeout",
        "2",
        "--lean",
        "-q",
    ]
    document = printed([*arguments, "-o", str(out)], "run", 1)
    assert document["summary"]["coverage_after_s"]
    assert written(out / "run.json")["algo"] == "gmapping"


def test_generate_and_teleop(tmp_path):
    script = tmp_path / "drive.txt"
    script.write_text("1.0,0.2,0.0\n")
    document = printed(["teleop", "office", str(tmp_path / "t.bag"), "--script", str(script), "-q"], "teleop")
    assert written(Path(document["record"]))["outputs"]
    world = ["generate", "cluttered_room", str(tmp_path / "g.mcap"), "--duration", "1", "-q"]
    assert written(Path(printed(world, "generate")["record"]))["algo"] == "simulation"


def test_view(mapped, corridor, room, tmp_path):
    out = str(tmp_path / "view.png")
    for source in (str(mapped[0]), room, OFFICE_TRUTH, str(corridor / "state.pbstream")):
        assert printed(["view", source, "-o", out, "-q"], "view")["output"] == out
    assert printed(["view", CORRIDOR, "-o", out, "--duration", "1", "-q"], "view")["kind"] == "recording"
    assert printed(["view", str(mapped[0]), "-o", str(tmp_path / "view.mcap"), "-q"], "view")["kind"]


def test_map_tools(room, tmp_path):
    printed(["map-tools", "info", room], "map-tools-info")
    empty = tmp_path / "empty.yaml"
    write_map(empty, OccupancyGrid(np.full((4, 4), -1, dtype=np.int8), 0.05, (0.0, 0.0, 0.0)))
    assert printed(["map-tools", "info", str(empty)], "map-tools-info")["known_bounds_m"] is None
    assert printed(["map-tools", "diff", str(empty), str(empty)], "map-tools-diff")["known_in_both_cells"] == 0
    printed(["map-tools", "convert", room, str(tmp_path / "c.yaml"), "-q"], "map-tools-convert")
    printed(["map-tools", "crop", room, str(tmp_path / "d.yaml"), "-q"], "map-tools-crop")
    shutil.copy(room, tmp_path / "same.yaml")
    printed(["map-tools", "diff", room, str(tmp_path / "c.yaml"), "-o", str(tmp_path / "d.png")], "map-tools-diff")


def test_vocabulary(tmp_path):
    rng = np.random.default_rng(0)
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for number in range(4):
        blocks = rng.integers(0, 256, (15, 20), dtype=np.uint8)
        Image.fromarray(blocks.repeat(16, 0).repeat(16, 1)).save(pictures / f"{number}.png")
    file = tmp_path / "words.npz"
    small = ["--branching", "4", "--levels", "3", "--features", "150", "-q"]
    printed(["vocabulary", "train", str(pictures), "-o", str(file), *small], "vocabulary-train")
    assert written(tmp_path / "words.npz.run.json")["summary"]["words"] > 0
    assert printed(["vocabulary", "info", str(file)], "vocabulary-info")["words"] > 0


@pytest.mark.parametrize(
    "algo", ["gmapping", "cartographer", "rtabmap", "orbslam3", "navigation", "plan", "simulation"]
)
def test_config_show(algo):
    assert printed(["config", "show", "--algo", algo], "config-show")["parameters"]


def test_config_check(tmp_path):
    configs = SAMPLES.parent / "configs"
    printed(["config", "check", str(configs / "move_base.launch"), "--beams", "360"], "config-check")
    broken = tmp_path / "broken.launch"
    broken.write_text("<launch>")
    assert printed(["config", "check", str(broken)], "config-check", 1)["counts"]["error"] == 1


def test_warmup(monkeypatch):
    monkeypatch.setattr("slamcli.cli.warmup.ROOMS", ("grids.distance",))
    assert list(printed(["warmup", "-q"], "warmup")["seconds"]) == ["grids.distance"]
