# SPDX-License-Identifier: MIT
"""Accuracy and cost of the orbslam3 tier on real recordings, for several numbers of key points.

usage: python benchmarks/visual_slam.py DATA [--features 500,1000,2000] [--only NAME]

DATA is the folder ``visual`` of the real recordings (redkitchen, kitti06, fr3_cabinet). Each run is a fresh process of the installed
``slamcli``; the first one may compile kernels, so run ``slamcli warmup`` before. Printed per run: ATE RMSE after alignment (with scale for one camera),
share of the frames that have a pose, frames per second of all (start-up, files and report included), CPU seconds, peak memory.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import resource
import subprocess
import tempfile
import time

CASES = {
    "redkitchen rgbd": ("redkitchen", "rgbd", "groundtruth.tum", "se3"),
    "redkitchen mono": ("redkitchen", "mono", "groundtruth.tum", "sim3"),
    "kitti06 stereo": ("kitti06", "stereo", "groundtruth.tum", "se3"),
    "fr3_cabinet rgbd": ("fr3_cabinet", "rgbd", "groundtruth.txt", "se3"),
}


def run(command: list[str]) -> tuple[float, float]:
    """Run a command; return wall and CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.monotonic()
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - began, cpu


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--features", default="500,1000,2000")
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    print(
        "| recording | key points | ATE RMSE m | frames with a pose | keyframes | points | frames/s | CPU s | peak MB |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, (folder, mode, truth, alignment) in CASES.items():
        for number in args.features.split(",") if args.only in name else ():
            with tempfile.TemporaryDirectory() as out:
                wall, cpu = run(
                    ["slamcli", "map", "--algo", "orbslam3", str(args.data / folder), "--mode", mode, "-o", f"{out}/map",
                     "--set", f"ORBextractor.nFeatures={number}"]
                )  # fmt: skip
                record = json.loads(pathlib.Path(out, "map", "run.json").read_text())
                scored = subprocess.run(
                    ["slamcli", "evaluate", f"{out}/map/trajectory.tum", str(args.data / folder / truth), "--align-type", alignment, "--json"],
                    capture_output=True, text=True, check=True,
                )  # fmt: skip
            summary = record["summary"]
            error = next(v for k, v in _flat(json.loads(scored.stdout)) if k.endswith("rmse"))
            print(
                f"| {name} | {number} | {error:.4f} | {summary['tracked']}/{summary['frames']} | {summary['keyframes']} | {summary['points']} | "
                f"{summary['frames'] / wall:.0f} | {cpu:.1f} | {record['peak_memory_bytes'] / 1e6:.0f} |",
                flush=True,
            )


def _flat(document: object, prefix: str = "") -> list[tuple[str, float]]:
    """Return the numbers of a document by their path."""
    if isinstance(document, dict):
        return [pair for key, value in document.items() for pair in _flat(value, f"{prefix}.{key}")]
    return [(prefix, float(document))] if isinstance(document, (int, float)) else []


if __name__ == "__main__":
    main()
