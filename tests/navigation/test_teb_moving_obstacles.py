# SPDX-License-Identifier: MIT
"""Moving obstacles found in costmaps."""

from __future__ import annotations

import numpy as np
import pytest
from elastic_loop import Loop, window_of

from slamcli.navigation.footprint import padded_polygon
from slamcli.navigation.teb import TebParameters, TebPlanner
from slamcli.navigation.teb.moving_obstacles import PLUGIN, MovingObstacles
from slamcli.parameters import resolve

ROUND = padded_polygon((), 0.18, 0.0)
RESOLUTION_M = 0.05


def window(discs, corner=(0, 0)):
    """80 x 80 cells whose lower left one is `corner`, with a wall along y = 3.5 m and discs x, y, radius."""
    rows, columns = np.mgrid[0:80, 0:80]
    x, y = (columns + corner[0] + 0.5) * RESOLUTION_M, (rows + corner[1] + 0.5) * RESOLUTION_M
    costs = np.where(np.abs(y - 3.5) < 0.05, 254, 0).astype(np.uint8)
    for cx, cy, radius in discs:
        costs[np.hypot(x - cx, y - cy) < radius] = 254
    return window_of(costs, RESOLUTION_M, ROUND, (corner[0] * RESOLUTION_M, corner[1] * RESOLUTION_M))


def test_a_walker_is_followed_and_a_box_stands():
    watch = MovingObstacles()
    for k in range(61):  # 3 s at 20 Hz, the costmap new every fourth time, and moving along with the robot
        time_s = 0.2 * (k // 4)
        seen = window([(0.8 + 0.5 * time_s, 2.0 - 0.2 * time_s, 0.25), (2.5, 1.0, 0.2)], (k // 8, 0))
        moving = watch.observe(seen, 0.05 * k)
    assert moving.shape == (1, 5)
    assert moving[0, :2] == pytest.approx([0.8 + 0.5 * 3.0, 2.0 - 0.2 * 3.0], abs=0.06)
    assert moving[0, 2] == pytest.approx(0.25, abs=0.03)
    assert moving[0, 3:] == pytest.approx([0.5, -0.2], abs=0.05)
    # between costmaps it goes on; when it has been gone for a second it is forgotten
    later = watch.observe(seen, 3.1)
    assert later[0, :2] == pytest.approx(moving[0, :2] + 0.1 * moving[0, 3:])
    assert watch.observe(window([(2.5, 1.0, 0.2)]), 4.5).shape == (0, 5)


def test_one_who_stops_is_no_longer_moving():
    watch = MovingObstacles()
    for k in range(16):
        watch.observe(window([(0.8 + 0.1 * k, 2.0, 0.25)]), 0.2 * k)
    assert len(watch.observe(window([(2.3, 2.0, 0.25)]), 3.0)) == 1
    for k in range(16, 30):
        moving = watch.observe(window([(2.3, 2.0 + 1e-3 * k, 0.25)]), 0.2 * k)
        watch.observe(window([(2.3, 2.05, 0.25)]), 0.2 * k + 0.1)
    assert len(moving) == 0


def test_a_person_who_comes_along_is_seen_and_passed():
    occupied = np.zeros((80, 160), bool)
    occupied[:2], occupied[-2:], occupied[:, :2], occupied[:, -2:] = True, True, True, True

    def people(time_s, _):
        return np.array([[7.0 - 0.5 * time_s, 2.1, 0.25, -0.5, 0.0]])

    p = resolve(TebParameters, {"costmap_converter_plugin": PLUGIN, "max_vel_theta": 1.0, "acc_lim_theta": 2.0})
    outcome = Loop(occupied, side_m=6.0).drive(
        TebPlanner(p), (1.0, 2.0, 0.0), (7.0, 2.0, 0.0), people=people, limit_s=60.0
    )
    assert outcome.reached
    assert not outcome.hit_person
