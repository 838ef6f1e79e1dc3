# SPDX-License-Identifier: MIT
"""Mission files, right and wrong."""

from __future__ import annotations

import math

import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.pipelines.mission import Waypoint, read_mission, waypoints_of


def read(tmp_path, text):
    path = tmp_path / "m.yaml"
    path.write_text(text)
    return read_mission(path)


def test_a_whole_mission(tmp_path):
    mission = read(
        tmp_path,
        "start: [2.0, 8.75, 0.5]\nrepeat: 2\ntimeout: 120\nwaypoints:\n  - [-6.5, 8]\n  - {name: kitchen, pose: [24.0, 8.0, 1.5], wait: 5}\n",
    )
    first = Waypoint(name="1", x=-6.5, y=8.0)
    second = Waypoint(name="kitchen", x=24.0, y=8.0, yaw=1.5, wait_s=5.0)
    assert mission.waypoints == (first, second, first, second)
    assert mission.start == (2.0, 8.75, 0.5)
    assert mission.timeout_s == 120.0


def test_what_is_not_said_is_none(tmp_path):
    mission = read(tmp_path, "waypoints: [[1, 2]]")
    assert (mission.start, mission.timeout_s) == (None, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("waypoints: []", "waypoints: there is none"),
        ("- [1, 2]", "is a list, not a table of keys"),
        ("start: [1, 2]", "`waypoints` is missing"),
        ("waypoints: [[1, 2]]\nrepeats: 2", "did you mean"),
        ("waypoints: [[1]]", r"waypoints\[0\]: \[1\] is not \[x, y\] or \[x, y, yaw\]"),
        ("waypoints: [[1, .nan]]", r"waypoints\[0\]: nan is not a number"),
        ("waypoints: [[1, here]]", r"waypoints\[0\]: 'here' is not a number"),
        ("waypoints: [{pose: [1, 2], wait: -1}]", r"waypoints\[0\].wait: -1 is not a number between 0"),
        ("waypoints: [{name: a}]", r"waypoints\[0\]: `pose` is missing"),
        ("waypoints: [[1, 2]]\nrepeat: 1.5", "repeat: 1.5 is not a whole number"),
        ("waypoints: [[1, 2]]\nrepeat: 0", "repeat: 0 is not a number between 1"),
        ("waypoints: [[1, 2], [1, 2]]\nrepeat: 9999", "19998 goals are more than 10000"),
        ("waypoints: [[1, 2]]\ntimeout: 0", "timeout: 0 is not a number between 0.1"),
        ("waypoints: [[1, 2]\n", "cannot be read as YAML"),
        ("a: \x00", "cannot be read as YAML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    with pytest.raises(ConfigError, match=message):
        read(tmp_path, text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"no\.yaml: no such mission file"):
        read_mission(tmp_path / "no.yaml")


def test_points_of_the_command_line():
    assert waypoints_of([(1.0, 2.0), (3.0, 4.0, 0.5)]) == (
        Waypoint(name="1", x=1.0, y=2.0), Waypoint(name="2", x=3.0, y=4.0, yaw=0.5),
    )  # fmt: skip
    for wrong in ((1.0,), (math.nan, 0.0), (1.0, math.inf)):
        with pytest.raises(UsageError, match="write it as X,Y or X,Y,YAW"):
            waypoints_of([wrong])
