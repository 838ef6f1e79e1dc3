# SPDX-License-Identifier: MIT
"""LiDAR odometry in space on synthetic worlds: `slamcli map --algo cartographer` beside kiss-icp, on the same recordings.

    pip install kiss-icp
    python benchmarks/lidar_odometry.py OUT [WORLD ...] [--seeds 1 2 3] [--methods loops local kiss kiss-range] [--duration S]
                                        [--set KEY=VALUE] [--map-set KEY=VALUE]

Recordings are made in OUT where they are not there yet. Methods: `loops` is cartographer as it is, `local` without loop
closure (SLAMCLI_3D.search_rounds = 0), `kiss` is kiss-icp as it is (100 m, cells of 1 m, deskewing), `kiss-range` the
same told the scanner's range (cells of a hundredth of it, its own rule). One line each:

- ATE: root mean square of the distances between the scanned and the true positions of base_link, after the best rigid
  transform in space; and its share of the way.
- drift: mean translational error of all segments of 50 m (KITTI's measure), in percent; none where the way is shorter.
- end: how far the last position relative to the first one is from the truth, after the same transform.
- ms/cloud: wall time from opening the recording to the end of the mapping, over clouds; for kiss-icp with reading by
  slamcli's reader, and in brackets without reading. slamcli reads, maps, and writes map, cloud and report.

kiss-icp tells the pose at the end of a revolution, cartographer at its stamp; each is compared with the truth of its time.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from slamcli.evaluation.segments import kitti_errors
from slamcli.formats.trajectories import read_tum
from slamcli.geometry import alignment, se3
from slamcli.measurements import Odometry, PointCloud
from slamcli.pipelines.generate import generate
from slamcli.recordings import open_recording
from slamcli.trajectory import Trajectory, interpolate, path_lengths

WORLDS = ("office3d", "yard3d", "corridor3d")
SEGMENT_M = 50.0


@dataclass(frozen=True)
class Run:
    """What one method made of one recording."""

    trajectory: Trajectory
    """Poses of base_link."""
    seconds: float
    note: str = ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--duration", type=float)
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="KEY=VALUE", help="of the world")
    parser.add_argument("--map-set", action="append", default=[], metavar="KEY=VALUE", help="of cartographer")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print("| world | seed | method | ATE m | % of way | drift % | end m | ms/cloud | x real time |")
    print("|---|---|---|---|---|---|---|---|---|")
    for world in arguments.worlds:
        for seed in arguments.seeds:
            bag = recording(arguments.out, world, seed, arguments.duration, arguments.settings)
            truth, clouds, span_s = read_truth(bag)
            for method in arguments.methods:
                try:
                    made = METHODS[method](bag, arguments.out, arguments.map_set)
                except (subprocess.CalledProcessError, ImportError) as error:
                    print(f"| {world} | {seed} | {method} | failed: {error} |", flush=True)
                    continue
                print(f"| {world} | {seed} | {method} | {row(made, truth, clouds, span_s)} |", flush=True)


def recording(out: Path, world: str, seed: int, duration_s: float | None, settings: list[str]) -> Path:
    """Return the recording of a world, made where it is not there yet."""
    changes = dict(item.split("=", 1) for item in settings)
    tag = "".join(f"-{key}-{value}" for key, value in sorted(changes.items()))
    path = out / f"{Path(world).stem}-{seed}{'' if duration_s is None else f'-{duration_s:g}s'}{tag}.mcap"
    if not path.exists():
        generate(world, path, seed=seed, duration_s=duration_s, settings=changes)
    return path


def read_truth(bag: Path) -> tuple[Trajectory, int, float]:
    """Return the true poses of base_link (50 a second), the number of clouds, and the length of the recording."""
    with open_recording(bag) as recording:
        told = [m for m in recording.measurements(["/ground_truth"]) if isinstance(m, Odometry)]
        clouds = recording.topic("/points").count
        span_s = (recording.end_ns - recording.start_ns) / 1e9
    stamps = np.array([t.stamp_ns for t in told])
    positions, quats = np.array([t.position_m for t in told]), np.array([t.quat_xyzw for t in told])
    return Trajectory(stamps, positions, quats), int(clouds or 0), span_s


def cartographer(bag: Path, out: Path, settings: list[str]) -> Run:
    folder = out / f"{bag.stem}-maps"
    sets = [word for setting in settings for word in ("--set", setting)]
    begin = time.perf_counter()
    command = [
        sys.executable,
        "-m",
        "slamcli",
        "map",
        "--algo",
        "cartographer",
        str(bag),
        "-o",
        str(folder),
        *sets,
        "-q",
    ]
    subprocess.run(command, check=True)
    seconds = time.perf_counter() - begin
    peak = json.loads((folder / "run.json").read_text())["peak_memory_bytes"] / 2**20
    return Run(read_tum(folder / "trajectory.tum"), seconds, f"{peak:.0f} MB")


def without_loops(bag: Path, out: Path, settings: list[str]) -> Run:
    return cartographer(bag, out, ["SLAMCLI_3D.search_rounds=0", *settings])


def kiss_as_it_is(bag: Path, _out: Path, _settings: list[str]) -> Run:
    return kiss(bag, None)


def kiss_for_range(bag: Path, _out: Path, _settings: list[str]) -> Run:
    return kiss(bag, float(parameters(bag)["lidar3d.range_max"]))


def parameters(bag: Path) -> dict[str, str]:
    return json.loads(bag.with_suffix(".run.json").read_text())["parameters"]


def kiss(bag: Path, max_range_m: float | None) -> Run:
    from kiss_icp.config.parser import load_config
    from kiss_icp.kiss_icp import KissICP

    config, settings = load_config(None), parameters(bag)
    if max_range_m is not None:
        config.data.max_range = max_range_m
        config.mapping.voxel_size = max_range_m / 100.0  # its own rule
    odometry = KissICP(config)
    stamps, poses, inside = [], [], 0.0
    begin = time.perf_counter()
    with open_recording(bag) as recording:
        mount = recording.frames().lookup("base_link", "lidar3d")
        sweep_ns = round(1e9 / float(settings["lidar3d.rate"]))
        for cloud in recording.measurements(["/points"]):
            if not isinstance(cloud, PointCloud) or cloud.offset_ns is None:
                continue
            points, times = cloud.points_m.astype(np.float64), cloud.offset_ns / sweep_ns
            started = time.perf_counter()
            odometry.register_frame(points, times)
            inside += time.perf_counter() - started
            stamps.append(cloud.stamp_ns + sweep_ns)
            poses.append(odometry.last_pose)
    seconds = time.perf_counter() - begin
    T_base = mount @ np.array(poses) @ np.linalg.inv(mount)
    positions, quats = se3.to_position_quaternion(T_base)
    return Run(Trajectory(np.array(stamps), positions, quats), seconds, f"{inside / max(len(stamps), 1) * 1e3:.1f}")


METHODS = {"loops": cartographer, "local": without_loops, "kiss": kiss_as_it_is, "kiss-range": kiss_for_range}


def row(made: Run, truth: Trajectory, clouds: int, span_s: float) -> str:
    estimate = made.trajectory
    inside = (estimate.stamps_ns >= truth.stamps_ns[0]) & (estimate.stamps_ns <= truth.stamps_ns[-1])
    estimate = Trajectory(estimate.stamps_ns[inside], estimate.positions_m[inside], estimate.quats_xyzw[inside])
    there = interpolate(truth, estimate.stamps_ns)
    laid = alignment.umeyama(estimate.positions_m, there.positions_m)
    ate = float(
        np.sqrt(np.mean(np.sum((laid.transform_points(estimate.positions_m) - there.positions_m) ** 2, axis=1)))
    )
    way = float(path_lengths(there.positions_m)[-1])
    drift = kitti_errors(there, estimate, lengths_m=[SEGMENT_M]).trans_percent
    way_there = laid.rotation @ (estimate.positions_m[-1] - estimate.positions_m[0])
    end = np.linalg.norm(way_there - (there.positions_m[-1] - there.positions_m[0]))
    told = f"{drift.mean():.2f}" if len(drift) else "-"
    note = f" ({made.note})" if made.note else ""
    return (
        f"{ate:.3f} | {ate / way * 100:.3f} | {told} | {end:.3f} | {made.seconds / max(clouds, 1) * 1e3:.1f}{note} | "
        f"{span_s / made.seconds:.1f}"
    )


if __name__ == "__main__":
    main()
