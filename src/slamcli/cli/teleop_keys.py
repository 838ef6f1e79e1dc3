# SPDX-License-Identifier: MIT
"""The keys of teleop_twist_keyboard, and the velocities that they mean."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

# Forward, left, turn left: what is multiplied by the speeds.
MOVES: dict[str, tuple[int, int, int]] = {
    "u": (1, 0, 1), "i": (1, 0, 0), "o": (1, 0, -1),
    "j": (0, 0, 1), "l": (0, 0, -1),
    "m": (-1, 0, -1), ",": (-1, 0, 0), ".": (-1, 0, 1),
    "U": (1, 1, 0), "I": (1, 0, 0), "O": (1, -1, 0),
    "J": (0, 1, 0), "L": (0, -1, 0),
    "M": (-1, 1, 0), "<": (-1, 0, 0), ">": (-1, -1, 0),
}  # fmt: skip
# Linear and angular speed are multiplied.
SPEEDS: dict[str, tuple[float, float]] = {
    "q": (1.1, 1.1), "z": (0.9, 0.9), "w": (1.1, 1.0), "x": (0.9, 1.0), "e": (1.0, 1.1), "c": (1.0, 0.9),
}  # fmt: skip
END = "\x03"
_FASTEST = 1e3

# What one key sends: CSI and SS3 sequences (arrows, function keys), Alt with a key, a lone escape, or a character.
_KEY = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|\x1bO[ -~]|\x1b[^\x1b]|\x1b|.", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Teleoperator:
    """What has been asked for so far; `pressed` gives what is asked for then."""

    speed: float = 0.5
    """m/s."""
    turn: float = 1.0
    """rad/s."""
    move: tuple[int, int, int] = (0, 0, 0)
    ended: bool = False

    @property
    def twist(self) -> tuple[float, float, float]:
        """Forward and leftward m/s, and rad/s."""
        forward, left, turn = self.move
        return forward * self.speed, left * self.speed, turn * self.turn

    def pressed(self, key: str) -> Teleoperator:
        """Return the state after a key: a move, a change of speed, the end, or a stop."""
        if key in MOVES:
            return replace(self, move=MOVES[key])
        if key in SPEEDS:
            linear, angular = SPEEDS[key]
            return replace(self, speed=min(self.speed * linear, _FASTEST), turn=min(self.turn * angular, _FASTEST))
        return replace(self, move=(0, 0, 0), ended=self.ended or key == END)


def keys_of(text: str) -> list[str]:
    """Return the keys that a terminal sent: an arrow is one key, though it sends three characters."""
    return _KEY.findall(text)
