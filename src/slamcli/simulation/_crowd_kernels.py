# SPDX-License-Identifier: MIT
"""Kernels: people who walk by a social-force model; see `slamcli.simulation.social_force`.

A person is a row of 16: x, y, vx, vy, preferred speed, way walked, facing x and y, goal x and y, radius of arrival,
seconds without progress, least cost to the goal so far, the point x, y that is walked to, and seconds until another is
looked for.
"""

import math

import numpy as np
from numba import njit

_TAU = 0.54  # s, relaxation; this and the next six: Moussaid et al. 2009, table 1
_A = 4.5  # m/s^2
_GAMMA = 0.35
_N_SIDE, _N_AHEAD = 2.0, 3.0
_LAMBDA = 2.0
_THING_A, _THING_B = 10.0, 0.15  # m/s^2, m: nobody likes to touch a robot or a cart, wherever it moves
_PREFERS = 0.005  # rad/m: the side that is preferred
_WALL_A, _WALL_B = 3.0, 0.1
_SEES = 4.0  # m
_MOST_FORCE = 6.0  # m/s^2: nobody reacts harder
_PUSH = 40.0  # 1/s^2: bodies that overlap push each other apart
_LOOKS_EVERY = 0.2  # s
_AHEAD_M = 1.6  # how far down the costs people look


@njit(cache=True, nogil=True)
def room_at(room, frame, x, y):
    """Distance to the nearest wall on a field (H, W) of cells frame[2] wide from the corner frame[0:2]; 0 outside."""
    column, row = np.int64(math.floor((x - frame[0]) / frame[2])), np.int64(math.floor((y - frame[1]) / frame[2]))
    if row < 0 or column < 0 or row >= room.shape[0] or column >= room.shape[1]:
        return 0.0
    return np.float64(room[row, column])


@njit(cache=True, nogil=True)
def _is_clear(room, frame, ax, ay, bx, by, need):
    """Whether a straight line keeps `need` from walls."""
    length = math.hypot(bx - ax, by - ay)
    at = 0.0
    while at < length:
        share = at / length
        free = room_at(room, frame, ax + share * (bx - ax), ay + share * (by - ay))
        if free < need:
            return False
        at += max(free - need, 0.5 * frame[2])
    return room_at(room, frame, bx, by) >= need


@njit(cache=True, nogil=True)
def _descend(field, frame, x, y, room, need):
    """Return the farthest point in sight down the field of costs (h, w) with cells frame[3] wide, and the cost here."""
    size = frame[3]
    column, row = np.int64(math.floor((x - frame[0]) / size)), np.int64(math.floor((y - frame[1]) / size))
    row, column = min(max(row, 0), field.shape[0] - 1), min(max(column, 0), field.shape[1] - 1)
    here = field[row, column]
    tx, ty = x, y
    for step in range(max(np.int64(_AHEAD_M / size), 3)):
        best, to_row, to_column = field[row, column], row, column
        for r in range(max(row - 1, 0), min(row + 2, field.shape[0])):
            for c in range(max(column - 1, 0), min(column + 2, field.shape[1])):
                if field[r, c] < best:
                    best, to_row, to_column = field[r, c], r, c
        if to_row == row and to_column == column:
            break
        row, column = to_row, to_column
        px, py = frame[0] + (column + 0.5) * size, frame[1] + (row + 0.5) * size
        if step > 0 and not _is_clear(room, frame, x, y, px, py, need):
            break
        tx, ty = px, py
    return tx, ty, here


@njit(cache=True, nogil=True)
def _nearest_on_box(box, x, y):
    """Nearest point of a rounded box (7,) without its rounding to a point."""
    dx, dy = x - box[0], y - box[1]
    px, py = box[2] * dx + box[3] * dy, box[2] * dy - box[3] * dx
    px, py = min(max(px, -box[4]), box[4]), min(max(py, -box[5]), box[5])
    return box[0] + box[2] * px - box[3] * py, box[1] + box[3] * px + box[2] * py


@njit(cache=True, nogil=True)
def _interaction(gx, gy, vx, vy, ux, uy, extra, force):
    """Add to `force` (2,) how a person at (0, 0) with velocity v gives way to somebody at g with velocity u.

    Moussaid et al. 2009, eqs 5 to 8: slowing down along the direction of interaction t and turning aside of it. `extra`
    is how much larger than a person the other is. Everybody gives way to the right where both sides are equal.
    """
    centre = math.hypot(gx, gy)
    distance = max(centre - extra, 0.05)
    if distance > _SEES or centre < 1e-6:
        return
    ex, ey = gx / centre, gy / centre
    ix, iy = _LAMBDA * (vx - ux) + ex, _LAMBDA * (vy - uy) + ey
    size = math.hypot(ix, iy)
    if size < 1e-6:
        return
    tx, ty = ix / size, iy / size
    b = _GAMMA * size
    theta = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey) + _PREFERS * b
    slow = -_A * math.exp(-distance / b - (_N_AHEAD * b * theta) ** 2)
    turn = -_A * math.copysign(1.0, theta) * math.exp(-distance / b - (_N_SIDE * b * theta) ** 2)
    force[0] += slow * tx - turn * ty
    force[1] += slow * ty + turn * tx


@njit(cache=True, nogil=True)
def _keep_off(gx, gy, gap, force):
    """Add the repulsion from a thing whose nearest point lies at g, `gap` from the body (Helbing and Molnar 1995)."""
    far = math.hypot(gx, gy)
    if gap < 1.0 and far > 1e-6:
        push = _THING_A * math.exp(-max(gap, 0.0) / _THING_B) / far
        force[0] -= push * gx
        force[1] -= push * gy


@njit(cache=True, nogil=True)
def _wall_force(room, frame, x, y, radius, force):
    """Add the repulsion from the nearest wall; up the slope of the field of distances."""
    free = room_at(room, frame, x, y) - radius
    if free > 1.0:
        return
    reach = 2.0 * frame[2]
    sx = room_at(room, frame, x + reach, y) - room_at(room, frame, x - reach, y)
    sy = room_at(room, frame, x, y + reach) - room_at(room, frame, x, y - reach)
    size = math.hypot(sx, sy)
    if size > 1e-9:
        push = _WALL_A * math.exp(-max(free, 0.0) / _WALL_B)
        force[0] += push * sx / size
        force[1] += push * sy / size


@njit(cache=True, nogil=True)
def _outline_point(outline, x, y, c, s, px, py):
    """Nearest point to p on the outline (N, 2) of the robot at x, y with cos and sin of its yaw."""
    best, bx, by = np.inf, x, y
    for i in range(outline.shape[0]):
        j = i + 1 if i + 1 < outline.shape[0] else 0
        ax, ay = x + c * outline[i, 0] - s * outline[i, 1], y + s * outline[i, 0] + c * outline[i, 1]
        ex, ey = x + c * outline[j, 0] - s * outline[j, 1] - ax, y + s * outline[j, 0] + c * outline[j, 1] - ay
        length = ex * ex + ey * ey
        along = min(max(((px - ax) * ex + (py - ay) * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
        qx, qy = ax + along * ex, ay + along * ey
        far = (qx - px) ** 2 + (qy - py) ** 2
        if far < best:
            best, bx, by = far, qx, qy
    return bx, by


@njit(cache=True, nogil=True)
def _may_stand(room, frame, x, y, now_x, now_y, radius, robot, outline, keep, carts):
    """Whether a person may step from `now` to x, y: no nearer to a wall, the robot or a cart than they must keep."""
    free = room_at(room, frame, x, y)
    if free < radius and free <= room_at(room, frame, now_x, now_y):
        return False
    c, s = math.cos(robot[2]), math.sin(robot[2])
    qx, qy = _outline_point(outline, robot[0], robot[1], c, s, x, y)
    far = math.hypot(qx - x, qy - y)
    if far < keep:
        qx, qy = _outline_point(outline, robot[0], robot[1], c, s, now_x, now_y)
        if far <= math.hypot(qx - now_x, qy - now_y):
            return False
    for i in range(carts.shape[0]):
        qx, qy = _nearest_on_box(carts[i], x, y)
        far = math.hypot(qx - x, qy - y) - carts[i, 6]
        if far < radius:
            qx, qy = _nearest_on_box(carts[i], now_x, now_y)
            if far <= math.hypot(qx - now_x, qy - now_y) - carts[i, 6]:
                return False
    return True


@njit(cache=True, nogil=True)
def walk(
    step, people, targets, fields, field_frame, room, ways, way_ends, social, robot, outline, margin, carts, radius
):
    """Let everybody walk for `step` seconds and return how many need a new goal (targets[i, 0] is set to -1 for them).

    `targets` (P, 2) int64: the goal's field, and -1; or -2 and the point of `ways` (N, 2) that is walked to, on the way
    between way_ends[i, 0] and way_ends[i, 1]. `robot` (6,) is its pose and velocity in the map, `outline` and `margin` its
    body. `carts` (C, 9) are rounded boxes with velocities. Without `social` people keep to their way and wait for the
    robot.
    """
    count, asking = people.shape[0], 0
    before = people[:, :4].copy()
    force = np.zeros(2)
    c, s = math.cos(robot[2]), math.sin(robot[2])
    keep = radius + margin + 0.02
    for i in range(count):
        me = people[i]
        x, y, vx, vy = before[i, 0], before[i, 1], before[i, 2], before[i, 3]
        if targets[i, 0] == -2:
            tx, ty = ways[targets[i, 1], 0], ways[targets[i, 1], 1]
            if math.hypot(tx - x, ty - y) < 0.3:
                following = targets[i, 1] + 1
                targets[i, 1] = following if following < way_ends[i, 1] else way_ends[i, 0]
                tx, ty = ways[targets[i, 1], 0], ways[targets[i, 1], 1]
        else:
            me[11] += step
            me[15] -= step
            if me[15] <= 0.0:
                me[13], me[14], cost = _descend(fields[targets[i, 0]], field_frame, x, y, room, radius)
                me[15] = _LOOKS_EVERY
                if cost < me[12]:
                    me[11], me[12] = 0.0, cost
            tx, ty = me[13], me[14]
            if math.hypot(me[8] - x, me[9] - y) < me[10] or me[11] > 8.0:
                targets[i, 0] = -1
                asking += 1
        far = math.hypot(tx - x, ty - y)
        wx, wy = (me[4] * (tx - x) / far, me[4] * (ty - y) / far) if far > 1e-3 else (0.0, 0.0)
        qx, qy = _outline_point(outline, robot[0], robot[1], c, s, x, y)
        gap = math.hypot(qx - x, qy - y) - margin - radius
        if not social:
            nearer = (qx - x) * wx + (qy - y) * wy > 0.0
            if gap < 0.5 and nearer:
                wx, wy = 0.0, 0.0
            if gap < 0.2 and gap > -radius:
                far = max(math.hypot(qx - x, qy - y), 1e-6)
                wx, wy = wx - me[4] * (qx - x) / far, wy - me[4] * (qy - y) / far
            vx, vy = wx, wy
        else:
            force[0], force[1] = (wx - vx) / _TAU, (wy - vy) / _TAU
            for j in range(count):
                if j == i:
                    continue
                gx, gy = before[j, 0] - x, before[j, 1] - y
                if abs(gx) > _SEES or abs(gy) > _SEES:
                    continue
                _interaction(gx, gy, vx, vy, before[j, 2], before[j, 3], 0.0, force)
                far = math.hypot(gx, gy)
                if 1e-6 < far < 2.0 * radius:
                    force[0] -= _PUSH * (2.0 * radius - far) * gx / far
                    force[1] -= _PUSH * (2.0 * radius - far) * gy / far
            _interaction(qx - x, qy - y, vx, vy, robot[3], robot[4], margin - radius, force)
            _keep_off(qx - x, qy - y, gap, force)
            for j in range(carts.shape[0]):
                px, py = _nearest_on_box(carts[j], x, y)
                _interaction(px - x, py - y, vx, vy, carts[j, 7], carts[j, 8], carts[j, 6] - radius, force)
                _keep_off(px - x, py - y, math.hypot(px - x, py - y) - carts[j, 6] - radius, force)
            _wall_force(room, field_frame, x, y, radius, force)
            size = math.hypot(force[0], force[1])
            if size > _MOST_FORCE:
                force[0], force[1] = force[0] * _MOST_FORCE / size, force[1] * _MOST_FORCE / size
            vx, vy = vx + force[0] * step, vy + force[1] * step
            speed, most = math.hypot(vx, vy), 1.3 * me[4]
            if speed > most:
                vx, vy = vx * most / speed, vy * most / speed
        nx, ny = x + vx * step, y + vy * step
        if not _may_stand(room, field_frame, nx, ny, x, y, radius, robot, outline, keep, carts):
            if _may_stand(room, field_frame, nx, y, x, y, radius, robot, outline, keep, carts):
                ny = y
            elif _may_stand(room, field_frame, x, ny, x, y, radius, robot, outline, keep, carts):
                nx = x
            else:
                nx, ny = x, y
        me[2], me[3] = (nx - x) / step, (ny - y) / step
        me[0], me[1] = nx, ny
        speed = math.hypot(me[2], me[3])
        me[5] += speed * step
        if speed > 0.1:
            fx, fy = 0.7 * me[6] + 0.3 * me[2] / speed, 0.7 * me[7] + 0.3 * me[3] / speed
            size = math.hypot(fx, fy)
            if size > 1e-6:
                me[6], me[7] = fx / size, fy / size
    return asking


@njit(cache=True, nogil=True)
def see(people, step, radius, legs, leg_radius, apart, stride, bodies, seen):
    """Fill `bodies` (P, 9) with everybody's disc, and `seen` (P or 2 P, 9) with what a scanner meets: it, or two legs.

    People are shown where they were `step` seconds ago, with the velocity that brings them to where they are to be.
    """
    for i in range(people.shape[0]):
        me = people[i]
        x, y = me[0] - me[2] * step, me[1] - me[3] * step
        bodies[i, 0], bodies[i, 1], bodies[i, 2], bodies[i, 6] = x, y, 1.0, radius
        bodies[i, 7], bodies[i, 8] = me[2], me[3]
        if not legs:
            seen[i] = bodies[i]
            continue
        speed = math.hypot(me[2], me[3])
        phase = math.pi * (me[5] - speed * step) / stride
        swing, rate = 0.3 * stride * math.sin(phase), 0.3 * math.pi * speed * math.cos(phase)
        for k in range(2):
            way = 1.0 if k == 0 else -1.0
            leg = seen[2 * i + k]
            leg[0] = x + way * (-me[7] * apart / 2 + me[6] * swing)
            leg[1] = y + way * (me[6] * apart / 2 + me[7] * swing)
            leg[2], leg[6] = 1.0, leg_radius
            leg[7], leg[8] = me[2] + way * me[6] * rate, me[3] + way * me[7] * rate
