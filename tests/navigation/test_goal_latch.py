# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from slamcli.navigation.goal_latch import GoalLatch, GoalTolerances, turn_rate
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.oscillation import Oscillation
from slamcli.navigation.plan_heading import TurnToPlan

LIMITS = GoalTolerances(
    xy_m=0.1, yaw_rad=0.1, latch=False, stopped_m_s=0.1, stopped_rad_s=0.1, acc=(2.0, 2.0, 3.0), min_vel_theta=0.3,
    max_vel_theta=1.5, period_s=0.1,
)  # fmt: skip
GOAL = np.array([0.0, 0.0, 1.0])


def test_without_latch_the_position_can_be_lost() -> None:
    latch = GoalLatch(LIMITS)
    assert latch.position_reached(np.array([0.1, 0.0, 0.0]), GOAL)
    assert not latch.position_reached(np.array([0.11, 0.0, 0.0]), GOAL)
    latched = GoalLatch(dataclasses.replace(LIMITS, latch=True))
    assert not latched.position_reached(np.array([0.11, 0.0, 0.0]), GOAL)
    assert latched.position_reached(np.array([0.05, 0.0, 0.0]), GOAL)
    assert latched.position_reached(np.array([2.0, 0.0, 0.0]), GOAL)
    latched.reset()
    assert not latched.position_reached(np.array([2.0, 0.0, 0.0]), GOAL)


def test_the_goal_is_reached_standing_and_turned() -> None:
    latch = GoalLatch(LIMITS)
    there = np.array([0.0, 0.05, 0.95])
    assert latch.goal_reached(there, GOAL, np.array([0.1, -0.1, 0.1]))
    assert not latch.goal_reached(there, GOAL, np.array([0.0, 0.11, 0.0]))
    assert not latch.goal_reached(there, GOAL, np.array([0.0, 0.0, -0.11]))
    assert not latch.goal_reached(np.array([0.0, 0.0, 0.85]), GOAL, np.zeros(3))


def test_stops_then_turns_then_rests() -> None:
    latch = GoalLatch(LIMITS)
    at = np.zeros(3)
    stopping = latch.command(at, GOAL, np.array([0.5, -0.1, -0.2]), lambda _: True)
    assert stopping == pytest.approx([0.3, 0.0, 0.0])
    turning = latch.command(at, GOAL, np.zeros(3), lambda _: True)
    assert turning == pytest.approx([0.0, 0.0, 0.3])
    # Once it turns, turning is not standing's opposite any more.
    assert latch.command(at, GOAL, turning, lambda _: True)[2] == pytest.approx(0.6)
    assert latch.command(np.array([0.0, 0.0, 0.95]), GOAL, turning, lambda _: True).tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(NoCommandError, match="turning to the goal's heading"):
        latch.command(at, GOAL, np.zeros(3), lambda _: False)
    latch.reset()
    with pytest.raises(NoCommandError, match="stopping at the goal"):
        latch.command(at, GOAL, np.array([0.5, 0.0, 0.0]), lambda _: False)


def test_turn_rates() -> None:
    assert turn_rate(3.0, 1.4, LIMITS) == 1.5
    assert turn_rate(-3.0, -1.0, LIMITS) == pytest.approx(-1.3)  # what the acceleration reaches
    assert turn_rate(0.8, 0.7, LIMITS) == pytest.approx(0.8)
    assert turn_rate(0.2, 1.5, LIMITS) == pytest.approx(math.sqrt(2.0 * 3.0 * 0.2))  # it can still be stopped
    assert turn_rate(0.01, 0.0, LIMITS) == 0.3


def test_a_change_of_sense_is_not_changed_again_at_once() -> None:
    flags = Oscillation(0.05, 0.2)
    flags.update(np.zeros(3), np.array([0.2, 0.0, 0.5]), 0.1)
    assert flags.forbidden == 0
    flags.update(np.zeros(3), np.array([-0.1, 0.0, 0.5]), 0.1)
    assert flags.forbidden == 0b000001  # not forward
    flags.update(np.array([0.01, 0.0, 0.0]), np.array([-0.1, 0.0, -0.5]), 0.1)
    assert flags.forbidden == 0b010001  # nor turning left
    flags.update(np.array([-0.05, 0.0, 0.0]), np.array([-0.1, 0.0, -0.5]), 0.1)
    assert flags.forbidden == 0  # it has moved 6 cm from where that was
    flags.update(np.zeros(3), np.array([0.0, 0.1, 0.0]), 0.1)
    flags.update(np.zeros(3), np.array([0.0, -0.1, 0.0]), 0.1)
    assert flags.forbidden == 0b000100
    flags.update(np.array([0.0, 0.0, 0.25]), np.array([0.0, -0.1, 0.0]), 0.1)
    assert flags.forbidden == 0  # it has turned


def test_turns_do_not_count_at_speed() -> None:
    flags = Oscillation(0.05, 0.2)
    for turn in (0.5, -0.5, 0.5):
        flags.update(np.zeros(3), np.array([0.3, 0.0, turn]), 0.1)
    assert flags.forbidden == 0


def test_turns_to_a_plan_with_hysteresis() -> None:
    turn = TurnToPlan(0.8, LIMITS)
    ahead = np.column_stack([np.arange(0.0, 1.0, 0.05), np.zeros(20), np.zeros(20)])
    assert turn.command(np.array([0.0, 0.0, 0.7]), np.zeros(3), ahead, 0.2) is None
    twist = turn.command(np.array([0.0, 0.0, 0.9]), np.array([0.15, 0.0, 0.0]), ahead, 0.2)
    assert twist is not None
    assert twist == pytest.approx([0.0, 0.0, -0.3])
    assert turn.command(np.array([0.0, 0.0, 0.3]), np.zeros(3), ahead, 0.2) is not None
    assert turn.command(np.array([0.0, 0.0, 0.19]), np.zeros(3), ahead, 0.2) is None
    fast = np.array([0.5, 0.0, 0.0])
    assert turn.command(np.array([0.0, 0.0, 0.9]), fast, ahead, 0.2) is None
    backwards = turn.command(np.array([0.0, 0.0, 3.0]), fast, ahead, 0.2)
    assert backwards is not None
    assert backwards[0] == pytest.approx(0.3)
    assert TurnToPlan(0.0, LIMITS).command(np.array([0.0, 0.0, 3.0]), np.zeros(3), ahead, 0.2) is None
