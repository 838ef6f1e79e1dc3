# SPDX-License-Identifier: MIT
"""``slamcli map --algo cartographer`` on a sample recording: every file of a graph, the same bytes for any number of threads."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
ARGUMENTS = ["map", str(SAMPLES / "office.bag"), "--algo", "cartographer", "--duration", "25", "-q"]
FILES = {
    "map.yaml", "map.pgm", "map.png", "trajectory.tum", "keyframes.tum", "constraints.csv", "graph.g2o", "state.pbstream",
    "report.html", "run.json",
}  # fmt: skip
TIMES = re.compile(
    r'<div class="card"><b>[^<]*</b><span>(real time|computing|peak memory)</span></div>|<section><h2>Time per stage</h2>.*?</section>',
    re.DOTALL,
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cartographer")
    for name, jobs in (("one", "1"), ("two", "2")):
        assert run([*ARGUMENTS, "-o", str(folder / name), "--jobs", jobs]) == 0
    return folder


def test_the_folder_holds_what_the_page_says(made):
    out = made / "one"
    record = json.loads((out / "run.json").read_text())
    assert sorted(record["outputs"]) == sorted(path.name for path in out.iterdir())
    assert set(record["outputs"]) >= FILES
    assert len({len(column) for column in record["steps"].values()}) == 1
    trajectory, truth = read_tum(out / "trajectory.tum"), read_tum(SAMPLES / "office.truth.tum")
    n = len(trajectory)
    assert n == pytest.approx(251, abs=2)
    np.testing.assert_array_equal(trajectory.stamps_ns, truth.stamps_ns[:n])
    moved = np.linalg.norm(trajectory.positions_m[-1] - trajectory.positions_m[0])
    assert moved == pytest.approx(np.linalg.norm(truth.positions_m[n - 1] - truth.positions_m[0]), abs=0.1)
    grid = read_map(out / "map.yaml").grid
    assert (grid.cells == 0).sum() * grid.resolution_m**2 > 50  # square metres of free floor
    assert (grid.cells == 100).sum() > 200


def test_the_tables_tell_of_the_graph(made):
    out = made / "one"
    nodes = read_tum(out / "keyframes.tum")
    with (out / "constraints.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["node"] for row in rows if row["kind"] == "intra"} == {str(k) for k in range(len(nodes))}
    assert max(float(row["translation_residual_m"]) for row in rows) < 0.2
    assert set(nodes.stamps_ns) <= set(read_tum(out / "trajectory.tum").stamps_ns)


def test_the_result_does_not_depend_on_threads(made):
    one, two = made / "one", made / "two"
    for name in sorted(path.name for path in one.iterdir()):
        if name in ("run.json", "report.html"):
            continue
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    records = [json.loads((folder / "run.json").read_text()) for folder in (one, two)]
    for record in records:
        del record["timing"], record["peak_memory_bytes"]
    assert records[0] == records[1]
    pages = [TIMES.sub("", (folder / "report.html").read_text()) for folder in (one, two)]
    assert pages[0] == pages[1]
    assert "Pose graph" in pages[0]


def test_the_record_goes_to_stdout(tmp_path, capsys):
    assert run([*ARGUMENTS[:-3], "--duration", "5", "-q", "-o", str(tmp_path / "out"), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["algo"] == "cartographer"
    assert record == json.loads((tmp_path / "out" / "run.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--set", "POSE_GRAPH.constraint_builder.min_scor=0.6"],
            "did you mean POSE_GRAPH.constraint_builder.min_score",
        ),
        (["--config", "nowhere.lua"], "nowhere.lua"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert run([*ARGUMENTS, "-o", "out", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
