# SPDX-License-Identifier: MIT
"""A small closed loop for local planners: exact pose, a static map, a robot with bounded acceleration, moving discs."""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

from slamcli.errors import PlanningError
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.footprint import padded_polygon, radii
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.local_planner import NoCommandError
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.robot_state import RobotState

RADIUS_M, INFLATION_M, SCALING = 0.18, 0.5, 10.0


def costs_of(occupied, resolution_m, inscribed_m, inflation_m=INFLATION_M):
    away = ndimage.distance_transform_edt(~occupied) * resolution_m
    costs = np.where(away <= inflation_m, 252.0 * np.exp(-SCALING * (away - inscribed_m)), 0.0)
    costs = np.where(away <= inscribed_m, 253.0, costs)
    return np.ascontiguousarray(np.where(occupied, 254, costs).astype(np.uint8))


def window_of(costs, resolution_m, footprint, origin_m=(0.0, 0.0)):
    inscribed, circumscribed = radii(footprint)
    return CostWindow(
        costs=costs,
        origin_m=origin_m,
        resolution_m=resolution_m,
        frame="odom",
        footprint=footprint,
        inscribed_radius_m=inscribed,
        circumscribed_radius_m=circumscribed,
    )


def still(pose, twist=(0.0, 0.0, 0.0), time_s=0.0):
    return RobotState(
        time_s=time_s,
        pose_odom=np.array(pose, dtype=np.float64),
        T_map_odom=np.zeros(3),
        twist=np.array(twist, dtype=np.float64),
    )


@dataclass
class Outcome:
    reached: bool = False
    collided: bool = False
    hit_person: bool = False
    time_s: float = 0.0
    length_m: float = 0.0
    plan_m: float = 0.0
    refused: int = 0
    cpu_s: list = field(default_factory=list)
    track: list = field(default_factory=list)
    twists: list = field(default_factory=list)


class Loop:
    """One map; `drive` runs one goal. Odometry is exact, so that odom and map are the same frame."""

    def __init__(
        self, occupied, resolution_m=0.05, *, side_m=4.0, footprint=None, period_s=0.05, accelerations=(2.5, 2.5, 3.2)
    ):
        self.footprint = padded_polygon((), RADIUS_M, 0.0) if footprint is None else footprint
        self.occupied, self.resolution_m, self.period_s = occupied, resolution_m, period_s
        self.cells = round(side_m / resolution_m)
        self.accelerations = np.array(accelerations)
        inscribed, _ = radii(self.footprint)
        self.inscribed = inscribed
        self.costs = costs_of(occupied, resolution_m, inscribed)
        self.planner = LivePlanner(PlannerParameters(allow_unknown=False), "navfn")
        self.whole = window_of(self.costs, resolution_m, self.footprint)

    def local(self, pose, discs):
        res, half = self.resolution_m, self.cells // 2
        r0, c0 = int(pose[1] / res) - half, int(pose[0] / res) - half
        costs = np.zeros((self.cells, self.cells), np.uint8)
        rows = slice(max(0, r0), min(self.costs.shape[0], r0 + self.cells))
        columns = slice(max(0, c0), min(self.costs.shape[1], c0 + self.cells))
        into = (slice(rows.start - r0, rows.stop - r0), slice(columns.start - c0, columns.stop - c0))
        costs[into] = self.costs[rows, columns]
        if len(discs):
            y, x = np.mgrid[0 : self.cells, 0 : self.cells]
            x, y = (c0 + x + 0.5) * res, (r0 + y + 0.5) * res
            there = np.zeros(costs.shape, bool)
            for dx, dy, radius, *_ in discs:
                away = np.hypot(x - dx, y - dy)
                there |= (away <= radius) & (away > radius - 1.5 * res)
            if there.any():
                costs = np.maximum(costs, costs_of(there, res, self.inscribed))
        return window_of(costs, res, self.footprint, (c0 * res, r0 * res))

    def collides(self, pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        corners = self.footprint @ np.array([[c, s], [-s, c]]) + pose[:2]
        points = np.concatenate([corners + k / 8 * (np.roll(corners, -1, axis=0) - corners) for k in range(8)])
        cells = (points / self.resolution_m).astype(int)
        ok = (cells >= 0).all(1) & (cells[:, 1] < self.occupied.shape[0]) & (cells[:, 0] < self.occupied.shape[1])
        return bool(self.occupied[cells[ok, 1], cells[ok, 0]].any())

    def drive(
        self, planner, start, goal, *, limit_s=300.0, people=None, share_discs=False, replan_s=1.0, latency_s=0.0
    ):
        """Drive; people: function of time to discs (D, 5)."""
        out = Outcome()
        pose, twist = np.array(start, float), np.zeros(3)
        planner.reset()
        plan = self.planner.plan(self.whole, start, goal)
        out.plan_m = plan.length_m
        planner.set_plan(plan.poses)
        next_plan, window_age, window = replan_s, np.inf, None
        steps = round(self.period_s / 0.01)
        discs = np.zeros((0, 5))
        while out.time_s < limit_s:
            if people is not None:
                discs = people(out.time_s, pose)
            if window_age > 0.19:
                window, window_age = self.local(pose, discs), 0.0
            state = still(pose, twist, out.time_s)
            if planner.is_goal_reached(state):
                out.reached = True
                break
            if out.time_s >= next_plan:
                next_plan += replan_s
                with contextlib.suppress(PlanningError):
                    planner.set_plan(self.planner.plan(self.whole, pose, goal).poses)
            if share_discs:
                planner.set_moving_obstacles(discs)
            began = time.process_time()
            try:
                wanted = planner.compute_command(state, window).twist
            except NoCommandError:
                wanted = np.zeros(3)
                out.refused += 1
            out.cpu_s.append(time.process_time() - began)
            out.twists.append(wanted)
            for _ in range(steps):
                change = self.accelerations * 0.01
                twist = twist + np.clip(wanted - twist, -change, change)
                turned = pose[2] + 0.5 * twist[2] * 0.01
                c, s = np.cos(turned), np.sin(turned)
                step = 0.01 * np.array([c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]])
                pose = pose + step
                out.length_m += float(np.hypot(*step[:2]))
            out.time_s += self.period_s
            window_age += self.period_s
            out.track.append(pose.copy())
            out.collided |= self.collides(pose)
            if len(discs):
                near = np.hypot(discs[:, 0] - pose[0], discs[:, 1] - pose[1]) < discs[:, 2] + RADIUS_M
                out.hit_person |= bool(near.any() and np.hypot(*twist[:2]) > 0.1)
        return out


def free_poses(loop, count, seed):
    """Random free poses (count, 3) that hang together."""
    rng = np.random.default_rng(seed)
    away = ndimage.distance_transform_edt(~loop.occupied) * loop.resolution_m
    labels, _ = ndimage.label(away > max(0.3, radii(loop.footprint)[1] + loop.resolution_m))
    largest = np.bincount(labels[labels > 0]).argmax()
    rows, columns = np.nonzero(labels == largest)
    picks = rng.integers(len(rows), size=count)
    xy = (np.column_stack([columns[picks], rows[picks]]) + 0.5) * loop.resolution_m
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, count)])


def room_world(seed=0, size_m=12.0, resolution_m=0.05, boxes=14, door_m=0.9):
    """Walls about a room with a wall across that has a door, and boxes."""
    n = round(size_m / resolution_m)
    occupied = np.zeros((n, n), bool)
    occupied[:2], occupied[-2:], occupied[:, :2], occupied[:, -2:] = True, True, True, True
    rng = np.random.default_rng(seed)
    for _ in range(boxes):
        r, c = rng.integers(10, n - 20, 2)
        h, w = rng.integers(4, 16, 2)
        occupied[r : r + h, c : c + w] = True
    half = round(door_m / resolution_m / 2)
    occupied[:, n // 2 - 1 : n // 2 + 1] = True
    occupied[n // 3 - half - 10 : n // 3 + half + 10, n // 2 - 14 : n // 2 + 14] = False
    occupied[:, n // 2 - 1 : n // 2 + 1] = True
    occupied[n // 3 - half : n // 3 + half, n // 2 - 1 : n // 2 + 1] = False
    return occupied
