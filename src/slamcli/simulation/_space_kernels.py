# SPDX-License-Identifier: MIT
"""Kernel: exact intersections of rays in space with upright panels, boxes and cylinders, and with height fields.

Everything stands on a plan: rays walk through the cells of a coarse grid on it (Amanatides and Woo, A fast voxel
traversal algorithm for ray tracing, Eurographics 1987), which knows what stands in a cell and how high its ground lies.
"""

import math

import numpy as np
from numba import njit

_SLACK = 1e-9  # metres or share of a panel: rays through an edge that two faces share must not slip between them


@njit(cache=True, nogil=True)
def cast(origins, directions, panels, boxes, cylinders, starts, members, lows, highs, heights, layout, hits):
    """Lower `hits` (N, 3) range, reflectivity, cosine of incidence to the nearest hit of rays (N, 3), unit directions.

    `panels` (S, 7) x0, y0, x1, y1, low, high, reflectivity; `boxes` (B, 9) x, y, cos, sin, half length, half width, low,
    high, reflectivity; `cylinders` (C, 6) x, y, radius, low, high, reflectivity. Cell k of the coarse grid holds the
    things members[starts[k] : starts[k + 1]], counted through panels, boxes, cylinders. `heights` (F, H, W) are the nodes
    of height fields, `lows` and `highs` (F, h, w) their extremes in each coarse cell. `layout` is x, y of the grid's
    corner, the side of a fine and of a coarse cell, and the reflectivity of each field.
    """
    fields, rows, columns = lows.shape
    x0, y0, fine, coarse = layout[0], layout[1], layout[2], layout[3]
    ratio = np.int64(np.rint(coarse / fine))
    for i in range(origins.shape[0]):
        ox, oy, oz = origins[i, 0] - x0, origins[i, 1] - y0, origins[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        best, shine, cosine = hits[i, 0], hits[i, 1], hits[i, 2]
        enter, leave = _through_plan(ox, oy, dx, dy, columns * coarse, rows * coarse)
        leave = min(leave, best)
        if enter > leave:
            continue
        column = min(max(np.int64(np.floor((ox + enter * dx) / coarse)), 0), columns - 1)
        row = min(max(np.int64(np.floor((oy + enter * dy) / coarse)), 0), rows - 1)
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        next_x = ((column + (dx > 0)) * coarse - ox) / dx if dx != 0.0 else np.inf
        next_y = ((row + (dy > 0)) * coarse - oy) / dy if dy != 0.0 else np.inf
        per_x = abs(coarse / dx) if dx != 0.0 else np.inf
        per_y = abs(coarse / dy) if dy != 0.0 else np.inf
        at = enter
        while at <= leave:
            until = min(next_x, next_y, leave)
            near, far = oz + at * dz, oz + until * dz
            for f in range(fields):
                if min(near, far) <= highs[f, row, column] + _SLACK and max(near, far) >= lows[f, row, column] - _SLACK:
                    hit, slope = _field(
                        heights[f], row, column, ratio, fine, ox, oy, oz, dx, dy, dz, at, min(until, best)
                    )
                    if hit < best:
                        best, shine, cosine = hit, layout[4 + f], slope
            cell = row * columns + column
            for k in range(starts[cell], starts[cell + 1]):
                what = members[k]
                if what < panels.shape[0]:
                    hit, slope = _panel(panels[what], x0, y0, ox, oy, oz, dx, dy, dz)
                    colour = panels[what, 6]
                elif what < panels.shape[0] + boxes.shape[0]:
                    box = boxes[what - panels.shape[0]]
                    hit, slope = _box(box, x0, y0, ox, oy, oz, dx, dy, dz)
                    colour = box[8]
                else:
                    cylinder = cylinders[what - panels.shape[0] - boxes.shape[0]]
                    hit, slope = _cylinder(cylinder, x0, y0, ox, oy, oz, dx, dy, dz)
                    colour = cylinder[5]
                if hit < best:
                    best, shine, cosine = hit, colour, slope
            if best <= until:
                break
            at = until
            if next_x < next_y:
                next_x += per_x
                column += step_x
            else:
                next_y += per_y
                row += step_y
            if row < 0 or column < 0 or row >= rows or column >= columns:
                break
        hits[i, 0], hits[i, 1], hits[i, 2] = best, shine, cosine


@njit(cache=True, nogil=True)
def cast_bodies(origins, directions, times, bodies, reflectivity, hits):
    """Lower `hits` (N, 3) to the nearest of bodies (B, 7) x, y, radius, vx, vy, low, high; ray i is cast at times[i]."""
    cylinder = np.empty(6)
    for i in range(origins.shape[0]):
        for j in range(bodies.shape[0]):
            cylinder[0] = bodies[j, 0] + bodies[j, 3] * times[i]
            cylinder[1] = bodies[j, 1] + bodies[j, 4] * times[i]
            cylinder[2], cylinder[3], cylinder[4] = bodies[j, 2], bodies[j, 5], bodies[j, 6]
            hit, slope = _cylinder(
                cylinder, 0.0, 0.0, origins[i, 0], origins[i, 1], origins[i, 2],
                directions[i, 0], directions[i, 1], directions[i, 2],
            )  # fmt: skip
            if hit < hits[i, 0]:
                hits[i, 0], hits[i, 1], hits[i, 2] = hit, reflectivity, slope


@njit(cache=True, nogil=True)
def _through_plan(ox, oy, dx, dy, width, height):
    """Part of a ray above the rectangle [0, width] x [0, height]: where it enters (at least 0) and leaves."""
    enter, leave = 0.0, np.inf
    for origin, direction, size in ((ox, dx, width), (oy, dy, height)):
        if direction == 0.0:
            if origin < 0.0 or origin > size:
                return 1.0, 0.0
        else:
            a, b = -origin / direction, (size - origin) / direction
            enter = max(enter, min(a, b))
            leave = min(leave, max(a, b))
    return enter, leave


@njit(cache=True, nogil=True)
def _panel(panel, x0, y0, ox, oy, oz, dx, dy, dz):
    """Range to an upright panel (inf without a hit) and cosine of incidence."""
    ax, ay = panel[0] - x0 - ox, panel[1] - y0 - oy
    ex, ey = panel[2] - panel[0], panel[3] - panel[1]
    denominator = dx * ey - dy * ex
    if abs(denominator) < 1e-12:
        return np.inf, 0.0
    distance = (ax * ey - ay * ex) / denominator
    along = (ax * dy - ay * dx) / denominator
    if distance < 0.0 or not -_SLACK <= along <= 1.0 + _SLACK:
        return np.inf, 0.0
    z = oz + distance * dz
    if z < panel[4] - _SLACK or z > panel[5] + _SLACK:
        return np.inf, 0.0
    return distance, abs(denominator) / math.hypot(ex, ey)


@njit(cache=True, nogil=True)
def _box(box, x0, y0, ox, oy, oz, dx, dy, dz):
    """Range to a solid box turned about the upright (inf without a hit; from inside: its far side) and cosine of incidence."""
    rx, ry = ox - (box[0] - x0), oy - (box[1] - y0)
    c, s = box[2], box[3]
    enter, leave, cosine, cosine_out = -np.inf, np.inf, 0.0, 0.0
    for origin, direction, low, high in (
        (c * rx + s * ry, c * dx + s * dy, -box[4], box[4]),
        (c * ry - s * rx, c * dy - s * dx, -box[5], box[5]),
        (oz, dz, box[6], box[7]),
    ):
        if direction == 0.0:
            if origin < low or origin > high:
                return np.inf, 0.0
            continue
        a, b = (low - origin) / direction, (high - origin) / direction
        if a > b:
            a, b = b, a
        if a > enter:
            enter, cosine = a, abs(direction)
        if b < leave:
            leave, cosine_out = b, abs(direction)
    if enter > leave or leave < 0.0:
        return np.inf, 0.0
    if enter < 0.0:
        return leave, cosine_out
    return enter, cosine


@njit(cache=True, nogil=True)
def _cylinder(cylinder, x0, y0, ox, oy, oz, dx, dy, dz):
    """Range to a solid upright cylinder (inf without a hit; from inside: its far side) and cosine of incidence."""
    cx, cy, radius = cylinder[0] - x0 - ox, cylinder[1] - y0 - oy, cylinder[2]
    flat = dx * dx + dy * dy
    enter, leave, round_in, round_out = -np.inf, np.inf, False, False
    if flat > 0.0:
        along, across = (cx * dx + cy * dy) / flat, cx * dy - cy * dx
        half = (radius * radius - across * across / flat) / flat
        if half < 0.0:
            return np.inf, 0.0
        enter, leave, round_in, round_out = along - math.sqrt(half), along + math.sqrt(half), True, True
    elif cx * cx + cy * cy > radius * radius:
        return np.inf, 0.0
    if dz != 0.0:
        a, b = (cylinder[3] - oz) / dz, (cylinder[4] - oz) / dz
        if a > b:
            a, b = b, a
        if a > enter:
            enter, round_in = a, False
        if b < leave:
            leave, round_out = b, False
    elif oz < cylinder[3] or oz > cylinder[4]:
        return np.inf, 0.0
    if enter > leave or leave < 0.0:
        return np.inf, 0.0
    hit, on_side = (leave, round_out) if enter < 0.0 else (enter, round_in)
    if on_side:
        return hit, abs(((cx - hit * dx) * dx + (cy - hit * dy) * dy) / radius)
    return hit, abs(dz)


@njit(cache=True, nogil=True)
def _field(heights, row, column, ratio, fine, ox, oy, oz, dx, dy, dz, enter, leave):
    """Range to a height field inside one coarse cell (inf without a hit) and cosine of incidence.

    Each fine cell is two triangles over its corners, split from its upper left to its lower right one.
    """
    first_c, first_r = column * ratio, row * ratio
    c = min(max(np.int64(np.floor((ox + enter * dx) / fine)), first_c), first_c + ratio - 1)
    r = min(max(np.int64(np.floor((oy + enter * dy) / fine)), first_r), first_r + ratio - 1)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = ((c + (dx > 0)) * fine - ox) / dx if dx != 0.0 else np.inf
    next_y = ((r + (dy > 0)) * fine - oy) / dy if dy != 0.0 else np.inf
    per_x = abs(fine / dx) if dx != 0.0 else np.inf
    per_y = abs(fine / dy) if dy != 0.0 else np.inf
    at = enter
    while at <= leave:
        until = min(next_x, next_y, leave)
        u0, v0 = (ox + at * dx) / fine - c, (oy + at * dy) / fine - r
        u1, v1 = (ox + until * dx) / fine - c, (oy + until * dy) / fine - r
        z0, z1 = oz + at * dz, oz + until * dz
        a, b, d, e = heights[r, c], heights[r, c + 1], heights[r + 1, c], heights[r + 1, c + 1]
        hit, cosine = np.inf, 0.0
        for lower in (True, False):
            if lower:
                base, along, up = a, b - a, d - a
            else:
                base, along, up = b + d - e, e - d, e - b
            above0, above1 = z0 - (base + along * u0 + up * v0), z1 - (base + along * u1 + up * v1)
            if (above0 > 0.0 and above1 > 0.0) or (above0 < 0.0 and above1 < 0.0):
                continue
            share = above0 / (above0 - above1) if above0 != above1 else 0.0
            diagonal = (u0 + share * (u1 - u0)) + (v0 + share * (v1 - v0))
            if (lower and diagonal > 1.0 + _SLACK) or (not lower and diagonal < 1.0 - _SLACK):
                continue
            if at + share * (until - at) < hit:
                hit = at + share * (until - at)
                gx, gy = along / fine, up / fine
                cosine = abs(dz - gx * dx - gy * dy) / math.sqrt(1.0 + gx * gx + gy * gy)
        if hit < np.inf:
            return hit, cosine
        at = until
        if next_x < next_y:
            next_x += per_x
            c += step_x
        else:
            next_y += per_y
            r += step_y
        if c < first_c or r < first_r or c >= first_c + ratio or r >= first_r + ratio:
            break
    return np.inf, 0.0
