# SPDX-License-Identifier: MIT
"""DWAPlannerROS written down step by step, as slowly as it likes: the naive twin of slamcli.navigation.dwa_scoring."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.dwa_parameters import DwaParameters


class NaiveDwa:
    """One control cycle without extensions."""

    def __init__(self, p: DwaParameters, window: CostWindow, plan: np.ndarray, pose: np.ndarray, scaling: str) -> None:
        self.p, self.window, self.pose = p, window, pose
        self.height, self.width = window.costs.shape
        self.path = self.grid(self.cells(plan))
        self.goal = self.grid(self.cells(plan)[-1:])
        away = math.hypot(*(plan[-1, :2] - pose[:2]))
        angle = math.atan2(plan[-1, 1] - pose[1], plan[-1, 0] - pose[0])
        nose = plan.copy()
        nose[-1, 0] += p.forward_point_distance * math.cos(angle)
        nose[-1, 1] += p.forward_point_distance * math.sin(angle)
        self.front = self.grid(self.cells(nose)[-1:])
        res = window.resolution_m
        path, goal = res * p.path_distance_bias, res * p.goal_distance_bias
        occupied = p.occdist_scale
        if scaling == "kinetic":
            path, goal, occupied = path / 2, goal / 2, occupied * res
        aligned = away**2 > p.forward_point_distance**2 * p.cheat_factor
        self.scales = [1.0, occupied, goal, path if aligned else 0.0, path, goal, p.twirling_scale]

    def cell(self, x: float, y: float) -> tuple[int, int] | None:
        r = math.floor((y - self.window.origin_m[1]) / self.window.resolution_m)
        c = math.floor((x - self.window.origin_m[0]) / self.window.resolution_m)
        return (r, c) if 0 <= r < self.height and 0 <= c < self.width else None

    def cells(self, plan: np.ndarray) -> list[tuple[int, int]]:
        points = [plan[0, :2]]
        for a, b in zip(plan[:-1, :2], plan[1:, :2], strict=True):
            steps = max(math.ceil(math.dist(a, b) / self.window.resolution_m), 1)
            points += [b + (j / steps - 1.0) * (b - a) for j in range(1, steps + 1)]
        found: list[tuple[int, int]] = []
        for x, y in points:
            at = self.cell(x, y)
            if at is not None and self.window.costs[at] != 255:
                found.append(at)
            elif found:
                break
        return found

    def grid(self, targets: list[tuple[int, int]]) -> dict[tuple[int, int], int]:
        size = self.height * self.width
        distance = {(r, c): size + 1 for r in range(self.height) for c in range(self.width)}
        queue = deque(targets)
        distance.update(dict.fromkeys(targets, 0))
        while queue:
            r, c = queue.popleft()
            for near in ((r, c - 1), (r, c + 1), (r - 1, c), (r + 1, c)):
                if distance.get(near) != size + 1:
                    continue
                if self.window.costs[near] >= 253:
                    distance[near] = size
                else:
                    distance[near] = distance[r, c] + 1
                    queue.append(near)
        return distance

    def motion(self, sample: np.ndarray, twist: np.ndarray) -> tuple[list[list[float]], list[float]] | None:
        p = self.p
        speed = math.hypot(sample[0], sample[1])
        if speed + 1e-4 < p.min_vel_trans and abs(sample[2]) + 1e-4 < p.min_vel_theta:
            return None
        if speed - 1e-4 > p.max_vel_trans:
            return None
        steps = math.ceil(
            max(speed * p.sim_time / p.sim_granularity, abs(sample[2]) * p.sim_time / p.angular_sim_granularity)
        )
        if steps == 0:
            return None
        dt = p.sim_time / steps
        acc = [p.acc_lim_x, p.acc_lim_y, p.acc_lim_theta]

        def closer(now: list[float]) -> list[float]:
            return [
                min(t, v + a * dt) if v < t else max(t, v - a * dt) for t, v, a in zip(sample, now, acc, strict=True)
            ]

        velocity = list(sample) if p.use_dwa else closer(list(twist))
        command = list(velocity)
        x, y, yaw = self.pose
        points = []
        for _ in range(steps):
            points.append([x, y, yaw])
            if not p.use_dwa:
                velocity = closer(velocity)
            x += (velocity[0] * math.cos(yaw) - velocity[1] * math.sin(yaw)) * dt
            y += (velocity[0] * math.sin(yaw) + velocity[1] * math.cos(yaw)) * dt
            yaw += velocity[2] * dt
        return points, command

    def line(self, a: tuple[int, int], b: tuple[int, int]) -> list[tuple[int, int]]:
        """Bresenham's line, as costmap_2d's LineIterator has it."""
        (r, c), (r1, c1) = a, b
        dr, dc = abs(r1 - r), abs(c1 - c)
        sr, sc = (1 if r1 >= r else -1), (1 if c1 >= c else -1)
        long, short = max(dr, dc), min(dr, dc)
        error, found = long // 2, [(r, c)]
        for _ in range(long):
            error += short
            both = error >= long
            error -= long if both else 0
            if dc >= dr:
                c, r = c + sc, r + (sr if both else 0)
            else:
                r, c = r + sr, c + (sc if both else 0)
            found.append((r, c))
        return found

    def footprint_cost(self, x: float, y: float, yaw: float) -> float:
        corners = []
        for px, py in self.window.footprint:
            at = self.cell(x + math.cos(yaw) * px - math.sin(yaw) * py, y + math.sin(yaw) * px + math.cos(yaw) * py)
            if at is None:
                return -6.0
            corners.append(at)
        worst = 0
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            values = [int(self.window.costs[at]) for at in self.line(a, b)]
            if max(values) >= 254:
                return -6.0
            worst = max(worst, *values)
        return float(max(worst, int(self.window.costs[self.cell(x, y)])))

    def critic(self, k: int, points: list[list[float]], command: list[float]) -> float:
        size = self.height * self.width
        if k == 0:
            return 0.0
        if k == 1:
            costs = []
            for x, y, yaw in points:
                costs.append(self.footprint_cost(x, y, yaw))
                if costs[-1] < 0:
                    return costs[-1]
            return sum(costs) if self.p.sum_scores else max(costs)
        if k == 6:
            return abs(command[2])
        grid = {2: self.front, 3: self.path, 4: self.path, 5: self.goal}[k]
        shift = self.p.forward_point_distance if k in (2, 3) else 0.0
        value = 0.0
        for x, y, yaw in points:
            at = self.cell(x + shift * math.cos(yaw), y + shift * math.sin(yaw))
            if at is None:
                return -4.0
            value = grid[at]
            if k in (4, 5) and value >= size:
                return -3.0 if value == size else -2.0
        return float(value)

    def total(self, sample: np.ndarray, twist: np.ndarray, best: float) -> tuple[list[float], float]:
        """Return the critics' weighted costs and the sum; negative if the motion is out."""
        motion = self.motion(sample, twist)
        costs = [0.0] * 7
        if motion is None:
            return costs, -1.0
        total = 0.0
        for k, scale in enumerate(self.scales):
            if scale == 0.0:
                continue
            cost = self.critic(k, *motion)
            if cost < 0:
                return costs, cost
            costs[k] = cost * scale
            total += costs[k]
            if best > 0 and total > best:
                break
        return costs, total

    def choose(self, samples: np.ndarray, twist: np.ndarray) -> int:
        """Return the row of the first cheapest motion, -1 for none."""
        chosen, best = -1, -1.0
        for s, sample in enumerate(samples):
            _, total = self.total(sample, twist, best)
            if total >= 0 and (best < 0 or total < best):
                chosen, best = s, total
        return chosen
