# SPDX-License-Identifier: MIT
"""Worlds explored with both tiers, and goals driven to on the maps that came of it.

    python benchmarks/exploration.py office warehouse cluttered_room loop_corridor ../shared/data/maps/stdr/simple_rooms.yaml \
        [--slam gmapping] [--goals 3] [--seed 0] [--people 0] [--keep DIR]

Where a world has no start of its own the robot begins where it has the most room. Goals are drawn among all places
that it can get to in the true world.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from slamcli.pipelines.explore_request import explore_request
from slamcli.pipelines.explore_run import run_exploration
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigate_request import NavigateRequest
from slamcli.runtime import RunLog
from slamcli.simulation.free_space import FreeSpace

_ROOM_M = 0.4
"""What a goal keeps from walls."""


def start_of(world: str) -> tuple[float, ...]:
    """Return where the robot begins: x, y, yaw."""
    place = open_world(world)
    if place.start is not None:
        return tuple(float(v) for v in place.start)
    x, y = FreeSpace(place, _ROOM_M).roomiest().tolist()
    return x, y, 0.0


def draw_goals(world: str, start: tuple[float, ...], count: int, seed: int) -> np.ndarray:
    """Return places (count, 2) that can be reached in truth."""
    places = FreeSpace(open_world(world), _ROOM_M).places(np.array(start[:2]))
    return places[np.random.default_rng(seed).integers(len(places), size=count)]


def explore(world: str, slam: str, folder: Path, args: argparse.Namespace) -> str:
    """Explore, then drive on the map; return a row of the table."""
    start = start_of(world)
    drive = NavigateRequest(
        waypoints=(), world=world, slam=slam, start=start, seed=args.seed, people=args.people, output=folder, lean=True
    )
    began = time.process_time()
    outcome = run_exploration(explore_request(drive), RunLog())
    cpu_s = time.process_time() - began
    told, after = outcome.document["summary"], []
    robot = Navigator(folder / "map.yaml", world=world, start=start, seed=args.seed)
    for x, y in draw_goals(world, start, args.goals, args.seed).tolist():
        after.append(robot.go_to(x, y))
    hit = len(robot.plant.collisions)
    reached = f"{sum(a.succeeded for a in after)} of {len(after)}" + (f", {hit} collisions" if hit else "")
    for arrival in after:
        if not arrival.succeeded:
            print(f"   goal {arrival.goal[0]:.2f},{arrival.goal[1]:.2f} {arrival.status}: {arrival.message}")
    seconds = told["duration_s"]
    return (
        f"| {Path(world).stem} | {slam} | {told['status']} | {told['reachable_m2']:.0f} | {100 * told['coverage']:.2f} % "
        f"| {seconds:.0f} s | {told['path_length_m']:.0f} m | {told['goals']} | {told['goals_given_up']} | {told['recoveries']} "
        f"| {told['collisions']} | {told['localisation_rmse_m']:.3f} m | {seconds / cpu_s:.1f} | {reached} |"
    )


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="+")
    parser.add_argument("--slam", action="append", choices=["gmapping", "cartographer"])
    parser.add_argument("--goals", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--people", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="Folder for what the runs leave.")
    args = parser.parse_args()
    print(
        "| world | SLAM | | reachable m² | coverage | simulated | driven | goals | given up | recoveries | collisions | pose RMS | x real time | goals on its map |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for world in args.worlds:
            for slam in args.slam or ("gmapping", "cartographer"):
                folder = (args.keep or Path(scratch)) / f"{Path(world).stem}_{slam}"
                folder.parent.mkdir(parents=True, exist_ok=True)
                print(explore(world, slam, folder, args), flush=True)


if __name__ == "__main__":
    main()
