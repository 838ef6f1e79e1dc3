# SPDX-License-Identifier: MIT
"""``slamcli map-tools``: inspect, convert, crop and compare saved maps."""

from __future__ import annotations

from typing import Any, cast

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, verbosity_options
from slamcli.errors import UsageError

_MODES = click.Choice(["trinary", "scale", "raw"])


@click.group()
def command() -> None:
    """Inspect, convert, crop and compare saved maps (a YAML and its picture).

    \b
    slamcli map-tools info map.yaml
    slamcli map-tools convert map.yaml out.yaml --mode scale
    slamcli map-tools crop map.yaml small.yaml
    slamcli map-tools diff old.yaml new.yaml -o diff.png --max changed=0.01
    """  # noqa: D301 - click needs the backspace itself


@command.command(short_help="Size, area, and how ROS 1 and nav2 read a map.")
@click.argument("map_path", metavar="MAP", type=click.Path())
@json_option
def info(map_path: str, as_json: bool) -> int:
    """Size, area known, free and occupied, and how ROS 1 and nav2 would each read MAP.

    Exit codes: 0 done (warnings included), 2 the map cannot be read.
    """
    from slamcli.pipelines.map_tools import info as look

    found = look(map_path)
    document = found.document()
    if as_json:
        print_json(document, "map-tools-info")
        return 0
    _print_info(document)
    with Console() as console:
        for warning in found.warnings:
            console.warn(warning)
    return 0


def _print_info(document: dict[str, Any]) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table

    x, y, yaw = document["origin"]
    width, height = document["size_m"]
    table = Table(show_header=False, box=None, pad_edge=False)
    for name, value in (
        ("map", document["map"]),
        ("picture", document["image"]),
        ("size", f"{document['width']} x {document['height']} cells of {document['resolution_m']:g} m: {width:.2f} x {height:.2f} m"),
        ("origin", f"{x:g}, {y:g}, yaw {yaw:g} rad"),
        ("mode", f"{document['mode']}, negate {int(document['negate'])}, occupied_thresh {document['occupied_thresh']:g}, free_thresh {document['free_thresh']:g}"),
        ("known", "none" if document["known_bounds_m"] is None else "x {:.2f} to {:.2f} m, y {:.2f} to {:.2f} m".format(*(document["known_bounds_m"][i] for i in (0, 2, 1, 3)))),
    ):  # fmt: skip
        table.add_row(name, value)
    areas = Table(box=None, pad_edge=False)
    for heading in ("read by", "free", "occupied", "between", "unknown"):
        areas.add_column(heading, justify="left" if heading == "read by" else "right")
    for system, counts in document["cells"].items():
        area = document["area_m2"][system]
        areas.add_row({"ros1": "ROS 1", "nav2": "nav2"}[system], *(f"{counts[s]} ({area[s]:.1f} m²)" for s in counts))
    console = RichConsole(soft_wrap=True)
    console.print(table)
    console.print(areas)


@command.command(short_help="Write a map in another mode or picture format.")
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path())
@click.option("--mode", type=_MODES, help="Mode of TARGET (default: that of SOURCE).")
@click.option("--image-format", metavar="SUFFIX", help="pgm, png, bmp, tif or webp (default: pgm; png in scale mode).")
@click.option("--negate/--no-negate", default=False, show_default=True, help="White is occupied in TARGET.")
@click.option("--occupied-thresh", type=click.FloatRange(0, 1), default=0.65, show_default=True, help="Occupancy above which a cell is occupied, as written.")  # fmt: skip
@click.option("--free-thresh", type=click.FloatRange(0, 1), default=0.196, show_default=True, help="Occupancy below which a cell is free, as written.")  # fmt: skip
@click.option("--read-as", type=click.Choice(["ros1", "nav2"]), default="ros1", show_default=True, help="Whose reading of SOURCE counts.")  # fmt: skip
@json_option
@verbosity_options
def convert(
    source: str, target: str, mode: str | None, image_format: str | None, negate: bool, occupied_thresh: float,
    free_thresh: float, read_as: str, as_json: bool, verbosity: int,
) -> int:  # fmt: skip
    """Write the map SOURCE as TARGET (.yaml) in another mode, picture format, with other thresholds or colours."""
    from slamcli.pipelines.map_tools import convert as run

    written = run(
        source, target, mode=cast(Any, mode), image_format=image_format, negate=negate,
        occupied_thresh=occupied_thresh, free_thresh=free_thresh, dialect=cast(Any, read_as),
    )  # fmt: skip
    _tell_written("map-tools-convert", written, as_json, verbosity)
    return 0


@command.command(short_help="Write a part of a map, or what is known of it.")
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path())
@click.option("--bounds", metavar="MINX,MINY,MAXX,MAXY", help="What to keep, metres, map frame (default: what is known).")  # fmt: skip
@click.option("--margin", "margin_m", type=click.FloatRange(min=0), default=0.0, show_default=True, metavar="METRES", help="Kept around it.")  # fmt: skip
@json_option
@verbosity_options
def crop(source: str, target: str, bounds: str | None, margin_m: float, as_json: bool, verbosity: int) -> int:
    """Write the part of SOURCE within bounds, or its known part, as TARGET (.yaml)."""
    from slamcli.pipelines.map_tools import crop_map

    written = crop_map(source, target, bounds=_bounds(bounds), margin_m=margin_m)
    _tell_written("map-tools-crop", written, as_json, verbosity)
    return 0


@command.command(short_help="Count the cells that differ between two maps.")
@click.argument("first", type=click.Path())
@click.argument("second", type=click.Path())
@click.option("-o", "--output", type=click.Path(), metavar="FILE.png", help="Draw what changed, on the cells of FIRST.")
@click.option("--max", "limits", multiple=True, metavar="KEY=VALUE", help="Fail (exit 1) above: changed (share), changed_cells, appeared_cells, vanished_cells.")  # fmt: skip
@json_option
@verbosity_options
def diff(first: str, second: str, output: str | None, limits: tuple[str, ...], as_json: bool, verbosity: int) -> int:
    """Count the cells that differ between two maps, aligned by origin and resolution.

    Exit codes: 0 done, 1 a --max was exceeded, 2 wrong usage or input.
    """
    from slamcli.pipelines.map_tools import check_limits, compare, difference_document, draw_difference

    bars = _limits(limits)
    found = compare(first, second)
    document = difference_document(found)
    if output:
        document["output"] = str(draw_difference(found, output))
    if as_json:
        print_json(document, "map-tools-diff")
    elif verbosity >= 0:
        _print_difference(document)
    check_limits(found, bars)
    return 0


def _print_difference(document: dict[str, Any]) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("in FIRST", "free in SECOND", "occupied", "unknown", "outside"):
        table.add_column(heading, justify="left" if heading == "in FIRST" else "right")
    for state, counts in document["cells"].items():
        table.add_row(state, *(str(count) for count in counts.values()))
    console = RichConsole(soft_wrap=True)
    console.print(table)
    console.print(
        f"changed {document['changed_cells']} of {document['known_in_both_cells']} cells known in both"
        f" ({100 * document['changed']:.2f} %), appeared {document['appeared_cells']}, vanished {document['vanished_cells']}"
    )


def _tell_written(name: str, written: tuple[Any, ...], as_json: bool, verbosity: int) -> None:
    names = [str(path) for path in written]
    if as_json:
        print_json({"outputs": names}, name)
        return
    with Console(verbosity) as console:
        console.say(f"written: {', '.join(names)}")


def _bounds(text: str | None) -> tuple[float, float, float, float] | None:
    if text is None:
        return None
    try:
        x0, y0, x1, y1 = (float(v) for v in text.split(","))
    except ValueError as error:
        raise UsageError(f"--bounds {text}: write them as MINX,MINY,MAXX,MAXY (metres)") from error
    if not all(abs(v) < 1e9 for v in (x0, y0, x1, y1)):
        raise UsageError(f"--bounds {text}: write them as MINX,MINY,MAXX,MAXY (metres)")
    return x0, y0, x1, y1


def _limits(texts: tuple[str, ...]) -> dict[str, float]:
    limits = {}
    for text in texts:
        key, _, value = text.partition("=")
        try:
            limits[key.strip()] = float(value)
        except ValueError as error:
            raise UsageError(f"--max {text}: write it as KEY=VALUE, for example --max changed=0.01") from error
    return limits
