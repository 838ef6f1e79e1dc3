# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
from pathlib import Path

import pytest
from drive_loop import Site, rooms

from slamcli.formats.maps import read_map
from slamcli.native.ros_yaml import read_ros_yaml
from slamcli.navigation.dwa import DwaPlanner
from slamcli.navigation.dwa_parameters import read_dwa
from slamcli.navigation.local_planner import LocalPlanner
from slamcli.navigation.pursuit import RegulatedPurePursuit
from slamcli.navigation.pursuit_parameters import PursuitParameters

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
MISSION = {
    s.name.removeprefix("DWAPlannerROS/"): s.value for s in read_ros_yaml(CONFIGS / "base_local_planner_params.yaml")
}
DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", "../shared/data")) / "maps"


def planner(name: str) -> LocalPlanner:
    if name == "dwa":
        return DwaPlanner(read_dwa(MISSION))
    return RegulatedPurePursuit(PursuitParameters())


@pytest.mark.parametrize(("name", "tolerance"), [("dwa", 0.15), ("pursuit", 0.25)])
@pytest.mark.parametrize("fov", [360.0, 180.0])
def test_reaches_goals_among_rooms_and_pillars(name: str, tolerance: float, fov: float) -> None:
    site = Site(rooms(0))
    for i, (start, goal) in enumerate(site.pairs(2, seed=int(fov))):
        drive = site.drive(planner(name), start, goal, seed=i, fov_deg=fov)
        assert drive.reached, (start, goal, drive)
        assert drive.collisions == 0
        assert drive.off_m < tolerance + 0.02
        assert drive.driven_m < 1.1 * drive.planned_m


def test_the_same_drive_twice() -> None:
    site = Site(rooms(1))
    start, goal = site.pairs(1, seed=3)[0]
    first, second = (site.drive(planner("dwa"), start, goal, seed=5) for _ in range(2))
    assert first == second


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["nav2/tb3_sandbox", "stdr/sparse_obstacles"])
def test_reaches_goals_on_published_maps(name: str) -> None:
    path = DATA / f"{name}.yaml"
    if not path.is_file():
        pytest.skip(f"no {path}: set SLAMCLI_TEST_DATA")
    site = Site(read_map(path).grid)
    for i, (start, goal) in enumerate(site.pairs(2, seed=1)):
        drive = site.drive(planner("dwa"), start, goal, seed=i)
        assert drive.reached, (start, goal, drive)
        assert drive.collisions == 0
