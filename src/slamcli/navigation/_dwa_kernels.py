# SPDX-License-Identifier: MIT
"""Compiled scoring of sampled motions: rollout, footprint, and the critics of DWAPlannerROS in one pass.

One file, as a kernel calls helpers of its own file only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LETHAL = 254
EPSILON = 1e-4
OSCILLATES, OBSTACLE, BLOCKED, UNREACHABLE, OFF_MAP, NOT_SAMPLED, PRUNED = -5.0, -6.0, -3.0, -2.0, -4.0, -1.0, -9.0
"""Why a motion is out; base_local_planner's numbers, but for the last two."""
OSCILLATION, OBSTACLES, FRONT, ALIGNMENT, PATH, GOAL, TWIRLING, TOTAL = 0, 1, 2, 3, 4, 5, 6, 7
"""Columns of the table of costs."""


@njit(cache=True, nogil=True)
def between_cost(costs, r0, c0, r1, c1):
    """Return the greatest cost on the cells of a line without its ends."""
    dr = abs(r1 - r0)
    dc = abs(c1 - c0)
    step_r = 1 if r1 >= r0 else -1
    step_c = 1 if c1 >= c0 else -1
    steep = dr > dc
    length = dr if steep else dc
    add = dc if steep else dr
    error = length // 2
    r = r0
    c = c0
    worst = 0
    for _ in range(length - 1):
        error += add
        side = error >= length
        if side:
            error -= length
        if steep:
            r += step_r
            if side:
                c += step_c
        else:
            c += step_c
            if side:
                r += step_r
        worst = max(worst, int(costs[r, c]))
    return worst


@njit(cache=True, nogil=True)
def outline_cost(costs, footprint, x, y, cosine, sine, scale, origin_x, origin_y, resolution):
    """Return the greatest cost under the outline, -1 on an obstacle or unknown cell or off the costmap."""
    height, width = costs.shape
    count = len(footprint)
    worst = 0
    first_r = 0
    first_c = 0
    last_r = 0
    last_c = 0
    for i in range(count + 1):
        r = first_r
        c = first_c
        if i < count:
            px = footprint[i, 0] * scale
            py = footprint[i, 1] * scale
            c = math.floor((x + cosine * px - sine * py - origin_x) / resolution)
            r = math.floor((y + sine * px + cosine * py - origin_y) / resolution)
            if r < 0 or c < 0 or r >= height or c >= width:
                return -1
            worst = max(worst, int(costs[r, c]))
        if i == 0:
            first_r = r
            first_c = c
        elif abs(r - last_r) > 1 or abs(c - last_c) > 1:
            worst = max(worst, between_cost(costs, last_r, last_c, r, c))
        if worst >= LETHAL:
            return -1
        last_r = r
        last_c = c
    return worst


@njit(cache=True, nogil=True)
def clearance_squared(costs, x, y, radius, origin_x, origin_y, resolution):
    """Return the squared distance in cells from a point to the nearest obstacle's centre within `radius` cells."""
    height, width = costs.shape
    fc = (x - origin_x) / resolution - 0.5
    fr = (y - origin_y) / resolution - 0.5
    c0 = math.floor(fc + 0.5)
    r0 = math.floor(fr + 0.5)
    nearest = 2.0 * (radius + 1.0) * (radius + 1.0)
    for r in range(max(0, r0 - radius), min(height, r0 + radius + 1)):
        for c in range(max(0, c0 - radius), min(width, c0 + radius + 1)):
            if costs[r, c] == LETHAL:
                squared = (r - fr) * (r - fr) + (c - fc) * (c - fc)
                if squared < nearest:
                    nearest = squared
    return nearest


@njit(cache=True, nogil=True)
def roll_out(pose, twist, sample, acc, rollout, goal, accelerate, points):
    """Write a motion, float64 (N, 5): x, y, yaw, its cosine and sine; return N, 0 for none.

    The first point is the pose itself; the place after the whole of sim_time is not among them, as in base_local_planner.
    `goal` is x, y, a radius and a time: motions end so long after they come within the radius, apart from the time that
    braking takes (negative radius: they do not).
    """
    speed = math.hypot(sample[0], sample[1])
    steps = math.ceil(max(speed * rollout[0] / rollout[1], abs(sample[2]) * rollout[0] / rollout[2]))
    if steps <= 0:
        return 0
    steps = min(steps, len(points))
    dt = rollout[0] / steps
    x, y, yaw = pose[0], pose[1], pose[2]
    vx, vy, w = sample[0], sample[1], sample[2]
    if accelerate:
        vx = towards(sample[0], twist[0], acc[0] * dt)
        vy = towards(sample[1], twist[1], acc[1] * dt)
        w = towards(sample[2], twist[2], acc[2] * dt)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    cosine_step, sine_step = math.cos(w * dt), math.sin(w * dt)
    end = steps
    for i in range(steps):
        if i >= end:
            return i
        if end == steps and math.hypot(goal[0] - x, goal[1] - y) <= goal[2]:
            braking = 0.5 * speed / max(acc[0], acc[1], 1e-3)
            end = min(steps, i + 1 + math.ceil((goal[3] + braking) / dt))
        points[i, 0], points[i, 1], points[i, 2], points[i, 3], points[i, 4] = x, y, yaw, cosine, sine
        if accelerate:
            vx = towards(sample[0], vx, acc[0] * dt)
            vy = towards(sample[1], vy, acc[1] * dt)
            w = towards(sample[2], w, acc[2] * dt)
        x += (vx * cosine - vy * sine) * dt
        y += (vx * sine + vy * cosine) * dt
        yaw += w * dt
        if accelerate:
            cosine, sine = math.cos(yaw), math.sin(yaw)
        else:
            cosine, sine = cosine * cosine_step - sine * sine_step, sine * cosine_step + cosine * sine_step
    return steps


@njit(cache=True, nogil=True)
def towards(target, value, step):
    """Return `value` moved towards `target` by at most `step`."""
    if value < target:
        return min(target, value + step)
    return max(target, value - step)


@njit(cache=True, nogil=True)
def allowed(sample, min_trans, max_trans, min_theta, forbidden):
    """Return 0 for a motion to be looked at, otherwise why it is out; `forbidden` has a bit for each sense of direction."""
    speed = math.hypot(sample[0], sample[1])
    if speed + EPSILON < min_trans and abs(sample[2]) + EPSILON < min_theta:
        return NOT_SAMPLED
    if speed - EPSILON > max_trans:
        return NOT_SAMPLED
    for k in range(3):
        if (sample[k] > 0.0 and forbidden & (1 << (2 * k))) or (sample[k] < 0.0 and forbidden & (2 << (2 * k))):
            return OSCILLATES
    return 0.0


@njit(cache=True, nogil=True)
def grid_costs(points, count, grids, origin_x, origin_y, resolution, shift, soft, row):
    """Write the four distances, cells, at a motion's end to `row`; return 0, or why it is out.

    `grids` are the distances to the goal ahead, the plan and the goal. With `soft` a point ahead that is blocked counts as
    if there were a free detour of twice its distance.
    """
    height, width = grids.shape[1:]
    size = height * width
    r = 0
    c = 0
    front_r = 0
    front_c = 0
    far_x = width * resolution - shift
    far_y = height * resolution - shift
    for i in range(count):
        x = points[i, 0] - origin_x
        y = points[i, 1] - origin_y
        c = math.floor(x / resolution)
        r = math.floor(y / resolution)
        if r < 0 or c < 0 or r >= height or c >= width:
            return OFF_MAP
        if i == count - 1 or x <= shift or y <= shift or x >= far_x or y >= far_y:
            front_c = math.floor((x + shift * points[i, 3]) / resolution)
            front_r = math.floor((y + shift * points[i, 4]) / resolution)
            if front_r < 0 or front_c < 0 or front_r >= height or front_c >= width:
                return OFF_MAP
        for k in range(1, 3):
            if grids[k, r, c] == size:
                return BLOCKED
            if grids[k, r, c] == size + 1:
                return UNREACHABLE
    if count == 0:
        return 0.0
    row[FRONT] = grids[0, front_r, front_c]
    row[ALIGNMENT] = grids[1, front_r, front_c]
    row[PATH] = grids[1, r, c]
    row[GOAL] = grids[2, r, c]
    if soft:
        detour = 2.0 * math.ceil(shift / resolution)
        if row[FRONT] >= size:
            row[FRONT] = row[GOAL] + detour
        if row[ALIGNMENT] >= size:
            row[ALIGNMENT] = row[PATH] + detour
    return 0.0


@njit(cache=True, nogil=True)
def obstacle_cost(
    points, count, costs, around, reach, footprint, scale, origin_x, origin_y, resolution, sum_scores, escape, most
):
    """Return the greatest cost (or the sum of costs) under the footprint along a motion, OBSTACLE if it hits one.

    `around` has the greatest cost within `reach` cells of each cell, which saves looking where nothing can be found. With
    `escape` a motion that begins in an obstacle may go on as long as it does not come nearer to it, if it ends free or a
    fifth of a cell farther away (turning in place need not). Costs above `most` need not be exact. A motion that begins free is looked at from its end, where there are more obstacles.
    """
    height, width = costs.shape
    total = 0.0
    clearance = -1.0
    least = 0.0
    backward = False
    for k in range(count):
        if k == 1:
            backward = clearance < 0.0
        i = count - k if backward else k
        x = points[i, 0]
        y = points[i, 1]
        c = math.floor((x - origin_x) / resolution)
        r = math.floor((y - origin_y) / resolution)
        inner = r >= reach and c >= reach and r + reach < height and c + reach < width
        if inner:
            bound = around[r, c]
            if bound == 0 or (bound < LETHAL and not sum_scores and bound <= total):
                clearance = -1.0
                continue
        elif r < 0 or c < 0 or r >= height or c >= width:
            return OBSTACLE
        cost = outline_cost(costs, footprint, x, y, points[i, 3], points[i, 4], scale, origin_x, origin_y, resolution)
        if cost < 0:
            if not escape or (i > 0 and clearance < 0.0):
                return OBSTACLE
            now = clearance_squared(costs, x, y, reach, origin_x, origin_y, resolution)
            if i > 0 and now < clearance - 1e-9:
                return OBSTACLE
            if i == 0:
                least = now
            clearance = now
            cost = LETHAL - 1
        else:
            clearance = -1.0
        value = float(max(cost, int(costs[r, c])))
        total = total + value if sum_scores else max(total, value)
        if total > most:
            return total
    if count > 1 and clearance >= 0.0 and math.sqrt(clearance) < math.sqrt(least) + 0.2:
        return OBSTACLE
    return total


@njit(cache=True, nogil=True)
def score(
    samples, pose, twist, acc, rollout, goal, limits, forbidden, costs, around, reach, footprint, grids, origin,
    resolution, scales, shift, growth, switches, points, commands, table,
):  # fmt: skip
    """Fill the table of costs, float64 (S, 8), and the commands (S, 3); return the cheapest motion's row, -1 for none.

    What distances cost comes first. Then footprints are laid down from the cheapest motion on, until no other can be
    cheaper; the first of equals is taken.

    Parameters
    ----------
    rollout
        sim_time, sim_granularity, angular_sim_granularity.
    goal
        See `roll_out`.
    limits
        min_vel_trans, max_vel_trans, min_vel_theta.
    scales
        float64 (7,), one for each critic; a critic of scale 0 costs nothing (obstacles are hit all the same).
    growth
        Speed from which the footprint grows, by how much it has grown at the highest speed, and its size before.
    switches
        bool (6,): accelerate along the motion, sum scores, escape, soft nose, turns in place hit nothing, prune.
    """
    accelerate, prune = switches[0], switches[5]
    known = np.empty(len(samples))
    for s in range(len(samples)):
        known[s] = distance_costs(
            samples[s], pose, twist, acc, rollout, goal, limits, forbidden, grids, origin, resolution, scales, shift,
            accelerate, switches[3], points, commands[s], table[s],
        )  # fmt: skip
    best = -1
    for s in np.argsort(known, kind="mergesort"):
        row = table[s]
        most = np.inf
        if prune:
            if row[TOTAL] < 0.0:
                continue
            if best >= 0:
                if known[s] > table[best, TOTAL] + 1e-9:
                    row[TOTAL] = PRUNED
                    continue
                if scales[OBSTACLES] > 0.0:
                    most = (table[best, TOTAL] + 1e-9 - known[s]) / scales[OBSTACLES]
        elif row[TOTAL] == NOT_SAMPLED or row[TOTAL] == OSCILLATES:
            continue
        count = roll_out(pose, twist, samples[s], acc, rollout, goal, accelerate, points)
        speed = math.hypot(commands[s, 0], commands[s, 1])
        scale = growth[2]
        if growth[1] > 0.0 and speed > growth[0] and limits[1] > growth[0]:
            scale *= 1.0 + growth[1] * (speed - growth[0]) / (limits[1] - growth[0])
        turns = switches[4] and speed == 0.0
        cost = obstacle_cost(
            points, 1 if turns else count, costs, around, reach, footprint, scale, origin[0], origin[1], resolution,
            switches[1], switches[2] or turns, most,
        )  # fmt: skip
        if cost < 0.0:
            row[TOTAL] = cost
        if row[TOTAL] < 0.0:
            continue
        row[OBSTACLES] = cost * scales[OBSTACLES]
        row[TOTAL] = row[:TOTAL].sum()
        if best < 0 or row[TOTAL] < table[best, TOTAL] or (row[TOTAL] == table[best, TOTAL] and s < best):
            best = s
    return best


@njit(cache=True, nogil=True)
def distance_costs(
    sample, pose, twist, acc, rollout, goal, limits, forbidden, grids, origin, resolution, scales, shift, accelerate,
    soft, points, command, row,
):  # fmt: skip
    """Fill a motion's command and all costs but that of obstacles; return their sum, inf for a motion that is out."""
    row[:] = 0.0
    row[TOTAL] = allowed(sample, limits[0], limits[1], limits[2], forbidden)
    if row[TOTAL] < 0.0:
        return np.inf
    count = roll_out(pose, twist, sample, acc, rollout, goal, accelerate, points)
    if count == 0:
        row[TOTAL] = NOT_SAMPLED
        return np.inf
    for k in range(3):
        command[k] = towards(sample[k], twist[k], acc[k] * rollout[0] / count) if accelerate else sample[k]
    row[TOTAL] = grid_costs(points, count, grids, origin[0], origin[1], resolution, shift, soft, row)
    if row[TOTAL] < 0.0:
        row[FRONT:TOTAL] = 0.0
        return np.inf
    row[TWIRLING] = abs(command[2])
    for k in range(FRONT, TOTAL):
        row[k] *= scales[k]
    return row[FRONT:TOTAL].sum()
