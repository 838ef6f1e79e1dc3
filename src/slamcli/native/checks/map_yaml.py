# SPDX-License-Identifier: MIT
"""Traps of map_server's map.yaml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from slamcli.native.checks.findings import ERROR, WARNING, Finding, at, check_declared, number
from slamcli.native.ros_parameters.declare import Table, row
from slamcli.native.settings import Setting

MAP: Table = (
    row("image", "", "Image, relative to the file's folder."),
    row("resolution", 0.05, "Size of a pixel.", "m", minimum=1e-6),
    row("negate", 0, "1: white is occupied.", minimum=0, maximum=1),
    row("occupied_thresh", 0.65, "Occupancy above which a cell is occupied.", minimum=0, maximum=1),
    row("free_thresh", 0.196, "Occupancy below which a cell is free.", minimum=0, maximum=1),
    row("mode", "trinary", "How pixels are read.", choices=("trinary", "scale", "raw")),
)
_UNKNOWN_PIXEL = (255 - 205) / 255


def check_map_yaml(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    """Yield what is wrong with a map's YAML file."""
    plain = {name: setting for name, setting in settings.items() if name not in ("origin", "negate")}
    yield from check_declared(plain, MAP, "map_server")
    first = next(iter(settings.values()))
    for name in ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh"):
        if name not in settings:
            yield at(first, ERROR, f"{name} is missing: map_server does not load this map")
    if "negate" in settings and settings["negate"].value not in (0, 1, True, False):
        yield at(settings["negate"], ERROR, f"negate={settings['negate'].value!r}: 0 or 1")
    origin = settings.get("origin")
    if origin is not None and not (
        isinstance(origin.value, list)
        and len(origin.value) == 3
        and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in origin.value)
    ):
        yield at(origin, ERROR, "origin must be [x, y, yaw]")
    image = settings.get("image")
    if image is not None and not _exists(Path(image.file).parent / str(image.value)):
        yield at(image, ERROR, f"the image {image.value} does not exist")
    free, occupied = number(settings, "free_thresh", 0.196), number(settings, "occupied_thresh", 0.65)
    mode = settings["mode"].value if "mode" in settings else "trinary"
    if "free_thresh" in settings and free > occupied:
        yield at(settings["free_thresh"], ERROR, f"free_thresh {free:g} is above occupied_thresh {occupied:g}")
    elif "free_thresh" in settings and free > _UNKNOWN_PIXEL and mode == "trinary":
        yield at(
            settings["free_thresh"],
            WARNING,
            f"free_thresh {free:g} is above 0.196: unknown cells (grey 205) are read as free",
        )


def _exists(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
