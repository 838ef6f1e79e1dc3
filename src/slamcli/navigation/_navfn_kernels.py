# SPDX-License-Identifier: MIT
"""Kernels of NavFn: wave propagation with the quadratic update, and gradient descent; see `slamcli.navigation.navfn`.

Grids are flat with a blocked border of one cell all around, so that no neighbour lies outside.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]

OBSTACLE = 254
NEUTRAL = 50
UNREACHED = np.float32(1.0e10)
_SIDE = np.float32(0.707106781)


@njit(cache=True)
def propagate(
    levels: Bytes, toll: Bytes, width: int, origin: int, target: int, potential: Singles, pending: Bools, extent: Ints
) -> int:
    """Let the wave grow from cell `origin` until `target` is reached; return the number of rounds.

    levels : uint8 (N,) costmap values; toll : uint8 (256,) what crossing a cell costs by its value, 254 is an obstacle;
    potential : float32 (N,) and pending : bool (N,), work space that is kept from call to call; extent : int64 (2,), first
    and last cell plus one that the call before may have touched, (0, N) before the first.
    """
    potential[extent[0] : extent[1]] = UNREACHED
    pending[extent[0] : extent[1]] = False
    lowest, highest = origin, origin
    current = np.empty(4096, dtype=np.int64)
    following = np.empty(4096, dtype=np.int64)
    overflow = np.empty(4096, dtype=np.int64)
    num_current, num_following, num_overflow = 0, 0, 0
    threshold = np.float32(OBSTACLE)
    sides = np.array([1, -1, -width, width])
    potential[origin] = 0.0
    for side in sides:
        if toll[levels[origin + side]] < OBSTACLE:
            current[num_current] = origin + side
            pending[origin + side] = True
            num_current += 1
    rounds = 0
    while num_current > 0:
        rounds += 1
        if num_following + 4 * num_current > len(following):
            following = np.concatenate((following[:num_following], np.empty(8 * num_current, dtype=np.int64)))
        if num_overflow + 4 * num_current > len(overflow):
            overflow = np.concatenate(
                (overflow[:num_overflow], np.empty(num_overflow + 8 * num_current, dtype=np.int64))
            )
        for i in range(num_current):
            pending[current[i]] = False
        for i in range(num_current):
            cell = current[i]
            left, right = potential[cell - 1], potential[cell + 1]
            up, down = potential[cell - width], potential[cell + width]
            value = _update(left, right, up, down, np.float32(toll[levels[cell]]))
            if not value < potential[cell]:
                continue
            potential[cell] = value
            lowest, highest = min(lowest, cell), max(highest, cell)
            near = value < threshold
            for k in range(4):
                if k == 0:
                    neighbour, there = cell - 1, left
                elif k == 1:
                    neighbour, there = cell + 1, right
                elif k == 2:
                    neighbour, there = cell - width, up
                else:
                    neighbour, there = cell + width, down
                cost = toll[levels[neighbour]]
                if there > value + _SIDE * np.float32(cost) and not pending[neighbour] and cost < OBSTACLE:
                    pending[neighbour] = True
                    if near:
                        following[num_following] = neighbour
                        num_following += 1
                    else:
                        overflow[num_overflow] = neighbour
                        num_overflow += 1
        current, following = following, current
        num_current, num_following = num_following, 0
        if num_current == 0:
            threshold += np.float32(2 * NEUTRAL)
            current, overflow = overflow, current
            num_current, num_overflow = num_overflow, 0
        if potential[target] < UNREACHED:
            break
    extent[0], extent[1] = lowest - width, highest + width + 1
    return rounds


@njit(cache=True)
def _update(left: np.float32, right: np.float32, up: np.float32, down: np.float32, toll: np.float32) -> np.float32:
    """Return the potential that a planar wave gives a cell, from the lower neighbour of each axis."""
    low = min(left, right)
    other = min(up, down)
    difference = abs(low - other)
    low = min(low, other)
    if difference >= toll:
        return low + toll
    d = difference / toll
    # Quadratic fit to the interpolated value; in double precision as the original's constants are.
    return np.float32(low + toll * np.float32(-0.2301 * d * d + 0.5307 * d + 0.7040))


@njit(cache=True)
def _gradient(potential: Singles, width: int, cell: int) -> tuple[float, float]:
    """Return the unit vector (x, y) of descent at a cell, zeros where there is none."""
    here = potential[cell]
    dx, dy = 0.0, 0.0
    left, right = potential[cell - 1], potential[cell + 1]
    up, down = potential[cell - width], potential[cell + width]
    if here >= UNREACHED:
        if left < UNREACHED:
            dx = -float(OBSTACLE)
        elif right < UNREACHED:
            dx = float(OBSTACLE)
        if up < UNREACHED:
            dy = -float(OBSTACLE)
        elif down < UNREACHED:
            dy = float(OBSTACLE)
    else:
        if left < UNREACHED:
            dx += left - here
        if right < UNREACHED:
            dx += here - right
        if up < UNREACHED:
            dy += up - here
        if down < UNREACHED:
            dy += here - down
    norm = np.sqrt(dx * dx + dy * dy)
    if norm == 0.0:
        return 0.0, 0.0
    return dx / norm, dy / norm


@njit(cache=True)
def _lowest_neighbour(levels: Bytes, toll: Bytes, potential: Singles, width: int, cell: int) -> int:
    """Return the cell of lowest potential among the eight around `cell`, no corner cut; `cell` where none is lower."""
    best, lowest = cell, potential[cell]
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            neighbour = cell + dy * width + dx
            if potential[neighbour] >= lowest or toll[levels[neighbour]] >= OBSTACLE:
                continue
            if (
                dx != 0
                and dy != 0
                and (toll[levels[cell + dx]] >= OBSTACLE or toll[levels[cell + dy * width]] >= OBSTACLE)
            ):
                continue
            best, lowest = neighbour, potential[neighbour]
    return best


@njit(cache=True)
def _clear(levels: Bytes, toll: Bytes, width: int, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Return whether a step shorter than a cell stays on free cells, the two beside a crossed corner included."""
    c0, r0 = int(np.floor(x0 + 0.5)), int(np.floor(y0 + 0.5))
    c1, r1 = int(np.floor(x1 + 0.5)), int(np.floor(y1 + 0.5))
    if toll[levels[r1 * width + c1]] >= OBSTACLE:
        return False
    if c0 != c1 and r0 != r1:
        return toll[levels[r0 * width + c1]] < OBSTACLE and toll[levels[r1 * width + c0]] < OBSTACLE
    return True


@njit(cache=True)
def descend(
    levels: Bytes, toll: Bytes, potential: Singles, width: int, target: int, origin: int, step: float, out: Floats
) -> int:
    """Write the way from cell `target` down to `origin` as x, y in cells to `out` (M, 2); return its length or -1.

    Where the gradient is flat, at the edge of what the wave reached, would leave the free cells, or does not lead
    down, the lowest of the eight neighbours is next, as in the original near obstacles.
    """
    cell = target
    dx, dy = 0.0, 0.0
    count = 0
    best = potential[target]
    stalled = 0
    while True:
        nearest = cell + int(np.floor(dx + 0.5)) + width * int(np.floor(dy + 0.5))
        x, y = cell % width + dx, cell // width + dy
        if count == len(out):
            return -1
        close = potential[nearest] < NEUTRAL
        if nearest == origin or (
            close and _clear(levels, toll, width, x, y, float(origin % width), float(origin // width))
        ):
            if count + 2 > len(out):
                return -1
            out[count, 0], out[count, 1] = x, y
            out[count + 1, 0], out[count + 1, 1] = origin % width, origin // width
            return count + 2
        out[count, 0], out[count, 1] = x, y
        count += 1
        smooth = stalled < 8
        if smooth:
            for row in range(-1, 2):
                for column in range(-1, 2):
                    if potential[cell + row * width + column] >= UNREACHED:
                        smooth = False
        moved = False
        if smooth:
            moved, cell, dx, dy = _slide(levels, toll, potential, width, cell, dx, dy, step)
        if not moved:
            lower = _lowest_neighbour(levels, toll, potential, width, nearest)
            if lower == nearest:
                return -1
            # Corners are never cut there, so the straight line to its centre stays on free cells.
            cell, dx, dy = lower, 0.0, 0.0
        here = potential[cell + int(np.floor(dx + 0.5)) + width * int(np.floor(dy + 0.5))]
        if here < best:
            best, stalled = here, 0
        else:
            stalled += 1


@njit(cache=True)
def _slide(
    levels: Bytes, toll: Bytes, potential: Singles, width: int, cell: int, dx: float, dy: float, step: float
) -> tuple[bool, int, float, float]:
    """Return whether one step down the bilinear gradient is possible, and the cell and offsets after it."""
    gx0, gy0 = _gradient(potential, width, cell)
    gx1, gy1 = _gradient(potential, width, cell + 1)
    gx2, gy2 = _gradient(potential, width, cell + width)
    gx3, gy3 = _gradient(potential, width, cell + width + 1)
    gx = (1.0 - dy) * ((1.0 - dx) * gx0 + dx * gx1) + dy * ((1.0 - dx) * gx2 + dx * gx3)
    gy = (1.0 - dy) * ((1.0 - dx) * gy0 + dx * gy1) + dy * ((1.0 - dx) * gy2 + dx * gy3)
    norm = np.sqrt(gx * gx + gy * gy)
    if norm == 0.0:
        return False, cell, dx, dy
    x, y = cell % width + dx, cell // width + dy
    new_x, new_y = x + gx * step / norm, y + gy * step / norm
    if not _clear(levels, toll, width, x, y, new_x, new_y):
        return False, cell, dx, dy
    dx += gx * step / norm
    dy += gy * step / norm
    if dx > 1.0:
        cell, dx = cell + 1, dx - 1.0
    if dx < -1.0:
        cell, dx = cell - 1, dx + 1.0
    if dy > 1.0:
        cell, dy = cell + width, dy - 1.0
    if dy < -1.0:
        cell, dy = cell - width, dy + 1.0
    return True, cell, dx, dy
