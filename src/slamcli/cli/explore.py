# SPDX-License-Identifier: MIT
"""``slamcli explore``: a simulated robot drives to frontiers until it knows all that it can reach."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, junit_option, seed_option, threshold_options, verbosity_options
from slamcli.cli.points import parse_point
from slamcli.cli.verdicts import Verdicts
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.explore_run import ExploreOutcome

_DEFAULTS = {"people": 0, "seed": 0}
_FLAGS = {
    "slam": "--slam", "start": "--start", "config_files": "--config", "sets": "--set", "slam_sets": "--slam-set", "local_planner": "--local-planner",
    "global_planner": "--global-planner", "people": "--people", "timeout_s": "--timeout", "seed": "--seed",
}  # fmt: skip
"""Options that change what happens, for the command that ``run.json`` holds."""


@click.command()
@click.argument("world", metavar="WORLD")
@click.option("--slam", type=click.Choice(["gmapping", "cartographer"]), required=True, help="Who makes the map.")
@click.option("--start", metavar="X,Y[,YAW]", help="Where the robot stands at first: metres and radians, in the world (default: the world's own).")  # fmt: skip
@click.option("--config", "config_files", multiple=True, type=click.Path(path_type=Path), metavar="FILE", help="Launch or parameter file of move_base, explore_lite or the system that maps; any number, later wins. Default: move_base.launch.")  # fmt: skip
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE", help="One parameter: explore/min_frontier_size=0.5, DWAPlannerROS/max_vel_x=0.4, laser.beams=720.")  # fmt: skip
@click.option("--slam-set", "slam_sets", multiple=True, metavar="KEY=VALUE", help="One parameter of the system that maps, by its native name.")  # fmt: skip
@click.option("--local-planner", type=click.Choice(["dwa", "teb", "pursuit"]), help="Who follows the plan (default: what base_local_planner says).")  # fmt: skip
@click.option("--global-planner", type=click.Choice(["navfn", "dijkstra", "astar", "theta_star", "hybrid_astar", "global_planner"]), help="Who makes it (default: what base_global_planner says, navfn).")  # fmt: skip
@click.option("--people", type=click.IntRange(min=0, max=500), default=0, show_default=True, help="How many walk about.")  # fmt: skip
@click.option("--timeout", "timeout_s", type=float, metavar="S", help="Simulated seconds for the whole (default: 3600).")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder for map, coverage, report, trajectories, recording and animation.")  # fmt: skip
@click.option("--bag", "recording", type=click.Path(path_type=Path), metavar="FILE", help="The recording (.mcap, .bag, .db3 or a folder), instead of DIR/run.mcap.")  # fmt: skip
@click.option("--animation", "film", type=click.Path(path_type=Path), metavar="FILE", help="The animation (.gif, .mp4), instead of DIR/run.gif.")  # fmt: skip
@click.option("--lean", is_flag=True, help="Leave recording and animation out of DIR.")
@threshold_options
@junit_option
@seed_option
@json_option
@verbosity_options
def command(
    world: str, start: str | None, verbosity: int, as_json: bool, upper: tuple[str, ...], lower: tuple[str, ...],
    junit: Path | None, **options: Any,
) -> int:  # fmt: skip
    """Explore WORLD (a world file, a map.yaml or a built-in name): drive to frontiers until none is left that can be reached, then home.

    \b
    slamcli explore office --slam cartographer -o office
    slamcli explore map.yaml --slam gmapping --start -2,0.5,0 -o again --lean
    slamcli explore warehouse --slam gmapping --set explore/gain=visible \\
        --animation warehouse.gif
    slamcli navigate 12,9 --map office/map.yaml --world office --start 2,8.8,0

    Exit codes: 0 nothing is left and the robot is home, 1 time ran out or the robot is stuck (the map so far is saved, the message
    says why), or a threshold was missed, 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself
    kernel_cache.prepare()
    from slamcli.pipelines.explore_request import explore_request
    from slamcli.pipelines.explore_run import require_explored, run_exploration
    from slamcli.pipelines.navigate_request import NavigateRequest
    from slamcli.pipelines.run_figures import run_figures

    begin = None if start is None else parse_point("--start", start)
    drive = NavigateRequest(
        waypoints=(), world=world, start=begin, command=_command_line(world, {"start": start, **options}), **options
    )
    request = explore_request(drive)
    subject = f"{options['slam']} in {Path(world).name}"
    with (
        Verdicts("explore", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        if not kernel_cache.is_filled("navigation"):
            console.say("compiling the stack (once on this machine; slamcli warmup does it beforehand)")
        log = RunLog(console)
        try:
            outcome = run_exploration(request, log)
        finally:
            console.tell(log)
        verdicts.judge(run_figures(outcome.document))
        if as_json:
            print_json(verdicts.added_to(outcome.document))
        else:
            _tell(outcome, console)
        verdicts.tell(console)
        require_explored(outcome)
    return verdicts.exit_code


def _command_line(world: str, options: dict[str, Any]) -> str:
    """Return the command that makes this run again: without what only says where results go."""
    words = ["slamcli", "explore", world]
    for name, flag in _FLAGS.items():
        value = options[name]
        if value is None or value == () or value == _DEFAULTS.get(name):
            continue
        for item in value if isinstance(value, tuple) else (value,):
            words += [flag, str(item)]
    return shlex.join(words)


def _tell(outcome: ExploreOutcome, console: Console) -> None:
    from slamcli.reports.tables import table_text

    summary, factor = outcome.document["summary"], outcome.document["timing"]["realtime_factor"]
    share, error = summary["coverage"], summary["localisation_rmse_m"]
    columns = ["world", "SLAM", "what became of it", "coverage %", "area m2", "time s", "driven m", "goals", "given up", "collisions", "pose RMS m"]  # fmt: skip
    row = (
        str(summary["world"]), str(summary["slam"]), str(summary["status"]), "–" if share is None else f"{100.0 * share:.2f}",
        f"{summary['reachable_m2']:.1f}", f"{summary['duration_s']:.1f}", f"{summary['path_length_m']:.1f}",
        str(summary["goals"]), str(summary["goals_given_up"]), str(summary["collisions"]), "–" if error is None else f"{error:.3f}",
    )  # fmt: skip
    click.echo(table_text(columns, [row], numeric=range(3, 11)))
    # A failure's message is the error that ends the command.
    told = ([] if outcome.failure else [str(summary["message"])]) + ([f"{factor:.3g} x real time"] if factor else [])
    console.say("; ".join(told) + (f" -> {', '.join(map(str, outcome.written))}" if outcome.written else ""))
