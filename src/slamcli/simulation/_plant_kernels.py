# SPDX-License-Identifier: MIT
"""Kernels of a robot that obeys velocities among walls and things that move; see `slamcli.simulation.plant`.

Every obstacle is a rounded box: x, y, cos, sin, half length, half width, radius. A wall has half width 0, a disc no
length either. The body is an outline (N, 2) with a radius around it; one point makes a disc. A tick and the gaps it
measures are one file, as a kernel calls helpers of its own file only.
"""

import math

import numpy as np
from numba import njit

_TOUCH_ENDS = 0.05  # metres: farther apart a contact is over
_LOOK = 0.6  # metres beyond which walls are not measured exactly while the robot drives


@njit(cache=True, nogil=True)
def _point_to_segment(px, py, ax, ay, bx, by):
    """Squared distance of a point to a segment."""
    ex, ey = bx - ax, by - ay
    length = ex * ex + ey * ey
    along = 0.0
    if length > 0.0:
        along = min(max(((px - ax) * ex + (py - ay) * ey) / length, 0.0), 1.0)
    dx, dy = ax + along * ex - px, ay + along * ey - py
    return dx * dx + dy * dy


@njit(cache=True, nogil=True)
def _segment_to_box(ax, ay, bx, by, half_x, half_y):
    """Squared distance of a segment to the box [-half_x, half_x] x [-half_y, half_y]; 0 if they meet."""
    enter, leave = 0.0, 1.0
    dx, dy = bx - ax, by - ay
    apart = False
    if dx == 0.0:
        apart = abs(ax) > half_x
    else:
        one, two = (-half_x - ax) / dx, (half_x - ax) / dx
        enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    if dy == 0.0:
        apart = apart or abs(ay) > half_y
    else:
        one, two = (-half_y - ay) / dy, (half_y - ay) / dy
        enter, leave = max(enter, min(one, two)), min(leave, max(one, two))
    if not apart and enter <= leave:
        return 0.0
    near_x, near_y = max(abs(ax) - half_x, 0.0), max(abs(ay) - half_y, 0.0)
    best = near_x * near_x + near_y * near_y
    near_x, near_y = max(abs(bx) - half_x, 0.0), max(abs(by) - half_y, 0.0)
    best = min(best, near_x * near_x + near_y * near_y)
    if dx != 0.0 or dy != 0.0:
        best = min(best, _point_to_segment(-half_x, -half_y, ax, ay, bx, by))
        best = min(best, _point_to_segment(half_x, -half_y, ax, ay, bx, by))
        best = min(best, _point_to_segment(-half_x, half_y, ax, ay, bx, by))
        best = min(best, _point_to_segment(half_x, half_y, ax, ay, bx, by))
    return best


@njit(cache=True, nogil=True)
def _outline_to_box(outline, half_x, half_y):
    """Distance of an outline (N, 2) in the frame of a box to it; 0 if they overlap or one holds the other."""
    count = outline.shape[0]
    best, inside = np.inf, False
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ax, ay, bx, by = outline[i, 0], outline[i, 1], outline[j, 0], outline[j, 1]
        best = min(best, _segment_to_box(ax, ay, bx, by, half_x, half_y))
        if (ay > 0.0) != (by > 0.0) and ax + (bx - ax) * -ay / (by - ay) > 0.0:
            inside = not inside
    return 0.0 if inside else math.sqrt(best)


@njit(cache=True, nogil=True)
def _box_gap(outline, radius, x, y, c, s, box, placed):
    """Gap between the body at a pose and a rounded box (7,); below 0 where they overlap. `placed` (N, 2) is room to work."""
    turned_c, turned_s = c * box[2] + s * box[3], s * box[2] - c * box[3]
    dx, dy = x - box[0], y - box[1]
    at_x, at_y = box[2] * dx + box[3] * dy, box[2] * dy - box[3] * dx
    for i in range(outline.shape[0]):
        placed[i, 0] = at_x + turned_c * outline[i, 0] - turned_s * outline[i, 1]
        placed[i, 1] = at_y + turned_s * outline[i, 0] + turned_c * outline[i, 1]
    return _outline_to_box(placed, box[4], box[5]) - radius - box[6]


@njit(cache=True, nogil=True)
def _near_cell(field, gx, gy, reach):
    """Distance in cells of a point to the nearest wall cell's square (field 0); `reach` where none is that near."""
    height, width = field.shape
    row, column = np.int64(math.floor(gy)), np.int64(math.floor(gx))
    first = 0
    if 0 <= row < height and 0 <= column < width:
        if field[row, column] == 0:
            return 0.0
        bound = np.int64(field[row, column]) - 1  # no wall is nearer than that
        if bound >= reach:
            return reach
        first = max(np.int64(bound * 0.7) - 1, 0)
    best = reach * reach
    for ring in range(first, np.int64(reach) + 2):
        if (ring - 1.0) * (ring - 1.0) > best and ring > 0:
            break
        for r in range(max(row - ring, 0), min(row + ring, height - 1) + 1):
            step = 1 if abs(r - row) == ring else max(2 * ring, 1)
            for k in range(column - ring, column + ring + 1, step):
                if 0 <= k < width and field[r, k] == 0:
                    dx, dy = max(k - gx, gx - k - 1.0, 0.0), max(r - gy, gy - r - 1.0, 0.0)
                    best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)


@njit(cache=True, nogil=True)
def wall_gap(outline, radius, x, y, yaw, field, frame, shapes, reach, placed):
    """Gap between the body at a pose and the nearest wall, `reach` (metres) where none is that near.

    `field` uint8 (H, W) is 0 in wall cells, else 1 + a number of cells within which there is none; `frame` holds x, y,
    cos, sin of its corner and its cell size. `shapes` (S, 7) are the other walls.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    around = radius
    for i in range(outline.shape[0]):
        around = max(around, math.hypot(outline[i, 0], outline[i, 1]) + radius)
    best = reach
    for i in range(shapes.shape[0]):
        box = shapes[i]
        far = math.hypot(box[0] - x, box[1] - y) - box[4] - box[5] - box[6] - around
        if far < best:
            best = min(best, _box_gap(outline, radius, x, y, c, s, box, placed))
    if field.shape[0] == 0:
        return best
    size = frame[4]
    gx = (frame[2] * (x - frame[0]) + frame[3] * (y - frame[1])) / size
    gy = (frame[2] * (y - frame[1]) - frame[3] * (x - frame[0])) / size
    wide = (best + around) / size
    near = _near_cell(field, gx, gy, wide)
    if outline.shape[0] == 1:
        return min(best, near * size - radius)
    if near >= wide:
        return best
    gc, gs = (c * frame[2] + s * frame[3]), (s * frame[2] - c * frame[3])
    wide = near + 2.0 * around / size + 1.0
    for r in range(max(np.int64(gy - wide), 0), min(np.int64(gy + wide), field.shape[0] - 1) + 1):
        for k in range(max(np.int64(gx - wide), 0), min(np.int64(gx + wide), field.shape[1] - 1) + 1):
            if field[r, k] != 0:
                continue
            at_x, at_y = (gx - k - 0.5) * size, (gy - r - 0.5) * size
            if math.hypot(at_x, at_y) - around - 0.7072 * size >= best:
                continue
            for i in range(outline.shape[0]):
                placed[i, 0] = at_x + gc * outline[i, 0] - gs * outline[i, 1]
                placed[i, 1] = at_y + gs * outline[i, 0] + gc * outline[i, 1]
            best = min(best, _outline_to_box(placed, 0.5 * size, 0.5 * size) - radius)
    return best


@njit(cache=True, nogil=True)
def mover_gap(outline, radius, x, y, yaw, movers, placed):
    """Gap between the body at a pose and the nearest of what moves (M, 9); inf without any."""
    c, s = math.cos(yaw), math.sin(yaw)
    best = np.inf
    for i in range(movers.shape[0]):
        best = min(best, _box_gap(outline, radius, x, y, c, s, movers[i], placed))
    return best


@njit(cache=True, nogil=True)
def _towards(now, wanted, most):
    return now + min(max(wanted - now, -most), most)


@njit(cache=True, nogil=True)
def _drive(state, wanted, limits, tick):
    """Change the twist state[3:6] (and steering state[6]) towards `wanted` (3,) within the limits of one tick."""
    kind = limits[0]
    x = min(max(wanted[0], -limits[2]), limits[1])
    turn = min(max(wanted[2], -limits[4]), limits[4])
    state[3] = _towards(state[3], x, limits[5] * tick)
    if kind == 2.0:
        if abs(x) > 1e-3:
            steer = math.atan(limits[8] * turn / x)
            steer = min(max(steer, -limits[9]), limits[9])
            state[6] = _towards(state[6], steer, limits[10] * tick)
        state[4] = 0.0
        state[5] = state[3] * math.tan(state[6]) / limits[8]
        return
    side = min(max(wanted[1], -limits[3]), limits[3]) if kind == 1.0 else 0.0
    state[4] = _towards(state[4], side, limits[6] * tick)
    state[5] = _towards(state[5], turn, limits[7] * tick)


@njit(cache=True, nogil=True)
def _tell(state, dx, dy, turn, told, draws, slip_draws, moving, tick, counters):
    """Move the odometry state[7:10] by what the wheels say of a true step, and set its twist state[10:13].

    `told` holds srr, srt, str, stt, distance and turn scale, pull, the shares told in slip, the chance that slip begins
    in a tick, its ticks, and how much and how slowly drift comes and goes.
    """
    share, turn_share = told[4], told[5]
    if told[9] > 0.0 and counters[3] <= 0 and moving and slip_draws[2] < told[9]:
        counters[3] = np.int64(told[10])
    if counters[3] > 0:
        counters[3] -= 1
        share, turn_share = share * told[8], turn_share * told[7]
    if told[11] > 0.0:
        keep = math.exp(-tick / told[12])
        spread = told[11] * math.sqrt(1.0 - keep * keep)
        state[13] = state[13] * keep + spread * slip_draws[0]
        state[14] = state[14] * keep + spread * slip_draws[1]
        share, turn_share = share * (1.0 + state[13]), turn_share * (1.0 + state[14])
    distance, bend = math.hypot(dx, dy), abs(turn)
    along = dx * share + draws[0] * math.sqrt(told[0] ** 2 * distance + told[2] ** 2 * bend)
    across = dy * share
    angle = turn * turn_share + told[6] * distance
    state[10], state[11], state[12] = state[3] * share, state[4] * share, angle / tick
    angle += draws[1] * math.sqrt(told[1] ** 2 * distance + told[3] ** 2 * bend)
    c, s = math.cos(state[9]), math.sin(state[9])
    state[7] += c * along - s * across
    state[8] += s * along + c * across
    state[9] += angle


@njit(cache=True, nogil=True)
def _obey(counters, queue, wanted, limits, tick):
    """Take the commands that are due from the queue; without one for too long the robot is to stand."""
    while counters[2] > 0 and queue[counters[1], 0] <= counters[0]:
        for i in range(3):
            wanted[i] = queue[counters[1], 1 + i]
        counters[1] = (counters[1] + 1) % queue.shape[0]
        counters[2] -= 1
        counters[4] = counters[0]
    if (counters[0] - counters[4]) * tick > limits[11]:
        wanted[:] = 0.0


@njit(cache=True, nogil=True)
def _step(state, tick):
    """Return dx, dy (in the frame of the body before) and the turn of one tick: the exact arc of a constant twist."""
    turn = state[5] * tick
    if abs(turn) > 1e-9:
        a, b = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn
    else:
        a, b = 1.0, 0.5 * turn
    return (a * state[3] - b * state[4]) * tick, (b * state[3] + a * state[4]) * tick, turn


@njit(cache=True, nogil=True)
def _note(events, found, tick, what, state, speed, approach):
    """Write a contact down if there is room, and return how many there are."""
    if found == events.shape[0]:
        return found
    events[found, 0], events[found, 1] = tick, what
    events[found, 2], events[found, 3], events[found, 4], events[found, 5] = state[0], state[1], speed, approach
    return found + 1


@njit(cache=True, nogil=True)
def _meet_walls(state, x, y, yaw, step, outline, radius, field, frame, shapes, touching, placed):
    """Return whether walls stop the step to a pose (1), even if the body only turned (2), or not (0); see `advance`.

    state[15] is the way that is surely free of walls: nothing is measured before it is used up.
    """
    state[15] -= step
    if state[15] > 0.0 and not touching[0]:
        return 0
    now = wall_gap(outline, radius, state[0], state[1], state[2], field, frame, shapes, _LOOK, placed)
    state[15] = now - step
    if state[15] <= 0.0:
        state[15] = 0.0
        then = wall_gap(outline, radius, x, y, yaw, field, frame, shapes, _LOOK, placed)
        if then <= 0.0 and (then < now or outline.shape[0] > 1) and step > 0.0:
            touching[0] = 1
            if outline.shape[0] == 1:
                return 1
            then = wall_gap(outline, radius, state[0], state[1], yaw, field, frame, shapes, _LOOK, placed)
            return 2 if then <= 0.0 else 1
    if now > _TOUCH_ENDS:
        touching[0] = 0
    return 0


@njit(cache=True, nogil=True)
def _last_part(state, x, y, yaw, outline, radius, field, frame, shapes, movers, placed):
    """Return the part of a step towards x, y with the heading after it, in 64ths, that leads up to the walls."""
    part = 0.0
    for i in range(1, 7):
        further = part + 0.5**i
        ax, ay = state[0] + further * (x - state[0]), state[1] + further * (y - state[1])
        gap = wall_gap(outline, radius, ax, ay, yaw, field, frame, shapes, _LOOK, placed)
        if gap > 0.0 and mover_gap(outline, radius, ax, ay, yaw, movers, placed) > 0.0:
            part = further
    return part


@njit(cache=True, nogil=True)
def advance(
    ticks, tick, state, counters, queue, wanted, limits, outline, radius, around, field, frame, shapes, movers,
    touching, told, draws, slip_draws, history, events,
):  # fmt: skip
    """Let `ticks` ticks pass and return how many contacts began; they stand in `events` (E, 6).

    `state` (16,) holds pose (yaw unwrapped), twist, steering, told pose, told twist, drift of distance and turn, and the
    way that is surely free of walls; `counters` (5,) the tick, head and count of the queue, ticks of slip left, tick of
    the last command. `queue` (Q, 4) holds due ticks and commands, `wanted` (3,) the one in effect. `movers` (M, 9) are
    rounded boxes and their velocities, `touching` (1 + M,) what the body touches (first: walls). `history` (T, 6) keeps
    poses and told poses of the last T ticks. An event is tick, what (-1 wall, else mover), x, y, speed, speed towards it.
    """
    found = 0
    placed = np.empty_like(outline)
    for k in range(ticks):
        counters[0] += 1
        _obey(counters, queue, wanted, limits, tick)
        _drive(state, wanted, limits, tick)
        for i in range(movers.shape[0]):
            movers[i, 0] += movers[i, 7] * tick
            movers[i, 1] += movers[i, 8] * tick
        dx, dy, turn = _step(state, tick)
        c, s = math.cos(state[2]), math.sin(state[2])
        x, y, yaw = state[0] + c * dx - s * dy, state[1] + s * dx + c * dy, state[2] + turn
        speed = math.hypot(state[3], state[4])
        step = math.hypot(dx, dy) + abs(turn) * (around - radius)
        before = touching[0]
        met = _meet_walls(state, x, y, yaw, step, outline, radius, field, frame, shapes, touching, placed)
        stopped, held = met > 0, met == 2
        if stopped and not before:
            found = _note(events, found, counters[0], -1, state, speed, speed + abs(state[5]) * (around - radius))
        for i in range(movers.shape[0]):
            box = movers[i]
            far = math.hypot(box[0] - x, box[1] - y) - box[4] - box[5] - box[6] - around
            then = far
            if far <= _TOUCH_ENDS:
                then = _box_gap(outline, radius, x, y, math.cos(yaw), math.sin(yaw), box, placed)
            if then > 0.0:
                if then > _TOUCH_ENDS:
                    touching[1 + i] = 0
                continue
            now = _box_gap(outline, radius, state[0], state[1], c, s, box, placed)
            if not touching[1 + i]:
                found = _note(events, found, counters[0], i, state, speed, max(now - then, 0.0) / tick)
            touching[1 + i] = 1
            if then < now - 1e-12:
                stopped = True
                then = _box_gap(outline, radius, state[0], state[1], math.cos(yaw), math.sin(yaw), box, placed)
                held = held or then < now - 1e-12
        if stopped:
            part = 0.0
            if held:
                yaw, turn, state[5] = state[2], 0.0, 0.0
            if met > 0 and step > 2e-3:  # a long last step goes on until the walls are reached
                part = _last_part(state, x, y, yaw, outline, radius, field, frame, shapes, movers, placed)
            dx, dy, state[3], state[4] = part * dx, part * dy, 0.0, 0.0
            x, y = state[0] + part * (x - state[0]), state[1] + part * (y - state[1])
        state[0], state[1], state[2] = x, y, yaw
        moving = abs(dx) + abs(dy) + abs(turn) > 1e-6
        _tell(state, dx, dy, turn, told, draws[k], slip_draws[k], moving, tick, counters)
        row = history[counters[0] % history.shape[0]]
        for i in range(3):
            row[i], row[3 + i] = state[i], state[7 + i]
    return found
