# SPDX-License-Identifier: MIT
"""A small closed loop for local planners: NavFn on the map, a robot with acceleration limits and latency, a scanner."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.footprint import padded_polygon, radii
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.layered_parameters import LayeredParameters
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.local_planner import LocalPlanner, NoCommandError
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.robot_state import RobotState
from slamcli.navigation.scan_observation import observe_scan
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.plant import Plant
from slamcli.simulation.world import World

RADIUS_M = 0.18
PERIOD_S = 0.05


@dataclass(frozen=True)
class Drive:
    """What became of a drive."""

    reached: bool
    time_s: float
    driven_m: float
    planned_m: float
    off_m: float
    collisions: int


class Site:
    """A map to drive on."""

    def __init__(self, grid: OccupancyGrid) -> None:
        self.world = World(name="test", grid=grid)
        costmap = compute_costmap(grid, CostmapParameters(robot_radius=RADIUS_M, inflation_radius=0.5))
        polygon = padded_polygon((), RADIUS_M, 0.01)
        inscribed, circumscribed = radii(polygon)
        corner = grid.cell_to_map(np.array([[-0.5, -0.5]]))[0]
        self.window = CostWindow(
            costs=np.ascontiguousarray(costmap.costs),
            origin_m=(float(corner[0]), float(corner[1])),
            resolution_m=grid.resolution_m,
            frame="map",
            footprint=polygon,
            inscribed_radius_m=inscribed,
            circumscribed_radius_m=circumscribed,
        )
        self.planner = LivePlanner(PlannerParameters(allow_unknown=False))
        self._roomy = np.argwhere(costmap.costs < 120)

    def pairs(self, count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return starts and goals, poses (3,), more than 1 m apart with a way between."""
        random = np.random.default_rng(seed)
        found: list[tuple[np.ndarray, np.ndarray]] = []
        while len(found) < count:
            cells = self._roomy[random.integers(len(self._roomy), size=2)]
            points = np.array(self.window.origin_m) + (cells[:, ::-1] + 0.5) * self.window.resolution_m
            start, goal = np.column_stack([points, random.uniform(-np.pi, np.pi, 2)])
            try:
                path = self.planner.plan(self.window, start.tolist(), goal.tolist())
            except NoPathError:
                continue
            if path.length_m > 1.0:
                found.append((start, goal))
        return found

    def drive(
        self, planner: LocalPlanner, start: np.ndarray, goal: np.ndarray, *, seed: int, fov_deg: float = 360.0
    ) -> Drive:
        """Drive until the goal is reached or time is up."""
        plant = Plant(
            self.world,
            SimulationParameters(
                robot_radius=RADIUS_M,
                robot_forward_acceleration=2.5,
                robot_swing_acceleration=3.2,
                robot_latency=0.05,
                laser_beams=180,
                laser_fov=fov_deg,
                laser_range_max=12.0,
            ),
            start=start,
            seed=seed,
        )
        costmap = LayeredCostmap(
            LayeredParameters.standard("local", robot_radius=RADIUS_M, inflation_radius=0.5), name="local"
        )
        path = self.planner.plan(self.window, start.tolist(), goal.tolist())
        planner.set_plan(path.poses)
        driven, last, failures, tick = 0.0, start, 0, 0
        limit = 30.0 + 4.0 * path.length_m / 0.5
        reached = False
        while plant.time_s < limit:
            if tick % 2 == 0:
                frame = se2.compose(plant.odom_pose, plant.T_base_laser)
                costmap.observe(observe_scan(plant.scan(), frame, costmap.parameters.sources[0], plant.time_s, 0.2))
            if tick % 4 == 0:
                costmap.update(plant.odom_pose, plant.time_s)
            state = RobotState(
                time_s=plant.time_s,
                pose_odom=plant.odom_pose,
                T_map_odom=se2.compose(plant.pose, se2.inverse(plant.odom_pose)),
                twist=plant.odom_twist,
            )
            reached = planner.is_goal_reached(state)
            if reached:
                break
            try:
                twist = planner.compute_command(state, costmap.window()).twist
            except NoCommandError:
                twist, failures = np.zeros(3), failures + 1
                if failures % 10 == 0:
                    planner.set_plan(self.planner.plan(self.window, plant.pose.tolist(), goal.tolist()).poses)
            plant.command(twist)
            plant.advance(PERIOD_S)
            driven, last, tick = driven + math.dist(plant.pose[:2], last[:2]), plant.pose, tick + 1
        return Drive(
            reached=reached,
            time_s=plant.time_s,
            driven_m=driven,
            planned_m=path.length_m,
            off_m=math.dist(plant.pose[:2], goal[:2]),
            collisions=len(plant.collisions),
        )


def rooms(seed: int) -> OccupancyGrid:
    """Four rooms of 3 m with doors of 0.8 m, and pillars, but none near a door."""
    random = np.random.default_rng(seed)
    cells = np.zeros((124, 124), dtype=np.int8)
    cells[[0, 1, 61, 62, 122, 123]] = 100
    cells[:, [0, 1, 61, 62, 122, 123]] = 100
    for middle in (20, 100):
        cells[61:63, middle : middle + 16] = 0
        cells[middle : middle + 16, 61:63] = 0
    doors = [(62, 28), (62, 108), (28, 62), (108, 62)]
    for r, c in random.integers(8, 112, (30, 2)):
        if min(math.dist((r, c), door) for door in doors) > 24:
            cells[r : r + 3, c : c + 3] = 100
    return OccupancyGrid(cells, 0.05)
