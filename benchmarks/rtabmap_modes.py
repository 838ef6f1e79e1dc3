# SPDX-License-Identifier: MIT
"""Accuracy and cost of the rtabmap tier for every combination of sensors, on recordings with truth.

usage: python benchmarks/rtabmap_modes.py DATA [--only TEXT] [--out FOLDER] [--verbose]

DATA is a folder of recordings NAME.mcap with NAME.truth.tum beside them; those that are not there are left out. They are made with
`slamcli generate` (`benchmarks/camera_recordings.py`, `benchmarks/sensor_recordings.py`, and `fused_...` with `--recordings`). Each run is
a fresh process; run `slamcli warmup` before. Printed per run: ATE RMSE after an alignment by SE(3), share of the frames or scans that have a
pose, nodes, links by looks and by nearness, how often odometry began anew, CPU seconds of the process, peak memory.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import re
import resource
import subprocess
import sys
import tempfile

import numpy as np

from slamcli.errors import SlamcliError
from slamcli.formats.trajectories import read_tum
from slamcli.geometry import alignment
from slamcli.pipelines.generate import generate
from slamcli.trajectory import interpolate

RGBD = ["--mode", "rgbd"]
OWN = ["--odom-topic", "none"]
GIVEN = ["--set", "slamcli.odometry=recording"]
VISUAL = ["--set", "slamcli.odometry=visual"]
NO_IMU = ["--imu-topic", "none"]
SCANS = ["--mode", "scan"]

# label: recording, options
CASES: dict[str, tuple[str, list[str]]] = {
    "RGB-D": ("small_room", [*RGBD, *OWN, *NO_IMU]),
    "RGB-D, IMU": ("small_room", [*RGBD, *OWN]),
    "RGB-D, odometry": ("small_room", RGBD),
    "RGB-D, odometry alone moves it": ("small_room", [*RGBD, *GIVEN]),
    "RGB-D, scans": ("small_room", OWN),
    "RGB-D, scans, odometry": ("small_room", []),
    "RGB-D, scans, odometry alone moves it": ("small_room", GIVEN),
    "one camera, scans, odometry": ("small_mono", ["--rgb-topic", "/camera/color/image_raw"]),
    "scans": ("small_room", [*SCANS, *OWN]),
    "scans, odometry": ("small_room", SCANS),
    "scans, odometry alone moves it": ("small_room", [*SCANS, *GIVEN]),
    "RGB-D in offices": ("fused_cloud_rgbd", [*RGBD, *OWN]),
    "RGB-D, clouds": ("fused_cloud_rgbd", OWN),
    "RGB-D, clouds, odometry": ("fused_cloud_rgbd", []),
    "RGB-D, clouds, odometry alone moves it": ("fused_cloud_rgbd", GIVEN),
    "RGB-D, clouds, both alone": ("fused_cloud_rgbd", [*OWN, "--set", "slamcli.odometry=scan"]),
    "RGB-D, clouds, odometry, clouds move it": ("fused_cloud_rgbd", ["--set", "slamcli.odometry=scan"]),
    "clouds": ("fused_cloud_rgbd", [*SCANS, *OWN, *NO_IMU]),
    "clouds, IMU": ("fused_cloud_rgbd", [*SCANS, *OWN]),
    "clouds, odometry": ("fused_cloud_rgbd", [*SCANS, *NO_IMU]),
    "clouds, odometry, IMU": ("fused_cloud_rgbd", SCANS),
    "clouds, odometry alone moves it": ("fused_cloud_rgbd", [*SCANS, *GIVEN]),
    "stereo": ("fused_stereo_odom", OWN),
    "stereo, odometry": ("fused_stereo_odom", []),
    "stereo, odometry alone moves it": ("fused_stereo_odom", GIVEN),
    "stereo in a room": ("room_stereo_inertial", NO_IMU),
    "stereo in a room, IMU": ("room_stereo_inertial", []),
    "stereo, not rectified": ("room_radtan_stereo", []),
    "stereo, fisheye": ("desk_fisheye_stereo_inertial", []),
    "RGB-D in a room": ("room_rgbd", []),
    "RGB-D, blur and rolling shutter": ("room_rgbd_hard", []),
    "RGB-D, corridor": ("loop_rgbd", []),
    "scans, corridor": ("loop_corridor", OWN),
    "scans, odometry, corridor": ("loop_corridor", []),
    "two scanners": ("two_lasers", []),
    "two scanners, both named": ("two_lasers", ["--scan-topic", "/scan_front", "--scan-topic", "/scan_rear"]),
    "multi-echo": ("multi_echo", []),
    "scans, IMU": ("imu_scan_only", []),
    "a planar scanner's clouds": ("cloud2d", []),
    "scans and landmarks": ("fix_landmarks", []),
    "clouds in hills": ("yard3d", []),
    "images black for 2 s": ("bad_black", []),
    "4 frames of 10 missing": ("bad_drops", []),
    "bare walls": ("bad_plain", []),
    "another size from 3 s on": ("bad_resize", []),
    "depth 0.25 s late": ("bad_depth_delay", []),
    "depth five times": ("bad_depth_scale", []),
    "images end half way": ("fused_blind", []),
    "images black for 8 s, odometry": ("fused_black", RGBD),
    "images black for 8 s, scans, odometry": ("fused_black", []),
    "1 Hz, odometry": ("fused_slow", RGBD),
    "1 Hz": ("fused_slow", [*RGBD, *OWN]),
    "wheels slip": ("fused_slip", RGBD),
    "wheels slip, scans": ("fused_slip", []),
    "wheels slip, odometry alone moves it": ("fused_slip", [*RGBD, *GIVEN]),
    "stereo, wheels slip": ("fused_street_slip", []),
}

SMALL = {"camera.kind": "rgbd", "camera.width": 320, "camera.height": 240, "camera.rate": 10, "imu.enabled": True}
RECORDINGS: dict[str, tuple[str, dict[str, float | str], float]] = {
    "small_room": ("cluttered_room", {**SMALL, "camera.rate": 5}, 60.0),
    "small_mono": ("cluttered_room", {**SMALL, "camera.kind": "mono", "camera.rate": 5}, 60.0),
    "fused_black": ("cluttered_room", {**SMALL, "camera.black_from": 20, "camera.black_seconds": 8}, 60.0),
    "fused_blind": ("cluttered_room", {**SMALL, "camera.black_from": 25, "camera.black_seconds": 1000}, 60.0),
    "fused_slow": ("cluttered_room", {**SMALL, "camera.rate": 1}, 60.0),
}
"""Made with ``--recordings`` where they are not there: name, world, settings, seconds."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("--only", default="", help="of the cases whose recording and sensors this expression finds")
    parser.add_argument("--out", type=pathlib.Path, help="keep results here")
    parser.add_argument("--duration", type=float, help="seconds of each recording, its first ones")
    parser.add_argument("--verbose", action="store_true", help="also print what each run said")
    parser.add_argument("--recordings", action="store_true", help="make those recordings in DATA that are not there")
    arguments = parser.parse_args()
    if arguments.recordings:
        make(arguments.data)
    print("| sensors | recording | ATE m | way m | with a pose | nodes | by looks | near | anew | CPU s | peak MB |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for label, (name, options) in CASES.items():
        if re.search(arguments.only, f"{name} {label}"):
            if not (arguments.data / f"{name}.mcap").exists():
                print(f"{label}: there is no {arguments.data / name}.mcap", file=sys.stderr)
                continue
            with tempfile.TemporaryDirectory() as folder:
                options = options if arguments.duration is None else [*options, "--duration", str(arguments.duration)]
                out = (arguments.out or pathlib.Path(folder)) / f"{name} {label}".replace(" ", "_").replace(",", "")
                print(
                    f"| {label} | {name} | {row(arguments.data, name, options, out, arguments.verbose)} |", flush=True
                )


def make(folder: pathlib.Path) -> None:
    """Make the recordings that are not there."""
    for name, (world, settings, seconds) in RECORDINGS.items():
        path = folder / f"{name}.mcap"
        if not path.exists():
            generate(world, path, seed=1, duration_s=seconds, settings=settings, truth=folder / f"{name}.truth.tum")


def row(data: pathlib.Path, name: str, options: list[str], out: pathlib.Path, verbose: bool) -> str:
    """Map a recording; return what came of it."""
    command = [sys.executable, "-m", "slamcli", "map", "--algo", "rtabmap", str(data / f"{name}.mcap"), "-o", str(out)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ran = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if verbose:
        sys.stderr.write(f"--- {name} {' '.join(options)}\n{ran.stderr}{ran.stdout}")
    if ran.returncode != 0:
        return f"exit code {ran.returncode}: {(ran.stderr.strip() or ran.stdout).splitlines()[-1]}"
    record = json.loads((out / "run.json").read_text())
    told = record["summary"]
    try:
        error_m, way_m, count = score(out / "trajectory.tum", data / f"{name}.truth.tum")
    except SlamcliError as error:
        return f"not scored: {error}"
    return (
        f"{error_m:.4f} | {way_m:.0f} | {count}/{told['frames']} | {told['nodes in the map']}/{told['nodes']} | {told['loop_closures']} | "
        f"{told['proximity_closures']} | {told['odometry_resets']} | {cpu_s:.1f} | {record['peak_memory_bytes'] / 1e6:.0f}"
    )


def score(estimate_path: pathlib.Path, truth_path: pathlib.Path) -> tuple[float, float, int]:
    """Return the ATE's RMSE and the way, metres, and how many poses there are."""
    estimate, truth = read_tum(estimate_path), read_tum(truth_path)
    inside = (estimate.stamps_ns >= truth.stamps_ns[0]) & (estimate.stamps_ns <= truth.stamps_ns[-1])
    there = interpolate(truth, estimate.stamps_ns[inside])
    laid = alignment.umeyama(estimate.positions_m[inside], there.positions_m)
    errors = np.linalg.norm(laid.transform_points(estimate.positions_m[inside]) - there.positions_m, axis=1)
    way = float(np.linalg.norm(np.diff(there.positions_m, axis=0), axis=1).sum())
    return float(np.sqrt(np.mean(errors**2))), way, len(estimate.stamps_ns)


if __name__ == "__main__":
    main()
