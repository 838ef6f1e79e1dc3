# SPDX-License-Identifier: MIT
"""Naive twins of the layered costmap's kernels: cell by cell, everything anew, as costmap_2d's documents describe it."""

from __future__ import annotations

import math

import numpy as np

from slamcli.navigation.costmap import compute_costmap

UNKNOWN, LETHAL, INSCRIBED = 255, 254, 253


def line(start: tuple[int, int], end: tuple[int, int]) -> list[tuple[int, int]]:
    """Cells from start to end (row, column): one per row or column, in closed form."""
    (r0, c0), (r1, c1) = start, end
    rows, columns = abs(r1 - r0), abs(c1 - c0)
    sign_r, sign_c = (1 if r1 > r0 else -1), (1 if c1 > c0 else -1)
    if columns >= rows:
        return [
            (r0 + sign_r * ((columns // 2 + k * rows) // max(columns, 1)), c0 + sign_c * k) for k in range(columns + 1)
        ]
    return [(r0 + sign_r * k, c0 + sign_c * ((rows // 2 + k * columns) // rows)) for k in range(rows + 1)]


def clear(costs, origin, ends, corner, resolution, most_m, least_m=0.0) -> None:
    height, width = costs.shape
    x0, y0 = (origin[0] - corner[0]) / resolution, (origin[1] - corner[1]) / resolution
    if not (0 <= x0 < width and 0 <= y0 < height):
        return
    for end in ends:
        x1, y1 = (end[0] - corner[0]) / resolution, (end[1] - corner[1]) / resolution
        share = 1.0
        for a, b, size in ((x0, x1, width), (y0, y1, height)):
            if b < 0:
                share = min(share, -a / (b - a))
            if b > size:
                share = min(share, (size - a) / (b - a))
        start = (int(y0), int(x0))
        last = (
            min(max(int(y0 + (y1 - y0) * share), 0), height - 1),
            min(max(int(x0 + (x1 - x0) * share), 0), width - 1),
        )
        cells = line(start, last)
        length = math.hypot(last[0] - start[0], last[1] - start[1])
        most, least = math.ceil(most_m / resolution), least_m / resolution
        if length < least:
            continue
        if length > 0:
            count = int(min(1.0, most / length) * (len(cells) - 1))
            cells = cells[math.ceil(least / length * (len(cells) - 1)) : count + 1]
        for cell in cells:
            costs[cell] = 0


def mark(costs, origin, points, corner, resolution, most_m, least_m=0.0, low_m=-1000.0, high_m=2.0) -> None:
    for x, y, z in points:
        distance = math.dist((x, y, z), origin)
        column, row = math.floor((x - corner[0]) / resolution), math.floor((y - corner[1]) / resolution)
        if (
            low_m <= z <= high_m
            and least_m <= distance < most_m
            and 0 <= row < costs.shape[0]
            and 0 <= column < costs.shape[1]
        ):
            costs[row, column] = LETHAL


def outline(costs, polygon, pose, corner, resolution) -> None:
    """Free the polygon under the robot, if all of its corners are on the map."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    cells = []
    for x, y in polygon:
        column = math.floor((pose[0] + c * x - s * y - corner[0]) / resolution)
        row = math.floor((pose[1] + s * x + c * y - corner[1]) / resolution)
        if not (0 <= row < costs.shape[0] and 0 <= column < costs.shape[1]):
            return
        cells.append((row, column))
    edges = {cell for a, b in zip(cells, cells[1:] + cells[:1], strict=True) for cell in line(a, b)}
    for column in {c for _, c in edges}:
        rows = [r for r, c in edges if c == column]
        for row in range(min(rows), max(rows) + 1):
            costs[row, column] = 0


def put(layer, out, method) -> None:
    """Combine a layer with those below: true overwrite, overwrite (0), maximum (1)."""
    for cell in np.ndindex(*out.shape):
        value, old = int(layer[cell]), int(out[cell])
        if (
            method == "all"
            or (method == 0 and value != UNKNOWN)
            or (method == 1 and value != UNKNOWN and (old == UNKNOWN or old < value))
        ):
            out[cell] = value


def inflated(below, resolution, inscribed_m, radius_m, factor, *, inflate_unknown=False):
    """Costs with inflation, from the nearest of all obstacles."""
    out = below.copy()
    reach = math.ceil(radius_m / resolution)
    obstacles = np.argwhere(below == LETHAL)
    if reach == 0 or not len(obstacles):
        return out
    for cell in np.ndindex(*below.shape):
        squared = int(((obstacles - np.array(cell)) ** 2).sum(axis=1).min())
        if squared > reach * reach:
            continue
        distance = math.sqrt(squared) * resolution
        cost = INSCRIBED if distance <= inscribed_m else int(252 * math.exp(-factor * (distance - inscribed_m)))
        cost = LETHAL if squared == 0 else cost
        if below[cell] == UNKNOWN:
            out[cell] = cost if cost >= (1 if inflate_unknown else INSCRIBED) else UNKNOWN
        else:
            out[cell] = max(cost, int(below[cell]))
    return out


class NaiveCostmap:
    """A costmap of one static map (or none), one obstacle layer, and inflation, which computes everything anew."""

    def __init__(self, parameters, grid=None) -> None:
        self.own = parameters.costmap
        self.layer = next(layer for layer in parameters.layers if layer.kind == "obstacle")
        self.default = UNKNOWN if self.own.track_unknown else 0
        if grid is None:
            shape = (round(self.own.height / self.own.resolution), round(self.own.width / self.own.resolution))
            self.static, self.resolution = None, self.own.resolution
            self.corner = np.array([self.own.origin_x, self.own.origin_y])
        else:
            import dataclasses

            plain = dataclasses.replace(self.own, inflation_enabled=False)
            self.static, self.resolution = compute_costmap(grid, plain).costs, grid.resolution_m
            shape, self.corner = self.static.shape, np.array(grid.origin[:2])
        self.obstacles = np.full(shape, self.default, dtype=np.uint8)

    def update(self, observations, polygon, pose, inscribed_m):
        if self.own.rolling_window:
            self._follow(pose)
        parameters = self.layer.obstacle
        for observation in observations:
            for ends in (observation.points, observation.clear_points):
                clear(self.obstacles, observation.origin, ends, self.corner, self.resolution, parameters.raytrace_range)
        for observation in observations:
            mark(
                self.obstacles,
                observation.origin,
                observation.points,
                self.corner,
                self.resolution,
                parameters.obstacle_range,
            )
        outline(self.obstacles, polygon, pose, self.corner, self.resolution)
        below = np.full(self.obstacles.shape, self.default, dtype=np.uint8)
        if self.static is not None:
            put(self.static, below, "all")
        put(self.obstacles, below, parameters.combination_method)
        return inflated(
            below,
            self.resolution,
            inscribed_m,
            self.own.inflation_radius,
            self.own.cost_scaling_factor,
            inflate_unknown=self.own.inflate_unknown,
        )

    def _follow(self, pose) -> None:
        height, width = self.obstacles.shape
        steps = []
        for k, size in ((1, height), (0, width)):
            wanted = pose[k] - (size - 0.5) * self.resolution / 2
            steps.append(math.trunc((wanted - self.corner[k]) / self.resolution))
        moved = np.full_like(self.obstacles, self.default)
        for row, column in np.ndindex(height, width):
            r, c = row + steps[0], column + steps[1]
            if 0 <= r < height and 0 <= c < width:
                moved[row, column] = self.obstacles[r, c]
        self.obstacles = moved
        self.corner = self.corner + np.array([steps[1], steps[0]]) * self.resolution
