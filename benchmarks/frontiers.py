# SPDX-License-Identifier: MIT
"""How long a search for frontiers takes, CPU time.

    slamcli generate office office.bag --map-out office.map.yaml        (the same for other worlds)
    python benchmarks/frontiers.py office.map.yaml [more.map.yaml ...]

Of each map everything farther than 5 m from a free cell in its middle is made unknown. Besides: an open plane of 1000 x 1000 cells, all of which can be
crossed, and the same with 2 % obstacles and a strip of unknown cells.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from slamcli.formats.maps import read_map
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.navigation.frontiers import FrontierSearch, costs_of_map, warm

RUNS = 20


def measure(name: str, costs: np.ndarray, pose: np.ndarray, origin=(0.0, 0.0), resolution_m=0.05) -> None:
    for gain in ("size", "visible"):
        search = FrontierSearch(ExploreParameters(gain=gain))
        spent = []
        for _ in range(RUNS):
            start = time.process_time()
            found = search.find(costs, origin, resolution_m, pose)
            spent.append(1e3 * (time.process_time() - start))
        print(
            f"{name:16s} {costs.shape[0]} x {costs.shape[1]}, gain {gain:8s}{len(found):4d} frontiers: first {spent[0]:.1f} ms,"
            f" then median {np.median(spent[1:]):.1f} ms, longest {max(spent[1:]):.1f} ms"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("maps", nargs="*", type=Path)
    warm()
    plane = np.zeros((1000, 1000), np.uint8)
    plane[:, 980:] = 255
    measure("plane", plane, np.array([25.0, 25.0, 0.0]))
    random = np.random.default_rng(0)
    plane[random.random(plane.shape) < 0.02] = 254
    measure("2 % obstacles", plane, np.array([25.0, 25.0, 0.0]))
    for path in parser.parse_args().maps:
        grid = read_map(path).grid
        costs = costs_of_map(grid)
        free = np.argwhere(costs == 0)
        cell = free[len(free) // 2]
        row, column = np.indices(costs.shape)
        costs[np.hypot(row - cell[0], column - cell[1]) > 5.0 / grid.resolution_m] = 255
        pose = np.append(grid.cell_to_map([cell])[0], 0.0)
        measure(path.stem.split(".")[0], costs, pose, grid.origin[:2], grid.resolution_m)


if __name__ == "__main__":
    main()
