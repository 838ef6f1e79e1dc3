# SPDX-License-Identifier: MIT
"""The command line of slamcli compare: tables, JSON, thresholds, JUnit, exit codes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from slamcli.cli.main import run
from slamcli.formats.trajectories import read_tum, write_tum
from slamcli.pipelines.schemas import SchemaName, first_deviation

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
TRUTH = SAMPLES / "office.truth.tum"


@pytest.fixture
def results(tmp_path: Path) -> list[str]:
    """Options of two finished results, the second with every position stretched by a hundredth."""
    words = []
    for name, factor in (("old", 1.0), ("new", 1.01)):
        folder = tmp_path / name
        folder.mkdir()
        truth = read_tum(TRUTH)
        write_tum(folder / "trajectory.tum", replace(truth, positions_m=factor * truth.positions_m))
        (folder / "run.json").write_text('{"algo": "gmapping", "frames": {"base": "base_link"}}')
        words += ["--result", f"{name}={folder}"]
    return words


def test_the_table_names_the_best(results: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["compare", *results, "--ref", str(TRUTH), "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    line = next(line for line in out.splitlines() if "ate.rmse" in line)
    assert line.split()[:4] == ["ATE", "m", "0", "*"] or "0.0000 *" in line
    assert "old: nothing stood out" in out


def test_json_keeps_to_its_schema_and_a_missed_threshold_fails(
    results: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "compare",
        *results,
        "--ref",
        str(TRUTH),
        "-o",
        str(tmp_path / "out"),
        "--json",
        "--junit",
        str(tmp_path / "j.xml"),
    ]
    assert run([*words, "--max", "new.ate.rmse=0.01", "--max", "old.ate.rmse=0.01"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert first_deviation(document, SchemaName("compare", 1)) is None
    assert [verdict["passed"] for verdict in document["thresholds"]] == [False, True]
    assert document["results"][1]["figures"]["ate.rmse"] == pytest.approx(0.1, abs=0.06)
    suite = ET.parse(tmp_path / "j.xml").getroot()  # noqa: S314 - our own file
    assert (suite.get("tests"), suite.get("failures")) == ("2", "1")
    assert str(tmp_path / "out") not in (tmp_path / "out" / "run.json").read_text()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "nothing to run on: name a recording"),
        (["nothing.bag"], "nothing.bag"),
        (["{office}", "--algo", "gmaping"], "no SLAM system 'gmaping'"),
        (["{office}", "--algo", "orbslam3"], "needs camera images"),
        (["{office}", "--max", "x"], "is not KEY=VALUE"),
        (["{office}", "--ref", "nothing.tum"], "nothing.tum"),
    ],
)
def test_wrong_usage_is_one_line_and_leaves_nothing(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [word.replace("{office}", str(SAMPLES / "office.bag")) for word in words]
    assert run(["compare", *filled, "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert told in err
    assert len(err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_wrong_key_names_the_figures(results: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["compare", *results, "--ref", str(TRUTH), "-o", str(tmp_path / "out")]
    assert run([*words, "--max", "new.ate.rms=1"]) == 2
    assert "did you mean new.ate.rmse?" in capsys.readouterr().err
