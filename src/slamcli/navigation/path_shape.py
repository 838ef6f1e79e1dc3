# SPDX-License-Identifier: MIT
"""What is done to a path after it is found: check, shortcuts, headings, dense samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slamcli.navigation import _path_kernels as kernels
from slamcli.navigation.search_space import SearchGrid, sample_space

_SHARP_TURN_RAD = 0.35
_COINCIDENT_CELLS = 1e-6
_SMOOTHING_ROUNDS = 200
_SETTLED_CELLS = 1e-3


def line_integral(space: SearchGrid, path_rc: NDArray[np.float64]) -> float:
    """Return the weighted length of a path (N, 2), row and column, in cells; inf if it touches a blocked cell."""
    return float(
        kernels.path_cost(
            space.levels.reshape(-1), space.blocked, space.weight, space.stride, np.ascontiguousarray(path_rc + 1.0)
        )
    )


def simplify(space: SearchGrid, path_rc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the path with stretches replaced by straight lines where these are free and cost no more."""
    keep = np.ones(len(path_rc), dtype=np.bool_)
    if len(path_rc) > 2:
        kernels.shortcut(
            space.levels.reshape(-1),
            space.blocked,
            space.weight,
            space.stride,
            np.ascontiguousarray(path_rc + 1.0),
            keep,
        )
    return path_rc[keep]


def smooth(space: SearchGrid, path_rc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the path with points at most a cell apart, each moved to the middle of its neighbours where that costs no more.

    A point stays where a line beside it would touch a blocked cell or cost more than before, so the path gets shorter or
    cheaper and keeps its clearance where costs ask for it; the ends stay.
    """
    points = np.ascontiguousarray(dense(path_rc, 1.0) + 1.0)
    if len(points) > 2:
        kernels.relax(
            space.levels.reshape(-1),
            space.blocked,
            space.weight,
            space.stride,
            points,
            _SMOOTHING_ROUNDS,
            _SETTLED_CELLS,
        )
    return points - 1.0


def anchored(
    cells_rc: NDArray[np.float64], start_rc: NDArray[np.float64], goal_rc: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a path over neighbouring cells (N, 2) shifted so that it runs from `start_rc` to `goal_rc`.

    The offset from the centres goes over from that of the start to that of the goal, so that there is no kink at the ends.
    Every point stays in its cell, and a line between neighbours in the two or four cells around it, which are all free.
    """
    if len(cells_rc) == 1:
        return np.vstack([start_rc, goal_rc])
    share = np.linspace(0.0, 1.0, len(cells_rc))[:, None]
    return cells_rc + (1.0 - share) * (start_rc - cells_rc[0]) + share * (goal_rc - cells_rc[-1])


def distinct(path_rc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the path without points that coincide with the one before (a step without direction); the ends stay."""
    lengths = np.linalg.norm(np.diff(path_rc, axis=0), axis=1)
    keep = np.concatenate([[True], lengths > _COINCIDENT_CELLS])
    keep[-1] = True
    if len(path_rc) > 2 and lengths[-1] <= _COINCIDENT_CELLS:
        keep[-2] = False
        keep[0] = True
    return path_rc[keep]


def dense(path_rc: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return the path with points added so that neighbours are at most `spacing` apart."""
    lengths = np.linalg.norm(np.diff(path_rc, axis=0), axis=1)
    pieces = np.maximum(np.ceil(lengths / spacing), 1).astype(np.int64)
    if len(pieces) == 0 or pieces.max() == 1:
        return path_rc
    segment = np.repeat(np.arange(len(pieces)), pieces)
    first = np.cumsum(pieces) - pieces
    share = (np.arange(pieces.sum()) - first[segment]) / pieces[segment]
    points = path_rc[segment] + share[:, None] * (path_rc[segment + 1] - path_rc[segment])
    return np.vstack([points, path_rc[-1:]])


def headings(
    points: NDArray[np.float64], mode: str, window: int, start_yaw: float | None, goal_yaw: float | None
) -> NDArray[np.float64]:
    """Return float64 (N,), radians, the yaw of each pose as global_planner's orientation filter sets it.

    Parameters
    ----------
    points
        float64 (N, 2), x and y in metres.
    mode
        One of `slamcli.navigation.planner_parameters.ORIENTATION_MODES`.
    window
        A heading points from the pose `window` before to the one `window` after.
    start_yaw, goal_yaw
        Kept at the ends where they are given; else the path's own heading stands there.
    """
    index = np.arange(len(points))
    ahead = points[np.minimum(index + window, len(points) - 1)] - points[np.maximum(index - window, 0)]
    forward = np.arctan2(ahead[:, 1], ahead[:, 0])
    first = forward[0] if start_yaw is None else start_yaw
    last = forward[-1] if goal_yaw is None else goal_yaw
    if mode == "none":
        yaw = np.zeros(len(points))
        first, last = start_yaw or 0.0, goal_yaw or 0.0
    elif mode == "interpolate":
        yaw = _interpolate(first, last, len(points))
    elif mode == "forward_then_interpolate":
        yaw = forward.copy()
        turns = np.abs(_wrap(np.diff(forward[:-1]))) > _SHARP_TURN_RAD
        begin = int(np.flatnonzero(turns)[-1]) + 1 if turns.any() else 0
        yaw[begin:] = _interpolate(yaw[begin], last, len(points) - begin)
    else:
        turn = {"forward": 0.0, "backward": np.pi, "leftward": -np.pi / 2, "rightward": np.pi / 2}[mode]
        yaw = forward + turn
        first = yaw[0] if start_yaw is None else start_yaw
        last = yaw[-1] if goal_yaw is None else goal_yaw
    yaw[0], yaw[-1] = first, last
    return _wrap(yaw)


def _interpolate(first: float, last: float, count: int) -> NDArray[np.float64]:
    turn = float(_wrap(np.array(last - first)))
    return first + turn * np.linspace(0.0, 1.0, count)


def _wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.arctan2(np.sin(angle), np.cos(angle))


def warm() -> None:
    """Compile the kernels of this module."""
    space = sample_space()
    line_integral(space, smooth(space, simplify(space, np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]]))))
