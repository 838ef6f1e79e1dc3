# SPDX-License-Identifier: MIT
"""``slamcli navigate``: drive a simulated robot to goals with the whole navigation stack."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, junit_option, seed_option, threshold_options, verbosity_options
from slamcli.cli.points import PointsCommand, parse_point
from slamcli.cli.verdicts import Verdicts
from slamcli.errors import UsageError
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.mission import Mission
    from slamcli.pipelines.navigate_run import NavigateOutcome

_DEFAULTS = {"dwa_scaling": "noetic", "localization": "amcl", "people": 0, "seed": 0}
_FLAGS = {
    "config_files": "--config", "sets": "--set", "slam": "--slam", "slam_sets": "--slam-set", "timeout_s": "--timeout", "world": "--world", "local_planner": "--local-planner",
    "global_planner": "--global-planner", "dwa_scaling": "--dwa-scaling", "localization": "--localization", "people": "--people",
    "seed": "--seed",
}  # fmt: skip
"""Options that change what happens, for the command that ``run.json`` holds."""


class NavigateCommand(PointsCommand):
    """``--start -1,2,0`` has a value that begins with a minus sign, and is not one of the goals."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Bind the start to its option before points are looked for."""
        bound: list[str] = []
        for arg in args:
            if bound and bound[-1] == "--start":
                bound[-1] = f"--start={arg}"
            else:
                bound.append(arg)
        return super().parse_args(ctx, bound)


@click.command(cls=NavigateCommand)
@click.argument("goals", nargs=-1, metavar="[GOAL]...")
@click.option("--map", "map_path", type=click.Path(path_type=Path), metavar="FILE", help="The map that the robot knows (its YAML).")  # fmt: skip
@click.option("--slam", type=click.Choice(["gmapping", "cartographer"]), help="Make the map on the way instead; needs --world.")  # fmt: skip
@click.option(
    "--start",
    metavar="X,Y[,YAW]",
    help="Where the robot stands at first: metres and radians, in the map (default: the world's own).",
)
@click.option("--mission", "mission_path", type=click.Path(path_type=Path), metavar="FILE", help="Goals from a YAML file: poses, names, waits, rounds.")  # fmt: skip
@click.option("--world", metavar="WORLD", help="Simulate another world than the map shows: a world file, a map.yaml or a built-in name.")  # fmt: skip
@click.option("--config", "config_files", multiple=True, type=click.Path(path_type=Path), metavar="FILE", help="Launch or parameter file of move_base and AMCL (with --slam also of the system that maps); any number, later wins. Default: move_base.launch.")  # fmt: skip
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE", help="One parameter: DWAPlannerROS/max_vel_x=0.4, amcl/min_particles=200, laser.beams=720.")  # fmt: skip
@click.option("--slam-set", "slam_sets", multiple=True, metavar="KEY=VALUE", help="One parameter of the system that maps, by its native name.")  # fmt: skip
@click.option("--arg", "arguments", multiple=True, metavar="NAME=VALUE", help="Argument of a launch file.")
@click.option("--local-planner", type=click.Choice(["dwa", "teb", "pursuit"]), help="Who follows the plan (default: what base_local_planner says).")  # fmt: skip
@click.option("--global-planner", type=click.Choice(["navfn", "dijkstra", "astar", "theta_star", "hybrid_astar", "global_planner"]), help="Who makes it (default: what base_global_planner says, navfn).")  # fmt: skip
@click.option("--dwa-scaling", type=click.Choice(["noetic", "kinetic"]), default=_DEFAULTS["dwa_scaling"], show_default=True, help="How DWA's weights count: as ROS noetic or as kinetic has them.")  # fmt: skip
@click.option("--localization", type=click.Choice(["amcl", "truth"]), default=_DEFAULTS["localization"], show_default=True, help="How the robot knows where it is.")  # fmt: skip
@click.option("--people", type=click.IntRange(min=0, max=500), default=0, show_default=True, help="How many walk about.")  # fmt: skip
@click.option("--timeout", "timeout_s", type=float, metavar="S", help="Simulated seconds for each goal (default: by the length of the way).")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder for report, trajectories, recording and animation.")  # fmt: skip
@click.option("--bag", "recording", type=click.Path(path_type=Path), metavar="FILE", help="The recording (.mcap, .bag, .db3 or a folder), instead of DIR/run.mcap.")  # fmt: skip
@click.option("--animation", "film", type=click.Path(path_type=Path), metavar="FILE", help="The animation (.gif, .mp4), instead of DIR/run.gif.")  # fmt: skip
@click.option("--lean", is_flag=True, help="Leave recording and animation out of DIR.")
@threshold_options
@junit_option
@seed_option
@json_option
@verbosity_options
def command(
    goals: tuple[str, ...], map_path: Path | None, start: str | None, mission_path: Path | None, arguments: tuple[str, ...],
    verbosity: int, as_json: bool, upper: tuple[str, ...], lower: tuple[str, ...], junit: Path | None, **options: Any,
) -> int:  # fmt: skip
    """Drive a simulated robot to each GOAL (x,y or x,y,yaw; metres, radians): map server, AMCL, costmaps, planners, move_base.

    \b
    slamcli navigate 3.0,2.0 --map map.yaml --start 0,0,0
    slamcli navigate 3,2,1.57 -1.5,2 --map map.yaml --start 0,0,0 --people 5 \\
        -o tour
    slamcli navigate --mission rounds.yaml --map map.yaml --bag rounds.bag \\
        --animation rounds.gif
    slamcli navigate 6.5,8 --slam gmapping --world office \\
        --config slam_navigation_full.launch -o unknown
    slamcli navigate 3,2 --map map.yaml --start 0,0 --local-planner teb \\
        --set TebLocalPlannerROS/max_vel_x=0.4

    Exit codes: 0 every goal was reached, 1 one was not and the message says why, or a threshold was missed, 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself
    kernel_cache.prepare()
    from slamcli.pipelines.mission import waypoints_of
    from slamcli.pipelines.navigate_request import NavigateRequest
    from slamcli.pipelines.navigate_run import require_all_reached, run_navigation
    from slamcli.pipelines.run_figures import run_figures

    mission = _mission(mission_path, goals)
    points = [parse_point("goal", goal) for goal in goals]
    launch_arguments = _pairs(arguments)
    begin = _start(start, mission)
    if options["timeout_s"] is None and mission is not None:
        options["timeout_s"] = mission.timeout_s
    request = NavigateRequest(
        waypoints=waypoints_of(points) if mission is None else mission.waypoints, map_path=map_path, start=begin,
        launch_arguments=launch_arguments, command=_command_line(goals, map_path, begin, mission_path, launch_arguments, options),
        **options,
    )  # fmt: skip
    place = options["world"] if map_path is None else map_path.name
    subject = f"{len(request.waypoints)} goals on {place}"
    with (
        Verdicts("navigate", subject=subject, upper=upper, lower=lower, junit=junit) as verdicts,
        Console(verbosity) as console,
    ):
        if not kernel_cache.is_filled("navigation"):
            console.say("compiling the stack (once on this machine; slamcli warmup does it beforehand)")
        log = RunLog(console)
        try:
            outcome = run_navigation(request, log)
        finally:
            console.tell(log)
        verdicts.judge(run_figures(outcome.document))
        if as_json:
            print_json(verdicts.added_to(outcome.document))
        else:
            _tell(outcome, console)
        verdicts.tell(console)
        require_all_reached(outcome)
    return verdicts.exit_code


def _mission(path: Path | None, goals: tuple[str, ...]) -> Mission | None:
    if path is None:
        return None
    if goals:
        raise UsageError("give goals or --mission, not both")
    from slamcli.pipelines.mission import read_mission

    return read_mission(path)


def _start(text: str | None, mission: Mission | None) -> tuple[float, ...] | None:
    if text is not None:
        return parse_point("--start", text)
    return None if mission is None else mission.start


def _pairs(texts: tuple[str, ...]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UsageError(f"--arg {text}: write it as NAME=VALUE")
        pairs[name] = value
    return pairs


def _command_line(
    goals: tuple[str, ...], map_path: Path | None, start: tuple[float, ...] | None, mission: Path | None, arguments: dict[str, str],
    options: dict[str, Any],
) -> str:  # fmt: skip
    """Return the command that makes this run again: without what only says where results go."""
    words = ["slamcli", "navigate", *goals] + ([] if map_path is None else ["--map", map_path.name])
    words += [] if start is None else ["--start", ",".join(f"{v:.12g}" for v in start)]
    words += ["--mission", mission.name] if mission is not None else []
    for name, flag in _FLAGS.items():
        value = options[name]
        if value is None or value == () or value == _DEFAULTS.get(name):
            continue
        for item in value if isinstance(value, tuple) else (value,):
            words += [flag, str(item)]
    for name, value in arguments.items():
        words += ["--arg", f"{name}={value}"]
    return shlex.join(words)


def _tell(outcome: NavigateOutcome, console: Console) -> None:
    from slamcli.reports.tables import table_text

    rows = [
        (
            goal.name, f"{goal.goal[0]:g},{goal.goal[1]:g}", goal.status, f"{goal.end_s - goal.begin_s:.1f}", f"{goal.length_m:.2f}",
            _figure(goal.ratio), _figure(goal.clearance_m), str(goal.collisions), str(len(goal.recoveries)),
        )
        for goal in outcome.story.goals
    ]  # fmt: skip
    columns = ["goal", "x,y", "what became of it", "time s", "driven m", "x shortest", "clearance m", "collisions", "recoveries"]  # fmt: skip
    click.echo(table_text(columns, rows, numeric=range(3, 9)))
    error, factor = outcome.story.figures()["localisation_rmse_m"], outcome.document["timing"]["realtime_factor"]
    told = [f"{outcome.story.duration_s:.1f} s, {outcome.story.length_m:.1f} m driven"]
    told += [f"localisation error {error:.3f} m (RMS)"] if error is not None else []
    told += [f"{factor:.3g} x real time"] if factor else []
    console.say(", ".join(told) + (f" -> {', '.join(map(str, outcome.written))}" if outcome.written else ""))


def _figure(value: float) -> str:
    return f"{value:.2f}" if abs(value) < 1e6 else "–"  # neither NaN nor infinite
