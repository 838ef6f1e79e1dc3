# SPDX-License-Identifier: MIT
"""The figures of a run, by hand."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from slamcli.evaluation.drive_story import DriveStory, GoalStory


def goal(**changes) -> GoalStory:
    values = dict(
        name="1", goal=(3.0, 0.0, math.nan), status="succeeded", message="goal reached", begin_s=1.0, end_s=4.5, length_m=3.3,
        optimum_m=3.0, clearance_m=0.4, collisions=0, caused=0, recoveries=(), plans=2,
    )  # fmt: skip
    return GoalStory(**{**values, **changes})


def story(**changes) -> DriveStory:
    values = dict(
        grid=None, times_s=np.array([0.0, 1.0, 2.0, 3.0]),
        truth=np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, np.pi / 2], [1, 3, np.pi / 2]]),
        estimate=np.array([[np.nan] * 3, [1.0, 0.3, 0.1], [1.4, 2, np.pi / 2], [1, 3, np.pi / 2]]),
        twists=np.array([[0.0, 0, 0], [0.3, 0.4, 0], [0.2, 0, 1.0], [0, 0, 0]]), command_times_s=np.zeros(0), commands=np.zeros((0, 3)),
        plans=(np.zeros((2, 3)),), people_times_s=np.zeros(0), people=(), events=(), goals=(goal(),),
    )  # fmt: skip
    return DriveStory(**{**values, **changes})


def test_length_duration_and_errors():
    told = story()
    assert told.length_m == 4.0
    assert told.duration_s == 3.0
    position, heading = told.errors()
    np.testing.assert_allclose(position, [np.nan, 0.3, 0.4, 0.0], atol=1e-12)
    np.testing.assert_allclose(heading, [np.nan, 0.1, 0.0, 0.0], atol=1e-12)
    assert told.place_at(1.5).tolist() == [1.0, 1.0]
    assert told.place_at(99.0).tolist() == [1.0, 3.0]


def test_figures_sum_up_goals_and_are_json():
    failed = goal(
        status="aborted", length_m=9.0, optimum_m=1.0, clearance_m=0.1, collisions=2, caused=1, recoveries=("a", "b")
    )
    unknown = goal(optimum_m=math.nan, clearance_m=math.inf)
    figures = story(goals=(goal(), failed, unknown)).figures()
    assert (figures["goals"], figures["reached"]) == (3, 2)
    assert figures["ratio"] == pytest.approx(1.1)  # of goals that were reached, where the optimum is known
    assert figures["clearance_m"] == 0.1
    assert (figures["collisions"], figures["collisions_caused"], figures["recoveries"], figures["plans"]) == (
        2,
        1,
        2,
        1,
    )
    assert figures["localisation_rmse_m"] == pytest.approx(math.sqrt((0.09 + 0.16) / 3))
    assert figures["localisation_max_m"] == pytest.approx(0.4)
    assert figures["top_speed_m_s"] == pytest.approx(0.5)
    assert figures["by_goal"][0]["time_s"] == 3.5
    assert figures["by_goal"][2]["optimum_m"] is None
    json.dumps(figures, allow_nan=False)


def test_a_run_in_which_nothing_happened_has_figures_too():
    none = np.zeros((0, 3))
    figures = story(times_s=np.zeros(0), truth=none, estimate=none, twists=none, plans=(), goals=()).figures()
    assert (figures["goals"], figures["path_length_m"], figures["ratio"], figures["localisation_rmse_m"]) == (
        0,
        0.0,
        None,
        None,
    )
    json.dumps(figures, allow_nan=False)


def test_a_goal_where_the_robot_stands_has_no_ratio():
    assert math.isnan(goal(optimum_m=0.0).ratio)


def test_a_goal_that_was_not_reached_has_no_ratio():
    assert math.isnan(goal(status="timeout").ratio)


def test_ways_of_people_end_where_their_number_changes_or_one_jumps():
    def at(*places):
        return np.array([[x, y, 0.3, 0, 0] for x, y in places]).reshape(-1, 5)

    people = (at((0, 0), (5, 5)), at((0.1, 0), (5.1, 5)), at((0.2, 0), (9.0, 5)), at((0.3, 0)), at((0.4, 0)))
    ways = story(people=people).people_ways()
    assert [way[:, 0].tolist() for way in ways] == [[0, 0.1, 0.2], [5, 5.1], [0.3, 0.4]]
