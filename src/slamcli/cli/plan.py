# SPDX-License-Identifier: MIT
"""``slamcli plan``: paths on a saved map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, verbosity_options
from slamcli.cli.points import PointsCommand, parse_point
from slamcli.errors import UsageError

if TYPE_CHECKING:
    from slamcli.pipelines.plan import Answer, PlanningSite
    from slamcli.runtime import RunLog


def _list_settings(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from slamcli.navigation.costmap_parameters import CostmapParameters
        from slamcli.navigation.planner_parameters import PlannerParameters
        from slamcli.parameters import declarations

        for d in (*declarations(CostmapParameters), *declarations(PlannerParameters)):
            default = "auto" if d.default is None else str(d.default).lower() if d.kind is bool else d.default
            click.echo(f"{d.name}={default}\n    {d.help}{f' [{d.unit}]' if d.unit else ''}")
        ctx.exit()


@click.command(cls=PointsCommand)
@click.argument("start", required=False)
@click.argument("goal", required=False)
@click.option("--map", "map_path", type=click.Path(), required=True, metavar="FILE", help="The map's YAML.")
@click.option(
    "--planner",
    type=click.Choice(["navfn", "dijkstra", "astar", "theta_star", "hybrid_astar", "global_planner"]),
    default="navfn",
    show_default=True,
    help="navfn: ROS' default, smooth. dijkstra, astar: cheapest path on the 8-connected grid (both find the same cost). theta_star: any angle. hybrid_astar: drivable with a turning radius, headings and reverse. global_planner: ROS' package of that name with its options.",
)
@click.option("--costmap", "costmaps", multiple=True, type=click.Path(), metavar="FILE", help="costmap_2d parameter file; any number, later ones win.")  # fmt: skip
@click.option("--robot-radius", type=float, metavar="METRES", help="Radius of a round robot; 0 plans for a point and looks for the shortest way (no inflation).")  # fmt: skip
@click.option("--footprint", metavar="POLYGON", help="Outline of the robot instead: [[x1,y1],[x2,y2],...] in metres.")
@click.option("--inflation-radius", type=float, metavar="METRES", help="How far obstacles have a cost (default 0.55).")
@click.option("--default-tolerance", type=float, metavar="METRES", help="How far from the goal the path may end.")
@click.option("--allow-unknown/--no-allow-unknown", default=None, help="Plan through unknown cells (default: only where no other way exists).")  # fmt: skip
@click.option("--simplify", is_flag=True, default=None, help="Straighten the path where that is free and costs no more.")  # fmt: skip
@click.option("--smooth", is_flag=True, default=None, help="Smooth the path where that is free and costs no more.")
@click.option(
    "--turning-radius", type=float, metavar="METRES", help="hybrid_astar: least radius of a curve (default 0.4)."
)
@click.option("--forward-only", is_flag=True, default=None, help="hybrid_astar: no driving in reverse (Dubins instead of Reeds-Shepp).")  # fmt: skip
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Any costmap_2d or navfn parameter (see --list-settings).")  # fmt: skip
@click.option("--pairs", "pairs_path", type=click.Path(), metavar="FILE.csv", help="Plan many: start_x,start_y,goal_x,goal_y per line; answers one JSON line each.")  # fmt: skip
@click.option("--strict", is_flag=True, help="With --pairs: exit with 1 if any pair has no path.")
@click.option("-o", "--output", "outputs", multiple=True, type=click.Path(), metavar="PATH", help="File (.csv .json .tum .mcap .bag .png) or folder for all of them; any number. Default: path.png and path.csv here; nothing with --json or --pairs.")  # fmt: skip
@click.option("--list-settings", is_flag=True, is_eager=True, expose_value=False, callback=_list_settings, help="Explain every parameter.")  # fmt: skip
@json_option
@verbosity_options
def command(
    start: str | None, goal: str | None, map_path: str, costmaps: tuple[str, ...], planner: str,
    pairs_path: str | None, strict: bool, outputs: tuple[str, ...], as_json: bool, verbosity: int,
    assignments: tuple[str, ...], **values: Any,
) -> int:  # fmt: skip
    """Plan a path from START to GOAL (x,y or x,y,yaw; metres, radians) on a saved map.

    \b
    slamcli plan -1.5,2.0 3.0,2.0 --map intel/map.yaml
    slamcli plan 0,0 12.5,-3,1.57 --map map.yaml --robot-radius 0.18 \\
        --planner astar -o path.mcap
    slamcli plan 0,0,0 5,5,3.14 --map map.yaml \\
        --footprint '[[.3,.2],[-.2,.2],[-.2,-.2],[.3,-.2]]' \\
        --planner hybrid_astar
    slamcli plan 0,0 5,5 --map map.yaml --costmap costmap_common_params.yaml \\
        -o planned/
    slamcli plan --pairs pairs.csv --map map.yaml --robot-radius 0 --planner astar

    Exit codes: 0 a path was found (with --pairs: every pair was answered), 1 there is none and the message says what
    is nearest, 2 wrong usage or input.
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.plan import load_site
    from slamcli.pipelines.plan_outputs import check_targets
    from slamcli.runtime import RunLog

    _check_usage(start, goal, pairs_path, strict)
    if planner != "hybrid_astar" and (values["turning_radius"] is not None or values["forward_only"]):
        raise UsageError("--turning-radius and --forward-only belong to --planner hybrid_astar")
    targets = [Path(p) for p in outputs]
    check_targets(targets)
    settings = _settings(assignments, values)
    points = [parse_point(role, text) for role, text in (("start", start), ("goal", goal)) if text is not None]
    with Console(verbosity) as console:
        log = RunLog(console)
        if not kernel_cache.is_filled("navigation"):
            console.say("compiling the planners (once on this machine; slamcli warmup does it beforehand)")
        pairs = _read_pairs(pairs_path)
        site = load_site(map_path, planner=planner, costmap_files=costmaps, settings=settings, log=log)
        if pairs:
            console.tell(log)
            return _plan_many(site, pairs, targets, strict)
        return _plan_one(site, points, targets, as_json, console, log)


def _check_usage(start: str | None, goal: str | None, pairs_path: str | None, strict: bool) -> None:
    if pairs_path is None and (start is None or goal is None):
        raise UsageError("give START and GOAL as x,y (or many with --pairs FILE.csv); see slamcli plan --help")
    if pairs_path is not None and start is not None:
        raise UsageError("give START and GOAL, or --pairs, not both")
    if strict and pairs_path is None:
        raise UsageError("--strict belongs to --pairs")


def _settings(assignments: tuple[str, ...], values: dict[str, Any]) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {assignment}: write it as KEY=VALUE, for example --set cost_scaling_factor=5")
        settings[key.strip()] = value.strip()
    names = {
        "inflation_radius": "inflation_layer.inflation_radius",
        "turning_radius": "minimum_turning_radius",
        "forward_only": "motion_model_for_search",
    }
    if values.get("forward_only"):
        values["forward_only"] = "DUBIN"
    settings.update({names.get(key, key): value for key, value in values.items() if value is not None})
    return settings


def _read_pairs(path: str | None) -> list[tuple[float, float, float, float]]:
    if path is None:
        return []
    from slamcli.formats.pairs import read_pairs

    return read_pairs(path)


def _plan_many(
    site: PlanningSite, pairs: list[tuple[float, float, float, float]], targets: list[Path], strict: bool
) -> int:
    import json

    from slamcli.pipelines.plan import plan_many
    from slamcli.pipelines.schemas import stamped

    if targets:
        raise UsageError("-o belongs to one path; with --pairs redirect stdout: slamcli plan --pairs … > answers.jsonl")
    failed = 0
    for index, answer in enumerate(plan_many(site, pairs)):
        failed += answer.path is None
        click.echo(json.dumps(stamped("plan-pair", {"index": index, **answer.document()})))
    return 1 if strict and failed else 0


def _plan_one(
    site: PlanningSite,
    points: list[tuple[float, ...]],
    targets: list[Path],
    as_json: bool,
    console: Console,
    log: RunLog,
) -> int:
    from slamcli.pipelines.plan import plan, require_path
    from slamcli.pipelines.plan_outputs import write_outputs

    answer = plan(site, points[0], points[1], log=log)
    if not targets and not as_json:
        targets = [Path("path.png"), Path("path.csv")]
    written = write_outputs(targets, site, answer, log) if answer.path is not None else ()
    console.tell(log)
    if as_json:
        document = {"map": str(site.map.path), **answer.document(points=True), "parameters": site.parameters}
        print_json(
            {**document, "outputs": [str(p) for p in written], "notes": log.notes, "warnings": log.warnings}, "plan"
        )
    require_path(answer)
    if not as_json:
        _print_table(answer, written)
    return 0


def _print_table(answer: Answer, written: tuple[Path, ...]) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table

    from slamcli.pipelines.plan import require_path

    path = require_path(answer)
    table = Table(show_header=False, box=None, pad_edge=False)
    rows = [
        ("planner", path.method),
        ("start", ",".join(f"{v:g}" for v in answer.start)),
        ("goal", ",".join(f"{v:g}" for v in answer.goal)),
        ("length", f"{path.length_m:.3f} m, {len(path.points_m)} points"),
        ("cost", f"{path.cost:.3f} (metres of free space that cost as much)"),
        ("clearance", f"{path.clearance_m:.3f} m to the nearest obstacle"),
        ("time", f"{answer.time_ms:.1f} ms"),
        ("written", ", ".join(str(p) for p in written)),
    ]
    if path.directions is not None:
        rows.insert(4, ("reverse", f"{path.reverse_m:.3f} m"))
    if path.goal_offset_m > 1e-6:
        rows.insert(3, ("ends", f"{path.goal_offset_m:.3f} m from the goal (default_tolerance)"))
    for row in rows:
        table.add_row(*row)
    RichConsole(soft_wrap=True).print(table)
