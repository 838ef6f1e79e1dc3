# SPDX-License-Identifier: MIT
"""``slamcli sweep``: many values of native parameters on one recording, ranked."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.fleet_options import fleet_options
from slamcli.cli.map import command as map_command
from slamcli.cli.options import json_option, verbosity_options
from slamcli.cli.recording_options import recording_options
from slamcli.cli.sweep_progress import SweepProgress
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.sensor_request import SensorRequest
    from slamcli.recordings import Mends

_INTERRUPTED = 130
_OF_MAP = (
    "scan_topics", "points_topics", "odom_topic", "imu_topic", "fix_topic", "landmark_topic", "rgb_topic", "depth_topic",
    "left_topic", "right_topic", "camera_info_topic", "camera_files", "mode", "vocabulary", "base_frame", "odom_frame", "map_frame",
    "start_s", "duration_s",
)  # fmt: skip
"""Options of ``slamcli map`` that every run gets as they are."""


@click.command()
@fleet_options(result="sweep", own_jobs=True)
@click.argument("bag", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--algo", default="gmapping", show_default=True, help="SLAM system.")
@click.option(
    "--set", "sets", multiple=True, metavar="KEY=VALUES",
    help="A native parameter: V1,V2,... or a range LOW:HIGH[:log][:int] to draw from, or LOW:HIGH:/STEPS; one value alone holds for all runs.",
)  # fmt: skip
@click.option("--random", "draws", type=click.IntRange(min=1), metavar="N", help="Try N random sets instead of all.")
@click.option(
    "--seeds", "num_seeds", type=click.IntRange(1, 1000), default=1, show_default=True, metavar="N",
    help="Run every set with so many seeds.",
)  # fmt: skip
@click.option(
    "--seed", "first_seed", type=click.IntRange(min=0), default=0, show_default=True,
    help="The first seed; also that of --random.",
)  # fmt: skip
@click.option(
    "--ref", "--truth", "ref", metavar="GT",
    help="What is true: a trajectory, a relations file or a map; `truth` finds what lies beside BAG. {name} and {dir} stand for BAG's.",
)  # fmt: skip
@click.option(
    "--objective", metavar="KEY",
    help="Figure to rank by: of evaluate (ate.rmse), summary.*, time.realtime_factor, peak_memory_bytes, ...  [default: by --ref]",
)  # fmt: skip
@click.option(
    "--maximise", is_flag=True, default=None, help="Larger is better, where the figure's name does not say it."
)
@click.option(
    "--min-coverage", "least_coverage", type=click.FloatRange(0.0, 1.0), default=0.8, show_default=True, metavar="SHARE",
    help="A run that covers less than this share of what the best run covers has failed.",
)  # fmt: skip
@click.option(
    "--together", is_flag=True, help="Every BAG is a recording of its own, and sets are ranked over all of them."
)
@click.option(
    "--keep", type=click.Choice(["all", "best", "none"]), default="best", show_default=True,
    help="Whose result folders stay; figures stay of all.",
)  # fmt: skip
@click.option(
    "--config", "config_files", multiple=True, type=click.Path(path_type=Path),
    help="Native file of the system (launch, YAML, Lua, .ini) that all runs begin with; later wins.",
)  # fmt: skip
@click.option("--arg", "arguments", multiple=True, metavar="NAME=VALUE", help="An argument of a launch file.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path),
    help="Folder for the result (default: BAG's name with -sweep, beside it); what is done in it is not done again.",
)  # fmt: skip
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Threads of each run.")
@recording_options
@json_option
@verbosity_options
def command(
    bag: tuple[Path, ...], arguments: tuple[str, ...], ref: str | None, output: Path | None, mends: Mends,
    verbosity: int, as_json: bool, together: bool, workers: int | None, **options: Any,
) -> int:  # fmt: skip
    """Try many values of native parameters on the recording BAG, and rank them.

    \b
    slamcli sweep robot.bag --set particles=10,30,60 --seeds 6 \\
        --ref robot.relations
    slamcli sweep desk.mcap --algo orbslam3 \\
        --set ORBextractor.nFeatures=500,1000,2000 --ref truth
    slamcli sweep run.mcap --algo cartographer --random 40 --ref truth \\
        --set POSE_GRAPH.constraint_builder.min_score=0.4:0.8 \\
        --set POSE_GRAPH.optimize_every_n_nodes=20:200:log
    slamcli sweep a.bag b.bag c.bag --together --set srr=0.01,0.1 \\
        --ref '{dir}/{name}.truth.tum'

    The folder gets sweep.csv, sweep.json, sweep.md, report.html, a plot per parameter, and best.launch, .lua, .ini or .yaml: the
    best set as the system's own file. Stop it at any time: the same command goes on where it was.
    """  # noqa: D301 - click needs the backspace itself
    kernel_cache.prepare()
    from slamcli.pipelines.map import default_output
    from slamcli.pipelines.sweep import run_sweep
    from slamcli.pipelines.sweep_outputs import write_sweep
    from slamcli.pipelines.sweep_request import SweepRequest
    from slamcli.pipelines.sweep_subjects import find_subjects
    from slamcli.reports.sweep_tables import sweep_text

    of_map = {name: options.pop(name) for name in _OF_MAP}
    launch_arguments = dict(_pair(text) for text in arguments)
    maps = default_output(bag)
    request = SweepRequest(
        subjects=find_subjects(bag, ref, together=together),
        output=output or maps.with_name(f"{maps.name.removesuffix('-maps')}-sweep"),
        launch_arguments=launch_arguments, map_options=_map_words(click.get_current_context()), sensors=_sensors(of_map), mends=mends,
        workers=workers or os.cpu_count() or 1, command=_command_line(), **options,
    )  # fmt: skip
    with Console(verbosity) as console:
        log = RunLog()
        progress = SweepProgress(console)
        try:
            sweep = run_sweep(request, log, progress.told)
            progress.clear()
            document = write_sweep(sweep, log)
        except KeyboardInterrupt:
            progress.clear()
            console.warn(f"interrupted: {progress.done} runs are done and kept; the same command goes on from there")
            return _INTERRUPTED
        finally:
            progress.clear()
            console.tell(log)
        if as_json:
            print_json(document)
        else:
            click.echo(sweep_text(document))
            console.say(f"{request.output}: report.html, sweep.csv, {document['best']['file']}")
    return 0


for _option in map_command.params:
    if _option.name in _OF_MAP:
        command.params.append(_option)


def _sensors(of_map: dict[str, Any]) -> SensorRequest:
    """Return the sensors that the runs are told to use."""
    from slamcli.pipelines.map_request import MapRequest
    from slamcli.recordings.camera_topics import CameraNames

    roles = ("rgb", "depth", "left", "right", "camera_info")
    cameras = CameraNames(**{role: of_map[f"{role}_topic"] for role in roles})
    others = {name: of_map[name] for name in of_map if name not in {"vocabulary", *(f"{role}_topic" for role in roles)}}
    return MapRequest(algo="", inputs=(), cameras=cameras, **others).sensors


def _map_words(context: click.Context) -> tuple[str, ...]:
    """Return what the user gave of the options of ``map``, as words of its command line."""
    from slamcli.cli.recording_options import given_mends

    words: list[str] = []
    for parameter in context.command.params:
        name = parameter.name or ""
        if name in _OF_MAP and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            words += _words(parameter.opts[0], context.params[name])
    for option, value in given_mends(context).items():
        words += _words(option, value)
    return tuple(words)


def _words(option: str, value: Any) -> list[str]:
    found: list[str] = []
    for item in value if isinstance(value, tuple) else (value,):
        found += [option] if item is True else [option, str(item)]
    return found


def _command_line() -> str:
    """Return the command as it was typed, without what cannot change the result."""
    context = click.get_current_context()
    left_out = {"output", "workers", "scheduler", "max_memory", "as_json", "verbosity", "keep"}
    words = ["slamcli", "sweep"]
    for parameter in context.command.params:
        name = parameter.name or ""
        if name in left_out or context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        value = context.params[name]
        if isinstance(parameter, click.Argument):
            words += [str(item) for item in value]
        else:
            words += _words(next(opt for opt in parameter.opts if opt.startswith("--")), value)
    return shlex.join(words)


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise click.BadParameter(f"{text!r}: write it as NAME=VALUE", param_hint="--arg")
    return name, value
