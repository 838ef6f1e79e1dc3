# SPDX-License-Identifier: MIT
"""What is written down when a simulated robot touches something."""

from __future__ import annotations

from dataclasses import dataclass

AT_FAULT_FROM_M_S = 0.1
"""A robot that moves faster than this towards what it touches has caused the contact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One contact, from its first moment until both are 5 cm apart again."""

    time_s: float
    x_m: float
    """Where base_link was, map frame."""
    y_m: float
    kind: str
    """wall, person or cart."""
    speed_m_s: float
    """Of the robot when it touched."""
    approach_m_s: float
    """How fast the robot's own motion closed the gap; at walls the speed of its fastest corner."""

    @property
    def by_robot(self) -> bool:
        """Whether the robot ran into it: walls never move, and who walks into a robot that stands has only themselves to blame."""
        return self.kind == "wall" or self.approach_m_s > AT_FAULT_FROM_M_S
