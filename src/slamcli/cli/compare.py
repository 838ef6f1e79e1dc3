# SPDX-License-Identifier: MIT
"""``slamcli compare``: several systems on one recording, side by side."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from slamcli.cli.camera_options import camera_options
from slamcli.cli.console import Console, print_json
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

if TYPE_CHECKING:
    from slamcli.pipelines.jobs import JobOutcome
    from slamcli.recordings import Mends


_WANTED = ("algos", "variants", "results", "configs", "sets", "modes")
_NO_MATTER = frozenset(
    {
        "output",
        "junit",
        "as_json",
        "verbosity",
        "jobs",
        "workers",
        "scheduler",
        "max_memory",
        "each",
        "fresh",
        "keep_inputs",
    }
)
"""Options that change nothing in the result."""


@click.command()
@fleet_options(result="compare", own_jobs=True)
@click.argument("bag", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--algo", "algos", multiple=True, metavar="ALGO",
    help="A system to run, repeatable; default: every one that the recording allows.",
)  # fmt: skip
@click.option(
    "--variant", "variants", multiple=True, metavar="NAME=ALGO[:KEY=VALUE,...]",
    help="A system once more, with other parameters and a name of its own.",
)  # fmt: skip
@click.option(
    "--result", "results", multiple=True, metavar="NAME=DIR",
    help="A finished result, a folder that `slamcli map` wrote: nothing is run for it.",
)  # fmt: skip
@click.option(
    "--ref", "--truth", "references", multiple=True, metavar="TRUTH",
    help="Ground truth: a trajectory, a relations file or a map.yaml; once for each kind.",
)  # fmt: skip
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Folder (default: BAG's name with -compare, beside it)."
)
@click.option(
    "--config", "configs", multiple=True, metavar="ALGO=FILE", help="Native file of one system, or of one variant."
)
@click.option(
    "--set", "sets", multiple=True, metavar="ALGO:KEY=VALUE",
    help="One parameter of one system or variant; KEY=VALUE where one of the systems alone has the key.",
)  # fmt: skip
@click.option("--mode", "modes", multiple=True, metavar="ALGO=MODE", help="How a system runs (`slamcli map --mode`).")
@click.option(
    "--scan-topic",
    "scan_topics",
    multiple=True,
    metavar="TOPIC",
    help="As of `slamcli map`, for the systems that use it; as the next.",
)
@click.option("--points-topic", "points_topics", multiple=True, metavar="TOPIC", help="Point clouds.")
@click.option("--odom-topic", metavar="TOPIC", help="Odometry; `tf`, or `none`.")
@click.option("--imu-topic", metavar="TOPIC", help="IMU; `none` leaves it out.")
@click.option("--base-frame", help="Frame of the robot.")
@click.option("--start", "start_s", type=float, metavar="SECONDS", help="Begin this long after the recording's start.")
@click.option("--duration", "duration_s", type=float, metavar="SECONDS", help="Use this much of the recording.")
@camera_options
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
    workers: int | None,
    **options: Any,
) -> int:
    """Run several SLAM systems on the recording BAG (several files: one recording that was split), and compare what they make of it.

    \b
    slamcli compare robot.bag
    slamcli compare mit-csail.clf.gz --algo gmapping --algo cartographer \\
        --algo rtabmap --ref mit-csail.relations
    slamcli compare office.bag --ref office.truth.tum --ref office.map.yaml \\
        --max gmapping.ate.rmse=0.05
    slamcli compare robot.bag --variant few=gmapping:particles=10 \\
        --variant many=gmapping:particles=100
    slamcli compare robot.bag --result before=robot-maps --algo gmapping \\
        --set particles=60 --max gmapping.map.wall_thickness_m=0.1
    slamcli compare robot.bag --algo cartographer \\
        --config cartographer=mine.lua --mode cartographer=2d

    DIR gets compare.json, compare.md, report.html, maps.png, overlay.png, trajectories.png, run.json and the whole result of each
    system in a folder of its own. A comparison that was stopped goes on where it was. Keys of --max and --min are NAME.FIGURE.
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.compare import run_compare
    from slamcli.pipelines.compare_request import CompareRequest, Wanted
    from slamcli.reports.compare_tables import comparison_text
    from slamcli.runtime import RunLog

    subject = " ".join(path.name for path in bag) or "results"
    with (
        Verdicts("compare", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        context = click.get_current_context()
        request = CompareRequest(
            inputs=bag, wanted=Wanted(**{name: options.pop(name) for name in _WANTED}), mends=mends, given_mends=given_mends(context),
            jobs=jobs or os.cpu_count() or 1, workers=workers or 1, command=_command_line(context), judged=verdicts.keys, **options,
        )  # fmt: skip
        log = RunLog(console)
        try:
            outcome = run_compare(request, log, lambda ended: _tell(ended, console))
        finally:
            console.tell(log)
        verdicts.judge(outcome.figures())
        document = {**outcome.document, "thresholds": verdicts.as_dicts()}
        if as_json:
            print_json(document)
        else:
            click.echo(comparison_text(document))
            console.say(f"{outcome.output}/report.html")
        verdicts.tell(console)
    return verdicts.exit_code


def _tell(ended: JobOutcome, console: Console) -> None:
    if not ended.done:
        message = ended.message.removeprefix("slamcli: ")
        console.say(f"{ended.name}: {message or f'ended with exit code {ended.exit_code}'}")
    elif ended.reused:
        console.say(f"{ended.name}: done before, in {ended.wall_s:.1f} s")
    else:
        console.say(f"{ended.name}: {ended.wall_s:.1f} s, {ended.peak_memory_bytes / 1e6:.0f} MB")


def _command_line(context: click.Context) -> str:
    """Return the command that makes this comparison again, without what cannot change it."""
    words = ["slamcli", "compare", *(path.name for path in context.params["bag"])]
    for parameter in context.command.params:
        name = parameter.name or ""
        if not isinstance(parameter, click.Option) or name in _NO_MATTER:
            continue
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        value = context.params[name]
        for item in value if isinstance(value, tuple) else (value,):
            words += [parameter.opts[0]] if item is True else [parameter.opts[0], str(item)]
    return shlex.join(words)
