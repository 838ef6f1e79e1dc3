# SPDX-License-Identifier: MIT
"""Planning figures: MovingAI scenarios against their published optima, 4000 x 4000 maps, lengths against the shortest path.

python benchmarks/planning.py [--data ../shared/data] [--every N] [--skip-large] [--skip-scenarios] [--pairs N]
"""

from __future__ import annotations

import argparse
import gzip
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from slamcli.errors import SlamcliError
from slamcli.formats.maps import read_map
from slamcli.grids import OccupancyGrid, distance
from slamcli.navigation import planner_methods, shortest_path
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import Costmap, compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.endpoints import NoPathError
from slamcli.navigation.global_planner import METHODS, GlobalPlanner, Method
from slamcli.navigation.hybrid_parameters import HybridParameters
from slamcli.navigation.live_planner import LivePlanner
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.navigation.shortest_path import shortest_length


def read_scenarios(map_path: Path) -> tuple[OccupancyGrid, list[list[str]]]:
    with gzip.open(map_path, "rt") as stream:
        rows = [row for row in stream.read().split("\n")[4:] if row]
    with gzip.open(map_path.with_name(map_path.name.replace(".map.gz", ".map.scen.gz")), "rt") as stream:
        lines = [line.split() for line in stream.read().split("\n")[1:] if line.strip()]
    free = np.array([[c in ".G" for c in row] for row in rows])
    return OccupancyGrid(np.where(free, 0, 100).astype(np.int8), 1.0), lines


def last_digit(published: str) -> float:
    """Half a unit of the last digit that is published (at least two decimals), computed there with sqrt(2) = 1.41421356."""
    decimals = len(published.partition(".")[2])
    return 0.51 * 10.0 ** -max(decimals, 2) + 3e-9 * float(published)


def run_scenarios(folder: Path, every: int) -> None:
    print(
        f"{'map':18} {'queries':>7}  "
        + "  ".join(f"{m + ' optimal':>17} {'ms/query':>8}" for m in ("dijkstra", "astar"))
    )
    totals = dict.fromkeys(("dijkstra", "astar"), 0)
    count = 0
    for path in sorted(folder.glob("*.map.gz")):
        grid, lines = read_scenarios(path)
        lines = lines[::every]
        count += len(lines)
        costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.0))
        columns = []
        for method in ("dijkstra", "astar"):
            planner = GlobalPlanner(costmap, None, method)
            optimal = 0
            began = time.perf_counter()
            planner.prepare_for_many()
            for line in lines:
                x0, y0, x1, y1 = (int(v) + 0.5 for v in line[4:8])
                length = planner.plan((x0, y0), (x1, y1)).length_m
                optimal += abs(length - float(line[8])) <= last_digit(line[8])
            took = (time.perf_counter() - began) * 1e3 / len(lines)
            totals[method] += optimal
            columns.append(f"{optimal:>9} of {len(lines):>4} {took:8.2f}")
        print(f"{path.name.removesuffix('.map.gz'):18} {len(lines):7}  " + "  ".join(columns), flush=True)
    print(f"all: {count} queries, optimal: " + ", ".join(f"{m} {n}" for m, n in totals.items()))


def scattered(size: int) -> OccupancyGrid:
    """Walls at random: a route across is only a little longer than the straight line."""
    random = np.random.default_rng(1)
    cells = np.zeros((size, size), dtype=np.int8)
    for _ in range(size // 2):
        r, c = random.integers(0, size, 2)
        h, w = random.integers(5, size // 15, 2)
        cells[r : r + (h if h < w else 4), c : c + (w if w <= h else 4)] = 100
    cells[:60, :60] = cells[-60:, -60:] = 0
    return OccupancyGrid(cells, 0.05)


def halls(size: int) -> OccupancyGrid:
    """Walls across the whole map with a door at alternating ends: every search goes everywhere."""
    cells = np.zeros((size, size), dtype=np.int8)
    for k in range(1, 10):
        at = k * size // 10
        cells[at : at + 4] = 100
        door = slice(size - 80, size - 40) if k % 2 else slice(40, 80)
        cells[at : at + 4, door] = 0
    return OccupancyGrid(cells, 0.05)


def window_of(costmap: Costmap) -> CostWindow:
    return CostWindow(
        costs=costmap.costs,
        origin_m=(0.0, 0.0),
        resolution_m=costmap.grid.resolution_m,
        frame="map",
        footprint=costmap.footprint,
        inscribed_radius_m=costmap.inscribed_radius_m,
        circumscribed_radius_m=costmap.circumscribed_radius_m,
    )


def run_large(name: str, grid: OccupancyGrid) -> None:
    """CPU seconds corner to corner: saved map with its preparation, live map first and again; a goal 5 m away again."""
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.2, inflation_radius=0.55))
    window, end = window_of(costmap), grid.cells.shape[0] * grid.resolution_m - 1.0
    print(f"{name}, {grid.cells.shape[0]} x {grid.cells.shape[1]}; CPU time")
    print(f"  {'planner':15} {'saved s':>8} {'live s':>8} {'again s':>8} {'near ms':>8} {'length m':>9}")
    for method in [m for m in METHODS if m != "hybrid_astar"]:
        began = time.process_time()
        GlobalPlanner(costmap, None, method).plan((1.0, 1.0), (end, end))
        saved = time.process_time() - began
        live = LivePlanner(None, method)
        seconds = []
        for goal in ((end, end), (end, end), (4.5, 4.5), (4.5, 4.5)):
            began = time.process_time()
            path = live.plan(window, (1.0, 1.0), goal)
            seconds.append(time.process_time() - began)
            if goal[0] == end:
                length = path.length_m
        print(
            f"  {method:15} {saved:8.2f} {seconds[0]:8.2f} {seconds[1]:8.2f} {1e3 * seconds[3]:8.1f} {length:9.1f}",
            flush=True,
        )


CHOICES: dict[str, tuple[Method, dict[str, Any]]] = {
    "navfn": ("navfn", {}),
    "navfn, cost_factor 0.2": ("navfn", {"cost_factor": 0.2}),
    "navfn, cost_factor 0.1": ("navfn", {"cost_factor": 0.1}),
    "navfn, cost_factor 0.05": ("navfn", {"cost_factor": 0.05}),
    "global_planner": ("global_planner", {}),
    "astar": ("astar", {}),
    "astar, smooth": ("astar", {"smooth": True}),
    "theta_star": ("theta_star", {}),
    "theta_star, cost_factor 0": ("theta_star", {"cost_factor": 0.0}),
    "hybrid_astar, forward": ("hybrid_astar", {"hybrid": HybridParameters(motion_model_for_search="DUBIN")}),
    "hybrid_astar": ("hybrid_astar", {}),
}


def run_quality(folder: Path, num_pairs: int) -> None:
    """Lengths over the shortest any-angle path for the mission's robot, pairs at least 1 m apart in the largest region."""
    for path in sorted(folder.rglob("*.yaml")):
        try:
            grid = read_map(path).grid
        except SlamcliError:
            continue
        if min(grid.cells.shape) < 50 or grid.origin[2] or "speed" in path.name or "keepout" in path.name:
            continue
        costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.18, inflation_radius=0.5))
        window = window_of(costmap)
        regions, _ = ndimage.label(costmap.costs < 253)
        counts = np.bincount(regions.ravel())
        counts[0] = 0
        cells = np.argwhere(regions == counts.argmax())
        random = np.random.default_rng(0)
        ratios: dict[str, list[float]] = {name: [] for name in CHOICES}
        failed = dict.fromkeys(CHOICES, 0)
        times = dict.fromkeys(CHOICES, 0.0)
        planners = {name: LivePlanner(PlannerParameters(**o), m) for name, (m, o) in CHOICES.items()}
        for _ in range(num_pairs):
            start, goal = ((cells[random.integers(len(cells))][::-1] + 0.5) * grid.resolution_m for _ in range(2))
            shortest = shortest_length(window, start, goal)
            if shortest < 1.0:
                continue
            for name, planner in planners.items():
                began = time.process_time()
                try:
                    ratios[name].append(planner.plan(window, start, goal).length_m / shortest)
                except NoPathError:
                    failed[name] += 1
                times[name] += time.process_time() - began
        print(f"{path.relative_to(folder)} {grid.cells.shape[0]} x {grid.cells.shape[1]}")
        print(f"  {'planner':26} {'mean':>6} {'p95':>6} {'max':>6} {'>1.15':>5} {'failed':>6} {'ms':>7}")
        for name, values in ratios.items():
            print(
                f"  {name:26} {np.mean(values):6.3f} {np.percentile(values, 95):6.3f} {max(values):6.3f}"
                f" {sum(v > 1.15 for v in values):5} {failed[name]:6} {1e3 * times[name] / num_pairs:7.1f}",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data")
    parser.add_argument("--every", type=int, default=1, help="take every Nth scenario")
    parser.add_argument("--skip-large", action="store_true")
    parser.add_argument("--skip-scenarios", action="store_true")
    parser.add_argument(
        "--pairs", type=int, default=0, help="also compare N pairs per saved map with the shortest path"
    )
    options = parser.parse_args()
    distance.warm()
    shortest_path.warm()
    for method in METHODS:
        planner_methods.warm(method)
    if not options.skip_large:
        run_large("scattered walls", scattered(4000))
        run_large("ten halls", halls(4000))
    if not options.skip_scenarios:
        run_scenarios(options.data / "movingai", options.every)
    if options.pairs:
        run_quality(options.data / "maps", options.pairs)


if __name__ == "__main__":
    main()
