# SPDX-License-Identifier: MIT
"""The exploration's state machine: a robot that sees and jumps through rooms drawn by hand, and what goes wrong on the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.navigation.exploration import Exploration, Phase
from slamcli.navigation.explore_parameters import ExploreParameters

HOME = np.array([1.5, 1.5, 0.0])
ROOMS = (
    "##################",
    "#.......#........#",
    "#.......#........#",
    "#..###..#........#",
    "#.......#........#",
    "#.......#........#",
    "#................#",
    "#.......#........#",
    "####.####........#",
    "#.......#........#",
    "#.......#........#",
    "##################",
)
WORLD = np.array([[254 if c == "#" else 0 for c in row] for row in ROOMS[::-1]], np.uint8)


def look(known, pose, reach=4.0):
    """Uncover what is in sight."""
    for angle in np.linspace(-math.pi, math.pi, 180):
        for step in np.arange(0.0, reach, 0.2):
            row, column = int(pose[1] + step * math.sin(angle)), int(pose[0] + step * math.cos(angle))
            known[row, column] = WORLD[row, column]
            if WORLD[row, column] == 254:
                break


class Robot:
    """Is at its goal at once, or drives towards it at `speed` metres per second."""

    def __init__(self, speed=math.inf, **parameters):
        self.exploration = Exploration(ExploreParameters(**{"min_frontier_size": 1.0} | parameters), HOME)
        self.known = np.full(WORLD.shape, 255, np.uint8)
        self.pose, self.time_s, self.speed, self.goals = HOME.copy(), 0.0, speed, []

    def step(self, blocked=lambda _goal: False, seeing=True):
        if seeing:
            look(self.known, self.pose)
        told = self.exploration.step(self.known, (0.0, 0.0), 1.0, self.pose, self.time_s)
        if told.is_new:
            self.goals.append(told.goal)
        if told.goal is not None:
            if blocked(told.goal):
                self.exploration.failed("no plan")
            else:
                self.drive(told.goal)
        self.time_s += 1.0
        return told

    def drive(self, goal):
        way = goal[:2] - self.pose[:2]
        far = math.hypot(*way)
        self.pose[:2] += way * min(1.0, self.speed / max(far, 1e-9))
        if far <= self.speed:
            self.exploration.reached(self.time_s)

    def run(self, limit=400, **how):
        for _ in range(limit):
            told = self.step(**how)
            if told.phase is Phase.DONE:
                return told
        raise AssertionError("never done")


@pytest.mark.parametrize("parameters", [{}, {"goal_point": "initial"}, {"gain": "visible"}, {"potential_scale": 3.0}])
def test_everything_is_seen_and_the_robot_comes_home(parameters):
    robot = Robot(speed=0.7, **parameters)
    told = robot.run()
    assert told.reason == "home again"
    assert np.array_equal(robot.known[WORLD == 0], WORLD[WORLD == 0])
    assert math.hypot(*(robot.pose[:2] - HOME[:2])) < 1e-6
    assert robot.time_s < 250.0


def test_without_return_it_ends_where_it_is():
    robot = Robot(return_home=False)
    assert robot.run().reason == "nothing is left to explore"
    assert math.hypot(*(robot.pose[:2] - HOME[:2])) > 1.0


def test_same_again():
    one, other = Robot(speed=0.7), Robot(speed=0.7)
    one.run()
    other.run()
    assert np.array(one.goals).tobytes() == np.array(other.goals).tobytes()


def test_goals_that_fail_are_not_tried_again_but_once():
    robot = Robot(blacklist_retries=1, return_home=False)
    east = lambda goal: goal[0] > 8.0  # noqa: E731
    told = robot.run(blocked=east)
    assert "cannot be reached" in told.reason
    assert robot.known[5, 14] == 255
    assert len(robot.exploration.blacklist) >= 1
    tried = [tuple(np.round(goal[:2], 3)) for goal in robot.goals if east(goal)]
    assert max(tried.count(goal) for goal in tried) <= 2


def test_a_goal_that_the_robot_does_not_come_nearer_to():
    robot = Robot(speed=0.0, progress_timeout=5.0, blacklist_retries=0, return_home=False)
    told = [robot.step() for _ in range(8)]
    first = told[0].goal
    assert [one.is_new for one in told[:5]] == [True, False, False, False, False]
    assert any("no progress for 5 s" in one.reason for one in told)
    assert np.abs(robot.exploration.blacklist[0] - first).max() == 0.0


def test_a_frontier_that_stays_although_the_robot_was_there():
    robot = Robot(visit_patience=3.0, blacklist_retries=0, return_home=False)
    look(robot.known, robot.pose)
    phases = []
    for _ in range(40):
        told = robot.step(seeing=False)  # the map never changes
        phases.append(told.phase)
        if told.phase is Phase.DONE:
            break
    assert Phase.WAITING in phases
    assert phases[-1] is Phase.DONE
    assert phases.index(Phase.DONE) - phases.index(Phase.WAITING) >= 2


def test_hysteresis_keeps_the_goal():
    costs = np.zeros((5, 12), np.uint8)
    costs[:, 0], costs[:, -1] = 255, 255

    def goals(hysteresis):
        exploration = Exploration(ExploreParameters(goal_hysteresis=hysteresis, potential_scale=1.0), HOME)
        found = []
        for k, x in enumerate((5.6, 6.4, 5.6, 6.4)):
            found.append(exploration.step(costs, (0.0, 0.0), 1.0, np.array([x, 2.5, 0.0]), float(k)).goal[0])
        return found

    assert len(set(goals(5.0))) == 1
    assert len(set(goals(0.0))) == 2


def test_a_way_home_that_fails_is_told():
    told = Robot().run(blocked=lambda goal: np.array_equal(goal, HOME))
    assert told.phase is Phase.DONE
    assert told.reason == "the way home failed: no plan"
    assert told.goal is None


def test_frontiers_are_looked_for_at_their_frequency():
    robot = Robot(speed=0.0, planner_frequency=0.5)
    robot.step()
    before = robot.exploration.step(robot.known, (0.0, 0.0), 1.0, robot.pose, 1.0).frontiers
    assert robot.exploration.step(robot.known, (0.0, 0.0), 1.0, robot.pose, 1.9).frontiers is before
    assert robot.exploration.step(robot.known, (0.0, 0.0), 1.0, robot.pose, 2.0).frontiers is not before
