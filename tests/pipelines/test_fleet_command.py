# SPDX-License-Identifier: MIT
"""Many inputs through ``map`` and ``evaluate``: each gives what it gives by hand, and a summary says what became of all."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from held_runs import hold, holding, until
from store_servers import store_server

from slamcli.cli.main import run
from slamcli.pipelines.process_tree import tree
from slamcli.pipelines.schemas import first_deviation, schema_of
from slamcli.recordings import create_recording, open_recording

ROOT = Path(__file__).resolve().parents[2]

FAST = ["--set", "particles=1"]
TIMES = ("timing", "peak_memory_bytes")


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of a second each, and a file that is none."""
    folder = tmp_path_factory.mktemp("bags")
    with open_recording([ROOT / "sample_data" / "office.bag"]) as recording:
        for name, start in (("a", 20.0), ("b", 60.0)):
            with create_recording(folder / f"{name}.mcap") as writer:
                for topic in ("/scan", "/odom"):
                    for measurement in recording.measurements([topic], start_s=start, duration_s=1.0):
                        writer.write(topic, measurement)
    (folder / "bad.mcap").write_text("garbage")
    return folder


@pytest.fixture(scope="module")
def maps(bags, tmp_path_factory):
    """The fleet of `map` over them, run once."""
    here = tmp_path_factory.mktemp("maps")
    shutil.copytree(bags, here / "bags")
    words = [sys.executable, "-m", "slamcli", "map", "bags", *FAST, "--laser-pose", "0.1,0,0", "-o", "maps"]
    done = subprocess.run(words, cwd=here, capture_output=True, text=True, timeout=120, check=False)
    return here, done


def content(folder: Path) -> dict[str, object]:
    """What lies in a result, without what may differ."""
    found: dict[str, object] = {p.name: p.read_bytes() for p in folder.iterdir() if p.name != "report.html"}
    document = json.loads((folder / "run.json").read_text())
    return {**found, "run.json": {key: value for key, value in document.items() if key not in TIMES}}


def test_each_gives_what_it_gives_by_hand_and_one_failure_stops_nothing(maps, monkeypatch, capsys):
    here, done = maps
    monkeypatch.chdir(here)
    assert done.returncode == 1
    assert done.stdout.splitlines()[0].split()[:2] == ["name", "state"]
    assert [line.split()[:2] for line in done.stdout.splitlines()[2:]] == [
        ["a", "done"],
        ["b", "done"],
        ["bad", "failed"],
    ]
    assert sum(line.startswith("[") for line in done.stderr.splitlines()) == 2
    assert "bad failed: bags/bad.mcap: not a recording" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("maps: 2 of 3 done, 1 failed, ")
    assert run(["map", "bags/a.mcap", *FAST, "--laser-pose", "0.1,0,0", "-o", "hand"]) == 0
    assert content(Path("hand")) == content(Path("maps/a"))
    assert not Path("maps/bad").exists()


def test_the_summary_in_all_its_forms(maps):
    here, _ = maps
    document = json.loads((here / "maps/summary.json").read_text())
    record = json.loads((here / "maps/run.json").read_text())
    assert first_deviation(document, schema_of(document)) is None
    assert first_deviation(record, schema_of(record)) is None
    assert document["counts"] == {"inputs": 3, "done": 2, "missed": 0, "failed": 1}
    assert document["options"] == ["--set=particles=1", "--laser-pose=0.1,0,0", "--jobs", "1"]
    a, _, bad = document["runs"]
    assert (a["input"], a["output"], a["report"], a["state"]) == ("bags/a.mcap", "a", "a/report.html", "done")
    assert a["figures"]["poses"] == json.loads((here / "maps/a/run.json").read_text())["summary"]["poses"]
    assert (bad["state"], bad["output"], bad["exit_code"], bad["figures"]) == ("failed", None, 2, {})
    assert [entry["name"] for entry in record["inputs"]] == ["a.mcap", "b.mcap"]
    rows = list(csv.DictReader((here / "maps/summary.csv").read_text().splitlines()))
    assert [row["name"] for row in rows] == ["a", "b", "bad"]
    assert int(rows[0]["poses"]) == a["figures"]["poses"]
    assert rows[2]["message"] == bad["message"]
    assert "| bad | failed |" in (here / "maps/summary.md").read_text()
    page = (here / "maps/report.html").read_text()
    assert 'href="a/report.html">a</a>' in page
    assert "<li>bad: bags/bad.mcap: not a recording" in page
    assert "2 of 3 done, 1 failed" in page


def test_the_same_call_goes_on_and_fresh_runs_all(maps, monkeypatch, capsys):
    here, _ = maps
    monkeypatch.chdir(here)
    words = ["map", "bags", *FAST, "--laser-pose", "0.1,0,0", "-o", "maps"]
    before = Path("maps/a/map.pgm").stat().st_ino
    assert run([*words, "--json"]) == 1
    captured = capsys.readouterr()
    assert [row["timing"]["reused"] for row in json.loads(captured.out)["runs"]] == [True, True, False]
    assert "a was done before" in captured.err
    assert Path("maps/a/map.pgm").stat().st_ino == before
    assert run(["map", "bags/[a].mcap", *words[2:], "--fresh", "--workers", "1", "-q"]) == 0
    assert Path("maps/a/map.pgm").stat().st_ino != before


def test_results_are_scored_against_their_truths(maps, monkeypatch, capsys):
    here, _ = maps
    monkeypatch.chdir(here)
    Path("truth").mkdir()
    for name in ("a", "b"):
        shutil.copy(f"maps/{name}/trajectory.tum", f"truth/{name}.tum")
    words = ["evaluate", "maps", "truth/{name}.tum", "--align-type", "none", "--max", "ate.rmse=1e-6", "-o", "scores"]
    assert run([*words, "--json", "--junit", "ci.xml"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [(row["name"], row["figures"]["ate.rmse"]) for row in document["runs"]] == [("a", 0.0), ("b", 0.0)]
    assert document["runs"][0]["input"] == "maps/a/trajectory.tum"
    poses = [line.split() for line in Path("truth/b.tum").read_text().splitlines() if not line.startswith("#")]
    Path("truth/b.tum").write_text("".join(f"{t} {float(x) + 0.5} {' '.join(rest)}\n" for t, x, *rest in poses))
    assert run([*words, "--junit", "ci.xml"]) == 1
    captured = capsys.readouterr()
    assert "b missed a threshold: ate.rmse = 0.5" in captured.err
    assert [line.split()[:2] for line in captured.out.splitlines()[2:]] == [["a", "done"], ["b", "missed"]]
    suite = ET.parse("ci.xml").getroot()  # noqa: S314
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "1", "0")
    assert Path("scores/b/evaluation.json").exists()


def test_inputs_come_from_stores_and_go_again(bags, tmp_path, monkeypatch, capsys):
    from obstore.fsspec import FsspecStore

    monkeypatch.chdir(tmp_path)
    FsspecStore.clear_instance_cache()
    with store_server() as store:
        for name, value in store.environment.items():
            monkeypatch.setenv(name, value)
        store.objects = {"june/a.mcap": (bags / "a.mcap").read_bytes(), "june/note.txt": b"x"}
        web = f"{store.address}/bucket/june/a.mcap?signature=secret"
        Path("list.txt").write_text(f"s3://bucket/june/*\n{web}\nfile://{bags}/bad.mcap\n")
        assert run(["map", "@list.txt", *FAST, "--laser-pose", "0.1,0,0"]) == 1, capsys.readouterr().err
        assert run(["map", "s3://bucket/none/*.mcap", *FAST]) == 2
        assert "s3://bucket/none/*.mcap: nothing is there" in capsys.readouterr().err
    document = json.loads(Path("list-maps/summary.json").read_text())
    first, second, third = document["runs"]
    assert first["input"] == "s3://bucket/june/a.mcap"
    assert second["input"] == web.partition("?")[0]
    assert third["input"] == f"{bags}/bad.mcap"
    assert first["figures"] == second["figures"]
    assert "secret" not in "".join(p.read_text() for p in Path("list-maps").rglob("*.json"))
    assert sorted(p.name for p in Path("list-maps").iterdir() if p.is_dir()) == sorted(
        ["jobs", first["name"], second["name"]]
    )


def test_an_interrupted_fleet_ends_its_runs_and_goes_on_later(bags, tmp_path, monkeypatch):
    shutil.copytree(bags, tmp_path / "bags")
    (tmp_path / "bags" / "bad.mcap").unlink()
    held = tmp_path / "bags" / "b.mcap"
    hold(held)
    environment = {**os.environ, "PYTHONPATH": holding(tmp_path / "hold")}
    words = [sys.executable, "-m", "slamcli", "map", "bags", *FAST, "--laser-pose", "0.1,0,0", "-o", "maps"]
    with subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=environment) as process:
        until(lambda: (tmp_path / "maps/jobs/a.json").exists())
        inner = until(lambda: tree(process.pid)[1:])
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted: 1 of 2 ended; the same command goes on from there" in said
    assert not Path(f"/proc/{inner[0]}").exists()
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == ["a", "jobs"]
    Path(f"{held}.pipe").unlink()
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0
    assert "a was done before" in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["map", "none/*.mcap"], "none/*.mcap: no recording matches this pattern"),
        (["map", "@none.txt"], "@none.txt: the list cannot be read"),
        (["map", "a.mcap", "--workers", "2"], "--workers is for many inputs: say --each"),
        (["map", "a.mcap", "--scheduler", "tcp://x:1"], "--scheduler is for many inputs: say --each"),
        (["map", "--each"], "--each: name the inputs"),
        (["map", "--each", "a.mcap", "--max-memory", "much"], "--max-memory 'much' is no size: write it as 2GB"),
        (["map", "--each", "a.mcap", "--max-memory", "1MB"], "no run gets by with less than 100 MB"),
        (["map", "--each", "a.mcap", "--save-state", "x.pbstream"], "put {name} into its name"),
        (["map", "--each", "a.mcap", "-o", "file"], "file is a file: name a folder"),
        (["evaluate", "e/*.tum", "r.tum", "--plot", "p.png"], "put {name} into its name"),
        (["map", "foo://x/*", "-o", "o"], "foo:// is no store that fsspec knows"),
    ],
)
def test_wrong_usage_is_one_line(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    Path("a.mcap").write_text("garbage")
    Path("file").write_text("")
    Path("e").mkdir()
    Path("e/a.tum").write_text("1 0 0 0 0 0 0 1\n")
    assert run(words) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_nothing_but_wrong_inputs_is_wrong_usage(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("a.mcap").write_text("garbage")
    assert run(["map", "--each", "a.mcap", "-o", "out", "-q"]) == 2
    assert "a failed: a.mcap: not a recording" in capsys.readouterr().err
