# SPDX-License-Identifier: MIT
"""Command lines of slamcli that reach every kernel between them: what kernel_calls.py runs."""

from __future__ import annotations

from pathlib import Path

SAMPLES = Path(__file__).resolve().parent.parent / "sample_data"
OFFICE, DESK, TOWN = str(SAMPLES / "office.bag"), str(SAMPLES / "desk_rgbd.mcap"), str(SAMPLES / "office.map.yaml")
ROOMS_TO_EXPLORE = """
rooms: [[0, 0, 6, 4], [6, 0, 9, 4]]
doors: [{at: [6, 2], width: 1.0}]
boxes: [{at: [3, 2.6], size: [0.8, 0.6]}]
start: [1.5, 1.5, 0]
"""
VOXELS = "local_costmap: {plugins: [{name: obstacles, type: 'costmap_2d::VoxelLayer'}, {name: inflation, type: 'costmap_2d::InflationLayer'}]}\n"


def scenarios(folder: Path) -> list[tuple[str, list[str]]]:
    """Return command lines that reach the kernels between them; short ones, for they are run one after another."""
    rooms, voxels = folder / "rooms.yaml", folder / "voxels.yaml"
    rooms.write_text(ROOMS_TO_EXPLORE)
    voxels.write_text(VOXELS)
    return [*_mapping(folder), *_cameras(folder), *_lidar(folder), *_navigation(folder, voxels, rooms)]


def _mapped(algo: str, recording: str, out: Path, *options: str) -> list[str]:
    return ["map", "--algo", algo, recording, "--jobs", "1", *options, "-o", str(out)]


def _mapping(folder: Path) -> list[tuple[str, list[str]]]:
    made = folder / "gmapping"
    builder = "TRAJECTORY_BUILDER_2D"
    tsdf = [
        "--set", f"{builder}.submaps.grid_options_2d.grid_type=TSDF",
        "--set", f"{builder}.submaps.range_data_inserter.range_data_inserter_type=TSDF_INSERTER_2D",
        "--set", f"{builder}.use_online_correlative_scan_matching=true",
    ]  # fmt: skip
    return [
        ("gmapping", _mapped("gmapping", OFFICE, made, "--duration", "20")),
        ("gmapping film", ["view", str(made), "-o", str(folder / "film.gif"), "--max-pixels", "300"]),
        ("gmapping evaluate", ["evaluate", str(made / "map.yaml"), TOWN]),
        ("gmapping improved", _mapped("gmapping", OFFICE, folder / "improved", "--duration", "10", "--set", "proposal=improved")),
        ("compare", ["compare", OFFICE, "--algo", "gmapping", "--duration", "10", "-o", str(folder / "compared")]),
        ("cartographer", _mapped("cartographer", OFFICE, folder / "cartographer")),
        ("cartographer tsdf", _mapped("cartographer", OFFICE, folder / "tsdf", "--duration", "20", *tsdf)),
        ("rtabmap laser", _mapped("rtabmap", OFFICE, folder / "rtabmap-laser", "--duration", "40")),
    ]  # fmt: skip


def _cameras(folder: Path) -> list[tuple[str, list[str]]]:
    stereo, fisheye, bent = (str(folder / f"{name}.mcap") for name in ("stereo", "fisheye", "bent"))
    camera = ["--camera", "stereo", "--imu", "--image-size", "320x240", "--rate", "15"]
    raw = ["--set", "camera.rectified=false", "--duration", "1"]
    return [
        ("rgbd rtabmap", _mapped("rtabmap", DESK, folder / "rgbd-rtabmap", "--octomap")),
        ("rgbd orbslam3", _mapped("orbslam3", DESK, folder / "rgbd-orbslam3", "--mode", "rgbd", "--dense", "mesh")),
        ("mono orbslam3", _mapped("orbslam3", DESK, folder / "mono", "--mode", "mono")),
        ("vocabulary", ["vocabulary", "train", DESK, "--levels", "3", "-o", str(folder / "words.npz")]),
        ("stereo generate", ["generate", "visual_room", stereo, *camera, "--duration", "5"]),
        ("stereo orbslam3", _mapped("orbslam3", stereo, folder / "stereo", "--mode", "stereo-inertial")),
        ("stereo rtabmap", _mapped("rtabmap", stereo, folder / "stereo-rtabmap", "--mode", "stereo")),
        ("fisheye generate", ["generate", "visual_desk", fisheye, *camera, *raw, "--set", "camera.lens=fisheye", "--set", "camera.fov=150"]),
        ("fisheye orbslam3", _mapped("orbslam3", fisheye, folder / "fisheye", "--mode", "stereo")),
        ("bent generate", ["generate", "visual_desk", bent, *camera, *raw, "--set", "camera.lens=radtan"]),
        ("bent orbslam3", _mapped("orbslam3", bent, folder / "bent", "--mode", "stereo")),
    ]  # fmt: skip


def _lidar(folder: Path) -> list[tuple[str, list[str]]]:
    lidar, flat = str(folder / "lidar.mcap"), str(folder / "flat.mcap")
    online = "TRAJECTORY_BUILDER_3D.use_online_correlative_scan_matching=true"
    return [
        ("generate", ["generate", "office", flat, "--people", "3", "--duration", "20"]),
        ("lidar generate", ["generate", "office3d", lidar, "--lidar3d", "--imu", "--duration", "30"]),
        ("lidar cartographer", _mapped("cartographer", lidar, folder / "lidar", "--mode", "3d")),
        ("lidar online", _mapped("cartographer", lidar, folder / "lidar-online", "--mode", "3d", "--duration", "4", "--set", online)),
    ]  # fmt: skip


def _navigation(folder: Path, voxels: Path, rooms: Path) -> list[tuple[str, list[str]]]:
    def localized(name: str, *options: str) -> list[str]:
        return ["localize", OFFICE, "--map", TOWN, *options, "-o", str(folder / name)]

    def planned(planner: str, *options: str) -> list[str]:
        return ["plan", "2,8.75", "24,8", "--map", TOWN, "--planner", planner, *options, "-o", str(folder / planner)]

    def driven(name: str, goal: str, *options: str) -> list[str]:
        start = ["--map", TOWN, "--start", "2,8.75,0", "--lean"]
        return ["navigate", goal, *start, *options, "-o", str(folder / name)]

    teb = ["--local-planner", "teb"]
    old = [f"TebLocalPlannerROS/{name}" for name in ("legacy_obstacle_association=true", "simple_exploration=true")]
    return [
        ("localize", localized("amcl", "--global", "--duration", "30")),
        ("localize omni", localized("omni", "--start", "2,8.75,0", "--duration", "5", "--set", "odom_model_type=omni")),
        ("localize beam", localized("beam", "--start", "2,8.75,0", "--duration", "5", "--set", "laser_model_type=beam")),
        ("plan navfn", planned("navfn")),
        ("plan astar", planned("astar")),
        ("plan dijkstra", planned("dijkstra")),
        ("plan theta", planned("theta_star")),
        ("drive dwa", driven("dwa", "10,8", "--people", "3")),
        ("drive voxels", driven("voxels", "5,8.5", "--config", str(voxels))),
        ("drive teb", driven("teb", "10,8", "--people", "3", *teb)),
        ("drive old teb", driven("old", "5,8.5", "--people", "3", *teb, "--set", old[0], "--set", old[1])),
        ("drive pursuit", driven("pursuit", "8,8.5", "--local-planner", "pursuit")),
        ("drive global_planner", driven("global", "5,8.5", "--global-planner", "global_planner")),
        ("drive global_planner on cells", driven("cells", "5,8.5", "--global-planner", "global_planner", "--set", "GlobalPlanner/use_dijkstra=false", "--set", "GlobalPlanner/use_grid_path=true")),
        ("drive car", driven("car", "8,8.5", "--set", "robot.drive=car", "--global-planner", "hybrid_astar", *teb)),
        ("explore", ["explore", str(rooms), "--slam", "cartographer", "--lean", "--set", "explore/gain=visible", "-o", str(folder / "explored")]),
    ]  # fmt: skip
