# SPDX-License-Identifier: MIT
"""The timed elastic band in a loop of its own: how long a cycle takes, who arrives, who is met.

    python benchmarks/teb.py [--goals 40] [--maps ../shared/data/maps]

The loop knows the pose exactly; robot, costmap and people are those of tests/navigation/elastic_loop.py. Times are CPU
times of `compute_command`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "navigation"))

from elastic_loop import Loop, Outcome, free_poses, room_world

from slamcli.formats.maps import read_map
from slamcli.navigation.teb import TebParameters, TebPlanner
from slamcli.parameters import resolve
from slamcli.simulation.world import OCCUPIED_FROM

ROBOT = {
    "max_vel_x": 0.5,
    "max_vel_x_backwards": 0.1,
    "max_vel_theta": 1.5,
    "acc_lim_x": 2.5,
    "acc_lim_theta": 3.2,
    "xy_goal_tolerance": 0.15,
    "yaw_goal_tolerance": 0.15,
}
"""The limits of the robot of configs/base_local_planner_params.yaml."""
DATA_MAPS = ("nav2/depot.yaml", "stdr/simple_rooms.yaml", "turtlebot3/map.yaml")


def drive_all(name: str, loop: Loop, values: dict, goals: int, people: int = 0, share: bool = False) -> None:
    """Drive to random goals and print a line."""
    poses = free_poses(loop, 2 * goals, seed=1)
    planner = TebPlanner(resolve(TebParameters, values), seed=0)
    outcomes: list[Outcome] = []
    for k, (start, goal) in enumerate(zip(poses[::2], poses[1::2], strict=True)):
        walk = walkers(loop, people, k, start) if people else None
        outcomes.append(loop.drive(planner, start, goal, people=walk, share_discs=share))
    cpu = 1e3 * np.concatenate([outcome.cpu_s for outcome in outcomes])
    ratios = [o.length_m / o.plan_m for o in outcomes if o.reached and o.plan_m > 1.0]
    print(
        f"| {name} | {sum(o.reached for o in outcomes)}/{goals} | {sum(o.collided for o in outcomes)} |"
        f" {sum(o.hit_person for o in outcomes) if people else ''} | {np.median(ratios):.3f} |"
        f" {np.mean(cpu):.2f} | {np.percentile(cpu, 99):.2f} |",
        flush=True,
    )


def walkers(loop: Loop, count: int, seed: int, start: np.ndarray):
    """Discs that walk to and fro between free places, stop for nobody, and begin away from the robot."""
    ends = free_poses(loop, 40 * count, seed=[seed, 7])[:, :2].reshape(-1, 2, 2)
    lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    free = [
        k
        for k, (a, b) in enumerate(ends)
        if 1.5 < lengths[k] < 8.0 and np.hypot(*(a - start[:2])) > 1.5 and not crosses(loop, a, b)
    ][:count]

    def discs(time_s: float, _: np.ndarray) -> np.ndarray:
        rows = []
        for k in free:
            a, b = ends[k]
            phase = (0.5 * time_s / lengths[k]) % 2.0
            share, sign = (phase, 1.0) if phase < 1.0 else (2.0 - phase, -1.0)
            rows.append([*(a + share * (b - a)), 0.25, *(0.5 * sign * (b - a) / lengths[k])])
        return np.array(rows).reshape(-1, 5)

    return discs


def crosses(loop: Loop, a: np.ndarray, b: np.ndarray) -> bool:
    """Whether an obstacle lies between two points."""
    points = a + np.linspace(0.0, 1.0, 200)[:, None] * (b - a)
    cells = (points / loop.resolution_m).astype(int)
    return bool(loop.occupied[cells[:, 1], cells[:, 0]].any())


def main() -> None:
    """Drive, and print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=40)
    parser.add_argument("--maps", type=Path, default=None, help="folder of maps; none: only rooms of its own")
    arguments = parser.parse_args()
    print(
        "| world | arrived | hit walls | hit people | way / plan | ms a cycle, mean | 99 % |\n|---|---|---|---|---|---|---|"
    )
    room = room_world()
    drive_all("room, the original's limits", Loop(room), {}, arguments.goals)
    drive_all("room", Loop(room), ROBOT, arguments.goals)
    drive_all("room, 80 x 80 cells of 0.1 m, 3 m ahead", Loop(room[::2, ::2], 0.1, side_m=8.0), ROBOT, arguments.goals)
    drive_all("room, 160 x 160 cells, 3 m ahead", Loop(room, side_m=8.0), ROBOT, arguments.goals)
    single = ROBOT | {"enable_homotopy_class_planning": False}
    drive_all("room, one band", Loop(room), single, arguments.goals)
    long = np.array([[0.3, 0.16], [-0.3, 0.16], [-0.3, -0.16], [0.3, -0.16]])
    drive_all("room, robot of 0.6 x 0.32 m", Loop(room, footprint=long), ROBOT, arguments.goals)
    car = ROBOT | {"min_turning_radius": 0.4, "max_vel_x_backwards": 0.3}
    drive_all("room, car, 0.4 m turning radius", Loop(room), car, arguments.goals)
    drive_all("room, 5 people who see nobody", Loop(room), ROBOT, arguments.goals, people=5)
    seen = ROBOT | {"costmap_converter_plugin": "costmap_converter::CostmapToDynamicObstacles"}
    drive_all("the same, motion seen (CostmapToDynamicObstacles)", Loop(room), seen, arguments.goals, people=5)
    drive_all("the same, motion told", Loop(room), ROBOT, arguments.goals, people=5, share=True)
    for name in DATA_MAPS if arguments.maps else ():
        grid = read_map(arguments.maps / name).grid
        occupied = (grid.cells >= OCCUPIED_FROM) | (grid.cells < 0)
        drive_all(name, Loop(occupied, grid.resolution_m), ROBOT, arguments.goals)


if __name__ == "__main__":
    main()
