# SPDX-License-Identifier: MIT
"""Planning figures: every MovingAI scenario against its published optimum, and one 4000 x 4000 map.

python benchmarks/planning.py [--data ../shared/data] [--every N] [--skip-large]
"""

from __future__ import annotations

import argparse
import gzip
import time
from pathlib import Path

import numpy as np

from slamcli.grids import OccupancyGrid, distance
from slamcli.navigation import grid_search, navfn, path_shape
from slamcli.navigation.costmap import compute_costmap
from slamcli.navigation.costmap_parameters import CostmapParameters
from slamcli.navigation.global_planner import METHODS, GlobalPlanner


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
    print(f"{'map':18} {'queries':>7}  " + "  ".join(f"{m + ' optimal':>17} {'ms/query':>8}" for m in METHODS[1:]))
    totals = dict.fromkeys(METHODS[1:], 0)
    count = 0
    for path in sorted(folder.glob("*.map.gz")):
        grid, lines = read_scenarios(path)
        lines = lines[::every]
        count += len(lines)
        costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.0))
        columns = []
        for method in METHODS[1:]:
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


def run_large(size: int) -> None:
    random = np.random.default_rng(1)
    cells = np.zeros((size, size), dtype=np.int8)
    for _ in range(size // 2):
        r, c = random.integers(0, size, 2)
        h, w = random.integers(5, size // 15, 2)
        cells[r : r + (h if h < w else 4), c : c + (w if w <= h else 4)] = 100
    cells[:60, :60] = cells[-60:, -60:] = 0
    grid = OccupancyGrid(cells, 0.05)
    began = time.perf_counter()
    costmap = compute_costmap(grid, CostmapParameters(robot_radius=0.2, inflation_radius=0.55))
    print(f"{size} x {size}: costmap {time.perf_counter() - began:.2f} s")
    for method in METHODS:
        began = time.perf_counter()
        planner = GlobalPlanner(costmap, None, method)
        end = size * 0.05 - 1.0
        path = planner.plan((1.0, 1.0), (end, end))
        print(
            f"  {method}: {time.perf_counter() - began:.2f} s, {path.length_m:.1f} m, cost {path.cost:.1f}", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data")
    parser.add_argument("--every", type=int, default=1, help="take every Nth scenario")
    parser.add_argument("--skip-large", action="store_true")
    options = parser.parse_args()
    for module in (distance, grid_search, navfn, path_shape):
        module.warm()
    if not options.skip_large:
        run_large(4000)
    run_scenarios(options.data / "movingai", options.every)


if __name__ == "__main__":
    main()
