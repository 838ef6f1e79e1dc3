# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.geometry import se2
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.plan_window import PlanWindow, between_cusps
from slamcli.navigation.robot_state import RobotState


def window(cells: int = 80) -> CostWindow:
    return CostWindow(
        costs=np.zeros((cells, cells), dtype=np.uint8),
        origin_m=(-2.0, -2.0),
        resolution_m=0.05,
        frame="odom",
        footprint=np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]]),
        inscribed_radius_m=0.1,
        circumscribed_radius_m=0.1414,
    )


def at(x: float, y: float, yaw: float = 0.0, correction: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> RobotState:
    T_map_odom = np.array(correction)
    return RobotState(
        time_s=0.0,
        pose_odom=se2.between(T_map_odom, np.array([x, y, yaw])),
        T_map_odom=T_map_odom,
        twist=np.zeros(3),
    )


LINE = np.column_stack([np.linspace(0.0, 5.0, 51), np.zeros(51), np.zeros(51)])


def test_begins_at_the_robot_and_ends_at_the_reach_of_the_costmap() -> None:
    plans = PlanWindow()
    assert plans.set_plan(LINE)
    assert not plans.set_plan(LINE)
    plan = plans.cut(at(1.0, 0.2), window())
    assert plan.poses[0] == pytest.approx([1.0, 0.0, 0.0])
    assert 2.9 < plan.poses[-1, 0] <= 1.0 + np.sqrt(2.0**2 - 0.2**2) + 1e-9
    assert plan.goal == pytest.approx([5.0, 0.0, 0.0])
    assert not plan.reaches_goal
    assert plan.distance_m == pytest.approx(0.2)
    assert plan.remaining_m == pytest.approx(4.0)
    end = plans.cut(at(4.0, 0.0), window())
    assert end.reaches_goal
    assert end.poses[-1] == pytest.approx([5.0, 0.0, 0.0])


def test_sparse_plans_get_poses_between() -> None:
    plans = PlanWindow()
    plans.set_plan(np.array([[0.0, 0.0, 3.0], [1.0, 0.0, -3.0]]))
    poses = plans.cut(at(0.0, 0.0), window()).poses
    assert len(poses) == 21
    assert np.abs(np.diff(poses[:, 0])).max() < 0.0501
    assert poses[10, 2] == pytest.approx(np.pi)


def test_the_window_is_in_odom() -> None:
    plans = PlanWindow()
    plans.set_plan(LINE)
    correction = (3.0, -2.0, 0.7)
    plan = plans.cut(at(1.0, 0.0, correction=correction), window())
    back = se2.compose(np.array(correction), plan.poses)
    np.testing.assert_allclose(back[:, 1], 0.0, atol=1e-12)
    assert back[0, 0] == pytest.approx(1.0)


def hairpin() -> np.ndarray:
    """Out along y = 0 and back along y = 0.6, as round a thin wall."""
    out = np.column_stack([np.arange(0.0, 6.0, 0.05), np.zeros(120)])
    back = np.column_stack([np.arange(6.0, 0.0, -0.05), np.full(120, 0.6)])
    points = np.vstack([out, back])
    return np.column_stack([points, np.zeros(len(points))])


def test_progress_tells_ways_apart_that_lie_side_by_side() -> None:
    literal, tracking = PlanWindow(follow_progress=False), PlanWindow()
    for plans in (literal, tracking):
        plans.set_plan(hairpin())
        for x in np.arange(0.0, 6.0, 0.1):
            plans.cut(at(x, 0.0), window())
        for x in np.arange(6.0, 3.0, -0.1):
            last = plans.cut(at(x, 0.6), window())
        if plans is tracking:
            assert last.poses[0] == pytest.approx([3.1, 0.6, 0.0], abs=0.051)
            assert last.poses[-1, 0] < 1.2
        else:  # base_local_planner's weakness: the way out again
            assert last.poses[0, 1] == 0.0
            assert last.poses[0, 0] < 1.3


def test_prune_drops_for_good_what_is_more_than_a_metre_away() -> None:
    plans = PlanWindow(follow_progress=False, prune=True)
    plans.set_plan(LINE)
    assert plans.cut(at(2.5, 0.0), window()).poses[0, 0] == pytest.approx(1.55, abs=0.051)
    assert plans.cut(at(1.0, 0.0), window()).poses[0, 0] == pytest.approx(1.55, abs=0.051)
    unpruned = PlanWindow(follow_progress=False)
    unpruned.set_plan(LINE)
    assert unpruned.cut(at(2.5, 0.0), window()).poses[0, 0] == pytest.approx(0.5, abs=0.051)


def test_some_of_the_plan_behind_can_stay() -> None:
    plans = PlanWindow(keep_behind_m=0.5)
    plans.set_plan(LINE)
    assert plans.cut(at(2.0, 0.0), window()).poses[0, 0] == pytest.approx(1.5)


def test_finds_the_plan_again_after_the_robot_was_carried() -> None:
    plans = PlanWindow()
    plans.set_plan(LINE)
    plans.cut(at(0.0, 0.0), window())
    assert plans.cut(at(4.0, 0.1), window()).poses[0, 0] == pytest.approx(4.0)


@pytest.mark.parametrize("follow", [True, False])
def test_a_plan_out_of_reach_is_no_plan(follow: bool) -> None:
    plans = PlanWindow(follow_progress=follow)
    with pytest.raises(NoCommandError, match="no global plan"):
        plans.cut(at(0.0, 0.0), window())
    plans.set_plan(LINE)
    with pytest.raises(NoCommandError, match=r"3.00 m away .* \(2.00 m\)"):
        plans.cut(at(0.0, 3.0), window())


def test_bad_plans_are_refused() -> None:
    plans = PlanWindow()
    for bad in (np.empty((0, 3)), np.zeros((2, 2)), np.array([[0.0, np.nan, 0.0]])):
        with pytest.raises(DataError, match="finite poses"):
            plans.set_plan(bad)
    plans.set_plan(np.zeros((1, 3)))
    assert plans.cut(at(0.0, 0.0), window()).reaches_goal
    plans.clear()
    assert not plans.has_plan


def there_and_back() -> np.ndarray:
    """Forward 1 m along x, then in reverse 0.6 m."""
    x = np.concatenate([np.linspace(0.0, 1.0, 21), np.linspace(0.95, 0.4, 12)])
    return np.column_stack([x, np.zeros(33), np.zeros(33)])


def test_plans_are_cut_where_they_turn_back() -> None:
    pieces = between_cusps(there_and_back())
    assert [len(piece) for piece in pieces] == [21, 13]
    assert pieces[0][-1] == pytest.approx([1.0, 0.0, 0.0])
    assert pieces[1][0] == pytest.approx([1.0, 0.0, 0.0])
    assert pieces[1][-1] == pytest.approx([0.4, 0.0, 0.0])
    assert len(between_cusps(LINE)) == 1
    assert len(between_cusps(LINE[:1])) == 1
    doubled = np.repeat(there_and_back(), 2, axis=0)
    assert [len(piece) for piece in between_cusps(doubled)] == [21, 13]


def test_the_way_back_is_shown_only_from_the_cusp_on() -> None:
    plans = PlanWindow(stop_at_cusps=True)
    plans.set_plan(there_and_back())
    before = plans.cut(at(0.6, 0.02), window())
    assert before.to_end
    assert not before.reaches_goal
    assert before.poses[-1, 0] == pytest.approx(1.0)
    assert before.remaining_m == pytest.approx(0.4)
    assert before.goal[0] == pytest.approx(0.4)
    after = plans.cut(at(0.97, 0.02), window())
    assert after.reaches_goal
    assert after.poses[-1, 0] == pytest.approx(0.4)
    # It does not go back to the stretch before, which lies in the same place.
    assert plans.cut(at(0.6, 0.0), window()).reaches_goal
    assert not plans.set_plan(there_and_back())
    assert not plans.cut(at(0.6, 0.0), window()).reaches_goal
