# SPDX-License-Identifier: MIT
from __future__ import annotations

import io
import json
import sys

import pytest

from slamcli.cli.main import run
from slamcli.pipelines.schemas import schema_names

GOOD = {"schema": "slamcli.vocabulary-info.1", "file": "a", "size_bytes": 1, "branching": 2, "levels": 1, "nodes": 3, "words": 2,
        "words_without_weight": 0, "weighting": "tf-idf", "weights": [0.5, 1.0], "matching_nodes": 2}  # fmt: skip


@pytest.fixture
def write(tmp_path):
    def _write(**changes):
        path = tmp_path / "document.json"
        path.write_text(json.dumps({key: value for key, value in (GOOD | changes).items() if value is not ...}))
        return str(path)

    return _write


def test_names_are_listed_with_what_writes_them(capsys):
    assert run(["schema"]) == 0
    lines = capsys.readouterr().out.splitlines()
    stamps = [line.split()[0] for line in lines]
    assert stamps == [schema.stamp for schema in schema_names()]
    assert "slamcli.doctor.1" in stamps
    assert any(line.endswith("  slamcli doctor BAG --json") for line in lines)


@pytest.mark.parametrize("name", ["doctor", "doctor.1", "doctor-1", "slamcli.doctor.1"])
def test_a_schema_is_printed(capsys, name):
    assert run(["schema", name]) == 0
    assert json.loads(capsys.readouterr().out)["properties"]["schema"]["const"] == "slamcli.doctor.1"


def test_an_unknown_name_is_one_line(capsys):
    assert run(["schema", "docter"]) == 2
    assert capsys.readouterr().err == "slamcli: no schema 'docter': did you mean 'doctor'?\n"


def test_a_document_that_keeps_to_its_schema(capsys, write):
    path = write()
    assert run(["schema", "--validate", path]) == 0
    assert capsys.readouterr().out == f"{path}: slamcli.vocabulary-info.1\n"
    assert run(["schema", "vocabulary-info", "--validate", path]) == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"words": ...}, "$: 'words' is a required property"),
        ({"words": "two"}, "$.words: 'two' is not of type 'integer'"),
        ({"weights": [1.0]}, "$.weights: [1.0] is too short"),
        ({"colour": 1}, "$: Additional properties are not allowed ('colour' was unexpected)"),
        ({"words": "w" * 1000}, "…"),
    ],
)
def test_the_first_deviation_is_one_line_and_exit_code_1(capsys, write, changes, message):
    path = write(**changes)
    assert run(["schema", "--validate", path]) == 1
    said = capsys.readouterr().out
    assert said.startswith(f"{path}: not slamcli.vocabulary-info.1: ")
    assert said.rstrip("\n").endswith(message)
    assert said.count("\n") == 1
    assert len(said) < 500 + len(path)


def test_all_documents_are_checked_and_one_that_is_wrong_decides(capsys, write, tmp_path):
    wrong = write(words=-1)
    good = tmp_path / "good.json"
    good.write_text(json.dumps(GOOD))
    assert run(["schema", "--validate", wrong, "--validate", str(good)]) == 1
    assert [line.split(": ")[1] for line in capsys.readouterr().out.splitlines()] == [
        "not slamcli.vocabulary-info.1",
        "slamcli.vocabulary-info.1",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"schema": ', "not a JSON document"),
        ('{"schema": NaN}', "NaN is not JSON"),
        ("[" * 100_000, "not a JSON document"),
        ("[]", "names no schema"),
        ("{}", "names no schema"),
        ('{"schema": 1}', "names no schema"),
        ('{"schema": "slamcli.doctor.99"}', "'slamcli.doctor.99' is not one that this slamcli knows"),
        ('{"schema": "../../etc/passwd"}', "is not one that this slamcli knows"),
    ],
)
def test_what_is_no_document_of_ours_is_exit_code_2(capsys, tmp_path, text, message):
    path = tmp_path / "x.json"
    path.write_text(text)
    assert run(["schema", "--validate", str(path)]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert str(path) in err
    assert err.count("\n") == 1


def test_a_missing_file_is_exit_code_2(capsys, tmp_path):
    assert run(["schema", "--validate", str(tmp_path / "none.json")]) == 2
    assert "No such file" in capsys.readouterr().err


def test_stdin_is_read(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(json.dumps(GOOD).encode())))
    assert run(["schema", "--validate", "-"]) == 0
    assert capsys.readouterr().out == "-: slamcli.vocabulary-info.1\n"
