# SPDX-License-Identifier: MIT
"""``slamcli convert``: recordings and classic logs between formats."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, verbosity_options

if TYPE_CHECKING:
    from slamcli.pipelines.conversion import Conversion

_FORMATS = ("rosbag1", "mcap", "rosbag2-mcap", "rosbag2-sqlite3", "sqlite3")


def _names(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> tuple[str, ...]:  # noqa: ARG001
    return tuple(name for value in values for name in value.split(",") if name)


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="SRC... DST")
@click.option(
    "--format", "format_", type=click.Choice(_FORMATS), help="Format of DST; found from its name where left out."
)
@click.option(
    "--compression",
    type=click.Choice(("none", "lz4", "bz2", "zstd")),
    help="rosbag1: none, bz2, lz4; MCAP: none, lz4, zstd (default); rosbag2-sqlite3: none, zstd.",
)
@click.option(
    "--encoding",
    type=click.Choice(("cdr", "ros1")),
    help="Messages in a plain MCAP file: ROS 2's (default) or ROS 1's.",
)
@click.option(
    "--layout",
    type=click.Choice(("tum", "euroc", "kitti")),
    help="Write a data-set folder: TUM RGB-D, EuRoC (cameras and IMU) or KITTI odometry (rectified stereo).",
)
@click.option("--start", "start_s", type=float, help="Leave out so many seconds at the beginning.")
@click.option("--duration", "duration_s", type=float, help="Convert so many seconds.")
@click.option("--topics", multiple=True, callback=_names, metavar="NAME,...", help="Only these topics.")
@click.option("--exclude-topics", multiple=True, callback=_names, metavar="NAME,...", help="Not these topics.")
@click.option("--laser-fov", type=click.FloatRange(0, 360, min_open=True), metavar="DEG", help="CARMEN: field of view.")
@click.option(
    "--laser-max-range",
    type=click.FloatRange(0, min_open=True),
    metavar="M",
    help="CARMEN, BreezySLAM: readings at or over this are no return.",
)
@click.option(
    "--wheels",
    type=click.FloatRange(0, min_open=True),
    nargs=3,
    metavar="RADIUS HALF_AXLE TICKS",
    help="BreezySLAM: wheel radius and half axle in metres, ticks per turn. [default: 0.077 0.165 2000]",
)
@click.option("--laser-ahead", type=float, metavar="M", help="BreezySLAM: laser ahead of the axle. [default: 0.145]")
@click.option(
    "--depth-scale",
    type=click.FloatRange(0, min_open=True),
    metavar="UNITS",
    help="Raw depth units per metre of SRC, a data-set folder or with --layout.  [default: as SRC says]",
)
@json_option
@verbosity_options
def command(
    paths: tuple[Path, ...],
    format_: str | None,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    start_s: float | None,
    duration_s: float | None,
    topics: tuple[str, ...],
    exclude_topics: tuple[str, ...],
    laser_fov: float | None,
    laser_max_range: float | None,
    wheels: tuple[float, float, float] | None,
    laser_ahead: float | None,
    depth_scale: float | None,
    as_json: bool,
    verbosity: int,
) -> int:
    """Convert recordings and classic logs between formats, or a saved state or database to its trajectory.

    SRC is a recording (.bag, .db3, .mcap, a ROS 2 bag folder, or several files of one recording), a data-set folder
    (TUM RGB-D, EuRoC, TUM-VI, KITTI odometry, 7-Scenes, ICL-NUIM) or a classic log (CARMEN .log and .clf, BreezySLAM
    exp*.dat, also gzipped CARMEN). DST is named .bag (ROS 1), .mcap, .db3, or is a
    folder (a ROS 2 bag). Messages and stamps are kept; what DST held before is replaced in one step; DST.run.json says
    what was done.

    Of a state of Cartographer (.pbstream; NAME:1 for one of several trajectories) the trajectory is written, to .tum,
    .kitti or .csv (EuRoC), or the state anew, to .pbstream. Of a database of RTAB-Map (.db; NAME:odometry and NAME:truth for other
    poses than the optimised ones) the trajectory is written, or its graph, to .g2o.

    \b
    slamcli convert intel.clf.gz intel.mcap
    slamcli convert drive.bag drive_ros2
    slamcli convert drive_0.bag drive_1.bag drive.mcap \\
        --topics /scan,/odom,/tf,/tf_static
    slamcli convert rgbd_dataset_freiburg1_desk desk.mcap
    slamcli convert desk.mcap desk_folder --layout tum
    slamcli convert state.pbstream path.tum
    slamcli convert rtabmap.db graph.g2o
    """  # noqa: D301 (click wants the character)
    from slamcli.errors import UsageError
    from slamcli.formats.pbstream.container import is_pbstream
    from slamcli.pipelines.conversion import Selection
    from slamcli.pipelines.convert import convert
    from slamcli.pipelines.convert_folder import convert_to_folder
    from slamcli.pipelines.trajectories import parse_source
    from slamcli.recordings.breezy import BreezyOptions
    from slamcli.recordings.carmen import CarmenOptions
    from slamcli.rtabmap.database.probing import is_database
    from slamcli.runtime import RunLog

    numbers = {"--laser-ahead": laser_ahead, "--laser-max-range": laser_max_range, "--laser-fov": laser_fov}
    numbers["--depth-scale"] = depth_scale
    for option, value in numbers.items():
        if value is not None and not math.isfinite(value):
            raise UsageError(f"{option} {value:g} is not a finite number")
    if not all(math.isfinite(value) for value in wheels or ()):
        raise UsageError("--wheels: give radius and half axle in metres, and ticks per turn")
    if len(paths) < 2:
        raise UsageError("name what to convert and where to: slamcli convert SRC DST")
    source = parse_source(str(paths[0])).path
    if is_pbstream(source) or is_database(source):
        with Console(verbosity) as console:
            _convert_state(paths, console, as_json=as_json, database=not is_pbstream(source))
        return 0
    carmen = CarmenOptions(fov_rad=math.radians(laser_fov) if laser_fov else None, max_range_m=laser_max_range)
    robot: dict[str, Any] = {"laser_ahead_m": laser_ahead, "range_max_m": laser_max_range}
    if wheels:
        robot |= dict(zip(("wheel_radius_m", "half_axle_m", "ticks_per_turn"), wheels, strict=True))
    breezy = BreezyOptions(**{name: value for name, value in robot.items() if value is not None})
    selection = Selection(start_s=start_s, duration_s=duration_s, topics=topics, exclude_topics=exclude_topics)
    if layout is not None and (format_ or compression or encoding):
        raise UsageError("--layout writes a folder of images: --format, --compression and --encoding are for bags")
    began = time.perf_counter()
    with Console(verbosity) as console:
        log = RunLog(console)
        if layout is not None:
            conversion = convert_to_folder(
                paths[:-1], paths[-1], layout, selection=selection, depth_units_per_m=depth_scale, log=log
            )
        else:
            conversion = convert(
                paths[:-1],
                paths[-1],
                format=format_,
                compression=compression,
                encoding=encoding,
                selection=selection,
                carmen=carmen,
                breezy=breezy,
                depth_units_per_m=depth_scale,
                log=log,
            )
        console.tell(log)
        seconds = time.perf_counter() - began
        if as_json:
            print_json(_document(conversion, log.notes, log.warnings, dict(log.counts), seconds), "convert")
        elif verbosity >= 0:
            click.echo(_summary(conversion, seconds))
    return 0


def _convert_state(paths: tuple[Path, ...], console: Console, *, as_json: bool, database: bool) -> None:
    from slamcli.errors import UsageError
    from slamcli.pipelines.convert_database import convert_database
    from slamcli.pipelines.convert_state import convert_state
    from slamcli.runtime import RunLog

    if len(paths) > 2:
        what = "a database of RTAB-Map" if database else "a saved state"
        raise UsageError(f"{paths[0]} is {what}: one at a time (slamcli map joins several)")
    log = RunLog(console)
    made = (convert_database if database else convert_state)(str(paths[0]), paths[1], log)
    console.tell(log)
    if as_json:
        print_json(
            {
                "sources": [str(made.source)], "source_format": "rtabmap" if database else "pbstream", "target": str(made.target),
                "format": made.format, "poses": made.poses, "size_bytes": made.size_bytes,
                "notes": log.notes, "warnings": log.warnings, "seconds": round(made.seconds, 3),
            },
            "convert-state",
        )  # fmt: skip
    else:
        console.say(f"{made.target}: {made.format}, {made.poses} poses, {made.size_bytes / 1e6:.1f} MB")


def _document(
    conversion: Conversion, notes: list[str], warnings: list[str], counts: dict[str, int], seconds: float
) -> dict[str, Any]:
    return {
        "sources": [str(path) for path in conversion.sources],
        "source_format": conversion.source_format,
        "target": str(conversion.target),
        "format": conversion.format,
        "compression": conversion.compression,
        "size_bytes": conversion.size_bytes,
        "record": str(conversion.record),
        "num_messages": conversion.num_messages,
        "num_lost": conversion.num_lost,
        "start_ns": conversion.start_ns,
        "end_ns": conversion.end_ns,
        "topics": [
            {"name": topic.name, "type": topic.msgtype, "encoding": topic.encoding, "count": topic.count}
            for topic in conversion.topics
        ],
        "damage": list(conversion.damage),
        "notes": notes,
        "warnings": warnings,
        "counts": counts,
        "seconds": round(seconds, 3),
    }


def _summary(conversion: Conversion, seconds: float) -> str:
    width = max((len(topic.name) for topic in conversion.topics), default=0)
    lines = [f"  {topic.name:<{width}}  {topic.count:>8}  {topic.msgtype}" for topic in conversion.topics]
    span = ((conversion.end_ns or 0) - (conversion.start_ns or 0)) / 1e9
    lines.append(
        f"{conversion.target}: {conversion.format}, {conversion.num_messages} messages over {span:.1f} s, "
        f"{conversion.size_bytes / 1e6:.1f} MB ({conversion.compression}), in {seconds:.1f} s"
    )
    return "\n".join(lines)
