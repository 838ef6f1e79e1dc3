# SPDX-License-Identifier: MIT
"""Random goals on maps, driven in the simulator with the whole stack: who arrives, how far he went, what he hit.

    python benchmarks/navigation.py ../shared/data/maps --pairs 100 --people 0 --jobs 2 [--map NAME] [--json FILE]

Starts and goals are drawn among the cells where the robot fits; a pair without a way must be reported as such.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import ndimage

from slamcli.errors import SlamcliError
from slamcli.formats.maps import read_map
from slamcli.grids import OccupancyGrid
from slamcli.navigation.cost_window import CostWindow
from slamcli.navigation.costmap import INSCRIBED, NO_INFORMATION
from slamcli.navigation.footprint_check import is_blocked, outline
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.motion_check import is_round
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigation_config import load_navigation
from slamcli.simulation.world import OCCUPIED_FROM

_FINER = 4
FREE_AT_LEAST = 20  # cells: a map on which the robot fits nowhere else has no pairs to draw


def find_maps(folder: Path) -> list[Path]:
    """Return the maps that can be read and have room for the robot."""
    return sorted(path for path in folder.rglob("*.yaml"))


def body_room(path: Path) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function of points (N, 2): distance to the nearest wall or unknown cell, metres, 0 outside."""
    grid = open_world(str(path)).grid
    fine = np.repeat(np.repeat(grid.cells, _FINER, axis=0), _FINER, axis=1)
    finer = OccupancyGrid(fine, grid.resolution_m / _FINER, grid.origin)
    walls = np.pad((fine >= OCCUPIED_FROM) | (fine < 0), 1, constant_values=True)
    distance = (ndimage.distance_transform_edt(~walls)[1:-1, 1:-1] - 1.0) * finer.resolution_m

    def room(points: np.ndarray) -> np.ndarray:
        cells = finer.map_to_cell(points)
        inside = finer.contains(cells)
        found = np.zeros(len(points))
        found[inside] = distance[cells[inside, 0], cells[inside, 1]]
        return found

    return room


def stands(window: CostWindow, room: Callable[[np.ndarray], np.ndarray], pose: np.ndarray) -> bool:
    """Whether the robot's outline is free in a pose, on the costmap and in the world."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    edge = outline(window) @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]
    return not is_blocked(window, pose[None]).any() and bool((room(edge) > 0.0).all())


def draw_pairs(path: Path, count: int, seed: int, sets: tuple[str, ...]) -> list[tuple[list[float], list[float], bool]]:
    """Return start pose, goal pose and whether a way joins them on the map."""
    config = load_navigation(sets=sets)
    grid = read_map(path).grid
    costmap = LayeredCostmap(config.global_costmap, name="global", static=grid)
    costmap.update(np.zeros(3))
    window = costmap.window()
    room = body_room(path)
    rows, columns = np.nonzero(window.costs < INSCRIBED)
    points = np.column_stack([columns, rows]) * window.resolution_m + window.resolution_m / 2 + window.origin_m
    points = points[room(points) > window.inscribed_radius_m]
    if len(points) < FREE_AT_LEAST:
        return []
    through_unknown = (window.costs == NO_INFORMATION) & (config.planner.allow_unknown is not False)
    regions, _ = ndimage.label((window.costs < INSCRIBED) | through_unknown)

    def region(point: np.ndarray) -> int:
        column, row = np.floor((point[:2] - window.origin_m) / window.resolution_m).astype(int)
        return int(regions[row, column])

    rng = np.random.default_rng([seed, 20261122])
    pairs = []
    while len(pairs) < count:
        ends = np.column_stack([points[rng.integers(0, len(points), 2)], rng.uniform(-np.pi, np.pi, 2)])
        if not is_round(window) and not all(stands(window, room, pose) for pose in ends):
            continue
        start, goal = ends.tolist()
        pairs.append((start, goal, region(ends[0]) == region(ends[1])))
    return pairs


def drive(job: tuple) -> dict:
    """Drive one pair."""
    path, index, start, goal, joined, options = job
    began, wall = time.process_time(), time.perf_counter()
    config = load_navigation(
        sets=options["sets"], local_planner=options["local_planner"], global_planner=options["global_planner"]
    )
    row = {"map": path.stem, "pair": index, "joined": joined, "start": start, "goal": goal}
    try:
        robot = Navigator(
            path, start=start, config=config, people=options["people"], seed=options["seed"] * 1000 + index,
            localization=options["localization"],
        )  # fmt: skip
        arrival = robot.go_to(*goal)
    except SlamcliError as error:
        return row | {"status": "error", "message": str(error)}
    row |= {"status": arrival.status, "message": arrival.message, "optimum_m": arrival.optimum_m}
    if arrival.drive is not None:
        d = arrival.drive
        row |= {
            "length_m": d.length_m, "seconds": d.end_s - d.begin_s, "clearance_m": d.clearance_m,
            "collisions": [[c.kind, c.time_s, c.speed_m_s, c.by_robot, c.x_m, c.y_m] for c in d.collisions],
            "recoveries": d.recoveries, "plans": d.plans,
            "goal_error_m": float(np.hypot(*(d.end_pose[:2] - goal[:2]))),
            "rmse_m": float(np.sqrt(np.mean(d.position_error_m**2))),
            "rmse_deg": float(np.degrees(np.sqrt(np.mean(d.heading_error_rad**2)))),
            "worst_m": float(d.position_error_m.max()),
        }  # fmt: skip
    return row | {"cpu_s": time.process_time() - began, "wall_s": time.perf_counter() - wall}


def summarise(name: str, rows: list[dict]) -> dict:
    """Return the figures of one map."""
    possible = [r for r in rows if r["joined"]]
    impossible = [r for r in rows if not r["joined"]]
    arrived = [r for r in possible if r["status"] == "succeeded"]
    ratios = [r["length_m"] / r["optimum_m"] for r in arrived if r["optimum_m"] > 1.0]
    driven = [r for r in rows if "seconds" in r]
    hits = [c for r in driven for c in r["collisions"]]
    return {
        "map": name, "pairs": len(possible), "arrived": len(arrived),
        "told_unreachable": f"{sum(r['status'] == 'unreachable' for r in impossible)}/{len(impossible)}",
        "hits_by_robot": sum(c[3] for c in hits), "hits": len(hits),
        "ratio_median": round(statistics.median(ratios), 3) if ratios else None,
        "ratio_p95": round(float(np.percentile(ratios, 95)), 3) if ratios else None,
        "ratio_over": sum(r > 1.15 for r in ratios), "ratios": len(ratios),
        "least_clearance_m": round(min((r["clearance_m"] for r in driven), default=float("nan")), 3),
        "recoveries": sum(len(r["recoveries"]) for r in driven),
        "rmse_m": round(float(np.median([r["rmse_m"] for r in driven])), 3) if driven else None,
        "x_real_time_cpu": round(sum(r["seconds"] for r in driven) / max(sum(r["cpu_s"] for r in driven), 1e-9), 1),
    }  # fmt: skip


def main() -> None:
    """Drive, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("maps", type=Path, help="folder of maps, or one map.yaml")
    parser.add_argument("--map", action="append", default=[], help="only maps with this in their path")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="index of the first pair to drive")
    parser.add_argument("--people", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--local-planner", default=None)
    parser.add_argument("--global-planner", default=None)
    parser.add_argument("--localization", default="amcl")
    parser.add_argument("--set", action="append", default=[], dest="sets")
    parser.add_argument("--json", type=Path, default=None, help="every drive as a line of JSON")
    arguments = parser.parse_args()
    options = {
        "sets": tuple(arguments.sets), "people": arguments.people, "seed": arguments.seed,
        "local_planner": arguments.local_planner, "global_planner": arguments.global_planner, "localization": arguments.localization,
    }  # fmt: skip
    paths = [arguments.maps] if arguments.maps.is_file() else find_maps(arguments.maps)
    paths = [p for p in paths if not arguments.map or any(part in str(p) for part in arguments.map)]
    lines, everything = [], []
    with multiprocessing.get_context("spawn").Pool(arguments.jobs) as pool:
        for path in paths:
            try:
                pairs = draw_pairs(path, arguments.first + arguments.pairs, arguments.seed, options["sets"])
            except SlamcliError as error:
                print(f"{path}: skipped: {error}")
                continue
            if not pairs:
                print(f"{path}: skipped: the robot fits nowhere")
                continue
            jobs = [(path, i, *pair, options) for i, pair in enumerate(pairs)][arguments.first :]
            rows = pool.map(drive, jobs, chunksize=1)
            everything += rows
            lines.append(summarise(f"{path.parent.name}/{path.stem}", rows))
            print(json.dumps(lines[-1]), flush=True)
            for row in rows:
                possible = row["joined"]
                bad = [c for c in row.get("collisions", []) if c[3]]
                if (possible and row["status"] != "succeeded") or bad:
                    print(f"    pair {row['pair']}: {row['status']}: {row['message']} {bad}", flush=True)
    print(json.dumps(summarise("all", everything)))
    if arguments.json:
        arguments.json.write_text("".join(json.dumps(row) + "\n" for row in everything))


if __name__ == "__main__":
    main()
