# SPDX-License-Identifier: MIT
"""``slamcli map``: a map and a trajectory from a recording."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.atlas_options import atlas_options, atlas_words
from slamcli.cli.camera_options import camera_options
from slamcli.cli.console import Console, print_json
from slamcli.cli.database_options import database_options, database_words
from slamcli.cli.fleet_options import fleet_options
from slamcli.cli.options import (
    jobs_option,
    json_option,
    junit_option,
    seed_option,
    threshold_options,
    verbosity_options,
)
from slamcli.cli.recording_options import given_mends, recording_options
from slamcli.cli.verdicts import Verdicts
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.map import MapOutcome
    from slamcli.recordings import Mends

_CHOICES = {
    "map_mode": "trinary", "cloud_format": "ply", "cloud_colour": "rgb", "dense": "none", "dense_voxel": 0.02, "dense_range": 5.0,
    "octomap": False, "mcap": False,
}  # fmt: skip
"""Options that say how files are written, with their defaults."""
_KERNELS = {"orbslam3": ("vision", "up to a minute")}
"""Room whose kernels a system needs most, where it is not the usual one, and how long they take to compile."""
_FILES = ("load_states", "load_frozen_states", "camera_files")
"""Options that name an input, as BAG does: without its folder in the recorded command."""


@click.command()
@fleet_options(result="maps")
@click.argument("bag", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--algo", default="gmapping", show_default=True, help="SLAM system (an installed `slamcli.mappers` entry point)."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Folder for the result (default: BAG's name with -maps, beside it).",
)
@click.option(
    "--config",
    "config_files",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Native file of the system (launch, YAML, Lua, .ini); later wins.",
)
@click.option(
    "--set",
    "sets",
    multiple=True,
    metavar="KEY=VALUE",
    help="One parameter, by its native name (`slamcli config show`).",
)
@click.option("--arg", "arguments", multiple=True, metavar="NAME=VALUE", help="An argument of a launch file.")
@click.option(
    "--scan-topic",
    "scan_topics",
    multiple=True,
    metavar="TOPIC",
    help="Laser scans; several times for several scanners (cartographer); `none` leaves them out.",
)
@click.option(
    "--points-topic",
    "points_topics",
    multiple=True,
    metavar="TOPIC",
    help="Point clouds, instead of or beside scans (cartographer, rtabmap); several times for several sensors; `none` leaves them out.",
)
@click.option(
    "--odom-topic", metavar="TOPIC", help="Odometry; `tf` takes it from the transforms, `none` leaves it out."
)
@click.option("--imu-topic", metavar="TOPIC", help="IMU (cartographer, orbslam3, rtabmap); `none` leaves it out.")
@click.option(
    "--fix-topic", metavar="TOPIC", help="GPS fixes, or poses in a fixed frame (cartographer); `none` leaves them out."
)
@click.option(
    "--landmark-topic", metavar="TOPIC", help="Landmarks (cartographer_ros LandmarkList); `none` leaves them out."
)
@click.option(
    "--mode",
    metavar="MODE",
    help="How the system runs, where it can run in several ways: 2d or 3d (cartographer); mono, stereo, rgbd, or one of them with -inertial (orbslam3); rgbd, stereo or scan (rtabmap).",
)
@click.option(
    "--load-state", "load_states", multiple=True, metavar="FILE", type=click.Path(path_type=Path),
    help="Go on from a state (.pbstream, cartographer); several are joined. Without BAG: its map and trajectory.",
)  # fmt: skip
@click.option(
    "--load-frozen-state", "load_frozen_states", multiple=True, metavar="FILE", type=click.Path(path_type=Path),
    help="The same, and it stays as it is: to localise in its map.",
)  # fmt: skip
@click.option(
    "--save-state", metavar="FILE", type=click.Path(path_type=Path),
    help="Where the state goes besides state.pbstream in the folder.",
)  # fmt: skip
@click.option("--base-frame", help="Frame of the robot.")
@click.option("--odom-frame", help="Frame of the odometry.")
@click.option("--map-frame", help="Name of the map's frame.")
@click.option("--start", "start_s", type=float, metavar="SECONDS", help="Begin this long after the recording's start.")
@click.option("--duration", "duration_s", type=float, metavar="SECONDS", help="Use this much of the recording.")
@click.option(
    "--map-mode",
    type=click.Choice(["trinary", "scale", "raw"]),
    default=_CHOICES["map_mode"],
    show_default=True,
    help="How occupancy is written into map.pgm.",
)
@click.option(
    "--cloud-format",
    type=click.Choice(["ply", "pcd", "none"]),
    default=_CHOICES["cloud_format"],
    show_default=True,
    help="File of the points of a 3D map.",
)
@click.option(
    "--cloud-colour",
    type=click.Choice(["rgb", "height", "intensity", "none"]),
    default=_CHOICES["cloud_colour"],
    show_default=True,
    help="By what its points are coloured: what the cameras saw (height where none did), or one of the others.",
)
@click.option(
    "--dense", type=click.Choice(["none", "cloud", "mesh", "texture"]), default=_CHOICES["dense"], show_default=True,
    help="Also write dense.ply from the depth images of keyframes: a coloured cloud, or a mesh (RGB-D; rtabmap: stereo too); or dense.obj, a mesh with the images on it.",
)  # fmt: skip
@click.option(
    "--dense-voxel", type=click.FloatRange(0.001, 1.0), default=_CHOICES["dense_voxel"], show_default=True, metavar="METRES",
    help="Size of its cells.",
)  # fmt: skip
@click.option(
    "--dense-range", type=click.FloatRange(0.1, 100.0), default=_CHOICES["dense_range"], show_default=True, metavar="METRES",
    help="Depths beyond are left out of it.",
)  # fmt: skip
@click.option(
    "--octomap", is_flag=True, help="Also write octomap.bt and .ot, free and occupied space (--algo rtabmap)."
)
@click.option("--mcap", is_flag=True, help="Also write result.mcap, the run as it went, for Foxglove and RViz.")
@click.option(
    "--truth",
    "--ref",
    "truth",
    metavar="TRAJECTORY",
    help="True trajectory (file, data-set folder, or BAG:/topic): its errors go into the report.",
)
@camera_options
@atlas_options
@database_options
@seed_option
@jobs_option
@threshold_options
@junit_option
@recording_options
@json_option
@verbosity_options
def command(
    bag: tuple[Path, ...],
    mends: Mends,
    verbosity: int,
    as_json: bool,
    jobs: int,
    upper: tuple[str, ...],
    lower: tuple[str, ...],
    junit: Path | None,
    arguments: tuple[str, ...],
    **options: Any,
) -> int:
    """Build a map and a trajectory from the recording BAG (several files: one recording that was split; rtabmap: or databases).

    \b
    slamcli map --algo gmapping intel.mcap -o intel
    slamcli map robot.bag --config gmapping.launch --set particles=50 --seed 3
    slamcli map run.db3 --scan-topic /front/scan --start 30 --duration 120
    slamcli map --algo cartographer second.mcap --load-state first/state.pbstream
    slamcli map --algo cartographer --load-state state.pbstream -o drawn
    slamcli map --algo orbslam3 redkitchen --mode rgbd --dense mesh -o kitchen
    slamcli map --algo orbslam3 second.mcap --load-atlas first/atlas.npz \\
        --localise-only
    slamcli map --algo rtabmap second.mcap --database home.db
    slamcli map --algo rtabmap old.db --set Kp/MaxFeatures=1000

    The folder gets map.yaml and map.pgm, trajectory.tum (one pose for every scan or image), map.png, report.html and run.json;
    of graph-based systems also the graph, of 3D ones the points. Exit codes: 0 done, 1 failed or a threshold missed (the result is
    written then), 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself
    kernel_cache.prepare()
    from slamcli.pipelines.map import run_map
    from slamcli.pipelines.map_outputs import OutputChoices
    from slamcli.pipelines.map_request import MapRequest
    from slamcli.pipelines.run_figures import run_figures

    launch_arguments = _pairs(arguments)
    command = _command_line(bag, launch_arguments, options, given_mends(click.get_current_context()))
    choices = OutputChoices(**{name: options.pop(name) for name in _CHOICES})
    request = MapRequest(
        inputs=bag, mends=mends, jobs=jobs or os.cpu_count() or 1, launch_arguments=launch_arguments,
        choices=choices, command=command, **options,
    )  # fmt: skip
    subject = f"{options['algo']} on {' '.join(path.name for path in request.files)}"
    with (
        Verdicts("map", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        room, wait = _KERNELS.get(options["algo"], ("registration", "about 20 s"))
        if not kernel_cache.is_filled(room):
            console.say(f"compiling kernels, once ({wait}; `slamcli warmup` does it beforehand)")
        log = RunLog(console)
        try:
            outcome = run_map(request, log)
        finally:
            console.tell(log)
        verdicts.judge(run_figures(outcome.run))
        if as_json:
            print_json(verdicts.added_to(outcome.run))
        else:
            _tell(outcome, console)
        verdicts.tell(console)
    return verdicts.exit_code


def _tell(outcome: MapOutcome, console: Console) -> None:
    run, summary = outcome.run, outcome.run["summary"]
    grid = outcome.result.grid
    size = (
        ""
        if grid is None
        else f"map of {grid.width * grid.resolution_m:.1f} x {grid.height * grid.resolution_m:.1f} m, "
    )
    factor = run["timing"]["realtime_factor"]
    console.say(
        f"{outcome.output}: {size}"
        f"{summary['poses']} poses, path of {summary['path_length_m']:.1f} m, "
        f"{run['timing']['total_s']:.1f} s ({factor:.{0 if factor >= 10 else 1}f} x real time), {run['peak_memory_bytes'] / 1e6:.0f} MB"
    )
    for key, value in summary.get("truth", {}).items():
        if key.endswith(".rmse"):
            console.say(f"{key} {value:.4f}")


def _pairs(texts: tuple[str, ...]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.BadParameter(f"{text!r}: write it as NAME=VALUE", param_hint="--arg")
        pairs[name] = value
    return pairs


def _command_line(
    bag: tuple[Path, ...], arguments: dict[str, str], options: dict[str, Any], mends: dict[str, Any]
) -> str:
    """Return the command that makes this result again: without the output folder and what cannot change the result."""
    words = ["slamcli", "map", "--algo", options["algo"], *(path.name for path in bag), "--seed", str(options["seed"])]
    names = {
        "config_files": "--config", "sets": "--set", "start_s": "--start", "duration_s": "--duration",
        "scan_topics": "--scan-topic", "points_topics": "--points-topic",
        "load_states": "--load-state", "load_frozen_states": "--load-frozen-state", "camera_files": "--camera",
    }  # fmt: skip
    for flag, topic in options["cameras"].named().items():
        words += [flag, topic]
    words += atlas_words(options["atlas"]) + database_words(options["database"])
    for key, value in options.items():
        if (
            key in ("algo", "seed", "output", "save_state", "cameras", "atlas", "database")
            or value in (None, ())
            or value == _CHOICES.get(key)
        ):
            continue
        flag = names.get(key, f"--{key.replace('_', '-')}")
        for item in value if isinstance(value, tuple) else (value,):
            text = item.name if isinstance(item, Path) and key in _FILES else str(item)
            words += [flag] if item is True else [flag, text]
    for name, value in arguments.items():
        words += ["--arg", f"{name}={value}"]
    for flag, value in mends.items():
        for item in value if isinstance(value, tuple) else (value,):
            words += [flag] if item is True else [flag, str(item)]
    return shlex.join(words)
