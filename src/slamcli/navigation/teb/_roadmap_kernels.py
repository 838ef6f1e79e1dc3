# SPDX-License-Identifier: MIT
"""Kernels for homotopy classes of paths: signatures, and all ways through a small graph."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_TOO_CLOSE_M = 0.05


@njit(cache=True, nogil=True)
def turned(ax: float, ay: float, bx: float, b_y: float) -> float:
    """Return the angle from a to b, seen from the origin, in -pi to pi."""
    return np.arctan2(ax * b_y - ay * bx, ax * bx + ay * b_y)


@njit(cache=True, nogil=True)
def residues(points: Floats, start: Floats, goal: Floats, prescaler: float, values: Complexes) -> None:
    """Write the residue of each point obstacle; values : complex128 (M,)."""
    num = points.shape[0]
    largest = max(num - 1, 5)
    a = (largest + 1) // 2
    b = largest - a
    begin = complex(start[0], start[1])
    delta = complex(goal[0] - start[0], goal[1] - start[1])
    normal = complex(-delta.imag, delta.real)
    low, high = begin - normal, begin + delta + normal
    if abs(delta) < 3.0:
        low, high = begin + complex(0.0, -3.0), begin + complex(3.0, 3.0)
    for k in range(num):
        here = complex(points[k, 0], points[k, 1])
        value = prescaler * a * (here - low) * b * (here - high)
        for j in range(num):
            away = here - complex(points[j, 0], points[j, 1])
            if j != k and abs(away) >= _TOO_CLOSE_M:
                value /= away
        values[k] = value


@njit(cache=True, nogil=True)
def signature(path: Floats, points: Floats, values: Complexes) -> complex:
    """Return the H-signature of a path, float64 (N, 2 or 3): the sum of residues times the change of log(z - obstacle)."""
    total = 0j
    for k in range(points.shape[0]):
        log_size, angle = 0.0, 0.0
        for i in range(path.shape[0] - 1):
            ax, ay = path[i, 0] - points[k, 0], path[i, 1] - points[k, 1]
            bx, b_y = path[i + 1, 0] - points[k, 0], path[i + 1, 1] - points[k, 1]
            sizes = (ax * ax + ay * ay, bx * bx + b_y * b_y)
            if sizes[0] == 0.0 or sizes[1] == 0.0:
                continue
            log_size += 0.5 * (np.log(sizes[1]) - np.log(sizes[0]))
            angle += turned(ax, ay, bx, b_y)
        total += values[k] * complex(log_size, angle)
    return total


@njit(cache=True, nogil=True)
def passing_sides(path: Floats, times: Floats, discs: Floats, sides: Floats) -> None:
    """Write how far round each moving disc (x, y, radius, vx, vy) a timed path turns, in turns; sides : float64 (D,)."""
    for k in range(discs.shape[0]):
        angle = 0.0
        for i in range(path.shape[0] - 1):
            ax = path[i, 0] - discs[k, 0] - times[i] * discs[k, 3]
            ay = path[i, 1] - discs[k, 1] - times[i] * discs[k, 4]
            bx = path[i + 1, 0] - discs[k, 0] - times[i + 1] * discs[k, 3]
            b_y = path[i + 1, 1] - discs[k, 1] - times[i + 1] * discs[k, 4]
            angle += turned(ax, ay, bx, b_y)
        sides[k] = angle / (2.0 * np.pi)


@njit(cache=True, nogil=True)
def same_class(a: complex, a_sides: Floats, b: complex, b_sides: Floats, threshold: float) -> bool:
    """Whether two paths pass all obstacles on the same sides; a disc far from either path does not count."""
    if abs(a.real - b.real) > threshold or abs(a.imag - b.imag) > threshold:
        return False
    for k in range(a_sides.shape[0]):
        if abs(a_sides[k]) >= threshold and abs(b_sides[k]) >= threshold and (a_sides[k] > 0.0) != (b_sides[k] > 0.0):
            return False
    return True


@njit(cache=True, nogil=True)
def link(
    nodes: Floats, costs: Bytes, origin_x: float, origin_y: float, resolution: float, heading: float, linked: Bools
) -> None:
    """Write which nodes (V, 2) lie ahead of which, towards the last one, with no cell of cost 253 or 254 between."""
    num = nodes.shape[0]
    gx, gy = nodes[num - 1, 0] - nodes[0, 0], nodes[num - 1, 1] - nodes[0, 1]
    goal = np.sqrt(gx * gx + gy * gy)
    for i in range(num - 1):
        for j in range(1, num):
            dx, dy = nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1]
            linked[i, j] = i != j and dx * gx + dy * gy > heading * goal * np.sqrt(dx * dx + dy * dy)
            steps = int(np.ceil(2.0 * max(abs(dx), abs(dy)) / resolution)) + 1 if linked[i, j] else -1
            for k in range(steps + 1):
                share = k / steps
                r = int(np.floor((nodes[i, 1] + share * dy - origin_y) / resolution))
                c = int(np.floor((nodes[i, 0] + share * dx - origin_x) / resolution))
                if 0 <= r < costs.shape[0] and 0 <= c < costs.shape[1] and 253 <= costs[r, c] <= 254:
                    linked[i, j] = False
                    break


@njit(cache=True, nogil=True)
def explore(
    nodes: Floats, linked: Bools, points: Floats, values: Complexes, discs: Floats, speed: float, threshold: float,
    known: Complexes, known_sides: Floats, limit: int, paths: Ints, lengths: Floats,
) -> int:  # fmt: skip
    """Write the shortest path of each class that is not known, node indices from 0 to the last node; return how many.

    nodes : (V, 2), start first, goal last; linked : (V, V); known : (K,); known_sides : (K, D); limit : how many paths are
    looked at; paths : (C, V), filled up with -1; lengths : (C,) in metres. With more classes than C the first C are kept.
    """
    num, room, num_discs = nodes.shape[0], paths.shape[0], discs.shape[0]
    found, seen, depth = 0, 0, 0
    stack, following = np.zeros(num, np.int64), np.zeros(num + 1, np.int64)
    marks, mark_sides = np.zeros(room, np.complex128), np.zeros((room, num_discs))
    visited = np.zeros(num, np.bool_)
    visited[0] = True
    path, times, sides = np.empty((num, 2)), np.zeros(num), np.empty(num_discs)
    path[0] = nodes[0]
    following[0] = num - 1  # the goal first, then from the start on
    while depth >= 0 and seen < limit:
        at, nxt = stack[depth], following[depth]
        if nxt < 0:
            visited[at] = False
            depth -= 1
            continue
        following[depth] = nxt - 1
        if visited[nxt] or not linked[at, nxt]:
            continue
        path[depth + 1] = nodes[nxt]
        step = path[depth + 1] - path[depth]
        times[depth + 1] = times[depth] + np.sqrt(step[0] * step[0] + step[1] * step[1]) / speed
        if nxt != num - 1:
            depth += 1
            stack[depth], following[depth] = nxt, num - 1
            visited[nxt] = True
            continue
        seen += 1
        mark = signature(path[: depth + 2], points, values)
        passing_sides(path[: depth + 2], times, discs, sides)
        old = not (np.isfinite(mark.real) and np.isfinite(mark.imag))
        for k in range(known.shape[0]):
            old = old or same_class(mark, sides, known[k], known_sides[k], threshold)
        if old:
            continue
        place = found
        for k in range(found):
            if same_class(mark, sides, marks[k], mark_sides[k], threshold):
                place = k
                break
        length = times[depth + 1] * speed
        if place == room or (place < found and length >= lengths[place]):
            continue
        found = max(found, place + 1)
        marks[place], mark_sides[place, :], lengths[place] = mark, sides, length
        paths[place, :] = -1
        paths[place, : depth + 1] = stack[: depth + 1]
        paths[place, depth + 1] = nxt
    return found
