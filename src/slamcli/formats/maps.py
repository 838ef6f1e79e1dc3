# SPDX-License-Identifier: MIT
"""Maps on disk: a YAML and its picture, as map_server reads them and map_saver writes them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from slamcli.errors import DataError, FormatError, UsageError
from slamcli.formats.map_images import MapImage, read_image, write_image
from slamcli.formats.map_modes import MODES, Dialect, Mode, PixelRule, image_from_occupancy, occupancy_from_image
from slamcli.grids import OccupancyGrid
from slamcli.outputs import atomic_file

_MAX_YAML_BYTES = 1 << 20
_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
_NO_MEANING = ("map_type",)

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class MapFile:
    """A map as it lies on disk, read."""

    grid: OccupancyGrid
    mode: Mode
    negate: bool
    occupied_thresh: float
    free_thresh: float
    image: Path
    """Path of the picture."""
    path: Path
    """Path of the YAML."""
    picture: MapImage
    """The pixels, for whoever wants to read them another way."""
    warnings: tuple[str, ...] = ()
    """What is odd about the file but does not prevent reading it."""

    @property
    def rule(self) -> PixelRule:
        """How its pixels were read."""
        return PixelRule(
            mode=self.mode, negate=self.negate, occupied_thresh=self.occupied_thresh, free_thresh=self.free_thresh
        )


def read_map(yaml_path: str | os.PathLike[str], *, dialect: Dialect = "ros1") -> MapFile:
    """Read a map as ROS 1 map_server does, or as nav2 does.

    The picture's path is taken relative to the YAML's folder unless it is absolute. Keys that may be missing
    are `mode` (trinary) and `negate` (0).

    Raises
    ------
    FormatError
        If the YAML or the picture does not exist, is damaged, lacks a key, or holds a value that no map can have.
    """
    path = Path(yaml_path)
    document = _load(path)
    unknown = [key for key in document if key not in _KEYS and key not in _NO_MEANING]
    warnings = tuple(f"{path}: key {key!r} has no meaning in a map and is ignored" for key in unknown)
    resolution = _value(document, "resolution", path, _positive)
    origin = _value(document, "origin", path, _pose)
    thresholds = [_value(document, key, path, _share) for key in ("occupied_thresh", "free_thresh")]
    if thresholds[1] > thresholds[0]:
        raise FormatError(f"{path}: free_thresh {thresholds[1]:g} is above occupied_thresh {thresholds[0]:g}")
    rule = PixelRule(
        mode=_value(document, "mode", path, _mode, "trinary"),
        negate=_value(document, "negate", path, _truth, "0"),
        occupied_thresh=thresholds[0],
        free_thresh=thresholds[1],
    )
    image_path = path.parent / _value(document, "image", path, _text)
    picture = _read_picture(image_path, path)
    try:
        grid = OccupancyGrid(occupancy_from_image(picture, rule, dialect), resolution, origin)
    except DataError as error:
        raise FormatError(f"{path}: {error}") from error
    return MapFile(
        grid, rule.mode, rule.negate, rule.occupied_thresh, rule.free_thresh, image_path, path, picture, warnings
    )


def write_map(
    yaml_path: str | os.PathLike[str],
    grid: OccupancyGrid,
    *,
    mode: Mode = "trinary",
    image: str | os.PathLike[str] | None = None,
    negate: bool = False,
    occupied_thresh: float = 0.65,
    free_thresh: float = 0.196,
    occupied_percent: int = 65,
    free_percent: int = 25,
) -> tuple[Path, Path]:
    """Write a map as map_saver does, the picture first, and return the paths of the YAML and the picture.

    Parameters
    ----------
    yaml_path
        Where the YAML goes.
    grid
        What to write.
    mode
        trinary (254, 0, 205), scale (occupancy as grey, unknown transparent) or raw (occupancy as the pixel's value).
    image
        Where the picture goes; its suffix names the format. Beside the YAML and under its name if left out: .pgm, or
        .png in scale mode.
    negate, occupied_thresh, free_thresh
        Written to the YAML and honoured in the picture: free, occupied and unknown cells read back as such, or it is
        an error. Scale keeps values between to the nearest that the greys between the thresholds can tell apart.
    occupied_percent, free_percent
        Trinary only: from which occupancy on a cell is written as occupied, and up to which as free (map_saver's
        ``--occ`` and ``--free``).

    Raises
    ------
    UsageError
        If the file cannot be written, or would not read back as what was written.
    """
    path = Path(yaml_path)
    if mode not in MODES:
        raise UsageError(f"map mode {mode!r}: choose one of {', '.join(MODES)}")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"{path}: the name of a map ends in .yaml; its picture is written beside it")
    if grid.cells.size == 0:
        raise UsageError(f"{path}: the map has no cells ({grid.width} x {grid.height})")
    rule = PixelRule(mode=mode, negate=negate, occupied_thresh=occupied_thresh, free_thresh=free_thresh)
    image_path = Path(image) if image is not None else path.with_suffix(".png" if mode == "scale" else ".pgm")
    grey, alpha = image_from_occupancy(grid.cells, rule, occupied_percent=occupied_percent, free_percent=free_percent)
    write_image(image_path, grey, alpha, f"CREATOR: map_saver.cpp {grid.resolution_m:.3f} m/pix")
    with atomic_file(path) as stream:
        stream.write(_yaml_text(path, image_path, grid, rule))
    return path, image_path


def _yaml_text(path: Path, image_path: Path, grid: OccupancyGrid, rule: PixelRule) -> str:
    name = os.path.relpath(image_path, path.parent)
    name = name if not set(name) & set("#:'\"\\{}[]\n") else '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'
    x, y, yaw = (f"{value:f}" for value in grid.origin)
    lines = [
        f"image: {name}",
        f"resolution: {_exact(grid.resolution_m)}",
        f"origin: [{x}, {y}, {yaw}]",
        f"negate: {int(rule.negate)}",
        f"occupied_thresh: {rule.occupied_thresh:g}",
        f"free_thresh: {rule.free_thresh:g}",
    ]
    if rule.mode != "trinary":
        lines.insert(1, f"mode: {rule.mode}")
    return "\n".join(lines) + "\n\n"


def _exact(value: float) -> str:
    """Return six decimals as map_saver writes them, or more where these would be another resolution."""
    text = f"{value:f}"
    return text if abs(float(text) - value) <= 1e-7 * value else repr(float(value))


def _load(path: Path) -> dict[str, Any]:
    if not path.exists():
        raise FormatError(f"{path}: no such map")
    if not path.is_file():
        raise FormatError(f"{path}: not a file: name the map's .yaml")
    try:
        with path.open("rb") as stream:
            data = stream.read(_MAX_YAML_BYTES + 1)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > _MAX_YAML_BYTES or data[:2] in (b"P5", b"P2", b"BM") or data[:4] == b"\x89PNG":
        raise FormatError(f"{path}: not a map YAML; name the .yaml, not the picture")
    try:
        # Every scalar stays text: what YAML would make of 1e-2, 0x10 or 12:30 is not what map_server makes of it.
        document = yaml.load(data.decode("utf-8"), Loader=yaml.BaseLoader)  # noqa: S506 - the base loader builds nothing
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark is not None else ""
        raise FormatError(f"{path}: not a YAML file{where}") from error
    if not isinstance(document, dict):
        raise FormatError(f"{path}: not a map: expected keys image, resolution, origin, …")
    return document


def _value(
    document: Mapping[str, Any], key: str, path: Path, parse: Callable[[Any], T], default: str | None = None
) -> T:
    raw = document.get(key, default)
    if raw is None:
        present = ", ".join(str(k) for k in list(document)[:8]) or "none"
        raise FormatError(f"{path}: key {key!r} is missing (keys found: {present})")
    try:
        return parse(raw)
    except (ValueError, TypeError, OverflowError) as error:
        shown = str(raw)
        shown = shown if len(shown) < 60 else shown[:57] + "..."
        raise FormatError(f"{path}: {key}: {shown!r} is not {error}") from error


def _number(raw: Any, what: str) -> float:
    if not isinstance(raw, str):
        raise TypeError(what)
    try:
        value = float(raw)
    except ValueError:
        raise ValueError(what) from None
    if not math.isfinite(value):
        raise ValueError(what)
    return value


def _positive(raw: Any) -> float:
    what = "a positive number of metres per pixel"
    value = _number(raw, what)
    if value <= 0 or value > 1e6 or value < 1e-6:
        raise ValueError(what)
    return value


def _share(raw: Any) -> float:
    what = "a number from 0 to 1"
    value = _number(raw, what)
    if not 0 <= value <= 1:
        raise ValueError(what)
    return value


def _pose(raw: Any) -> tuple[float, float, float]:
    what = "three numbers [x, y, yaw]"
    if not isinstance(raw, list) or len(raw) != 3:
        raise ValueError(what)
    x, y, yaw = (_number(value, what) for value in raw)
    if max(abs(x), abs(y)) > 1e9:
        raise ValueError("a pose on this planet (metres)")
    return x, y, yaw


def _truth(raw: Any) -> bool:
    text = str(raw).strip().lower()
    if text in ("1", "true", "yes", "on", "y"):
        return True
    if text in ("0", "false", "no", "off", "n"):
        return False
    raise ValueError("0 or 1")


def _mode(raw: Any) -> Mode:
    for mode in MODES:
        if raw == mode:
            return mode
    raise ValueError(f"a mode ({', '.join(MODES)})")


def _text(raw: Any) -> str:
    if not isinstance(raw, str) or not raw.strip() or "\0" in raw:
        raise ValueError("the name of a picture")
    return raw


def _read_picture(image_path: Path, path: Path) -> MapImage:
    try:
        return read_image(image_path)
    except OSError as error:
        raise FormatError(f"{path}: image {str(image_path)[:200]!r}: {error.strerror}") from error
    except FormatError as error:
        beside = path.parent / image_path.name
        if not image_path.exists() and beside.is_file():
            raise FormatError(
                f"{path}: image {str(image_path)!r} does not exist, but {beside.name} lies beside the YAML: write `image: {beside.name}`"
            ) from error
        raise FormatError(f"{path}: {error}") from error
