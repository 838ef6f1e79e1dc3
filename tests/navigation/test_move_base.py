# SPDX-License-Identifier: MIT
"""The state machine, with a planner and a controller that do as they are told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from slamcli.errors import PlanningError
from slamcli.navigation.local_planner import LocalCommand, NoCommandError
from slamcli.navigation.move_base import MoveBase, Phase
from slamcli.navigation.move_base_parameters import MoveBaseParameters, RecoveryParameters
from slamcli.navigation.recovery import MoveSlowAndClear
from slamcli.navigation.robot_state import RobotState

PERIOD_S = 0.05


class ScriptedPlanner:
    def __init__(self, fails=lambda now: False):
        self.fails, self.now, self.calls = fails, 0.0, []

    def make_plan(self, start, goal):
        self.calls.append(self.now)
        if self.fails(self.now):
            raise PlanningError("walled in")
        return np.array([start, goal])


class ScriptedController:
    def __init__(self, fails=lambda now: False, reached=lambda now: False):
        self.fails, self.reached, self.plans = fails, reached, []

    def set_plan(self, plan):
        self.plans.append(plan)

    def compute_command(self, state, costmap):
        if self.fails(state.time_s):
            raise NoCommandError("somebody in the way")
        return LocalCommand(twist=np.array([0.3, 0.0, 0.1]), trajectory=np.zeros((2, 3)), cost=1.0)

    def is_goal_reached(self, state):
        return self.reached(state.time_s)

    def reset(self):
        pass


class ScriptedRecovery:
    def __init__(self, name, cycles=1):
        self.name, self.cycles, self.left, self.begun = name, cycles, 0, []

    def begin(self, state):
        self.left = self.cycles
        self.begun.append(state.time_s)

    def step(self, state):
        self.left -= 1
        return None if self.left < 0 else np.array([0.0, 0.0, 0.4])


COSTMAP = SimpleNamespace(window=lambda: None, out_of_date=lambda time_s: ())
COSTMAPS = SimpleNamespace(local=COSTMAP, world=COSTMAP)


def state_at(now, x=0.0):
    return RobotState(
        time_s=now, pose_odom=np.array([x, 0.0, 0.0]), T_map_odom=np.array([1.0, 0.0, 0.0]), twist=np.zeros(3)
    )


def run(machine, planner, seconds, speed=0.3):
    """Step the machine until it is done; return the cycles with their times."""
    machine.set_goal(np.array([5.0, 0.0, 0.0]), state_at(0.0))
    cycles, now, x = [], 0.0, 0.0
    while now < seconds and machine.phase not in (Phase.SUCCEEDED, Phase.ABORTED):
        planner.now = now
        cycle = machine.step(state_at(now, x))
        cycles.append((now, cycle))
        x += speed * PERIOD_S * (cycle.twist[0] > 0)
        now = round(now + PERIOD_S, 6)
    return cycles


def test_a_goal_is_planned_for_once_and_driven_to():
    planner, controller = ScriptedPlanner(), ScriptedController(reached=lambda now: now >= 2.0)
    machine = MoveBase(MoveBaseParameters(), COSTMAPS, planner, controller, [])
    cycles = run(machine, planner, 10.0)
    assert machine.phase is Phase.SUCCEEDED
    assert planner.calls == [0.0]
    np.testing.assert_allclose(controller.plans[0][0], [1.0, 0.0, 0.0])  # from the pose in the map frame
    assert cycles[0][1].twist[0] == 0.3
    np.testing.assert_array_equal(cycles[-1][1].twist, 0.0)
    assert cycles[-1][0] == pytest.approx(2.0)


def test_planner_frequency_replans_on_the_way_and_a_failure_then_changes_nothing():
    planner = ScriptedPlanner(fails=lambda now: 0.9 < now < 1.1)
    controller = ScriptedController(reached=lambda now: now >= 3.02)
    machine = MoveBase(MoveBaseParameters(planner_frequency=1.0), COSTMAPS, planner, controller, [])
    cycles = run(machine, planner, 10.0)
    np.testing.assert_allclose(planner.calls, [0.0, 1.0, 2.0, 3.0])
    assert len(controller.plans) == 3
    assert all(cycle.phase is not Phase.PLANNING for _, cycle in cycles)


def test_without_a_plan_recoveries_come_in_order_after_planner_patience_and_then_it_gives_up():
    planner = ScriptedPlanner(fails=lambda now: True)
    recoveries = [ScriptedRecovery("first"), ScriptedRecovery("second", cycles=4)]
    machine = MoveBase(MoveBaseParameters(planner_patience=2.0), COSTMAPS, planner, ScriptedController(), recoveries)
    cycles = run(machine, planner, 60.0)
    begun = [(now, cycle.recovery) for now, cycle in cycles if cycle.recovery]
    assert [name for _, name in begun] == ["first", "second"]
    assert 2.0 < begun[0][0] < 2.2
    assert machine.phase is Phase.ABORTED
    assert machine.message == "failed to find a valid plan even after executing all recovery behaviours: walled in"
    turning = [now for now, cycle in cycles if cycle.twist[2] == 0.4]
    assert len(turning) == 5  # one of the first behaviour, four of the second


def test_max_planning_retries_shortens_the_wait():
    planner = ScriptedPlanner(fails=lambda now: True)
    machine = MoveBase(MoveBaseParameters(max_planning_retries=3), COSTMAPS, planner, ScriptedController(), [])
    cycles = run(machine, planner, 60.0)
    assert len(planner.calls) == 4
    assert cycles[-1][0] < 0.5
    assert machine.message == "failed to find a valid plan: walled in"


def test_a_controller_that_fails_for_less_than_its_patience_is_helped_by_new_plans():
    planner = ScriptedPlanner()
    controller = ScriptedController(fails=lambda now: 1.0 <= now < 4.0, reached=lambda now: now > 5.0)
    machine = MoveBase(MoveBaseParameters(), COSTMAPS, planner, controller, [ScriptedRecovery("first")])
    cycles = run(machine, planner, 30.0)
    assert machine.phase is Phase.SUCCEEDED
    assert not any(cycle.recovery for _, cycle in cycles)
    assert len(planner.calls) > 10
    stopped = [now for now, cycle in cycles if not cycle.twist.any() and cycle.phase is not Phase.SUCCEEDED]
    assert min(stopped) == pytest.approx(1.0)
    assert max(stopped) < 4.0


def test_a_controller_that_fails_for_longer_leads_to_recovery_and_success_begins_the_list_anew():
    planner = ScriptedPlanner()
    blocked = [(1.0, 6.1), (10.0, 15.1)]
    controller = ScriptedController(
        fails=lambda now: any(a <= now < b for a, b in blocked), reached=lambda now: now > 18.0
    )
    first, second = ScriptedRecovery("first"), ScriptedRecovery("second")
    machine = MoveBase(MoveBaseParameters(controller_patience=5.0), COSTMAPS, planner, controller, [first, second])
    run(machine, planner, 30.0)
    assert machine.phase is Phase.SUCCEEDED
    assert len(first.begun) == 2  # once for each blockade
    assert first.begun[0] == pytest.approx(6.05, abs=0.1)
    assert first.begun[1] == pytest.approx(15.05, abs=0.1)


def test_oscillation_is_noticed_by_the_way_made():
    planner, controller = ScriptedPlanner(), ScriptedController(reached=lambda now: now > 40.0)
    parameters = MoveBaseParameters(oscillation_timeout=4.0, oscillation_distance=0.5)
    machine = MoveBase(parameters, COSTMAPS, planner, controller, [ScriptedRecovery("first")])
    cycles = run(machine, planner, 60.0, speed=0.05)
    recovered = [now for now, cycle in cycles if cycle.recovery]
    assert recovered[0] == pytest.approx(4.1, abs=0.1)
    assert machine.phase is Phase.ABORTED
    assert "oscillating" in machine.message
    machine = MoveBase(parameters, COSTMAPS, planner, controller, [ScriptedRecovery("first")])
    cycles = run(machine, planner, 60.0, speed=0.3)
    assert machine.phase is Phase.SUCCEEDED
    assert not any(cycle.recovery for _, cycle in cycles)


def test_recovery_can_be_switched_off():
    planner = ScriptedPlanner(fails=lambda now: True)
    parameters = MoveBaseParameters(recovery_behavior_enabled=False, planner_patience=1.0)
    machine = MoveBase(parameters, COSTMAPS, planner, ScriptedController(), [ScriptedRecovery("first")])
    cycles = run(machine, planner, 60.0)
    assert machine.phase is Phase.ABORTED
    assert not any(cycle.recovery for _, cycle in cycles)


def test_a_cancelled_goal_stops_the_robot():
    planner = ScriptedPlanner()
    machine = MoveBase(MoveBaseParameters(), COSTMAPS, planner, ScriptedController(), [])
    machine.set_goal(np.array([5.0, 0.0, 0.0]), state_at(0.0))
    assert machine.step(state_at(0.0)).twist[0] > 0.0
    machine.cancel()
    np.testing.assert_array_equal(machine.step(state_at(0.1)).twist, 0.0)
    assert machine.phase is Phase.IDLE


def test_after_move_slow_and_clear_commands_are_scaled_for_a_stretch():
    cleared = []
    costmap = SimpleNamespace(
        window=lambda: None, out_of_date=lambda time_s: (), clear_inside=lambda *a: cleared.append(a)
    )
    costmaps = SimpleNamespace(local=costmap, world=costmap)
    slow = MoveSlowAndClear("move_slow_and_clear", costmaps, RecoveryParameters(limited_trans_speed=0.1))
    planner = ScriptedPlanner(fails=lambda now: now < 1.5)
    controller = ScriptedController(reached=lambda now: now > 8.0)
    machine = MoveBase(MoveBaseParameters(planner_patience=1.0), costmaps, planner, controller, [slow])
    cycles = run(machine, planner, 20.0)
    assert machine.phase is Phase.SUCCEEDED
    assert len(cleared) == 2
    moving = [cycle.twist for _, cycle in cycles if cycle.twist[0] > 0]
    np.testing.assert_allclose(moving[0], [0.1, 0.0, 0.1 / 3.0])
    np.testing.assert_allclose(moving[-1], [0.3, 0.0, 0.1])


def test_who_hears_nothing_from_its_sensors_stands_still():
    late = SimpleNamespace(window=lambda: None, out_of_date=lambda now: ("scan",) if 0.5 <= now < 1.0 else ())
    planner, controller = ScriptedPlanner(), ScriptedController(reached=lambda now: now >= 2.0)
    machine = MoveBase(MoveBaseParameters(), SimpleNamespace(local=late, world=late), planner, controller, [])
    cycles = run(machine, planner, 10.0)
    assert machine.phase is Phase.SUCCEEDED
    still = [now for now, cycle in cycles[:-1] if not cycle.twist.any()]
    np.testing.assert_allclose(still, np.arange(0.5, 1.0 - 1e-9, PERIOD_S))
    assert any(cycle.message == "no news from scan: the local costmap is out of date" for _, cycle in cycles)
