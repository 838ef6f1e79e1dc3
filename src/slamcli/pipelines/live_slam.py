# SPDX-License-Identifier: MIT
"""A tier that maps as it goes, built for the scanner of a simulated robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.mapper import LiveMapper, SensorOffer, Setup, find_live_tier
from slamcli.native import read_launch
from slamcli.native.settings import find_native
from slamcli.pipelines.config import load_native
from slamcli.pipelines.native_files import starts_node
from slamcli.runtime import RunLog

LIVE_TIERS = ("gmapping", "cartographer")


def build_live_slam(
    algo: str,
    files: Sequence[Path],
    sets: Sequence[str],
    *,
    scan_topic: str,
    T_base_laser: NDArray[np.float64],
    seed: int,
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> LiveMapper:
    """Return a mapper that takes the scans of one planar scanner, and odometry.

    Parameters
    ----------
    algo
        gmapping or cartographer.
    files
        Configuration files: those that say something to this tier are read, launch files that do not start it are left to navigation.
    sets
        ``KEY=VALUE`` with native names of the tier.
    scan_topic
        Topic of the scans.
    T_base_laser
        float64 (4, 4), where the scanner is.
    seed
        Of every draw.
    log
        Gets notes of what has no effect.
    arguments
        Values for the arguments of launch files.

    Raises
    ------
    UsageError
        If the tier does not map as it goes.
    ConfigError
        If a file or a parameter cannot be used.
    """
    log = log or RunLog()
    tier = find_live_tier(algo)
    config = load_native(algo, files, sets, log, arguments)
    plan = tier.plan(config.parameters, config.sources.keys(), SensorOffer(num_laser_scans=1, odometry=True), log)
    setup = Setup(T_base_laser={scan_topic: T_base_laser}, seed=seed, log=log)
    return tier.build_live(plan.parameters, setup)


def files_of_tier(algo: str, files: Sequence[Path], arguments: Mapping[str, str] | None = None) -> tuple[Path, ...]:
    """Return those of `files` that say something to a tier: its Lua files, and launch files that start it."""
    found = []
    for file in files:
        path = find_native(Path(file))
        suffix = path.suffix.lower()
        if (suffix == ".lua" and algo == "cartographer") or (
            suffix in (".launch", ".xml") and starts_node(algo, read_launch(path, arguments or {}))
        ):
            found.append(path)
    return tuple(found)
