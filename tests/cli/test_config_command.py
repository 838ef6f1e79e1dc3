# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path

import pytest

from slamcli.cli.main import run

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def test_show_prints_every_parameter_with_value_and_source(capsys):
    assert run(["config", "show", "--config", str(CONFIGS / "gmapping.launch"), "--set", "particles=7", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in document["parameters"]}
    assert (rows["particles"]["value"], rows["particles"]["source"], rows["particles"]["default"]) == (7, "--set", 30)
    assert (rows["minimumScore"]["value"], rows["minimumScore"]["changed"]) == (200, True)
    assert rows["minimumScore"]["source"].endswith("gmapping.launch:20")
    assert rows["iterations"]["source"].endswith("gmapping.launch:31")
    assert (rows["lskip"]["source"], rows["lskip"]["changed"]) == ("default", False)
    assert all(row["help"] for row in document["parameters"])
    assert document["remaps"] == {"scan": "/scan"}


def test_show_for_a_person_marks_what_was_changed(capsys):
    assert run(["config", "show", "--set", "particles=7", "--changed"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("* particles = 7   (default 30; 1 … 10000; from --set)")
    assert lines[1].strip() == "number of particles"
    assert len(lines) == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "--set", "particels=7"], "did you mean particles"),
        (["show", "--algo", "gmaping"], "no SLAM system 'gmaping': installed are"),
        (["show", "--config", "nowhere.launch"], "nowhere.launch: no such file"),
        (["show", "--arg", "x"], "write NAME=VALUE"),
        (["show", "--config", "pr2.lua"], "Lua files are for --algo cartographer"),
        (["show", "--algo", "cartographer", "--set", "min_score=2"], "did you mean POSE_GRAPH.constraint_builder.min"),
        (["show", "--algo", "cartographer", "--set", "MAP_BUILDER=2"], "unknown parameter 'MAP_BUILDER'"),
        (["check"], "Missing argument"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(capsys, arguments, message):
    assert run(["config", *arguments]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert len(captured.err.strip().splitlines()) == 1
    assert captured.out == ""


def test_check_sets_the_exit_code_by_severity(capsys, tmp_path):
    assert run(["config", "check", str(CONFIGS / "gmapping.launch"), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["counts"]["error"] == 1  # the package of the node, which roslaunch does not find
    assert any("minimumScore 200" in f["message"] and f["line"] == 20 for f in document["findings"])
    dwa = str(CONFIGS / "base_local_planner_params.yaml")
    assert run(["config", "check", dwa]) == 0
    assert f"{dwa}:23: warning: vtheta_samples" in capsys.readouterr().out
    assert run(["config", "check", dwa, "--strict"]) == 1
    assert run(["config", "check", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml: no such file" in capsys.readouterr().err
    (tmp_path / "bad.yaml").write_text("a: [")
    assert run(["config", "check", str(tmp_path / "bad.yaml")]) == 1


def test_cartographers_files_are_shown_and_checked(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["config", "show", "--algo", "cartographer", "--config", "backpack_2d.lua", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in document["parameters"]}
    score = rows["POSE_GRAPH.constraint_builder.min_score"]
    assert (score["value"], score["default"], score["changed"]) == (0.65, 0.55, True)
    assert score["source"].endswith("backpack_2d.lua:35")
    assert rows["POSE_GRAPH.constraint_builder.sampling_ratio"]["source"] == "default"
    assert run(["config", "check", "backpack_2d.lua", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["counts"]["error"] == 1
    assert "options lacks lookup_transform_timeout_sec" in document["findings"][0]["message"]
    assert run(["config", "check", "pr2.lua", "taurob_tracker.lua"]) == 0
    (tmp_path / "loop.lua").write_text("while true do end")
    assert run(["config", "show", "--algo", "cartographer", "--config", "loop.lua"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("slamcli: loop.lua:1: it does not end")
