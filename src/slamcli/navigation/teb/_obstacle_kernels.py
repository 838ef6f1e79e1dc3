# SPDX-License-Identifier: MIT
"""Kernels for obstacles of a timed elastic band: out of a costmap, to its poses, under its footprint."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

LETHAL = 254
INSCRIBED = 253


@njit(cache=True, nogil=True)
def surface_cells(costs: Bytes, cells: Ints) -> int:
    """Write the flat indices of obstacle cells that have a neighbour, of four, that is none; return how many."""
    rows, columns = costs.shape
    num = 0
    for r in range(rows):
        for c in range(columns):
            if costs[r, c] == LETHAL and (
                r == 0
                or c == 0
                or r == rows - 1
                or c == columns - 1
                or costs[r - 1, c] != LETHAL
                or costs[r + 1, c] != LETHAL
                or costs[r, c - 1] != LETHAL
                or costs[r, c + 1] != LETHAL
            ):
                cells[num] = r * columns + c
                num += 1
    return num


@njit(cache=True, nogil=True)
def label(costs: Bytes, labels: Ints, stack: Ints) -> int:
    """Number the groups of neighbouring cells, of eight, of cost 253 and 254 from 1 on; return how many there are.

    labels : int64 (H, W), 0 where there is none; stack : int64 (H * W,) of work space.
    """
    rows, columns = costs.shape
    labels[:] = 0
    groups = 0
    for first in range(rows * columns):
        r, c = first // columns, first % columns
        if labels[r, c] != 0 or costs[r, c] < INSCRIBED or costs[r, c] > LETHAL:
            continue
        groups += 1
        labels[r, c] = groups
        stack[0] = first
        top = 1
        while top > 0:
            top -= 1
            r, c = stack[top] // columns, stack[top] % columns
            for rr in range(max(0, r - 1), min(rows, r + 2)):
                for cc in range(max(0, c - 1), min(columns, c + 2)):
                    if labels[rr, cc] == 0 and INSCRIBED <= costs[rr, cc] <= LETHAL:
                        labels[rr, cc] = groups
                        stack[top] = rr * columns + cc
                        top += 1
    return groups


@njit(cache=True, nogil=True)
def outline_distance(outline: Floats, closed: bool, pose: Floats, px: float, py: float) -> float:
    """Return the distance of a point from the outline of a robot at a pose; negative inside a closed one."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    dx, dy = px - pose[0], py - pose[1]
    bx, b_y = c * dx + s * dy, c * dy - s * dx
    best, inside = np.inf, False
    for k in range(outline.shape[0]):
        x1, y1 = outline[k, 0], outline[k, 1]
        ex, ey = outline[k, 2] - x1, outline[k, 3] - y1
        squared = ex * ex + ey * ey
        along = 0.0
        if squared > 0.0:
            along = min(1.0, max(0.0, ((bx - x1) * ex + (b_y - y1) * ey) / squared))
        gx, gy = bx - x1 - along * ex, b_y - y1 - along * ey
        best = min(best, np.sqrt(gx * gx + gy * gy) - outline[k, 4])
        if closed and (y1 > b_y) != (y1 + ey > b_y) and bx < x1 + (b_y - y1) / ey * ex:
            inside = not inside
    return -best if inside else best


@njit(cache=True, nogil=True)
def least_room(path: Floats, points: Floats, radius: float, reach: float) -> float:
    """Return half of the least width, between obstacles left and right of it, that a path leaves a disc of that radius.

    Only obstacles within `reach` metres of the disc count; inf where there are none on both sides.
    """
    least = np.inf
    bound = reach + radius
    for i in range(path.shape[0] - 1):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        left, right = np.inf, np.inf
        for k in range(points.shape[0]):
            px, py = points[k, 0] - path[i, 0], points[k, 1] - path[i, 1]
            squared = px * px + py * py
            if squared > bound * bound:
                continue
            if dx * py - dy * px > 0.0:
                left = min(left, squared)
            else:
                right = min(right, squared)
        least = min(least, 0.5 * (np.sqrt(left) + np.sqrt(right)) - radius)
    return least


@njit(cache=True, nogil=True)
def clearances(outline: Floats, closed: bool, poses: Floats, points: Floats, values: Floats) -> None:
    """Write the distance from the outline at each pose to the nearest point."""
    for i in range(poses.shape[0]):
        values[i] = np.inf
        for k in range(points.shape[0]):
            values[i] = min(values[i], outline_distance(outline, closed, poses[i], points[k, 0], points[k, 1]))


@njit(cache=True, nogil=True)
def associate(
    poses: Floats, outline: Floats, closed: bool, radius: float, points: Floats, force: float, cutoff: float,
    starts: Ints, near: Ints,
) -> int:  # fmt: skip
    """Attach obstacles to poses: all within `force` metres, and the nearest on either side within `cutoff`.

    starts : (N + 1,), obstacles of pose i are near[starts[i]:starts[i + 1]]; near : (N * M,); radius : of the circle about
    the outline. The first and the last pose get none. Returns how many there are.
    """
    num = poses.shape[0]
    total = 0
    starts[0] = 0
    for i in range(num):
        starts[i] = total
        if i == 0 or i == num - 1:
            continue
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        left, right = np.inf, np.inf
        left_k, right_k = -1, -1
        reach = cutoff + radius
        for k in range(points.shape[0]):
            dx, dy = points[k, 0] - poses[i, 0], points[k, 1] - poses[i, 1]
            squared = dx * dx + dy * dy
            if squared > reach * reach:
                continue
            on_left = c * dy - s * dx > 0.0
            bound = max(force, left if on_left else right) + radius
            if squared > bound * bound:
                continue  # too far, wherever on the outline it is nearest to
            far = outline_distance(outline, closed, poses[i], points[k, 0], points[k, 1])
            if far < force:
                near[total] = k
                total += 1
            elif far <= cutoff and on_left and far < left:
                left, left_k = far, k
            elif far <= cutoff and not on_left and far < right:
                right, right_k = far, k
        if left_k >= 0:
            near[total] = left_k
            total += 1
        if right_k >= 0:
            near[total] = right_k
            total += 1
    starts[num] = total
    return total


@njit(cache=True, nogil=True)
def associate_legacy(poses: Floats, points: Floats, affected: int, starts: Ints, near: Ints) -> int:
    """Attach each obstacle to the pose nearest to it and half of `affected` poses before and after."""
    num, half = poses.shape[0], affected // 2
    nearest = np.empty(points.shape[0], np.int64)
    for k in range(points.shape[0]):
        best = np.inf
        for i in range(num):
            squared = (points[k, 0] - poses[i, 0]) ** 2 + (points[k, 1] - poses[i, 1]) ** 2
            if squared < best:
                best, nearest[k] = squared, i
        if affected >= num:
            nearest[k] = num // 2
    total = 0
    starts[0] = 0
    for i in range(num):
        starts[i] = total
        if i == 0 or i == num - 1:
            continue
        for k in range(points.shape[0]):
            if 1 < nearest[k] <= num - 2 and (nearest[k] == i or abs(nearest[k] - i) < half):
                near[total] = k
                total += 1
    starts[num] = total
    return total


@njit(cache=True, nogil=True)
def cost_at(costs: Bytes, origin_x: float, origin_y: float, resolution: float, x: float, y: float) -> int:
    """Return the cost of the cell at a point; 0 outside."""
    r, c = int(np.floor((y - origin_y) / resolution)), int(np.floor((x - origin_x) / resolution))
    if r < 0 or c < 0 or r >= costs.shape[0] or c >= costs.shape[1]:
        return 0
    return int(costs[r, c])


@njit(cache=True, nogil=True)
def line_is_free(
    costs: Bytes, origin_x: float, origin_y: float, resolution: float,
    x1: float, y1: float, x2: float, y2: float, limit: int,
) -> bool:  # fmt: skip
    """Whether no cell along a line costs limit to 254; unknown cells and what is outside do not block."""
    steps = int(np.ceil(2.0 * max(abs(x2 - x1), abs(y2 - y1)) / resolution)) + 1
    for k in range(steps + 1):
        share = k / steps
        cost = cost_at(costs, origin_x, origin_y, resolution, x1 + share * (x2 - x1), y1 + share * (y2 - y1))
        if limit <= cost <= LETHAL:
            return False
    return True


@njit(cache=True, nogil=True)
def stands_free(
    costs: Bytes, origin_x: float, origin_y: float, resolution: float, corners: Floats, x: float, y: float, yaw: float
) -> bool:
    """Whether no obstacle cell is under the edges or the centre of a footprint at a pose."""
    if cost_at(costs, origin_x, origin_y, resolution, x, y) == LETHAL:
        return False
    c, s = np.cos(yaw), np.sin(yaw)
    num = corners.shape[0]
    for k in range(num):
        ax, ay = corners[k, 0], corners[k, 1]
        bx, b_y = corners[(k + 1) % num, 0], corners[(k + 1) % num, 1]
        if not line_is_free(
            costs, origin_x, origin_y, resolution,
            x + c * ax - s * ay, y + s * ax + c * ay, x + c * bx - s * b_y, y + s * bx + c * b_y, LETHAL,
        ):  # fmt: skip
            return False
    return True


@njit(cache=True, nogil=True)
def way_is_blocked(
    costs: Bytes, origin_x: float, origin_y: float, resolution: float, path: Floats, lenient_m: float
) -> bool:
    """Whether a path crosses cells of cost 253 or 254; of stretches within `lenient_m` of its ends only 254."""
    last = path.shape[0] - 1
    for i in range(last):
        away = min(
            (path[i + 1, 0] - path[0, 0]) ** 2 + (path[i + 1, 1] - path[0, 1]) ** 2,
            (path[i, 0] - path[last, 0]) ** 2 + (path[i, 1] - path[last, 1]) ** 2,
        )
        limit = INSCRIBED if away > lenient_m * lenient_m else LETHAL
        if not line_is_free(
            costs, origin_x, origin_y, resolution, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1], limit
        ):
            return True
    return False


@njit(cache=True, nogil=True)
def first_collision(
    costs: Bytes, origin_x: float, origin_y: float, resolution: float, corners: Floats,
    poses: Floats, step_m: float, step_rad: float,
) -> int:  # fmt: skip
    """Return the first pose, or the pose before the stretch, where the footprint meets an obstacle; -1 if there is none.

    Stretches longer than `step_m`, or turning more than `step_rad`, are checked between their poses, too.
    """
    num = poses.shape[0]
    for i in range(num):
        if not stands_free(costs, origin_x, origin_y, resolution, corners, poses[i, 0], poses[i, 1], poses[i, 2]):
            return i
        if i == num - 1:
            break
        dx, dy = poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1]
        turn = poses[i + 1, 2] - poses[i, 2]
        turn -= 2.0 * np.pi * np.floor((turn + np.pi) / (2.0 * np.pi))
        pieces = int(np.ceil(max(np.sqrt(dx * dx + dy * dy) / step_m, abs(turn) / step_rad)))
        for k in range(1, pieces):
            share = k / pieces
            if not stands_free(
                costs, origin_x, origin_y, resolution, corners,
                poses[i, 0] + share * dx, poses[i, 1] + share * dy, poses[i, 2] + share * turn,
            ):  # fmt: skip
                return i
    return -1
