# SPDX-License-Identifier: MIT
"""``slamcli localize``: where a robot was on a known map while a recording was made."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, junit_option, seed_option, threshold_options, verbosity_options
from slamcli.cli.points import parse_point
from slamcli.cli.recording_options import given_mends, recording_options
from slamcli.cli.verdicts import Verdicts
from slamcli.errors import UsageError
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.localize import Localized
    from slamcli.recordings import Mends


def _list_settings(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from slamcli.localization.amcl_parameters import AmclParameters
        from slamcli.parameters import declarations

        for d in declarations(AmclParameters):
            default = str(d.default).lower() if d.kind is bool else d.default
            click.echo(f"{d.name}={default}\n    {d.help}{f' [{d.unit}]' if d.unit else ''}")
        ctx.exit()


@click.command()
@click.argument("bag", nargs=-1, type=click.Path(path_type=Path))
@click.option("--map", "map", type=click.Path(path_type=Path), required=True, metavar="FILE", help="The map's YAML.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Folder for the result (default: BAG's name with -localized, beside it).")  # fmt: skip
@click.option("--start", metavar="X,Y,YAW", help="Where the robot was at the first scan, metres and radians (default: initial_pose_x, y, a).")  # fmt: skip
@click.option("--global", "everywhere", is_flag=True, help="Nobody knows where the robot was: look all over the map.")
@click.option("--config", "config_files", multiple=True, type=click.Path(path_type=Path), metavar="FILE", help="Launch file with a node amcl, or its parameter YAML; later wins.")  # fmt: skip
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE", help="One parameter by amcl's name (see --list-settings).")  # fmt: skip
@click.option("--arg", "arguments", multiple=True, metavar="NAME=VALUE", help="An argument of a launch file.")
@click.option("--scan-topic", "scan_topics", multiple=True, metavar="TOPIC", help="Laser scans; several times for several scanners.")  # fmt: skip
@click.option("--odom-topic", metavar="TOPIC", help="Odometry; `tf` takes it from the transforms.")
@click.option("--base-frame", help="Frame of the robot.")
@click.option("--odom-frame", help="Frame of the odometry.")
@click.option("--begin", "begin_s", type=float, metavar="SECONDS", help="Begin this long after the recording's start.")
@click.option("--duration", "duration_s", type=float, metavar="SECONDS", help="Use this much of the recording.")
@click.option("--ref", "--truth", "reference", metavar="TRAJECTORY", help="True trajectory in the map's frame, or another localiser's (file, or BAG:/topic): its errors go into the report.")  # fmt: skip
@click.option("--ref-align", "reference_align", type=click.Choice(["none", "se3", "sim3", "origin"]), default="none", show_default=True, help="How the result is laid on --ref first, where that has a frame (sim3: a scale, too) of its own.")  # fmt: skip
@click.option("--list-settings", is_flag=True, is_eager=True, expose_value=False, callback=_list_settings, help="Explain every parameter.")  # fmt: skip
@seed_option
@threshold_options
@junit_option
@recording_options
@json_option
@verbosity_options
def command(
    bag: tuple[Path, ...], mends: Mends, verbosity: int, as_json: bool, arguments: tuple[str, ...], upper: tuple[str, ...],
    lower: tuple[str, ...], junit: Path | None, **options: Any,
) -> int:  # fmt: skip
    """Localise the robot that made the recording BAG on a map, as ROS amcl does.

    \b
    slamcli localize drive.mcap --map map.yaml --start 2.0,1.5,0
    slamcli localize drive.bag --map map.yaml --global \\
        --config move_base.launch --seed 3
    slamcli localize drive.mcap --map map.yaml --scan-topic /front \\
        --scan-topic /rear --ref truth.tum
    slamcli localize drive.mcap --map map.yaml --set laser_model_type=beam \\
        --set max_particles=500

    The folder gets trajectory.tum (one pose of the robot in the map for every scan), poses.csv (with covariances), map.png,
    report.html and run.json. Exit codes: 0 done, 1 failed or a threshold missed, 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself
    kernel_cache.prepare()
    from slamcli.evaluation import AlignMode
    from slamcli.pipelines.localize import LocalizeRequest, run_localize
    from slamcli.pipelines.run_figures import run_figures

    words = _command_line(bag, arguments, options, given_mends(click.get_current_context()))
    start, align = options.pop("start"), AlignMode(options.pop("reference_align"))
    request = LocalizeRequest(
        inputs=bag, mends=mends, start=_pose(start), reference_align=align, launch_arguments=_pairs(arguments),
        command=words, **options,
    )  # fmt: skip
    subject = f"{' '.join(path.name for path in bag)} on {options['map'].name}"
    with (
        Verdicts("localize", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        if not kernel_cache.is_filled("localization"):
            console.say("compiling kernels, once (`slamcli warmup` does it beforehand)")
        log = RunLog(console)
        try:
            outcome = run_localize(request, log)
        finally:
            console.tell(log)
        verdicts.judge(run_figures(outcome.run))
        if as_json:
            print_json(verdicts.added_to(outcome.run))
        else:
            _tell(outcome, console)
        verdicts.tell(console)
    return verdicts.exit_code


def _tell(outcome: Localized, console: Console) -> None:
    run, summary = outcome.run, outcome.run["summary"]
    console.say(
        f"{outcome.output}: {summary['poses']} poses ({summary['scans_used']} scans used, {summary['mean_particles']:.0f} particles), "
        f"path of {summary['path_length_m']:.1f} m, in the end certain to {summary['final_deviation_m']:.2f} m and"
        f" {summary['final_deviation_deg']:.1f} degrees; {run['timing']['total_s']:.1f} s"
    )
    for key, value in summary.get("truth", {}).items():
        if (key.endswith(".rmse") or key.startswith("converged.")) and value is not None:
            console.say(f"{key} {value:.4f}")


def _pose(text: str | None) -> tuple[float, float, float] | None:
    """Return x, y, yaw."""
    if text is None:
        return None
    values = parse_point("--start", text)
    if not all(abs(value) < float("inf") for value in values):
        raise UsageError(f"--start {text}: numbers that are finite, please")
    return values[0], values[1], values[2] if len(values) > 2 else 0.0


def _pairs(texts: tuple[str, ...]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.BadParameter(f"{text!r}: write it as NAME=VALUE", param_hint="--arg")
        pairs[name] = value
    return pairs


def _command_line(
    bag: tuple[Path, ...], arguments: tuple[str, ...], options: dict[str, Any], mends: dict[str, Any]
) -> str:
    """Return the command that makes this result again: without the output folder."""
    words = ["slamcli", "localize", *(path.name for path in bag)]
    names = {
        "map": "--map", "start": "--start", "everywhere": "--global", "config_files": "--config", "sets": "--set",
        "scan_topics": "--scan-topic", "odom_topic": "--odom-topic", "base_frame": "--base-frame",
        "odom_frame": "--odom-frame", "begin_s": "--begin", "duration_s": "--duration", "reference": "--ref",
        "reference_align": "--ref-align", "seed": "--seed",
    }  # fmt: skip
    for key, flag in names.items():
        value = options[key]
        if value in (None, (), False) or (key == "reference_align" and value == "none"):
            continue
        for item in value if isinstance(value, tuple) else (value,):
            words += [flag] if item is True else [flag, item.name if key == "map" else str(item)]
    for argument in arguments:
        words += ["--arg", argument]
    for flag, value in mends.items():
        for item in value if isinstance(value, tuple) else (value,):
            words += [flag] if item is True else [flag, str(item)]
    return shlex.join(words)
