# SPDX-License-Identifier: MIT
"""Parameters declared once, and what a run remembers."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from slamcli.errors import ConfigError
from slamcli.parameters import as_dict, declarations, group, parameter, resolve
from slamcli.runtime import RunLog, peak_memory_bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    lstep: float = parameter(0.05, "a step", unit="m", minimum=0.0, maximum=1.0)
    str_: int = parameter(3, "a word of Python", name="str", minimum=1)
    on: bool = parameter(False, "a switch")
    way: str = parameter("auto", "a choice", choices=("auto", "NUMBER"))
    reach: float = parameter(None, "from the data", kind=float)


@dataclass(frozen=True, slots=True, kw_only=True)
class Solver:
    steps: int = parameter(20, "steps", minimum=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Matcher:
    weight: float = parameter(1.0, "a weight", minimum=0.0)
    solver: Solver = group(Solver())


@dataclass(frozen=True, slots=True, kw_only=True)
class Tables:
    options: Sample = group(Sample(lstep=0.5), name="")
    first: Matcher = group(Matcher(), name="FIRST")
    second: Matcher = group(Matcher(weight=4.0, solver=Solver(steps=7)), name="SECOND")
    last: bool = parameter(True, "a switch")


def test_groups_are_flattened_under_dotted_names():
    table = {entry.name: entry for entry in declarations(Tables)}
    assert list(table)[5:] == [
        "FIRST.weight", "FIRST.solver.steps", "SECOND.weight", "SECOND.solver.steps", "last",
    ]  # fmt: skip
    assert table["lstep"].default == 0.5
    assert table["SECOND.solver.steps"].default == 7
    assert table["SECOND.solver.steps"].field == "second.solver.steps"
    made = resolve(Tables, {"SECOND.solver.steps": "9", "str": 8}, {"FIRST.weight": 0.0})
    assert made == Tables(
        options=Sample(lstep=0.5, str_=8),
        first=Matcher(weight=0.0),
        second=Matcher(weight=4.0, solver=Solver(steps=9)),
    )
    assert as_dict(made)["SECOND.solver.steps"] == 9
    assert list(as_dict(made)) == list(table)
    assert resolve(Tables) == Tables()
    with pytest.raises(ConfigError, match=r"did you mean SECOND\.solver\.steps"):
        resolve(Tables, {"SECOND.solver.step": 9})
    with pytest.raises(ConfigError, match="at least 1"):
        resolve(Tables, {"SECOND.solver.steps": 0})


def test_later_layers_win_and_names_are_native():
    made = resolve(Sample, {"lstep": "0.1", "str": 5}, {"lstep": 0.2, "on": "Yes", "way": "0.5", "reach": "2"})
    assert as_dict(made) == {"lstep": 0.2, "str": 5, "on": True, "way": "0.5", "reach": 2.0}
    assert as_dict(resolve(Sample))["reach"] is None
    assert resolve(Sample, {"reach": "auto"}).reach is None
    assert [entry.name for entry in declarations(Sample)] == ["lstep", "str", "on", "way", "reach"]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("lstp", 1, "did you mean lstep"),
        ("LSTEP", 1, "did you mean lstep"),
        ("zzzzzz", 1, "config show"),
        ("lstep", "far", "not a number"),
        ("lstep", "nan", "not a number"),
        ("lstep", 2, "between 0 and 1 m"),
        ("lstep", True, "not a number"),
        ("str", "2.5", "not a whole number"),
        ("str", 0, "at least 1"),
        ("str", "1e999", "not a whole number"),
        ("on", "maybe", "not true or false"),
        ("way", "soon", "choose one of auto, NUMBER"),
        ("way", "inf", "choose one of"),
    ],
)
def test_wrong_values_are_told(name, value, message):
    with pytest.raises(ConfigError, match=message):
        resolve(Sample, {name: value})


def test_whole_numbers_in_other_dress():
    assert resolve(Sample, {"str": "3.0"}).str_ == 3
    assert resolve(Sample, {"str": "0x10"}).str_ == 16
    assert resolve(Sample, {"str": 4.0}).str_ == 4


def test_a_run_log_keeps_each_warning_once_and_adds_up_stages():
    log = RunLog()
    for _ in range(2):
        log.warn("careful")
        log.note("by the way")
        log.counts["mended"] += 2
        with log.stage("work", 3.0):
            pass
    assert log.warnings == ["careful"]
    assert log.notes == ["by the way"]
    assert log.counts["mended"] == 4
    assert list(log.seconds) == ["work"]
    assert log.seconds["work"] >= 0
    with pytest.raises(ValueError, match="inside"), log.stage("broken"):
        raise ValueError("inside")
    assert "broken" in log.seconds
    assert 10**6 < peak_memory_bytes() < 10**12
