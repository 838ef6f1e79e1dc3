# SPDX-License-Identifier: MIT
"""``slamcli generate``: a synthetic recording with ground truth."""

from __future__ import annotations

import math
from typing import Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, seed_option, verbosity_options
from slamcli.cli.points import parse_point
from slamcli.errors import UsageError

_SENSORS = {"/scan": "scans", "/points": "clouds", "/imu": "IMU samples"}
_CAMERAS = ("mono", "stereo", "rgbd")


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
@click.option(
    "--start", metavar="X,Y[,YAW]", help="Where the robot starts: metres and radians (or 90deg), in the map's frame."
)
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="A setting (see --list-settings).")
@click.option("--people", type=click.IntRange(min=0), help="How many people walk about (people.count).")
@click.option("--imu/--no-imu", default=None, help="Record an IMU (imu.enabled).")
@click.option("--lidar3d/--no-lidar3d", default=None, help="Record a spinning scanner (lidar3d.enabled).")
@click.option(
    "--camera",
    type=click.Choice([*_CAMERAS, *(f"{c}-inertial" for c in _CAMERAS)]),
    help="Record a camera (camera.kind), and an IMU.",
)
@click.option("--image-size", metavar="WxH", help="Pixels, for example 640x480 (camera.width, camera.height).")
@click.option("--rate", type=float, help="Images per second (camera.rate).")
@click.option("--exposure", type=float, help="Seconds for which the shutter is open (camera.exposure).")
@click.option("--motion-blur/--no-motion-blur", default=None, help="Blur over the exposure (camera.motion_blur).")
@click.option(
    "--rolling-shutter", type=float, metavar="S", help="Seconds from the first to the last row (camera.readout)."
)
@click.option("--compressed/--raw", default=None, help="JPEG and PNG, or raw images (camera.compressed).")
@click.option("--truth", type=click.Path(), metavar="FILE", help="Write the true pose at every scan or image (TUM).")
@click.option("--map-out", "map_path", type=click.Path(), metavar="FILE", help="Write the true map (map.yaml, .pgm).")
@click.option("--format", "container", metavar="FORMAT", help="Container, where OUT's suffix does not say it.")
@click.option("--compression", metavar="NAME", help="Compression of the container: none, bz2, lz4, zstd.")
@click.option("--list-worlds", is_flag=True, is_eager=True, expose_value=False, callback=_list_worlds, help="Name the built-in worlds.")  # fmt: skip
@click.option("--list-settings", is_flag=True, is_eager=True, expose_value=False, callback=_list_settings, help="Explain every setting.")  # fmt: skip
@json_option
@verbosity_options
def command(
    world: str, out: str, seed: int, duration_s: float | None, start: str | None, assignments: tuple[str, ...],
    people: int | None, imu: bool | None, lidar3d: bool | None, camera: str | None, image_size: str | None,
    rate: float | None, exposure: float | None, motion_blur: bool | None, rolling_shutter: float | None,
    compressed: bool | None, truth: str | None, map_path: str | None, container: str | None, compression: str | None,
    as_json: bool, verbosity: int,
) -> int:  # fmt: skip
    """Simulate a robot in WORLD and write its recording, with ground truth, to OUT.

    WORLD is a world file (YAML), a map.yaml, or the name of a built-in world (--list-worlds). OUT is a .bag, .mcap,
    .db3 or a folder.

    \b
    slamcli generate office office.mcap --truth office.truth.tum \\
        --map-out office.map.yaml
    slamcli generate warehouse hall.bag --duration 300 --people 4 --imu --seed 7
    slamcli generate map.yaml drive.mcap --set laser.range_max=4 \\
        --set laser.fov=240
    slamcli generate office slip.bag --set slip.count=3 \\
        --set clock.laser_offset=0.1
    slamcli generate visual_room room.mcap --camera rgbd-inertial \\
        --duration 20 --truth room.truth.tum
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.generate import generate
    from slamcli.runtime import RunLog

    short = {
        "people.count": people, "imu.enabled": imu, "lidar3d.enabled": lidar3d, "camera.rate": rate,
        "camera.exposure": exposure, "camera.motion_blur": motion_blur, "camera.readout": rolling_shutter,
        "camera.compressed": compressed, **_camera(camera, image_size),
    }  # fmt: skip
    settings = parse_settings(assignments) | {key: value for key, value in short.items() if value is not None}
    with Console(verbosity) as console:
        log = RunLog(console)
        made = generate(
            world, out, seed=seed, duration_s=duration_s, start=parse_start(start), settings=settings, truth=truth,
            map_path=map_path, format=container, compression=compression, log=log,
        )  # fmt: skip
        console.tell(log)
    if as_json:
        print_json(_document(made), "generate")
    else:
        written = [str(p) for p in (made.path, made.truth, made.map) if p is not None]
        told = [f"{made.messages[topic]} {what}" for topic, what in _SENSORS.items() if topic in made.messages]
        images = sum(count for topic, count in made.messages.items() if "/image_" in topic)
        told += [f"{images} images"] if images else []
        console.say(
            f"{made.world}: {made.duration_s:.1f} s, {made.length_m:.1f} m, {', '.join(told)}, seed "
            f"{made.seed} -> {', '.join(written)} ({made.speed:.2g} x real time)"
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


def parse_settings(assignments: tuple[str, ...]) -> dict[str, Any]:
    """Return what ``--set KEY=VALUE`` says; raise UsageError where it says nothing."""
    settings: dict[str, Any] = {}
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {assignment}: write it as KEY=VALUE, for example --set laser.range_max=8")
        settings[key.strip()] = value.strip()
    return settings


def _camera(kind: str | None, image_size: str | None) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    if kind is not None:
        settings["camera.kind"] = kind.partition("-")[0]
        if kind.endswith("-inertial"):
            settings["imu.enabled"] = True
    if image_size is not None:
        width, _, height = image_size.lower().partition("x")
        if not (width.isdecimal() and height.isdecimal()):
            raise UsageError(f"--image-size {image_size}: write it as WIDTHxHEIGHT, for example 640x480")
        settings |= {"camera.width": int(width), "camera.height": int(height)}
    return settings


def parse_start(text: str | None) -> tuple[float, float, float] | None:
    """Return the pose of ``--start X,Y[,YAW]``; raise UsageError where it is none."""
    if text is None:
        return None
    values = parse_point("--start", text)
    if not all(map(math.isfinite, values)):
        raise UsageError(f"--start {text}: write it as X,Y or X,Y,YAW (metres, radians)")
    return values[0], values[1], values[2] if len(values) == 3 else 0.0
