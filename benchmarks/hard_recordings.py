# SPDX-License-Identifier: MIT
"""Recordings that are hard for SLAM, one fault or limit each, with true trajectories and maps.

    python benchmarks/hard_recordings.py OUT [NAME ...] [--seed N]

writes OUT/NAME.bag, OUT/NAME.truth.tum and OUT/NAME.map.yaml. docs/generate.md says what each is for.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from slamcli.errors import SlamcliError
from slamcli.pipelines.generate import generate

FAST = {"robot.turn_rate": 2.0, "robot.turn_acceleration": 6.0}
SICK = {"laser.beams": 361, "laser.fov": 180, "laser.range_max": 30, "laser.resolution": 0.01, "laser.rate": 5}
SICK["laser.sweep"] = 0.0267  # its mirror turns at 75 Hz and needs two turns for half degrees; scans are sent at 5 Hz
SHORT = {
    "laser.beams": 682,
    "laser.fov": 240,
    "laser.range_max": 4,
    "laser.range_min": 0.02,
    "laser.noise_relative": 0.01,
}

# name: (world, settings, seconds or None for the world's route)
VARIANTS: dict[str, tuple[str, dict[str, float | str], float | None]] = {
    "office": ("office", {}, None),
    "fresh-odometry-0.1": ("office", {**FAST, "clock.laser_offset": 0.1}, None),
    "fresh-odometry-0.2": ("office", {**FAST, **SICK, "clock.laser_offset": 0.2}, None),
    "stale-odometry-0.1": ("office", {**FAST, "clock.laser_offset": -0.1}, None),
    "jitter": ("office", {**FAST, "clock.laser_jitter": 0.05}, None),
    "slip": ("office", {"slip.count": 6, "slip.seconds": 2.0}, None),
    "slip-loop": ("loop_corridor", {"slip.count": 4, "slip.seconds": 2.0}, None),
    "short-range": ("office", {**SHORT}, None),
    "short-range-room": ("cluttered_room", {**SHORT}, 240.0),
    "sick-5hz": ("loop_corridor", {**SICK}, None),
    "sick-5hz-office": ("office", {**SICK, **FAST, "odometry.stt": 0.1}, None),
    "poor-odometry": ("office", {"odometry.srr": 0.1, "odometry.srt": 0.08, "odometry.stt": 0.15, "odometry.pull": 0.02}, None),
    "people": ("office", {"people.count": 10}, None),
    "long-loop": ("long_loop", {}, None),
    "long-loop-short-range": ("long_loop", {"laser.range_max": 8, "laser.rate": 6}, None),
    "warehouse": ("warehouse", {}, 400.0),
}  # fmt: skip


def main() -> None:
    """Write the variants that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(VARIANTS)}")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or VARIANTS:
        if name not in VARIANTS:
            parser.error(f"no variant {name!r}; there are {', '.join(VARIANTS)}")
        world, settings, duration_s = VARIANTS[name]
        stem = arguments.out / name
        try:
            made = generate(
                world, f"{stem}.bag", seed=arguments.seed, duration_s=duration_s, settings=settings,
                truth=f"{stem}.truth.tum", map_path=f"{stem}.map.yaml",
            )  # fmt: skip
        except SlamcliError as error:
            parser.exit(1, f"{name}: {error}\n")
        slips = " ".join(f"{a:.1f}-{b:.1f} s" for a, b in made.slips_s)
        print(
            f"{name}: {made.duration_s:.0f} s, {made.length_m:.0f} m, {made.messages['/scan']} scans, "
            f"{made.speed:.0f} x real time{', slips at ' + slips if slips else ''}",
            flush=True,
        )


if __name__ == "__main__":
    main()
