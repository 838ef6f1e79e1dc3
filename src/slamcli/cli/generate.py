# SPDX-License-Identifier: MIT
"""``slamcli generate``: a synthetic recording with ground truth."""

from __future__ import annotations

import math
from typing import Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, seed_option, verbosity_options
from slamcli.errors import UsageError

_SENSORS = {"/scan": "scans", "/points": "clouds"}


def _list_worlds(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from slamcli.simulation.builtin import world_names

        click.echo("\n".join(world_names()))
        ctx.exit()


def _list_settings(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from slamcli.parameters import declarations
        from slamcli.simulation.parameters import SimulationParameters

        for d in declarations(SimulationParameters):
            default = "auto" if d.default is None else str(d.default).lower() if d.kind is bool else d.default
            choices = f" One of {', '.join(d.choices)}." if d.choices else ""
            click.echo(f"{d.name}={default}\n    {d.help}{f' [{d.unit}]' if d.unit else ''}{choices}")
        ctx.exit()


@click.command()
@click.argument("world")
@click.argument("out", type=click.Path())
@seed_option
@click.option("--duration", "duration_s", type=float, help="Seconds (default: the world's route; 120 at random).")
@click.option("--start", metavar="X,Y,YAW", help="Where the robot starts: metres and degrees, in the map's frame.")
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="A setting (see --list-settings).")
@click.option("--people", type=click.IntRange(min=0), help="How many people walk about (people.count).")
@click.option("--imu/--no-imu", default=None, help="Record an IMU (imu.enabled).")
@click.option("--lidar3d/--no-lidar3d", default=None, help="Record a spinning scanner (lidar3d.enabled).")
@click.option("--truth", type=click.Path(), metavar="FILE", help="Write the true pose at every scan (TUM).")
@click.option("--map-out", "map_path", type=click.Path(), metavar="FILE", help="Write the true map (map.yaml, .pgm).")
@click.option("--format", "container", metavar="FORMAT", help="Container, where OUT's suffix does not say it.")
@click.option("--compression", metavar="NAME", help="Compression of the container: none, bz2, lz4, zstd.")
@click.option("--list-worlds", is_flag=True, is_eager=True, expose_value=False, callback=_list_worlds, help="Name the built-in worlds.")  # fmt: skip
@click.option("--list-settings", is_flag=True, is_eager=True, expose_value=False, callback=_list_settings, help="Explain every setting.")  # fmt: skip
@json_option
@verbosity_options
def command(
    world: str, out: str, seed: int, duration_s: float | None, start: str | None, assignments: tuple[str, ...],
    people: int | None, imu: bool | None, lidar3d: bool | None, truth: str | None, map_path: str | None, container: str | None,
    compression: str | None, as_json: bool, verbosity: int,
) -> int:  # fmt: skip
    """Simulate a robot in WORLD and write its recording, with ground truth, to OUT.

    WORLD is a world file (YAML), a map.yaml, or the name of a built-in world (--list-worlds). OUT is a .bag, .mcap,
    .db3 or a folder.

    \b
    slamcli generate office office.mcap --truth office.truth.tum --map-out office.map.yaml
    slamcli generate warehouse hall.bag --duration 300 --people 4 --imu --seed 7
    slamcli generate map.yaml drive.mcap --set laser.range_max=4 --set laser.fov=240
    slamcli generate office slip.bag --set slip.count=3 --set clock.laser_offset=0.1
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.generate import generate
    from slamcli.runtime import RunLog

    settings = _settings(assignments)
    if people is not None:
        settings["people.count"] = people
    if imu is not None:
        settings["imu.enabled"] = imu
    if lidar3d is not None:
        settings["lidar3d.enabled"] = lidar3d
    with Console(verbosity) as console:
        log = RunLog(console)
        made = generate(
            world, out, seed=seed, duration_s=duration_s, start=_pose(start), settings=settings, truth=truth,
            map_path=map_path, format=container, compression=compression, log=log,
        )  # fmt: skip
        console.tell(log)
    if as_json:
        print_json(_document(made))
    else:
        written = [str(p) for p in (made.path, made.truth, made.map) if p is not None]
        told = [f"{made.messages[topic]} {what}" for topic, what in _SENSORS.items() if topic in made.messages]
        console.say(
            f"{made.world}: {made.duration_s:.1f} s, {made.length_m:.1f} m, {', '.join(told)}, seed "
            f"{made.seed} -> {', '.join(written)} ({made.speed:.0f} x real time)"
        )
    return 0


def _document(made: Any) -> dict[str, Any]:
    return {
        "world": made.world,
        "path": str(made.path),
        "truth": None if made.truth is None else str(made.truth),
        "map": None if made.map is None else str(made.map),
        "record": str(made.record),
        "seed": made.seed,
        "duration_s": made.duration_s,
        "length_m": made.length_m,
        "messages": dict(made.messages),
        "slips_s": [list(slip) for slip in made.slips_s],
        "settings": dict(made.settings),
        "seconds": made.seconds,
        "speed_x_real_time": made.speed,
    }


def _settings(assignments: tuple[str, ...]) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {assignment}: write it as KEY=VALUE, for example --set laser.range_max=8")
        settings[key.strip()] = value.strip()
    return settings


def _pose(text: str | None) -> tuple[float, float, float] | None:
    if text is None:
        return None
    try:
        values = [float(v) for v in text.split(",")]
    except ValueError as error:
        raise UsageError(f"--start {text}: write it as X,Y or X,Y,YAW (metres, degrees)") from error
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        raise UsageError(f"--start {text}: write it as X,Y or X,Y,YAW (metres, degrees)")
    return values[0], values[1], math.radians(values[2]) if len(values) == 3 else 0.0
