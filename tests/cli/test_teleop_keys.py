# SPDX-License-Identifier: MIT
"""Keys mean what they do in teleop_twist_keyboard."""

from __future__ import annotations

import pytest

from slamcli.cli.teleop_keys import Teleoperator, keys_of

# teleop_twist_keyboard's table: x, y, th, times speed 0.5 and turn 1.0.
MOVES = {
    "i": (1, 0, 0), "o": (1, 0, -1), "j": (0, 0, 1), "l": (0, 0, -1), "u": (1, 0, 1), ",": (-1, 0, 0), ".": (-1, 0, 1),
    "m": (-1, 0, -1), "O": (1, -1, 0), "I": (1, 0, 0), "J": (0, 1, 0), "L": (0, -1, 0), "U": (1, 1, 0), "<": (-1, 0, 0),
    ">": (-1, -1, 0), "M": (-1, 1, 0),
}  # fmt: skip


@pytest.mark.parametrize("key", MOVES)
def test_moves(key):
    x, y, th = MOVES[key]
    assert Teleoperator().pressed(key).twist == (0.5 * x, 0.5 * y, 1.0 * th)


@pytest.mark.parametrize("key", ["k", "K", " ", "t", "b", "a", "Q", "\x1b", "\x1b[A", "\x1bOA", "5", "\r", "é"])
def test_everything_else_stops(key):
    moving = Teleoperator().pressed("o")
    assert moving.pressed(key).twist == (0, 0, 0)
    assert not moving.pressed(key).ended


@pytest.mark.parametrize(
    ("key", "speed", "turn"),
    [("q", 0.55, 1.1), ("z", 0.45, 0.9), ("w", 0.55, 1.0), ("x", 0.45, 1.0), ("e", 0.5, 1.1), ("c", 0.5, 0.9)],
)
def test_speeds_change_by_a_tenth_while_the_robot_goes_on(key, speed, turn):
    driver = Teleoperator().pressed("u").pressed(key)
    assert driver.twist == pytest.approx((speed, 0.0, turn))
    assert driver.pressed(",").twist == pytest.approx((-speed, 0.0, 0.0))


def test_ctrl_c_stops_and_ends():
    driver = Teleoperator().pressed("i").pressed("\x03")
    assert driver.ended
    assert driver.twist == (0, 0, 0)


def test_speeds_stay_finite():
    driver = Teleoperator().pressed("i")
    for _ in range(2000):
        driver = driver.pressed("q")
    assert driver.twist == (1000.0, 0.0, 0.0)


def test_an_arrow_is_one_key_and_not_a_strafing_one():
    assert keys_of("i\x1bOAu\x1b[1;5Dq\x1bi,\x03") == ["i", "\x1bOA", "u", "\x1b[1;5D", "q", "\x1bi", ",", "\x03"]
    assert keys_of("\x1b") == ["\x1b"]
    assert keys_of("") == []
