# SPDX-License-Identifier: MIT
"""Files of velocities."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.pipelines.velocity_script import read_velocities


def script(tmp_path, text, name="s.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "0,0.5,0,0\n2,0.1,0,1\n5,0,0,0\n",
        "\ufefftime,vx,vy,wz\n0,0.5,0,0\n2,0.1,0,1\n5,0,0,0\n",
        "# a drive\n\n  Time; VX; wz   # named\n0; 0.5; 0\n2; .1; 1\n\n5; 0; 0 # the end\n",
        "0 0.5 0 0\n2\t1e-1 0 +1\n5 0 0 0",
    ],
)
def test_times(tmp_path, text):
    found = read_velocities(script(tmp_path, text))
    assert found.times_s.tolist() == [0, 2, 5]
    assert found.end_s == 5
    np.testing.assert_array_equal(found.twists, [[0.5, 0, 0], [0.1, 0, 1], [0, 0, 0]])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("s.csv", "2,0.5,0\n3,0.1,1\n"),
        ("s.txt", "duration vx vy wz\n2 0.5 0 0\n3 0.1 0 1\n"),
        ("s.yaml", "- [2, 0.5, 0]\n- {duration: 3, vx: 0.1, wz: 1}\n"),
        ("s.YML", "- duration: 2\n  vx: 0.5\n- wz: 1\n  duration: 3\n  vx: 0.1\n  vy: 0\n"),
    ],
)
def test_durations(tmp_path, name, text):
    found = read_velocities(script(tmp_path, text, name))
    assert found.times_s.tolist() == [0, 2]
    assert found.end_s == 5
    np.testing.assert_array_equal(found.twists, [[0.5, 0, 0], [0.1, 0, 1]])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("s.csv", "", r"s\.csv: holds no velocity: write time,vx"),
        ("s.csv", "# nothing\n", "holds no velocity"),
        ("s.csv", "1,2\n", r"s\.csv:1: 2 values: write time,vx"),
        ("s.csv", "\n1,2,3,4,5\n", r"s\.csv:2: 5 values"),
        ("s.csv", "0,0,0,0\n1,0,0\n", r"s\.csv:2: times and durations in one file"),
        ("s.csv", "time,vx,wz\n0,0,0,0\n", r"s\.csv:2: 4 values for the columns time,vx,wz"),
        ("s.csv", "time,speed,turn\n", r"s\.csv:1: time,speed,turn are not the columns of velocities: time,vx"),
        ("s.csv", "0,1,0,0\n5,x,0,0\n", r"s\.csv:2: vx 'x' is not a number"),
        ("s.csv", "nan,1,0\n", r"s\.csv:1: duration nan is not finite"),
        ("s.csv", "0,inf,0,0\n", r"s\.csv:1: vx inf is not finite"),
        ("s.csv", "-1,1,0,0\n", r"s\.csv:1: time -1 s is negative"),
        ("s.csv", "3,1,0,0\n2,0,0,0\n", r"s\.csv:2: time 2 s is before that of the row above, 3 s"),
        ("s.csv", "0.001,1,0\n", r"s\.csv:1: duration 0\.001 s: give at least 0\.01 s"),
        ("s.csv", "1e7,1,0\n", r"s\.csv:1: the drive is longer than"),
        ("s.csv", "1,1e9,0\n", r"s\.csv:1: vx 1e\+09 is no velocity"),
        ("s.yaml", "a: 1\n", r"s\.yaml:1: not a list"),
        ("s.yaml", "", "holds no velocity"),
        ("s.yaml", "- [1, 0, 0]\n- 7\n", r"s\.yaml:2: neither a list nor a mapping"),
        ("s.yaml", "- [1, 0, 0]\n- [1, [0], 0]\n", r"s\.yaml:2: a list or mapping where a number belongs"),
        ("s.yaml", "- {duration: 1, vx: 1, spin: 2}\n", r"s\.yaml:1: unknown key 'spin'"),
        ("s.yaml", "- {duration: 1, time: 1}\n", r"s\.yaml:1: give each key once, and either time or duration"),
        ("s.yaml", "- {duration: 1, vx: 1, vx: 2}\n", r"s\.yaml:1: give each key once"),
        ("s.yaml", "- {duration: x}\n", r"s\.yaml:1: duration 'x' is not a number"),
        ("s.yaml", "- [1, 0, 0]\n- [1\n", r"s\.yaml:3: cannot be read as YAML"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, name, text, message):
    with pytest.raises(ConfigError, match=message):
        read_velocities(script(tmp_path, text, name))


def test_files_that_are_no_text(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.csv: no such file of velocities"):
        read_velocities(tmp_path / "none.csv")
    (tmp_path / "s.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigError, match="cannot be read as text"):
        read_velocities(tmp_path / "s.csv")
