# SPDX-License-Identifier: MIT
from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as ET

import click
import pytest

from slamcli.cli.main import run
from slamcli.cli.verdicts import Verdicts
from slamcli.errors import DependencyError, EstimationError, ProcessError, UsageError
from slamcli.pipelines.run_figures import run_figures

FIGURES = {"ate.rmse": 0.25, "coverage.time": 0.5, "never": math.nan}


def read(path: Path) -> ET.Element:
    return ET.parse(path).getroot()[0]  # noqa: S314 - our own


def verdicts(junit: Path | None, *, upper=(), lower=()) -> Verdicts:
    return Verdicts("test", subject="a on b", upper=upper, lower=lower, junit=junit)


def fail_after(found: Verdicts, error: Exception) -> None:
    found.judge(FIGURES)
    raise error


def test_a_case_for_each_threshold_and_the_exit_code(tmp_path):
    junit = tmp_path / "deep" / "j.xml"
    with verdicts(junit, upper=["ate.rmse=0.3", "never=1"], lower=["coverage.time=0.9"]) as found:
        found.judge(FIGURES)
    suite = read(junit)
    assert [case.get("name") for case in suite.iter("testcase")] == [
        "a on b: ate.rmse <= 0.3", "a on b: never <= 1", "a on b: coverage.time >= 0.9",
    ]  # fmt: skip
    assert [case.find("failure") is not None for case in suite.iter("testcase")] == [False, True, True]
    assert {case.get("classname") for case in suite.iter("testcase")} == {"slamcli.test"}
    assert suite.findtext("testcase/system-out").splitlines()[2:] == [
        "ate.rmse = 0.25",
        "coverage.time = 0.5",
        "never = nan",
    ]
    assert found.exit_code == 1
    assert [row["passed"] for row in found.as_dicts()] == [True, False, False]
    assert found.added_to({"a": 1})["thresholds"] == found.as_dicts()


def test_without_thresholds_one_case_holds_the_figures(tmp_path):
    with verdicts(tmp_path / "j.xml") as found:
        found.judge(FIGURES)
    (case,) = read(tmp_path / "j.xml").iter("testcase")
    assert (case.get("name"), case.find("failure"), case.find("error")) == ("a on b", None, None)
    assert case.findtext("system-out").startswith("ate.rmse = 0.25\n")
    assert found.exit_code == 0
    assert found.added_to({"a": 1}) == {"a": 1}


@pytest.mark.parametrize(
    ("error", "kind", "message"),
    [
        (UsageError("no such file"), "error", "no such file"),
        (click.UsageError("no such option"), "error", "no such option"),
        (DependencyError("install it"), "error", "install it"),
        (MemoryError("too much"), "error", "MemoryError: too much"),
        (ZeroDivisionError("x"), "error", "ZeroDivisionError: x"),
        (EstimationError("nothing matches"), "failure", "nothing matches"),
        (ProcessError("one goal was not reached"), "failure", "one goal was not reached"),
    ],
)
def test_an_error_goes_on_and_stands_in_the_file(tmp_path, error, kind, message):
    with pytest.raises(type(error)), verdicts(tmp_path / "j.xml", upper=["ate.rmse=1"]):
        raise error
    (case,) = read(tmp_path / "j.xml").iter("testcase")
    assert case.find(kind).get("message") == message


def test_a_failure_after_the_verdicts_stands_before_them(tmp_path):
    with pytest.raises(ProcessError), verdicts(tmp_path / "j.xml", upper=["ate.rmse=1"]) as found:
        fail_after(found, ProcessError("one goal was not reached"))
    first, second = read(tmp_path / "j.xml").iter("testcase")
    assert first.findtext("failure") == "one goal was not reached"
    assert second.find("failure") is None


def test_a_reader_that_goes_away_is_no_error(tmp_path):
    with pytest.raises(BrokenPipeError), verdicts(tmp_path / "j.xml", upper=["ate.rmse=1"]) as found:
        fail_after(found, BrokenPipeError())
    assert read(tmp_path / "j.xml").get("errors") == "0"


def test_wrong_thresholds_stand_in_the_file_too(tmp_path):
    with pytest.raises(UsageError, match="not KEY=VALUE"), verdicts(tmp_path / "j.xml", lower=["ate.rmse"]):
        pass
    assert read(tmp_path / "j.xml").get("errors") == "1"
    wrong = pytest.raises(UsageError, match=r"no figure 'ate\.rms' here; did you mean ate\.rmse")
    with wrong, verdicts(tmp_path / "k.xml", upper=["ate.rms=1"]) as found:
        found.judge(FIGURES)
    assert read(tmp_path / "k.xml").get("errors") == "1"


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path):
    with pytest.raises(UsageError, match="is a folder"), verdicts(tmp_path):
        raise AssertionError("it was begun")


def test_evaluate_writes_what_became_of_wrong_input(tmp_path, capsys):
    junit = tmp_path / "j.xml"
    assert run(["evaluate", str(tmp_path / "none.tum"), str(tmp_path / "none.tum"), "--junit", str(junit)]) == 2
    (case,) = read(junit).iter("testcase")
    assert case.find("error").get("message") == capsys.readouterr().err.removeprefix("slamcli: ").strip()
    assert case.get("classname") == "slamcli.evaluate"


def test_figures_of_a_run_are_flat_numbers():
    run_document = {
        "summary": {"poses": 3, "ok": True, "name": "x", "list": [1], "none": None, "truth": {"ate.rmse": 0.5}, "memory": {"words": 7}},
        "timing": {"total_s": 2.0, "realtime_factor": None, "jobs": 2},
        "peak_memory_bytes": 10,
    }  # fmt: skip
    found = run_figures(run_document)
    assert math.isnan(found.pop("none"))
    assert math.isnan(found.pop("timing.realtime_factor"))
    assert found == {
        "poses": 3.0, "ok": 1.0, "truth.ate.rmse": 0.5, "memory.words": 7.0, "timing.total_s": 2.0, "peak_memory_bytes": 10.0,
    }  # fmt: skip
