# SPDX-License-Identifier: MIT
"""Parts of the messages that navigation publishes: planar poses in space, people as shapes, costs as occupancy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform
from slamcli.recordings.adapters import Marker
from slamcli.recordings.adapters.marker_array import Shape

Array = NDArray[np.float64]

_PERSON_COLOUR, _SPEED_COLOUR = (0.84, 0.37, 0.0, 0.9), (0.0, 0.45, 0.7, 0.9)
_PERSON_LIFETIME_S = 0.5


def planar_transform(stamp_ns: int, parent: str, child: str, T_parent_child: Array) -> FrameTransform:
    """Return one edge of the frame tree from a planar pose (3,)."""
    position, quat = level(T_parent_child)
    return FrameTransform(
        stamp_ns=stamp_ns, parent_frame_id=parent, child_frame_id=child, position_m=position, quat_xyzw=quat
    )


def level(pose: Array) -> tuple[Array, Array]:
    """Return positions and quaternions of planar poses (3,) or (N, 3)."""
    flat = np.atleast_2d(np.asarray(pose, dtype=np.float64))
    positions = np.column_stack([flat[:, :2], np.zeros(len(flat))])
    quats = quaternion.from_yaw(flat[:, 2])
    return (positions[0], quats[0]) if np.ndim(pose) == 1 else (positions, quats)


def people_markers(discs: Array) -> tuple[Marker, ...]:
    """Return markers of discs (D, 5): one for each radius, and one for all speeds."""
    discs = np.asarray(discs, dtype=np.float64).reshape(-1, 5)
    if not len(discs):
        return ()
    person, speed = np.array([_PERSON_COLOUR]), np.array([_SPEED_COLOUR])
    markers = []
    for radius in np.unique(discs[:, 2]):
        own = discs[discs[:, 2] == radius]
        places = np.column_stack([own[:, :2], np.full(len(own), radius)])
        markers.append(_passing("people", "points", places, person, 2 * float(radius)))
    ends = np.stack([discs[:, :2], discs[:, :2] + discs[:, 3:5]], axis=1).reshape(-1, 2)
    lines = np.column_stack([ends, np.repeat(discs[:, 2], 2)])
    return (*markers, _passing("speed", "lines", lines, speed, 0.05))


def _passing(namespace: str, shape: Shape, points_m: Array, colours: Array, size_m: float) -> Marker:
    """Return a marker that goes away where it does not come again."""
    return Marker(
        namespace=namespace, shape=shape, points_m=points_m, colours=colours, size_m=size_m,
        lifetime_s=_PERSON_LIFETIME_S,
    )  # fmt: skip


def _translation() -> NDArray[np.int8]:
    """Return costmap_2d's table (256,) from costs to occupancy: 253 is 99, 254 is 100, 255 unknown, others evenly between."""
    cost = np.arange(256)
    table = np.where(cost == 0, 0, 1 + 97 * (cost - 1) // 251)
    table[253:] = (99, 100, OccupancyGrid.UNKNOWN)
    return table.astype(np.int8)


TRANSLATION = _translation()
"""int8 (256,): occupancy by cost."""
