# SPDX-License-Identifier: MIT
"""The page of a run."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from slamcli.evaluation.drive_story import DriveStory, Event, GoalStory
from slamcli.grids import OccupancyGrid
from slamcli.reports.drive_map import drive_map
from slamcli.reports.drive_report import drive_report


def goal(**changes) -> GoalStory:
    values = dict(
        name="<kitchen>", goal=(3.0, 0.0, 1.0), status="succeeded", message="", begin_s=0.0, end_s=4.0, length_m=3.3,
        optimum_m=3.0, clearance_m=0.4, collisions=0, caused=0, recoveries=(), plans=1,
    )  # fmt: skip
    return GoalStory(**{**values, **changes})


def story(**changes) -> DriveStory:
    times = np.arange(40) * 0.1
    truth = np.column_stack([times, np.sin(times), np.cos(times)])
    values = dict(
        grid=OccupancyGrid(np.zeros((200, 300), np.int8), 0.05, (-2.0, -3.0, 0.0)), times_s=times, truth=truth,
        estimate=truth + 0.03, twists=np.full((40, 3), 0.5), command_times_s=times, commands=np.full((40, 3), 0.4),
        plans=(truth[::4], truth[1::4]), people_times_s=times, people=tuple(np.array([[t, 2.0, 0.3, 1, 0]]) for t in times),
        events=(Event(time_s=1.0, kind="recovery", message="rotate_recovery"), Event(time_s=2.0, kind="collision", message="wall <A>")),
        goals=(goal(), goal(name="2", status="aborted", message="no plan", optimum_m=math.nan, recoveries=("rotate_recovery",))),
    )  # fmt: skip
    return DriveStory(**{**values, **changes})


def page(**changes) -> str:
    run = {"slamcli": "0.1.0", "seed": 4, "timing": {"total_s": 1.0, "realtime_factor": 40.0}, "notes": ["took it"]}
    return drive_report(run, story(**changes), title="office <1>")


def test_the_page_says_how_it_went():
    text = page()
    for words in (
        "1 of 2",
        "goals reached",
        "1.10 ×",
        "0.40 m",
        "40.0 ×",
        "aborted: no plan",
        "rotate recovery",
        "took it",
    ):
        assert words in text
    assert "office &lt;1&gt;" in text
    assert "<kitchen>" not in text
    assert "wall <A>" not in text
    assert text == page()


def test_every_way_is_a_layer_that_can_be_switched():
    drawing = drive_map(story())
    for label in (
        "map",
        "people",
        "plans (2)",
        "where it was",
        "where it thought it was",
        "recoveries (1)",
        "collisions (1)",
        "goals",
    ):
        assert f"{label}</label>" in drawing
    assert drawing.count('class="missed"') == 1
    svg = drawing[drawing.index('<svg class="graph"') : drawing.rindex("</svg>") + 6]
    ET.fromstring(svg)  # noqa: S314 - our own


@pytest.mark.parametrize("grid", [None, OccupancyGrid(np.zeros((4, 4), np.int8), 0.05, (500.0, 500.0, 0.0))])
def test_a_way_without_a_map_below_it_is_drawn_all_the_same(grid):
    assert 'class="driven"' in drive_map(story(grid=grid))


def test_a_robot_that_never_set_out_has_a_page():
    none = np.zeros((0, 3))
    text = page(times_s=np.zeros(0), truth=none, estimate=none, twists=none, command_times_s=np.zeros(0), commands=none,
                plans=(), people=(), people_times_s=np.zeros(0), events=(),
                goals=(goal(status="unreachable", message="the goal lies in a wall"),))  # fmt: skip
    assert "unreachable: the goal lies in a wall" in text
    assert "Localisation" not in text


def test_many_events_are_cut():
    events = tuple(Event(time_s=float(i), kind="planning", message="") for i in range(300))
    assert "and 180 more" in page(events=events)
