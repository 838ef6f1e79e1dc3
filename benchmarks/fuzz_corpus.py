# SPDX-License-Identifier: MIT
"""Small valid inputs of every kind, and the commands that read them."""

from __future__ import annotations

import gzip
import importlib.util
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz_states import write_states
from fuzz_visual import write_small_atlas, write_vocabularies

from slamcli.cli.main import COMMANDS as TABLE
from slamcli.grids import OccupancyGrid
from slamcli.measurements import (
    FrameTransform,
    GeoFix,
    ImuSample,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    Odometry,
    PointCloud,
    StampedPose,
)

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
START_NS = 1_500_000_000_000_000_000
SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Input:
    """One valid input."""

    kind: str
    path: Path
    companions: tuple[Path, ...] = ()
    """Files beside it that belong to it."""


_ALL: dict[str, list[tuple[str, ...]]] = {
    "bag": [
        ("info", "{input}", "--json"),
        ("doctor", "{input}", "--json"),
        ("convert", "{input}", "{out}/copy.mcap"),
        ("convert", "{input}", "{out}/copy.bag"),
        ("view", "{input}", "-o", "{out}/picture.png"),
        ("map", "{input}", "-o", "{out}/map", "--set", "particles=2"),
        ("map", "{input}", "-o", "{out}/map", "--algo", "cartographer"),
        ("map", "{input}", "-o", "{out}/map", "--algo", "cartographer", "--points-topic", "/points", "--mode", "3d"),
        ("evaluate", "{input}:/pose", "{input}:odom>base_link", "--json"),
    ],
    "log": [
        ("convert", "{input}", "{out}/log.mcap"),
        ("info", "{input}", "--json"),
        ("map", "{input}", "-o", "{out}/map", "--set", "particles=2"),
        ("map", "{input}", "-o", "{out}/map", "--algo", "cartographer"),
    ],
    "map": [
        ("map-tools", "info", "{input}", "--json"),
        ("plan", "-0.5,-0.5", "0.5,0.5", "--map", "{input}", "--robot-radius", "0.1", "-o", "{out}/path"),
        ("map-tools", "convert", "{input}", "{out}/copy.yaml"),
        ("view", "{input}", "-o", "{out}/picture.png"),
        ("generate", "{input}", "{out}/drive.mcap", "--duration", "1"),
        ("config", "check", "{input}"),
    ],
    "trajectory": [
        ("evaluate", "{input}", "{input}", "--json"),
        ("view", "{input}", "-o", "{out}/picture.png"),
    ],
    "state": [
        ("info", "{input}", "--json"),
        ("view", "{input}", "-o", "{out}/picture.png"),
        ("convert", "{input}", "{out}/again.pbstream"),
        ("evaluate", "{input}", "{dir}/truth.tum", "--json"),
        ("map", "--algo", "cartographer", "--load-state", "{input}", "-o", "{out}/map"),
    ],
    "cloud": [("view", "{input}", "-o", "{out}/picture.png")],
    "relations": [("evaluate", "{dir}/truth.tum", "{input}", "--json")],
    "launch": [
        ("config", "check", "{input}", "--json"),
        ("config", "show", "--config", "{input}", "--json"),
    ],
    "lua": [
        ("config", "check", "{input}", "--json"),
        ("config", "show", "--algo", "cartographer", "--config", "{input}", "--json"),
    ],
    "parameters": [
        ("config", "check", "{input}", "--json"),
        ("config", "show", "--config", "{input}", "--json"),
    ],
    "costmap": [
        ("config", "check", "{input}", "--json"),
        ("plan", "-0.5,-0.5", "0.5,0.5", "--map", "{dir}/room.yaml", "--costmap", "{input}", "-o", "{out}/path"),
    ],
    "world": [("generate", "{input}", "{out}/drive.mcap", "--duration", "1")],
    "pairs": [("plan", "--pairs", "{input}", "--map", "{dir}/room.yaml", "--robot-radius", "0")],
    "vocabulary": [("vocabulary", "info", "{input}", "--json")],
    "atlas": [
        (
            "map",
            "--algo",
            "orbslam3",
            "{dir}/desk.mcap",
            "--duration",
            "0.3",
            "--load-atlas",
            "{input}",
            "-o",
            "{out}/map",
        )
    ],
    "urdf": [("info", "{dir}/plain.mcap", "--urdf", "{input}")],
}


def _exists(command: tuple[str, ...]) -> bool:
    return importlib.util.find_spec(f"slamcli.cli.{TABLE[command[0]][0]}") is not None


COMMANDS = {kind: [command for command in commands if _exists(command)] for kind, commands in _ALL.items()}


def make_corpus(folder: Path, kinds: list[str]) -> list[Input]:
    """Write valid inputs and return them; the kinds take turns."""
    folder.mkdir(parents=True)
    makers: list[Callable[[Path], list[Input]]] = [
        _bags,
        _logs,
        _maps,
        _trajectories,
        _relations,
        _states,
        _clouds,
        _visual,
        _configurations,
    ]
    found = [entry for maker in makers for entry in maker(folder)]
    return [entry for entry in found if COMMANDS[entry.kind] and (not kinds or entry.kind in kinds)]


def _bags(folder: Path) -> list[Input]:
    variants = [
        ("plain.bag", None, "none"),
        ("bz2.bag", None, "bz2"),
        ("lz4.bag", None, "lz4"),
        ("plain.mcap", None, "none"),
        ("zstd.mcap", None, "zstd"),
        ("single.db3", None, None),
        ("folder_sqlite", "rosbag2-sqlite3", "none"),
        ("folder_zstd", "rosbag2-sqlite3", "zstd"),
        ("folder_mcap", "rosbag2-mcap", None),
    ]
    from slamcli.recordings import create_recording

    inputs = []
    for name, container, compression in variants:
        with create_recording(folder / name, format=container, compression=compression) as recording:
            _record(recording)
        inputs.append(Input("bag", folder / name))
    return inputs


def _record(recording: object) -> None:
    write = recording.write  # type: ignore[attr-defined]
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    mount = FrameTransform(
        stamp_ns=START_NS, parent_frame_id="base_link", child_frame_id="laser", position_m=np.array([0.1, 0.0, 0.2]),
        quat_xyzw=identity, static=True,
    )  # fmt: skip
    write("/tf_static", mount)
    for k in range(12):
        stamp = START_NS + k * SECOND_NS // 5
        position = np.array([0.3 * k, 0.0, 0.0])
        write(
            "/tf",
            FrameTransform(
                stamp_ns=stamp,
                parent_frame_id="odom",
                child_frame_id="base_link",
                position_m=position,
                quat_xyzw=identity,
            ),
        )
        write(
            "/odom",
            Odometry(
                stamp_ns=stamp, frame_id="odom", child_frame_id="base_link", position_m=position, quat_xyzw=identity
            ),
        )
        write("/scan", _scan(stamp, 40, 0.3 * k))
        write(
            "/imu",
            ImuSample(
                stamp_ns=stamp, frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.array([0, 0, 9.81])
            ),
        )
        write("/pose", StampedPose(stamp_ns=stamp, frame_id="map", position_m=position, quat_xyzw=identity))
        points = np.arange(60, dtype=np.float32).reshape(20, 3) / 20 + 1
        times = np.arange(20, dtype=np.int64) * 4_000_000
        write("/points", PointCloud(stamp_ns=stamp, frame_id="lidar", points_m=points, offset_ns=times))
        place = {"latitude_deg": 48.0 + 1e-6 * k, "longitude_deg": 11.0, "altitude_m": 500.0}
        write("/fix", GeoFix(stamp_ns=stamp, frame_id="gps", **place))
        seen = LandmarkObservation(id="a", position_m=position, quat_xyzw=identity)
        write("/landmark", Landmarks(stamp_ns=stamp, frame_id="base_link", observations=(seen,)))


def _scan(stamp_ns: int, beams: int, x_m: float) -> LaserScan:
    angles = np.linspace(-math.pi / 2, math.pi / 2, beams)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(
            (6.0 - x_m) / np.maximum(np.cos(angles), 1e-3), 2.0 / np.maximum(np.abs(np.sin(angles)), 1e-3)
        )
    ranges[3] = np.inf
    ranges[4] = np.nan
    return LaserScan(
        stamp_ns=stamp_ns, frame_id="laser", angle_min_rad=float(angles[0]), angle_increment_rad=float(angles[1] - angles[0]),
        range_min_m=0.1, range_max_m=10.0, ranges_m=ranges.astype(np.float32),
    )  # fmt: skip


def _logs(folder: Path) -> list[Input]:
    lines = ["# CARMEN Logfile", "PARAM robot_frontlaser_offset 0.1", "PARAM laser_front_laser_fov 180"]
    for k in range(12):
        ranges = " ".join(f"{r:.2f}" for r in np.nan_to_num(_scan(0, 30, 0.3 * k).ranges_m, nan=81.9, posinf=81.9))
        x, t = 0.3 * k, 1000.0 + 0.2 * k
        lines.append(f"ODOM {x:.3f} 0.0 0.0 0.1 0.0 0.0 {t:.3f} host {t - 1000:.3f}")
        lines.append(f"FLASER 30 {ranges} {x:.3f} 0 0 {x:.3f} 0 0 {t:.3f} host {t - 1000:.3f}")
        lines.append(f"TRUEPOS {x:.3f} 0 0 {x:.3f} 0 0 {t:.3f} host {t - 1000:.3f}")
        lines.append(
            f"ROBOTLASER1 0 -1.57 3.14 0.108 10 0.01 0 30 {ranges} 0 {x:.3f} 0 0 {x:.3f} 0 0 0 0 0 0 0 {t:.3f} host {t - 1000:.3f}"
        )
    text = "\n".join(lines) + "\n"
    (folder / "a.log").write_text(text)
    (folder / "b.clf").write_text("\n".join(line for line in lines if line.startswith("FLASER")) + "\n")
    (folder / "c.clf.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    rows = [" ".join([str(k * 100_000), "0", str(k * 50), str(k * 51), *["0"] * 20, *["1500"] * 682]) for k in range(4)]
    (folder / "exp.dat").write_text("\n".join(rows) + "\n")
    return [Input("log", folder / name) for name in ("a.log", "b.clf", "c.clf.gz", "exp.dat")]


def _maps(folder: Path) -> list[Input]:
    from slamcli.formats.maps import write_map

    data = np.zeros((40, 40), dtype=np.int8)
    data[[0, -1], :] = data[:, [0, -1]] = 100
    data[20, 8:30] = 100
    data[5:8, 5:8] = -1
    grid = OccupancyGrid(cells=data, resolution_m=0.05, origin=(-1.0, -1.0, 0.0))
    write_map(folder / "room.yaml", grid)
    write_map(folder / "scale.yaml", grid, mode="scale")
    image = folder / "room.pgm"
    return [
        Input("map", folder / "room.yaml", (image,)),
        Input("map", folder / "scale.yaml", tuple(p for p in folder.glob("scale.*") if p.suffix != ".yaml")),
    ]


def _trajectories(folder: Path) -> list[Input]:
    rows = [(k * 0.1, 0.3 * k, math.sin(0.2 * k), 0.02 * k) for k in range(30)]
    (folder / "t.tum").write_text(
        "".join(
            f"{1500000000 + t:.9f} {x:.9f} {y:.9f} 0 0 0 {math.sin(a / 2):.9f} {math.cos(a / 2):.9f}\n"
            for t, x, y, a in rows
        )
    )
    (folder / "t.kitti").write_text(
        "".join(
            f"{math.cos(a):.9f} {-math.sin(a):.9f} 0 {x:.6f} {math.sin(a):.9f} {math.cos(a):.9f} 0 {y:.6f} 0 0 1 0\n"
            for _, x, y, a in rows
        )
    )
    (folder / "t.csv").write_text(
        "#timestamp,px,py,pz,qw,qx,qy,qz\n"
        + "".join(f"{1500000000000000000 + int(t * 1e9)},{x},{y},0,1,0,0,0\n" for t, x, y, _ in rows)
    )
    return [Input("trajectory", folder / name) for name in ("t.tum", "t.kitti", "t.csv")]


def _relations(folder: Path) -> list[Input]:
    truth = folder / "truth.tum"
    truth.write_text("".join(f"{100 + k:.6f} {k} 0 0 0 0 0 1\n" for k in range(20)))
    (folder / "a.relations").write_text("".join(f"{100 + k}.0 {101 + k}.0 1.0 0 0 0 0 0\n" for k in range(19)))
    return [Input("relations", folder / "a.relations", (truth,))]


def _states(folder: Path) -> list[Input]:
    return [Input("state", path, (folder / "truth.tum",)) for path in write_states(folder)]


def _visual(folder: Path) -> list[Input]:
    desk = folder / "desk.mcap"
    shutil.copy(CONFIGS.parent / "sample_data" / "desk_rgbd.mcap", desk)
    found = [Input("vocabulary", path) for path in write_vocabularies(folder)]
    return [*found, Input("atlas", write_small_atlas(folder), (desk,))]


def _clouds(folder: Path) -> list[Input]:
    from slamcli.formats.clouds import write_cloud

    points = np.random.default_rng(3).uniform(-2, 2, (40, 3)).astype(np.float32)
    cloud = PointCloud(stamp_ns=0, frame_id="map", points_m=points, intensities=points[:, 0].copy())
    for name in ("cloud.ply", "cloud.pcd"):
        write_cloud(folder / name, cloud)
    rows = "".join(f"{x:.3f} {y:.3f} {z:.3f}\n" for x, y, z in points.tolist())
    head = "\n".join(f"property float {axis}" for axis in "xyz")
    (folder / "text.ply").write_text(f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{head}\nend_header\n{rows}")
    fields = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA ascii\n"
    (folder / "text.pcd").write_text(fields.format(n=len(points)) + rows)
    return [Input("cloud", folder / name) for name in ("cloud.ply", "cloud.pcd", "text.ply", "text.pcd")]


def _configurations(folder: Path) -> list[Input]:
    inputs = []
    for name in ("gmapping.launch", "move_base.launch"):
        (folder / name).write_text((CONFIGS / name).read_text())
        inputs.append(Input("launch", folder / name))
    for name in ("backpack_2d.lua", "trajectory_builder_2d.lua", "taurob_tracker.lua"):
        (folder / name).write_text((CONFIGS / name).read_text())
        inputs.append(Input("lua", folder / name))
    (folder / "gmapping.yaml").write_text(
        "slam_gmapping:\n  particles: 30\n  lstep: 0.05\n  base_frame: base_link\n  maxUrange: 20.0\n"
    )
    inputs.append(Input("parameters", folder / "gmapping.yaml"))
    room = (folder / "room.yaml", folder / "room.pgm")
    for name in ("costmap_common_params.yaml", "base_local_planner_params.yaml", "global_costmap_params.yaml"):
        (folder / name).write_text((CONFIGS / name).read_text())
        inputs.append(Input("costmap", folder / name, room))
    for path in sorted((CONFIGS / "worlds").glob("*.yaml"))[:3]:
        (folder / f"world_{path.name}").write_text(path.read_text())
        inputs.append(Input("world", folder / f"world_{path.name}"))
    (folder / "pairs.csv").write_text("start_x,start_y,goal_x,goal_y\n-0.5,-0.5,0.5,0.5\n0.1,0.2,-0.3,0.4\n")
    inputs.append(Input("pairs", folder / "pairs.csv", room))
    (folder / "robot.urdf").write_text(
        '<robot name="r"><link name="base_link"/><link name="laser"/><joint name="j" type="fixed"><parent link="base_link"/>'
        '<child link="laser"/><origin xyz="0.1 0 0.2" rpy="0 0 1.57"/></joint></robot>\n'
    )
    with_bag = (folder / "plain.mcap",)
    inputs.append(Input("urdf", folder / "robot.urdf", with_bag))
    return inputs
