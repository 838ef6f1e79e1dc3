# SPDX-License-Identifier: MIT
"""People among scan points: gathering, following, and slowing down for them."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.navigation.collision_monitor import CollisionMonitor, CollisionMonitorParameters
from slamcli.navigation.moving_obstacles import MovingObstacles, follow, gather

HERE = np.zeros(3)


def person(x, y):
    """Two legs, a few points each."""
    return np.array([[x + dx, y + side] for side in (-0.11, 0.11) for dx in (-0.03, 0.0, 0.03)])


def standing(*centres, velocity=(0.0, 0.0)):
    count = len(centres)
    return MovingObstacles(
        0.0, np.array(centres, dtype=float), np.tile(np.array(velocity), (count, 1)), np.full(count, 0.15), np.zeros(count)
    )  # fmt: skip


def test_legs_are_one_thing_and_a_cupboard_is_none():
    cupboard = np.column_stack([np.linspace(3.0, 4.2, 60), np.full(60, 2.0)])
    centres, radii = gather(np.concatenate([person(1.0, 0.0), cupboard, person(2.0, -1.5)]))
    np.testing.assert_allclose(centres, [[1.0, 0.0], [2.0, -1.5]], atol=1e-9)
    np.testing.assert_allclose(radii, np.hypot(0.03, 0.11))
    assert gather(np.zeros((0, 2)))[0].shape == (0, 2)


def test_a_person_around_the_first_beam_is_not_cut_in_two():
    legs = person(1.0, 0.0)
    centres, _ = gather(np.concatenate([legs[3:], person(-2.0, 0.0), legs[:3]]))
    np.testing.assert_allclose(np.sort(centres[:, 0]), [-2.0, 1.0], atol=1e-9)


def test_velocities_settle_on_the_true_ones_and_the_lost_are_forgotten():
    around = MovingObstacles.none()
    for k in range(30):
        now = 0.1 * k
        around = follow(around, np.concatenate([person(1.0, -2.0 + 0.9 * now), person(-2.0 - 0.5 * now, 1.0)]), now)
    assert len(around.centres) == 2
    np.testing.assert_allclose(around.velocities, [[0.0, 0.9], [-0.5, 0.0]], atol=0.03)
    np.testing.assert_allclose(around.centres, [[1.0, -2.0 + 0.9 * 2.9], [-2.0 - 0.5 * 2.9, 1.0]], atol=0.02)
    for k in range(30, 35):
        around = follow(around, np.zeros((0, 2)), 0.1 * k)
    assert len(around.centres) == 2  # hidden for a moment
    assert len(follow(around, np.zeros((0, 2)), 3.6).centres) == 0


def closest(twist, around, seconds=3.0):
    """Return the least distance to anything when both go on, in tiny steps."""
    x = y = yaw = 0.0
    least = np.inf
    for k in range(int(seconds / 0.001)):
        theirs = around.centres + around.velocities * 0.001 * k
        least = min(least, float(np.hypot(*(theirs - [x, y]).T).min()))
        yaw += twist[2] * 0.001
        x += twist[0] * np.cos(yaw) * 0.001
        y += twist[0] * np.sin(yaw) * 0.001
    return least


@pytest.mark.parametrize("turn", [0.0, 0.6, -0.9])
@pytest.mark.parametrize("seed", range(5))
def test_within_its_horizon_nobody_is_approached_too_much(turn, seed):
    rng = np.random.default_rng(seed)
    monitor = CollisionMonitor(CollisionMonitorParameters(time_before_collision=3.0), 0.2)
    for _ in range(20):
        spot, velocity = rng.uniform(-2.0, 2.0, 2), rng.uniform(-0.9, 0.9, 2)
        if np.hypot(*spot) < 0.6:
            continue
        around = standing(spot, velocity=velocity)
        twist = monitor.limit(np.array([0.5, 0.0, turn]), HERE, around)
        if twist[0] > 0.0:
            assert closest(twist, around) >= 0.55 - 0.05  # between the steps of 0.1 s


def test_it_slows_down_first_and_stops_before_somebody_close():
    monitor = CollisionMonitor(CollisionMonitorParameters(), 0.2)
    wanted = np.array([0.5, 0.0, 0.0])
    far, near, close = (monitor.limit(wanted, HERE, standing((x, 0.0))) for x in (2.0, 1.0, 0.6))
    np.testing.assert_array_equal(far, wanted)
    assert 0.1 < near[0] < 0.5
    np.testing.assert_array_equal(close, 0.0)


def test_moving_away_and_turning_in_place_are_always_allowed():
    monitor = CollisionMonitor(CollisionMonitorParameters(), 0.2)
    behind = standing((-0.45, 0.0))
    np.testing.assert_array_equal(monitor.limit(np.array([0.5, 0.0, 0.0]), HERE, behind), [0.5, 0.0, 0.0])
    turn = np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(monitor.limit(turn, HERE, standing((0.4, 0.0))), turn)
    off = CollisionMonitor(CollisionMonitorParameters(enabled=False), 0.2)
    np.testing.assert_array_equal(off.limit(np.array([0.5, 0.0, 0.0]), HERE, standing((0.6, 0.0))), [0.5, 0.0, 0.0])
