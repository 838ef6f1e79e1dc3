# SPDX-License-Identifier: MIT
"""``slamcli evaluate``: scores a trajectory or a map against what is true."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from slamcli.cli.console import Console, print_json
from slamcli.cli.fleet_options import fleet_options
from slamcli.cli.options import json_option, junit_option, threshold_options, verbosity_options
from slamcli.cli.recording_options import given_mends, recording_options
from slamcli.cli.verdicts import Verdicts

if TYPE_CHECKING:
    from pathlib import Path

    from slamcli.recordings.mends import Mends

_RELATIONS = [
    "full",
    "trans_part",
    "rot_part",
    "angle_deg",
    "angle_rad",
    "point_distance",
    "point_distance_error_ratio",
]
_ALIGN = ["se3", "sim3", "posyaw", "origin", "scale", "none"]
_UNITS = ["f", "m", "d", "r", "s"]
_TIME_UNITS = ["auto", "s", "ms", "us", "ns"]


def _normalise(token: str) -> str:
    """Take evo's spelling of options with underscores as well."""
    return token.replace("_", "-")


@click.command(context_settings={"token_normalize_func": _normalise})
@fleet_options("estimate", result="evaluation")
@click.argument("estimate", metavar="EST")
@click.argument("reference", metavar="REF")
@click.option(
    "--mode",
    type=click.Choice(["auto", "trajectory", "relations", "map"]),
    default="auto",
    show_default=True,
    help="What REF is; auto finds it from the file.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    type=click.Choice(["ape", "rpe", "segments"]),
    help="Measure only this (repeatable); default: all.",
)
@click.option("-a", "--align", is_flag=True, help="Align by SE(3) (the default); with -s by Sim(3).")
@click.option("-s", "--correct-scale", is_flag=True, help="Correct the scale; without -a only that.")
@click.option("--align-origin", is_flag=True, help="Lay the first matched poses on each other.")
@click.option("--align-type", type=click.Choice(_ALIGN), help="The alignment by name; posyaw: position and yaw only.")
@click.option("--n-to-align", type=int, default=-1, show_default=True, help="Align on the first N poses; -1: all.")
@click.option(
    "-r",
    "--pose-relation",
    type=click.Choice(_RELATIONS),
    default="trans_part",
    show_default=True,
    metavar="PART",
    help=f"What of the error pose ATE and RPE measure: {', '.join(_RELATIONS)}.",
)
@click.option("-d", "--delta", type=float, default=1.0, show_default=True, help="RPE: distance between paired poses.")
@click.option(
    "-u",
    "--delta-unit",
    type=click.Choice(_UNITS),
    default="f",
    show_default=True,
    help="Unit of --delta: frames, metres, degrees, radians, seconds.",
)
@click.option(
    "-t",
    "--delta-tol",
    type=float,
    default=0.1,
    show_default=True,
    help="Relative tolerance of --delta with --all-pairs.",
)
@click.option("--all-pairs", is_flag=True, help="RPE over all pairs instead of consecutive ones.")
@click.option("--pairs-from-reference", is_flag=True, help="Find the pairs of RPE on the reference.")
@click.option(
    "--segment-length",
    "segment_lengths",
    type=float,
    multiple=True,
    metavar="M",
    help="Length of segments (repeatable); default: 100 to 800 m, and 10 to 50 % of the path.",
)
@click.option(
    "--project-to-plane", type=click.Choice(["xy", "xz", "yz"]), help="Project both trajectories after the alignment."
)
@click.option(
    "--t-max-diff", type=float, default=0.01, show_default=True, help="Largest difference of matching stamps, seconds."
)
@click.option(
    "--t-offset",
    type=float,
    default=0.0,
    show_default=True,
    help="Added to the stamps of EST for the matching, seconds.",
)
@click.option("--t-start", type=float, help="Use the reference from this stamp on, seconds.")
@click.option("--t-end", type=float, help="Use the reference up to this stamp, seconds.")
@click.option(
    "--sync-method",
    type=click.Choice(["nearest_time", "interpolation"]),
    default="nearest_time",
    show_default=True,
    help="Match the nearest poses, or interpolate the denser trajectory.",
)
@click.option(
    "--downsample", type=click.IntRange(min=2), metavar="N", help="Take at most N poses of either trajectory."
)
@click.option(
    "--motion-filter",
    type=(float, float),
    metavar="M DEG",
    help="Take poses after so many metres or degrees of motion.",
)
@click.option(
    "--time-unit",
    type=click.Choice(_TIME_UNITS),
    default="auto",
    show_default=True,
    help="Unit of the stamps in files.",
)
@click.option("--times", metavar="FILE", help="Stamps, one per line, of KITTI files: for both EST and REF.")
@click.option(
    "--max-gap",
    type=float,
    default=0.5,
    show_default=True,
    help="Relations: largest distance in time to the nearest pose, seconds.",
)
@click.option(
    "--map-align",
    type=click.Choice(["search", "refine", "none"]),
    default="search",
    show_default=True,
    help="Maps: search all poses, refine from where they are, or leave them there.",
)
@click.option(
    "--tolerance",
    type=float,
    metavar="M",
    help="Maps: distance up to which walls are the same; default: 0.1 m, or two cells if that is more.",
)
@click.option("--plot", metavar="FILE.png", help="Draw the paths and the errors over time.")
@click.option(
    "-o", "--output", metavar="DIR", help="Write evaluation.json, errors.csv, aligned.tum, plot.png and run.json there."
)
@threshold_options
@junit_option
@recording_options
@json_option
@verbosity_options
def command(
    estimate: str,
    reference: str,
    as_json: bool,
    verbosity: int,
    plot: str | None,
    output: str | None,
    upper: Sequence[str],
    lower: Sequence[str],
    junit: Path | None,
    mends: Mends,
    **options: Any,
) -> int:
    """Score EST against REF.

    EST is a trajectory (TUM, KITTI or EuRoC file, recording.mcap:/topic, or recording.mcap:odom>base_link) or a map.yaml. REF is a
    true trajectory of the same kinds, a relations file, or a map.yaml; it says what is measured.

    \b
    slamcli evaluate intel/trajectory.tum intel.relations
    slamcli evaluate run/trajectory.tum groundtruth.txt --max ate.rmse=0.05 \\
        --min coverage.time=0.9 --junit score.xml
    slamcli evaluate bag.mcap:/amcl_pose 'bag.mcap:map>base_link' \\
        --t-max-diff 0.05 --json
    slamcli evaluate kitti_est.txt kitti_gt.txt --metric segments
    slamcli evaluate intel/map.yaml floorplan.yaml --plot difference.png

    Without any option for it, EST is aligned to REF by SE(3). Exit codes: 0 done, 1 failed or a threshold missed, 2 wrong usage or
    input.
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.evaluation_outputs import write_outputs
    from slamcli.pipelines.evaluation_request import Request, run_request
    from slamcli.pipelines.schemas import stamped
    from slamcli.reports.evaluation_tables import evaluation_text
    from slamcli.runtime import RunLog

    subject = f"{estimate} against {reference}"
    with (
        Verdicts("evaluate", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        log = RunLog(console)
        context = click.get_current_context()
        given = {name for name in options if context.get_parameter_source(name) is ParameterSource.COMMANDLINE}
        request = Request(
            estimate=estimate,
            reference=reference,
            options=options,
            given=frozenset(given),
            mends=mends,
            given_mends=given_mends(context),
        )
        score = run_request(request, log)
        verdicts.judge(score.figures())
        document = stamped("evaluate", {"estimate": estimate, "reference": reference} | score.as_dict())
        document["warnings"] = log.warnings
        document["thresholds"] = verdicts.as_dicts()
        write_outputs(request, score, document, log, plot=plot, output=output)
        console.tell(log)
        if as_json:
            print_json(document)
        else:
            click.echo(evaluation_text(document))
        verdicts.tell(console)
    return verdicts.exit_code
