# SPDX-License-Identifier: MIT
"""AMCL on simulated recordings: accuracy, global localisation, kidnapping, bad starts, changed furniture, two scanners.

    python benchmarks/localization.py [accuracy] [global] [kidnapped] [start] [furniture] [lasers] [--maps ../shared/data/maps]
        [--runs 50] [--config move_base.launch] [--set KEY=VALUE] [--json FILE]

The robot drives at random for two minutes through built-in worlds and through maps, with the noise of odometry and scanner that
`slamcli generate` has. Parameters are the mission's (configs/move_base.launch). A run counts as localised if the pose comes within
0.3 m and 10 degrees of the truth and stays there to the end. CPU time is that of the filter per second of recording.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import time
from pathlib import Path

import numpy as np

from slamcli.geometry import quaternion, se2
from slamcli.grids import OccupancyGrid
from slamcli.localization.amcl import Amcl
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.measurements import LaserScan, Odometry
from slamcli.pipelines.config import load_declared
from slamcli.pipelines.generate import open_world
from slamcli.simulation import Simulation, resolve_settings
from slamcli.trajectory.wheel_odometry import WheelOdometry

WORLDS = ("office", "cluttered_room", "warehouse")
MAPS = ("nav2/depot.yaml", "meeting/meeting.yaml")
GLOBAL_WORLD = "office"
CLOSE_M, CLOSE_DEG = 0.3, 10.0
SECONDS = 120.0


@dataclasses.dataclass(frozen=True)
class Drive:
    """A simulated recording, scan by scan."""

    grid: OccupancyGrid
    scans: list[LaserScan]
    odometry: np.ndarray
    truth: np.ndarray
    mount: np.ndarray


@functools.lru_cache(maxsize=4)
def drive(world: str, seed: int, **settings: object) -> Drive:
    """Simulate one."""
    place = open_world(world)
    parameters = resolve_settings(place.settings, {name.replace("__", "."): v for name, v in settings.items()})
    simulation = Simulation(place, parameters, seed=seed, duration_s=SECONDS)
    scans, stamps, poses = [], [], []
    for message in simulation.messages():
        found = message.measurement
        if isinstance(found, LaserScan):
            scans.append(found)
        elif isinstance(found, Odometry) and message.topic == "/odom":
            stamps.append(found.stamp_ns)
            poses.append(found.pose_se2)
    truth = simulation.truth()
    at = np.array([scan.stamp_ns for scan in scans])
    p = parameters
    return Drive(
        grid=simulation.true_map(),
        scans=scans,
        odometry=WheelOdometry(np.array(stamps), np.array(poses)).at(at),
        truth=np.column_stack([truth.positions_m[:, :2], quaternion.yaw(truth.quats_xyzw)]),
        mount=np.array([p.laser_x, p.laser_y, np.radians(p.laser_yaw)]),
    )


@dataclasses.dataclass
class Errors:
    """What the filter was off by at each scan."""

    metres: np.ndarray
    degrees: np.ndarray
    cpu_s: float

    @classmethod
    def of(cls, truth: np.ndarray, told: np.ndarray, cpu_s: float) -> Errors:
        apart = se2.between(truth, told)
        return cls(np.hypot(apart[:, 0], apart[:, 1]), np.degrees(np.abs(apart[:, 2])), cpu_s)

    @property
    def settled(self) -> int | None:
        """The scan from which on the pose stays close; None if it does not in the last tenth."""
        far = np.flatnonzero((self.metres > CLOSE_M) | (self.degrees > CLOSE_DEG))
        first = int(far[-1]) + 1 if len(far) else 0
        return first if first < 0.9 * len(self.metres) else None

    def rmse(self, first: int = 0) -> tuple[float, float]:
        return tuple(float(np.sqrt(np.mean(v[first:] ** 2))) for v in (self.metres, self.degrees))  # type: ignore[return-value]


def follow(amcl: Amcl, parts: list[tuple[Drive, int, int]]) -> Errors:
    """Give the filter the scans of parts of drives, one after the other; odometry goes on between them."""
    told, truth, cpu = [], [], 0.0
    odom, last_ns = np.zeros(3), 0
    for found, first, end in parts:
        T_odom_this = se2.compose(odom, se2.inverse(found.odometry[first]))
        shift_ns = last_ns + 10**8 - found.scans[first].stamp_ns
        for k in range(first, end):
            odom, last_ns = se2.compose(T_odom_this, found.odometry[k]), found.scans[k].stamp_ns + shift_ns
            scan = dataclasses.replace(found.scans[k], stamp_ns=last_ns)
            began = time.process_time()
            amcl.update(odom, scan, found.mount)
            cpu += time.process_time() - began
            told.append(amcl.pose)
            truth.append(found.truth[k])
    return Errors.of(np.array(truth), np.array(told), cpu)


class Bench:
    """The measurements; each prints its table and returns its rows."""

    def __init__(self, parameters: AmclParameters, places: list[str], runs: int) -> None:
        self.parameters, self.places, self.runs = parameters, places, runs

    def amcl(self, grid: OccupancyGrid, seed: int) -> Amcl:
        return Amcl(self.parameters, grid, seed=seed)

    def accuracy(self) -> list[dict]:
        """Start at the truth; errors after the first 10 s."""
        rows = []
        for place in self.places:
            runs = []
            for seed in range(1, 6):
                found = drive(place, seed)
                amcl = self.amcl(found.grid, seed)
                amcl.set_pose(found.truth[0])
                runs.append(follow(amcl, [(found, 0, len(found.scans))]))
            metres = [run.rmse(100)[0] for run in runs]
            degrees = [run.rmse(100)[1] for run in runs]
            rows.append(
                {
                    "world": Path(place).stem, "runs": len(runs), "rmse_m": max(metres), "rmse_deg": max(degrees),
                    "largest_m": max(float(run.metres[100:].max()) for run in runs),
                    "cpu_ms_per_s": 1e3 * float(np.mean([run.cpu_s for run in runs])) / SECONDS,
                }
            )  # fmt: skip
        return show("accuracy (worst of the runs)", rows)

    def scattered(self) -> list[dict]:
        """Start anywhere with particles all over the map; ten starts in each drive."""
        rows = []
        for place in self.places:
            runs = []
            for n in range(self.runs if place == GLOBAL_WORLD else max(self.runs // 5, 1)):
                found = drive(place, 10 + n // 5)
                first = (n % 5) * 100
                amcl = self.amcl(found.grid, n)
                amcl.scatter()
                runs.append(follow(amcl, [(found, first, len(found.scans))]))
            rows.append(self._settled(place, runs))
        return show("global localisation", rows)

    def kidnapped(self) -> list[dict]:
        """After 40 s the robot is at another place, and odometry says nothing of it."""
        rows = []
        for place in self.places:
            runs = []
            for n in range(max(self.runs // 5, 1) if place != GLOBAL_WORLD else self.runs):
                before, after = drive(place, 10 + n // 5), drive(place, 20 + n // 5)
                first = 100 + (n % 5) * 100
                amcl = self.amcl(before.grid, n)
                amcl.set_pose(before.truth[0])
                follow_on = follow(amcl, [(before, 0, 400), (after, first, len(after.scans))])
                runs.append(Errors(follow_on.metres[400:], follow_on.degrees[400:], follow_on.cpu_s))
            rows.append(self._settled(place, runs))
        return show("kidnapped", rows)

    def start(self) -> list[dict]:
        """Start 1 m and 30 degrees off, with amcl's initial covariance."""
        rows = []
        for place in self.places:
            runs = []
            for n in range(max(self.runs // 5, 1)):
                found = drive(place, 1 + n // 5)
                angle = 2.0 * np.pi * n / 5
                off = np.array([np.cos(angle), np.sin(angle), np.radians(30.0 if n % 2 else -30.0)])
                amcl = self.amcl(found.grid, n)
                amcl.set_pose(se2.compose(found.truth[0], off))
                runs.append(follow(amcl, [(found, 0, len(found.scans))]))
            rows.append(self._settled(place, runs))
        return show("start 1 m and 30 degrees off", rows)

    def furniture(self) -> list[dict]:
        """A fifth of the map's walls is gone, in blocks of 1 m, and boxes of 0.5 m stand where none are."""
        rows = []
        for place in self.places:
            runs, begun = [], []
            for seed in range(1, 6):
                found = drive(place, seed)
                grid = changed(found, seed)
                amcl = self.amcl(grid, seed)
                amcl.set_pose(found.truth[0])
                runs.append(follow(amcl, [(found, 0, len(found.scans))]))
                begun.append(np.count_nonzero((grid.cells >= 65) != (found.grid.cells >= 65)))
            metres, degrees = ([run.rmse(100)[i] for run in runs] for i in (0, 1))
            share = float(np.mean(begun)) / max(int((drive(place, 1).grid.cells >= 65).sum()), 1)
            rows.append(
                {
                    "world": Path(place).stem, "runs": len(runs), "changed_share": share, "rmse_m": max(metres),
                    "rmse_deg": max(degrees), "largest_m": max(float(run.metres[100:].max()) for run in runs),
                }
            )  # fmt: skip
        return show("changed furniture (worst of the runs)", rows)

    def lasers(self) -> list[dict]:
        """One scanner ahead; the same and one that looks back, which hangs upside down."""
        rows = []
        for place in self.places:
            ahead = drive(place, 1)
            back = drive(place, 1, laser__x=-0.1, laser__yaw=180.0, laser__upside_down=True)
            T_back = np.diag([-1.0, 1.0, -1.0, 1.0])  # turned about z by 180 degrees, then about x
            T_back[:3, 3] = [-0.1, 0.0, 0.3]
            for name, mounts in (
                ("ahead", [(ahead, ahead.mount)]),
                ("both", [(ahead, ahead.mount), (back, T_back)]),
                ("back", [(back, T_back)]),
            ):
                amcl = self.amcl(ahead.grid, 1)
                amcl.set_pose(ahead.truth[0])
                told = []
                began = time.process_time()
                for k in range(len(ahead.scans)):
                    for found, mount in mounts:
                        topic = "/front" if found is ahead else "/back"
                        amcl.update(ahead.odometry[k], dataclasses.replace(found.scans[k], topic=topic), mount)
                    told.append(amcl.pose)
                errors = Errors.of(ahead.truth, np.array(told), time.process_time() - began)
                metres, degrees = errors.rmse(100)
                rows.append(
                    {
                        "world": Path(place).stem, "scanners": name, "rmse_m": metres, "rmse_deg": degrees,
                        "largest_m": float(errors.metres[100:].max()),
                    }
                )  # fmt: skip
        return show("several scanners", rows)

    def _settled(self, place: str, runs: list[Errors]) -> dict:
        ends = [run.settled for run in runs]
        good = [end for end in ends if end is not None]
        after = [run.rmse(end) for run, end in zip(runs, ends, strict=True) if end is not None]
        return {
            "world": Path(place).stem, "runs": len(runs), "localised": len(good), "share": len(good) / len(runs),
            "median_s": float(np.median(good)) / 10 if good else None, "longest_s": max(good) / 10 if good else None,
            "rmse_m_after": float(np.mean([m for m, _ in after])) if after else None,
            "cpu_ms_per_s": 1e3 * float(np.mean([run.cpu_s for run in runs])) * 10
            / float(np.mean([len(run.metres) for run in runs])),
        }  # fmt: skip


def changed(found: Drive, seed: int) -> OccupancyGrid:
    """Return the map with a fifth of its walls (in blocks of 1 m) gone, and boxes off the robot's way."""
    rng = np.random.default_rng([seed, 7])
    cells = found.grid.cells.copy()
    block = max(round(1.0 / found.grid.resolution_m), 1)
    rows, columns = -(-cells.shape[0] // block), -(-cells.shape[1] // block)
    gone = np.kron(rng.random((rows, columns)) < 0.2, np.ones((block, block), np.bool_))
    cells[(cells >= 65) & gone[: cells.shape[0], : cells.shape[1]]] = OccupancyGrid.FREE
    way = found.grid.map_to_cell(found.truth[:, :2])
    free = np.argwhere(cells == OccupancyGrid.FREE)
    for row, column in free[rng.integers(len(free), size=20)]:
        if np.abs(way - [row, column]).max(axis=1).min() > block:
            half = block // 4
            cells[row - half : row + half, column - half : column + half] = OccupancyGrid.OCCUPIED
    return OccupancyGrid(cells, found.grid.resolution_m, found.grid.origin)


def show(title: str, rows: list[dict]) -> list[dict]:
    """Print rows as a table."""
    print(f"\n{title}")
    print(" | ".join(rows[0]))
    for row in rows:
        print(" | ".join(f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()), flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=["accuracy", "global", "kidnapped", "start", "furniture", "lasers"])
    parser.add_argument("--maps", type=Path, default=Path("../shared/data/maps"))
    parser.add_argument("--worlds", nargs="*")
    parser.add_argument("--runs", type=int, default=50, help="in the office; a fifth of them elsewhere")
    parser.add_argument("--config", type=Path, default=Path("move_base.launch"))
    parser.add_argument("--set", dest="sets", action="append", default=[])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    parameters = load_declared("amcl", AmclParameters, [options.config], options.sets).parameters
    places = options.worlds or [*WORLDS, *(str(options.maps / name) for name in MAPS if (options.maps / name).exists())]
    bench = Bench(parameters, places, options.runs)
    measures = {"global": bench.scattered, "accuracy": bench.accuracy, "kidnapped": bench.kidnapped, "start": bench.start,
                "furniture": bench.furniture, "lasers": bench.lasers}  # fmt: skip
    found = {what: measures[what]() for what in options.what}
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
