# SPDX-License-Identifier: MIT
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.parameters import parameter
from slamcli.pipelines import config
from slamcli.pipelines.config import load_native
from slamcli.pipelines.config_show import show
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    particles: int = parameter(30, "Number of particles.", minimum=1)
    str_: float = parameter(0.1, "Noise.", name="str", unit="m")
    base_frame: str = parameter("base_link", "Frame.")
    tf_delay: float = parameter(0.05, "Only for a live system.", effective=False)


@pytest.fixture(autouse=True)
def tier(monkeypatch):
    monkeypatch.setattr(config, "find_tier", lambda _: SimpleNamespace(parameters=Parameters))


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_files_win_over_defaults_later_files_over_earlier_and_the_command_line_over_all(tmp_path):
    launch = write(
        tmp_path / "a.launch",
        '<launch><arg name="n" default="40"/><node pkg="gmapping" type="slam_gmapping" name="g">\n'
        '<param name="particles" value="$(arg n)"/><param name="str" value="0.3"/><remap from="scan" to="/laser"/>\n'
        '<param name="tf_delay" value="0.1"/></node></launch>',
    )
    yaml = write(tmp_path / "b.yaml", "slam_gmapping:\n  str: 0.4\n  base_frame: base\n")
    log = RunLog()
    loaded = load_native("gmapping", [launch, yaml], ["base_frame=base_footprint"], log, {"n": "50"})
    assert loaded.parameters == Parameters(particles=50, str_=0.4, base_frame="base_footprint", tf_delay=0.1)
    assert loaded.sources == {
        "particles": f"{launch}:2",
        "str": f"{yaml}:2",
        "base_frame": "--set",
        "tf_delay": f"{launch}:3",
    }
    assert loaded.topics("scans") == ("/laser",)
    assert log.notes == [f"tf_delay ({launch}:3) has no effect here: Only for a live system."]
    rows = {row.declaration.name: row for row in show("gmapping", sets=["particles=30"]).parameters}
    assert (rows["particles"].source, rows["particles"].changed) == ("--set", False)
    assert (rows["str"].source, rows["str"].value) == ("default", 0.1)


@pytest.mark.parametrize(
    ("name", "text", "sets", "message"),
    [
        ("a.yaml", "partikles: 3\n", [], r"unknown parameter 'partikles' in .*a\.yaml:1; did you mean particles\?"),
        ("a.yaml", "x: 1\nparticles: many\n", [], r"unknown parameter 'x'"),
        ("a.yaml", "particles: many\n", [], r"a\.yaml:1: particles='many': not a whole number"),
        ("a.yaml", "particles: 0\n", [], r"a\.yaml:1: particles=0: must be at least 1"),
        ("a.yaml", "", ["particles"], "write KEY=VALUE"),
        ("a.yaml", "", ["str=nan"], "--set: str='nan': not a number"),
        (
            "a.launch",
            '<launch><node pkg="p" type="t" name="n"/></launch>',
            [],
            r"starts no node of gmapping \(nodes: p/t\)",
        ),
        ("a.lua", "", [], "reads launch files"),
    ],
)
def test_errors_have_a_place(tmp_path, name, text, sets, message):
    with pytest.raises(ConfigError, match=message):
        load_native("gmapping", [write(tmp_path / name, text)], sets)


def test_the_planners_parameters_under_all_their_spellings(tmp_path):
    first = write(
        tmp_path / "a.yaml", "global_costmap:\n  robot_radius: 0.2\n  inflation_layer: {inflation_radius: 0.4}\n"
    )
    rows = {row.declaration.name: row for row in show("plan", [first], ["inflation_radius=0.7"]).parameters}
    assert (rows["robot_radius"].value, rows["robot_radius"].source) == (0.2, f"{first}:2")
    assert (rows["inflation_layer.inflation_radius"].value, rows["inflation_layer.inflation_radius"].source) == (
        0.7,
        "--set",
    )
    assert (rows["default_tolerance"].value, rows["default_tolerance"].source) == (0.0, "default")


def test_the_simulations_parameters():
    rows = {row.declaration.name: row for row in show("simulation", sets=["laser.beams=90"]).parameters}
    assert (rows["laser.beams"].value, rows["laser.beams"].source, rows["laser.beams"].changed) == (90, "--set", True)
    with pytest.raises(UsageError, match="world file"):
        show("simulation", [Path("x.yaml")])
