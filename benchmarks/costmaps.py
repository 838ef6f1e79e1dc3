# SPDX-License-Identifier: MIT
"""Costmap updates: a scan on a map of 4000 x 4000 cells, a rolling window of 80 x 80, and what computing all anew takes.

python benchmarks/costmaps.py [--cells N] [--scans N]

CPU times of one core; the first scans, in which kernels are loaded, do not count.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np

from slamcli.grids import OccupancyGrid
from slamcli.measurements.laser import LaserScan
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.layered_parameters import LayeredParameters
from slamcli.navigation.obstacle_parameters import ObstacleParameters
from slamcli.navigation.scan_observation import observe_scan
from slamcli.simulation.raycast import cast
from slamcli.simulation.world import World

BEAMS, RANGE_M, RESOLUTION_M = 360, 12.0, 0.05


def offices(cells: int) -> OccupancyGrid:
    """Rooms of 6 by 4 m with doors, pillars in some of them, and unknown space inside of the walls."""
    random = np.random.default_rng(0)
    plan = np.zeros((cells, cells), dtype=np.int8)
    rows, columns = 80, 120
    for row in range(0, cells, rows):
        plan[row : row + 3] = 100
        plan[row + 1] = -1
    for column in range(0, cells, columns):
        plan[:, column : column + 3] = 100
        plan[:, column + 1] = -1
    for row in range(0, cells - rows, rows):
        for column in range(0, cells - columns, columns):
            plan[row : row + 3, column + 50 : column + 70] = 0
            plan[row + 30 : row + 50, column : column + 3] = 0
            r, c = row + random.integers(10, 70), column + random.integers(10, 110)
            plan[r : r + 4, c : c + 4] = 100
    half = cells * RESOLUTION_M / 2
    return OccupancyGrid(plan, RESOLUTION_M, (-half, -half, 0.0))


def scans(world: World, count: int) -> list[tuple[np.ndarray, LaserScan]]:
    """A drive through a room and its door, with 1 cm of noise."""
    random = np.random.default_rng(1)
    found = []
    for k in range(count):
        pose = np.array([-2.0 + 0.05 * k, 1.9, 0.01 * k])
        angles = pose[2] + np.arange(BEAMS) * 2.0 * math.pi / BEAMS
        ranges = cast(world, np.tile(pose[:2], (BEAMS, 1)), np.column_stack([np.cos(angles), np.sin(angles)]), RANGE_M)
        ranges = ranges + random.normal(0.0, 0.01, BEAMS)
        facts = {"range_min_m": 0.1, "range_max_m": RANGE_M, "ranges_m": ranges.astype(np.float32)}
        step = 2.0 * math.pi / BEAMS
        found.append(
            (pose, LaserScan(stamp_ns=k, frame_id="laser", angle_min_rad=0.0, angle_increment_rad=step, **facts))
        )
    return found


def milliseconds(work: Callable[[], object]) -> float:
    began = time.process_time_ns()
    work()
    return (time.process_time_ns() - began) / 1e6


def measure(costmap: LayeredCostmap, drive: list[tuple[np.ndarray, LaserScan]]) -> tuple[list[float], list[float]]:
    """Times of an update, and of everything from the scan to the window."""
    source = costmap.parameters.sources[0]
    updates, whole = [], []
    for k, (pose, scan) in enumerate(drive):
        began = time.process_time_ns()
        costmap.observe(observe_scan(scan, pose, source, 0.1 * k, 0.2))
        updates.append(milliseconds(lambda pose=pose, k=k: costmap.update(pose, 0.1 * k)))
        costmap.window()
        whole.append((time.process_time_ns() - began) / 1e6)
    return updates[5:], whole[5:]


def show(name: str, updates: list[float], whole: list[float], full_ms: float) -> None:
    median = float(np.median(updates))
    print(
        f"{name:44} {median:8.3f} {max(updates):8.3f} {float(np.median(whole)):14.3f} {full_ms:10.1f} {full_ms / median:8.0f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cells", type=int, default=4000)
    parser.add_argument("--scans", type=int, default=105)
    options = parser.parse_args()
    grid = offices(options.cells)
    drive = scans(World(name="offices", grid=grid), options.scans)
    print(f"{'CPU ms':44} {'update':>8} {'slowest':>8} {'scan to window':>14} {'all anew':>10} {'ratio':>8}")
    robot = {"robot_radius": 0.18, "inflation_radius": 0.5}
    for reach in (3.0, 12.0):
        obstacle = ObstacleParameters(obstacle_range=reach - 0.5, raytrace_range=reach)
        parameters = LayeredParameters.standard("global", obstacle=obstacle, track_unknown=True, **robot)
        costmap = LayeredCostmap(parameters, name="global", static=grid)
        costmap.update(drive[0][0])
        updates, whole = measure(costmap, drive)
        incremental = costmap.window().costs.copy()
        costmap.start_over()
        full = milliseconds(lambda costmap=costmap: costmap.update(drive[-1][0]))
        if not np.array_equal(costmap.window().costs, incremental):
            raise SystemExit("the updates and the recomputation differ")
        show(f"global {options.cells} x {options.cells}, beams clear {reach:g} m", updates, whole, full)
    local = LayeredCostmap(LayeredParameters.standard("local", **robot), name="local")
    updates, whole = measure(local, drive)
    local.start_over()
    show("local 80 x 80, rolling", updates, whole, milliseconds(lambda: local.update(drive[-1][0])))
    print(f"compute_costmap of the map alone: {milliseconds(lambda: compute_costmap(grid, parameters.costmap)):.0f} ms")


if __name__ == "__main__":
    main()
