# SPDX-License-Identifier: MIT
"""Edges of the graph."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3


class LinkKind(IntEnum):
    """Where an edge is from; the numbers are those of RTAB-Map's databases."""

    NEIGHBOR = 0
    """Odometry between two nodes that follow each other."""
    GLOBAL_CLOSURE = 1
    """A place known again by its looks."""
    LOCAL_SPACE_CLOSURE = 2
    """A place known again because it is near (proximity in space)."""
    LOCAL_TIME_CLOSURE = 3
    """The same within short-term memory (proximity in time)."""
    USER_CLOSURE = 4
    VIRTUAL_CLOSURE = 5
    """Between sessions that are tied without a measurement."""
    NEIGHBOR_MERGED = 6
    """Odometry over nodes that were merged away."""
    POSE_PRIOR = 7
    """A pose known from elsewhere; `to_id` is `from_id`."""
    LANDMARK = 8
    """A marker that was seen; `to_id` is minus the marker's number."""
    GRAVITY = 9
    """Which way is down; `to_id` is `from_id`."""


CLOSURES = (LinkKind.GLOBAL_CLOSURE, LinkKind.LOCAL_SPACE_CLOSURE, LinkKind.LOCAL_TIME_CLOSURE, LinkKind.USER_CLOSURE)
"""Kinds that close loops."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Link:
    """A measured pose of one node in another."""

    from_id: int
    to_id: int
    kind: LinkKind
    T_from_to: NDArray[np.float64]
    """float64 (4, 4), pose of the base at `to_id` in the base at `from_id`: p_from = T_from_to @ p_to."""
    information: NDArray[np.float64]
    """float64 (6, 6), x, y, z (1/m^2), rotation vector (1/rad^2), along the axes of the base at `from_id`."""

    def inverse(self) -> Link:
        """Return the same measurement seen from the other end."""
        T = se3.inverse(self.T_from_to)
        R, t = self.T_from_to[:3, :3], self.T_from_to[:3, 3]
        across = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
        back = np.zeros((6, 6))  # from an error of the inverse to that of the measurement
        back[:3, :3] = back[3:, 3:] = -R
        back[:3, 3:] = across @ R
        return Link(
            from_id=self.to_id, to_id=self.from_id, kind=self.kind, T_from_to=T, information=back.T @ self.information @ back
        )  # fmt: skip
