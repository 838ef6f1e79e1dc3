# SPDX-License-Identifier: MIT
"""How fast the simulated robot's side of a closed loop runs, alone: physics, odometry, scans and people.

    python benchmarks/simulator.py [WORLD ...] --people 0,5,50 --seconds 60

A WORLD is a map.yaml, a world file or a built-in name; left out: an office of 50 x 50 m at 0.05 m per cell, made here, and
`warehouse`. 360 beams 10 times, odometry and a command 20 times, and 100 ticks in a simulated second. CPU time of this process.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from slamcli.errors import PlanningError
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.generate import open_world
from slamcli.simulation import Plant, World, resolve_settings
from slamcli.simulation.site import site_of

SETTINGS = {"laser.beams": 360, "laser.fov": 360.0, "laser.range_max": 30.0, "robot.radius": 0.2}


def office() -> World:
    """Return a map of 50 x 50 m: rooms of 5 m with doors of 1.2 m, and furniture."""
    cells = np.zeros((1000, 1000), np.int8)
    for at in [*range(0, 1000, 100), 999]:
        cells[at], cells[:, at] = 100, 100
    for at in range(100, 1000, 100):
        for door in range(38, 1000, 100):
            cells[at, door : door + 24] = cells[door : door + 24, at] = 0
    rng = np.random.default_rng(0)
    for row, column in rng.integers(0, 10, (60, 2)):
        cells[100 * row + 10 : 100 * row + 24, 100 * column + 12 : 100 * column + 30] = 100
    return World(name="office 50 x 50 m", grid=OccupancyGrid(cells, 0.05))


def run(world: World, people: int, seconds: int, seed: int) -> tuple[float, float, int]:
    """Return CPU seconds to place everything and per simulated second, and the number of contacts."""
    parameters = resolve_settings(world.settings, SETTINGS, {"people.count": people})
    start = np.array([*site_of(world).space.roomiest(), 0.0])
    began = time.process_time()
    plant = Plant(world, parameters, start=start, seed=seed)
    placed = time.process_time()
    rng = np.random.default_rng(seed)
    twist = np.zeros(3)
    for step in range(20 * seconds):
        if step % 40 == 0:
            twist = np.array([rng.uniform(0.0, 0.6), 0.0, rng.uniform(-0.8, 0.8)])
        plant.command(twist)
        plant.advance(0.05)
        plant.odometry()
        if step % 2:
            plant.scan()
    return placed - began, (time.process_time() - placed) / seconds, len(plant.collisions)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", metavar="WORLD")
    parser.add_argument("--people", default="0,5,50", help="numbers of people, with commas")
    parser.add_argument("--seconds", type=int, default=60, help="simulated seconds of each run")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    worlds = [open_world(name) for name in args.worlds] or [office(), open_world("warehouse")]
    print("| world | people | placed (ms) | CPU ms per simulated second | x real time |")
    print("|---|---|---|---|---|")
    for world in worlds:
        for people in (int(n) for n in args.people.split(",")):
            try:
                run(world, people, 2, args.seed)  # kernels and the world's own fields are there from now on
                placed, per_second, _ = run(world, people, args.seconds, args.seed)
            except PlanningError as error:
                print(f"| {world.name} | {people} | {error} | | |")
                continue
            print(
                f"| {world.name} | {people} | {1e3 * placed:.1f} | {1e3 * per_second:.2f} | {1 / per_second:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
