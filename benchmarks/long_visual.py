# SPDX-License-Identifier: MIT
"""Memory and time over a long recording: 7-Scenes RedKitchen played forth and back until it has so many frames.

    python benchmarks/long_visual.py OUT [--data ../shared/data/visual/redkitchen] [--frames 5000] [--algo A ...] [--set KEY=VALUE ...]

writes OUT/recording (links to the frames, which are not copied) and OUT/ALGO, and prints frames a CPU second and the peak of memory.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]
OPTIONS = {"orbslam3": ["--mode", "rgbd"], "rtabmap": []}


def play(source: Path, target: Path, frames: int) -> None:
    """Link frames of a 7-Scenes folder under new numbers, forth and back."""
    names = sorted({path.name.split(".")[0] for path in source.glob("frame-*.color.*")})
    if len(names) < 2:
        sys.exit(f"long_visual.py: {source} holds no frames of a 7-Scenes sequence: name its folder with --data")
    target.mkdir(parents=True, exist_ok=True)
    turn = [*range(len(names)), *range(len(names) - 2, 0, -1)]
    parts = {name: list(source.glob(f"{name}.*")) for name in names}
    for number in range(frames):
        name = names[turn[number % len(turn)]]
        for path in parts[name]:
            link = target / path.name.replace(name, f"frame-{number:06d}")
            if not link.exists():
                link.symlink_to(path.resolve())
    for path in source.iterdir():
        if path.is_file() and not path.name.startswith("frame-") and path.suffix not in (".tum", ".csv"):
            link = target / path.name
            if not link.exists():
                link.symlink_to(path.resolve())


def main() -> None:
    """Map the long recording with the systems that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=HERE / "shared" / "data" / "visual" / "redkitchen")
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--algo", action="append", choices=list(OPTIONS))
    parser.add_argument("--set", action="append", default=[], dest="sets", metavar="KEY=VALUE")
    arguments = parser.parse_args()
    recording = arguments.out / "recording"
    play(arguments.data, recording, arguments.frames)
    print("| system | frames | with a pose | CPU s | frames a CPU second | peak memory |\n|---|---|---|---|---|---|")
    for algo in arguments.algo or OPTIONS:
        target = arguments.out / algo
        command = [sys.executable, "-m", "slamcli", "map", "--algo", algo, str(recording), "-o", str(target), "--quiet"]
        command += [*OPTIONS[algo], *(word for one in arguments.sets for word in ("--set", one))]
        before = sum(os.times()[2:4])
        subprocess.run(command, check=True)
        cpu = sum(os.times()[2:4]) - before
        run = json.loads((target / "run.json").read_text())
        poses = sum(1 for line in (target / "trajectory.tum").read_text().splitlines() if not line.startswith("#"))
        megabytes = run["peak_memory_bytes"] / 1e6
        print(
            f"| {algo} | {arguments.frames} | {poses} | {cpu:.0f} | {arguments.frames / cpu:.1f} | {megabytes:.0f} MB |",
            flush=True,
        )


if __name__ == "__main__":
    main()
