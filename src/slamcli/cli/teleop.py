# SPDX-License-Identifier: MIT
"""``slamcli teleop``: drive a simulated robot with the keyboard, or by a file of velocities, and record it."""

from __future__ import annotations

import contextlib
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.generate import parse_settings, parse_start
from slamcli.cli.options import json_option, seed_option, verbosity_options
from slamcli.errors import UsageError
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.teleop import Driven, Teleop
    from slamcli.pipelines.velocity_script import VelocityScript

_FASTEST = 1000.0


@click.command()
@click.argument("world")
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--script", type=click.Path(path_type=Path), metavar="FILE", help="Velocities instead of the keyboard: rows time,vx,vy,wz or duration,vx,wz, or YAML; as fast as possible.")  # fmt: skip
@click.option("--speed", type=float, metavar="FACTOR", help="Simulated over real time (default: 1).")
@click.option("--key-timeout", "key_timeout_s", type=float, metavar="S", help="Stop so long after the last key (default: go on until another key).")  # fmt: skip
@click.option("--max-time", "max_time_s", type=float, metavar="S", help="Simulated seconds after which the drive ends.")
@click.option(
    "--start", metavar="X,Y[,YAW]", help="Where the robot starts: metres and radians (or 90deg), in the map's frame."
)
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="A setting of robot, sensors, people (see generate --list-settings).")  # fmt: skip
@click.option("--people", type=click.IntRange(min=0), help="How many people walk about (people.count).")
@click.option("--slam", type=click.Choice(["gmapping", "cartographer"]), help="Make a map while driving, and show it instead of the world.")  # fmt: skip
@click.option("--config", "config_files", multiple=True, type=click.Path(path_type=Path), metavar="FILE", help="Launch or Lua file of the system that maps.")  # fmt: skip
@click.option("--slam-set", "slam_sets", multiple=True, metavar="KEY=VALUE", help="One of its parameters, by its native name.")  # fmt: skip
@click.option("--truth", type=click.Path(path_type=Path), metavar="FILE", help="Write the true pose at every scan (TUM).")  # fmt: skip
@click.option("--map-out", "map_path", type=click.Path(path_type=Path), metavar="FILE", help="Write the map (map.yaml, .pgm): the one made with --slam, else the true one.")  # fmt: skip
@seed_option
@json_option
@verbosity_options
def command(
    world: str, out: Path, script: Path | None, start: str | None, assignments: tuple[str, ...], people: int | None,
    config_files: tuple[Path, ...], as_json: bool, verbosity: int, **options: Any,
) -> int:  # fmt: skip
    """Drive a simulated robot through WORLD with the keys of teleop_twist_keyboard, and record it to OUT.

    WORLD is a world file (YAML), a map.yaml, or the name of a built-in world (slamcli generate --list-worlds). OUT is a
    .bag, .mcap, .db3 or a folder.

    \b
       u i o       q/z  all speeds +-10 %        shift: strafe (robot.drive=omni)
       j k l       w/x  linear speed             any other key: stop
       m , .       e/c  turning speed            CTRL-C: end and save

    \b
    slamcli teleop office drive.mcap
    slamcli teleop office drive.mcap --slam gmapping --map-out room.yaml
    slamcli teleop warehouse drive.bag --people 4 --speed 2 --set robot.drive=omni
    slamcli teleop office drive.mcap --script velocities.csv \\
        --truth drive.truth.tum
    """  # noqa: D301 - click needs the backspace itself
    speed, timeout = _pace(script, options.pop("speed"), options.pop("key_timeout_s"))
    _require_a_driver(script)
    kernel_cache.prepare()
    from slamcli.pipelines.teleop import Teleop
    from slamcli.pipelines.teleop_request import TeleopRequest
    from slamcli.pipelines.velocity_script import read_velocities

    settings = parse_settings(assignments) | ({} if people is None else {"people.count": people})
    request = TeleopRequest(
        world=world, path=out, start=parse_start(start), settings=settings, script=script, slam_files=config_files,
        command=_command_line(script), **options,
    )  # fmt: skip
    velocities = None if script is None else read_velocities(script)
    with Console(verbosity) as console:
        if not all(
            kernel_cache.is_filled(room) for room in ("simulation", *(["registration"] if request.slam else []))
        ):
            console.say("compiling kernels (once on this machine; slamcli warmup does it beforehand)")
        log = RunLog(None if script is None else console)  # a progress line would spoil the picture
        try:
            teleop = Teleop(request, log)
            _drive(teleop, velocities, speed, timeout, request.max_time_s)
        finally:
            with contextlib.suppress(OSError):  # a terminal that has gone: the drive is saved, nobody listens
                console.tell(log)
        if as_json:
            print_json(_document(teleop.driven), "teleop")
        else:
            with contextlib.suppress(OSError):
                console.say(_told(teleop.driven))
    return 0


def _pace(script: Path | None, speed: float | None, key_timeout_s: float | None) -> tuple[float, float]:
    """Return speed and timeout with their defaults."""
    if script is not None and (speed is not None or key_timeout_s is not None):
        raise UsageError("--speed and --key-timeout are for the keyboard; a script is driven as fast as possible")
    factor, timeout = 1.0 if speed is None else speed, 0.0 if key_timeout_s is None else key_timeout_s
    if not 0.01 <= factor <= _FASTEST:
        raise UsageError(f"--speed {factor:g}: give a factor from 0.01 to {_FASTEST:g}")
    if not 0.0 <= timeout <= 3600.0:
        raise UsageError(f"--key-timeout {timeout:g}: give seconds, 0 for never")
    return factor, timeout


def _require_a_driver(script: Path | None) -> None:
    if script is None:
        from slamcli.cli.terminal import Terminal

        if not Terminal.is_there():
            raise UsageError(
                "no terminal to drive in (stdin or stderr is none, or TERM is dumb): give --script FILE with velocities"
            )


def _drive(
    teleop: Teleop, velocities: VelocityScript | None, speed: float, timeout_s: float, max_time_s: float | None
) -> None:
    if velocities is not None:
        teleop.play(velocities)
        return
    from slamcli.cli.teleop_screen import Pace, drive_by_keys
    from slamcli.cli.terminal import Terminal

    limit = math.inf if max_time_s is None else max_time_s
    pace = Pace(speed=speed, key_timeout_s=timeout_s, max_time_s=limit)
    world_map = teleop.true_map()
    with Terminal() as terminal, teleop.driving() as robot:
        drive_by_keys(robot, terminal, pace, world_map)


def _command_line(script: Path | None) -> str:
    return "teleop" if script is None else shlex.join(["teleop", "--script", script.name])


def _told(driven: Driven) -> str:
    written = [str(p) for p in (driven.path, driven.truth, driven.map) if p is not None]
    parts = [f"{driven.duration_s:.1f} s", f"{driven.length_m:.1f} m", f"{driven.messages.get('/scan', 0)} scans"]
    touched = len(driven.collisions)
    parts += [f"{touched} contact{'s' if touched != 1 else ''}"] if touched else []
    return f"{driven.world}: {', '.join(parts)}, seed {driven.seed} -> {', '.join(written)}"


def _document(driven: Driven) -> dict[str, Any]:
    return {
        "world": driven.world,
        "path": str(driven.path),
        "truth": None if driven.truth is None else str(driven.truth),
        "map": None if driven.map is None else str(driven.map),
        "record": str(driven.record),
        "seed": driven.seed,
        "duration_s": driven.duration_s,
        "length_m": driven.length_m,
        "collisions": [
            {"time_s": c.time_s, "with": c.kind, "x_m": c.x_m, "y_m": c.y_m, "speed_m_s": c.speed_m_s, "by_robot": c.by_robot}
            for c in driven.collisions
        ],
        "messages": dict(driven.messages),
        "settings": dict(driven.settings),
        "seconds": driven.seconds,
    }  # fmt: skip
