# SPDX-License-Identifier: MIT
"""Carts and boxes that come, stand or move, and go; how world files declare them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.simulation import World, load_world, resolve_settings
from slamcli.simulation.plant import Plant
from slamcli.simulation.world import Cart

HALL = np.array([[0.0, 0, 12, 0], [12, 0, 12, 8], [12, 8, 0, 8], [0, 8, 0, 0]])
BOX = np.array([[5.0, 2.0]])


def plant(*carts, settings=None, start=(1.0, 1.0, 0.0), seed=0):
    world = World(name="hall", segments=HALL, carts=carts)
    return Plant(world, resolve_settings({"laser.beams": 4, **(settings or {})}), start=np.array(start), seed=seed)


def test_a_box_comes_and_goes_at_its_times():
    robot = plant(Cart(BOX, (1.0, 0.6), yaw_rad=0.5, appears_s=2.0, leaves_s=5.0))
    there = []
    for _ in range(70):
        robot.advance(0.1)
        there.append(len(robot.boxes()))
    assert there == [0] * 20 + [1] * 30 + [0] * 20
    robot = plant(Cart(BOX, (1.0, 0.6), yaw_rad=0.5))
    robot.advance(0.1)
    np.testing.assert_allclose(robot.boxes(), [[5, 2, math.cos(0.5), math.sin(0.5), 0.5, 0.3, 0, 0, 0]])
    np.testing.assert_allclose(robot.discs(), [[5, 2, math.hypot(0.5, 0.3), 0, 0]])


def test_a_cart_moves_to_and_fro_at_its_speed():
    robot = plant(Cart(np.array([[4.0, 4.0], [8.0, 4.0]]), speed_m_s=1.0))
    places = []
    for _ in range(120):
        robot.advance(0.1)
        places.append(robot.discs()[0, 0])
    at = np.arange(1, 121) * 0.1
    expected = 4.0 + 4.0 - np.abs(4.0 - at % 8.0)
    np.testing.assert_allclose(places, expected, atol=0.06)
    assert robot.boxes()[0, 2] == pytest.approx(1.0)


def test_nothing_appears_on_the_robot():
    robot = plant(Cart(np.array([[1.5, 1.0]]), (0.6, 0.6), appears_s=1.0))
    robot.advance(3.0)
    assert len(robot.boxes()) == 0
    robot.teleport(np.array([6.0, 6.0, 0.0]))
    robot.advance(0.1)
    assert len(robot.boxes()) == 1


def test_carts_that_nobody_declared_come_stay_and_go():
    robot = plant(settings={"carts.count": 4, "carts.stay": 10.0, "carts.away": 10.0}, seed=3)
    counts, changes, before = [], 0, 0
    for _ in range(1200):
        robot.advance(0.5)
        boxes = robot.boxes()
        counts.append(len(boxes))
        changes += len(boxes) != before
        before = len(boxes)
        if len(boxes):
            assert (boxes[:, :2] > 0.45).all()
            assert (boxes[:, 0] < 11.55).all()
            assert np.hypot(*(boxes[:, :2] - robot.pose[:2]).T).min() > 0.5
    assert 1.3 < np.mean(counts) < 2.7
    assert changes > 100
    assert robot.collisions == ()


def test_people_walk_around_carts():
    carts = [Cart(np.array([[6.0, y]]), (0.5, 1.0)) for y in (1.0, 3.0, 5.0)]
    robot = plant(*carts, settings={"people.count": 8}, seed=1)
    least = math.inf
    for _ in range(1200):
        robot.advance(0.1)
        boxes = robot.boxes()
        people, boxes = boxes[:8, :2], boxes[8:]
        for box in boxes:
            apart = np.maximum(np.abs(people - box[:2]) - box[4:6], 0.0)
            least = min(least, np.hypot(*apart.T).min())
    assert least > 0.15


def test_the_robot_is_stopped_by_a_cart():
    robot = plant(Cart(np.array([[4.0, 1.0]]), (0.6, 0.6)))
    for _ in range(60):
        robot.command(np.array([0.6, 0.0, 0.0]))
        robot.advance(0.1)
    assert robot.pose[0] == pytest.approx(4.0 - 0.3 - 0.25, abs=0.01)
    assert [(c.kind, c.by_robot) for c in robot.collisions] == [("cart", True)]


def load(tmp_path, text):
    path = tmp_path / "w.yaml"
    path.write_text("rooms: [[0, 0, 5, 5]]\n" + text)
    return load_world(path)


def test_world_files_declare_carts(tmp_path):
    world = load(
        tmp_path,
        "obstacles:\n- {at: [1, 2], size: [1, 0.5], yaw: 90, appears: 3, leaves: 9}\n"
        "- {points: [[1, 1], [4, 1]], radius: 0.3, speed: 0.7}\ncarts: {count: 2}\n",
    )
    box, disc = world.carts
    assert (box.size_m, box.appears_s, box.leaves_s, box.yaw_rad) == ((1.0, 0.5), 3.0, 9.0, math.pi / 2)
    assert (disc.radius_m, disc.size_m, disc.speed_m_s, disc.leaves_s) == (0.3, (0.0, 0.0), 0.7, math.inf)
    np.testing.assert_array_equal(disc.points, [[1, 1], [4, 1]])
    assert world.settings == {"carts.count": 2}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{at: [1, 1]}", r"obstacles\[0\]: give `at` .* and `size` or `radius`"),
        ("{size: [1, 1]}", r"obstacles\[0\]: give `at`"),
        ("{at: [1, 1], points: [[1, 1], [2, 2]], radius: 1}", "give `at`"),
        ("{at: [1, 1], size: [0, 1]}", r"obstacles\[0\].size: \[0.0, 1.0\] is not two lengths above 0"),
        ("{at: [1, 1], radius: 0.1, appears: 5, leaves: 4}", "it leaves at 4 s, not after it appears at 5 s"),
        ("{at: [1, 1], radius: .nan}", r"obstacles\[0\].radius"),
        ("{at: [1, 1], radius: 1, sped: 1}", "sped"),
    ],
)
def test_mistakes_in_obstacles_are_named(tmp_path, entry, message):
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, f"obstacles:\n- {entry}\n")
