# SPDX-License-Identifier: MIT
"""CPU time of one command of DWA and of regulated pure pursuit on a local costmap of 80 x 80 cells.

    python benchmarks/local_planners.py [--commands 500]

DWA has the mission's parameters: 10 x 1 x 20 samples, 2 s ahead, a round robot of 0.18 m as a polygon of 16 corners.
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import numpy as np

from slamcli.grids import OccupancyGrid
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.dwa import DwaPlanner
from slamcli.navigation.dwa_parameters import AS_DWAPLANNERROS, read_dwa
from slamcli.navigation.footprint import padded_polygon, radii
from slamcli.navigation.local_planner import LocalPlanner
from slamcli.navigation.pursuit import RegulatedPurePursuit
from slamcli.navigation.pursuit_parameters import PursuitParameters
from slamcli.navigation.robot_state import RobotState

RADIUS_M = 0.18
CONFIGS = Path(__file__).resolve().parents[1] / "configs"


def window(occupied: np.ndarray) -> CostWindow:
    costmap = compute_costmap(
        OccupancyGrid(occupied, 0.05), CostmapParameters(robot_radius=RADIUS_M, inflation_radius=0.5)
    )
    polygon = padded_polygon((), RADIUS_M, 0.01)
    inscribed, circumscribed = radii(polygon)
    return CostWindow(
        costs=np.ascontiguousarray(costmap.costs),
        origin_m=(-2.0, -2.0),
        resolution_m=0.05,
        frame="odom",
        footprint=polygon,
        inscribed_radius_m=inscribed,
        circumscribed_radius_m=circumscribed,
    )


def places() -> dict[str, np.ndarray]:
    free = np.zeros((80, 80), dtype=np.int8)
    corridor = free.copy()
    corridor[[28, 52]] = 100
    pillars = free.copy()
    for r, c in np.random.default_rng(0).integers(0, 80, (40, 2)):
        if abs(r - 40) > 7 or c < 35:
            pillars[r : r + 2, c : c + 2] = 100
    pillars[33:47, 33:47] = 0
    return {"free": free, "corridor of 1.15 m": corridor, "among pillars": pillars}


def milliseconds(planner: LocalPlanner, costmap: CostWindow, speed: float, commands: int) -> tuple[float, float]:
    """Return median and 95th percentile of CPU time."""
    along = np.arange(0.0, 3.0, 0.05)
    planner.set_plan(np.column_stack([along, 0.1 * along, np.full(len(along), 0.1)]))
    took = []
    for i in range(commands + 5):
        pose = np.array([0.002 * (i % 20), 0.001 * (i % 7), 0.01 * (i % 5)])
        twist = np.array([speed, 0.0, 0.02 * (i % 3)])
        state = RobotState(time_s=0.05 * i, pose_odom=pose, T_map_odom=np.zeros(3), twist=twist)
        began = time.process_time()
        planner.compute_command(state, costmap)
        took.append((time.process_time() - began) * 1e3)
    return statistics.median(took[5:]), float(np.percentile(took[5:], 95))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", type=int, default=500)
    commands = parser.parse_args().commands
    settings = read_ros_yaml(CONFIGS / "base_local_planner_params.yaml")
    mission = {s.name.removeprefix("DWAPlannerROS/"): s.value for s in settings}
    planners: dict[str, LocalPlanner] = {
        "dwa": DwaPlanner(read_dwa(mission)),
        "dwa as DWAPlannerROS": DwaPlanner(read_dwa(mission | AS_DWAPLANNERROS)),
        "pursuit": RegulatedPurePursuit(PursuitParameters()),
    }
    print(f"{'costmap':20} {'m/s':>4}  " + "  ".join(f"{name:>22}" for name in planners) + "   ms: median (95 %)")
    for place, occupied in places().items():
        costmap = window(occupied)
        for speed in (0.1, 0.45):
            cells = []
            for planner in planners.values():
                median, high = milliseconds(planner, costmap, speed, commands)
                cells.append(f"{median:.2f} ({high:.2f})")
            print(f"{place:20} {speed:4.2f}  " + "  ".join(f"{cell:>22}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
