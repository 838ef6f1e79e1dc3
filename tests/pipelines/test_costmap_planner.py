# SPDX-License-Identifier: MIT
"""Plans to goals that the sensors show to be a hair too near to a wall."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.live_planner import LivePlanner
from slamcli.pipelines.costmap_planner import CostmapPlanner

START = np.array([0.5, 0.5, 0.0])


def costmap():
    """2 x 2 m; the cells from x = 1.5 m on are within the inscribed radius of a wall at 1.7 m."""
    costs = np.zeros((40, 40), np.uint8)
    costs[:, 30:34] = 253
    costs[:, 34:] = 254
    window = CostWindow(
        costs=costs, origin_m=(0.0, 0.0), resolution_m=0.05, frame="map", footprint=np.array([[0.1, 0.1], [-0.1, 0.1], [0.0, -0.1]]),
        inscribed_radius_m=0.2, circumscribed_radius_m=0.2,
    )  # fmt: skip
    return SimpleNamespace(window=lambda: window)


def test_a_goal_within_reach_of_a_free_place_is_planned_to():
    goal = np.array([1.56, 1.0, 0.7])
    plan = CostmapPlanner(LivePlanner(), costmap(), 0.15).make_plan(START, goal)
    np.testing.assert_array_equal(plan[-1], goal)
    assert np.hypot(*(plan[-2, :2] - goal[:2])) <= 0.15
    assert plan[:-1, 0].max() < 1.5  # what comes before keeps to free cells
    np.testing.assert_allclose(plan[0, :2], START[:2], atol=1e-9)


@pytest.mark.parametrize(("tolerance_m", "x"), [(0.15, 1.68), (0.0, 1.56), (0.15, 1.9)])
def test_beyond_the_tolerance_it_stays_without_a_plan(tolerance_m, x):
    with pytest.raises(NoPathError) as caught:
        CostmapPlanner(LivePlanner(), costmap(), tolerance_m).make_plan(START, np.array([x, 1.0, 0.0]))
    assert caught.value.status == "goal_blocked"
