# SPDX-License-Identifier: MIT
"""Saved maps: what they hold and how they are read, conversion, cropping, comparison."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ThresholdError, UsageError
from slamcli.formats.map_modes import UNKNOWN_GREY, Dialect, Mode, occupancy_from_image
from slamcli.formats.maps import MapFile, read_map, write_map
from slamcli.grids import OccupancyGrid
from slamcli.grids.crop import box_of_bounds, crop, known_box
from slamcli.grids.difference import STATES, GridDifference, difference
from slamcli.outputs import atomic_file
from slamcli.pipelines.output_record import write_output_record
from slamcli.runtime import RunLog

_LONGEST_MARGIN_M = 1e6
_LIMITS = ("changed", "changed_cells", "appeared_cells", "vanished_cells")


@dataclass(frozen=True, slots=True, kw_only=True)
class MapInfo:
    """What a map holds, and how each system reads it."""

    map: MapFile
    readings: Mapping[str, Mapping[str, int]]
    """Cells by system (ros1, nav2) and state (free, occupied, between, unknown)."""
    differing_cells: int
    """Cells that ROS 1 and nav2 read differently."""
    known_bounds_m: tuple[float, float, float, float] | None
    """Min x, min y, max x, max y of the known cells in the map frame; None if there are none."""
    warnings: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the facts as JSON has them."""
        found = self.map
        grid = found.grid
        area = grid.resolution_m**2
        return {
            "map": str(found.path),
            "image": str(found.image),
            "width": grid.width,
            "height": grid.height,
            "resolution_m": grid.resolution_m,
            "size_m": [grid.width * grid.resolution_m, grid.height * grid.resolution_m],
            "origin": list(grid.origin),
            "mode": found.mode,
            "negate": found.negate,
            "occupied_thresh": found.occupied_thresh,
            "free_thresh": found.free_thresh,
            "known_bounds_m": None if self.known_bounds_m is None else list(self.known_bounds_m),
            "cells": {name: dict(counts) for name, counts in self.readings.items()},
            "area_m2": {
                name: {state: count * area for state, count in counts.items()} for name, counts in self.readings.items()
            },
            "differing_cells": self.differing_cells,
            "warnings": list(self.warnings),
        }


def info(path: str | os.PathLike[str]) -> MapInfo:
    """Return what a map holds and how ROS 1 and nav2 each read it.

    Raises
    ------
    FormatError
        If it cannot be read.
    """
    found = read_map(path)
    nav2 = occupancy_from_image(found.picture, found.rule, "nav2")
    readings = {"ros1": _count(found.grid.cells), "nav2": _count(nav2)}
    differing = int((nav2 != found.grid.cells).sum())
    return MapInfo(
        map=found,
        readings=readings,
        differing_cells=differing,
        known_bounds_m=_known_bounds(found.grid),
        warnings=(*found.warnings, *_oddities(found, differing)),
    )


def _count(cells: NDArray[np.int8]) -> dict[str, int]:
    counts = np.bincount(cells.ravel().view(np.uint8), minlength=256)
    free, occupied = int(counts[0]), int(counts[100])
    between = int(counts[1:100].sum())
    return {"free": free, "occupied": occupied, "between": between, "unknown": cells.size - free - occupied - between}


def _known_bounds(grid: OccupancyGrid) -> tuple[float, float, float, float] | None:
    box = known_box(grid)
    if box is None:
        return None
    r0, c0, r1, c1 = box
    corners = grid.cell_to_map([[r - 0.5, c - 0.5] for r in (r0, r1) for c in (c0, c1)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _oddities(found: MapFile, differing: int) -> list[str]:
    grid, said = found.grid, []
    picture = found.picture
    grey = UNKNOWN_GREY if not found.negate else 255 - UNKNOWN_GREY
    at_205 = int((picture.channel_sum == grey * picture.num_channels).sum())
    occupancy_205 = (255 - UNKNOWN_GREY) / 255
    if at_205 and found.mode == "trinary" and found.free_thresh > occupancy_205:
        said.append(
            f"{at_205} pixels have the value 205, which map_saver writes for unknown; free_thresh {found.free_thresh:g} is"
            " above 0.196, so that they are read as free (nav2's map_saver writes 0.25): if they mean unknown, set"
            " free_thresh to 0.196"
        )
    if differing:
        said.append(f"ROS 1 and nav2 read {differing} cells differently (mode {found.mode})")
    if abs(grid.origin[2]) > 1e-9:
        said.append(
            f"the origin has a yaw of {grid.origin[2]:g} rad: costmap_2d and AMCL ignore it, slamcli honours it"
        )
    if not (grid.cells == OccupancyGrid.OCCUPIED).any():
        said.append("no cell is occupied")
    if not (grid.cells == OccupancyGrid.FREE).any():
        said.append("no cell is free")
    return said


def convert(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    mode: Mode | None = None,
    image_format: str | None = None,
    negate: bool = False,
    occupied_thresh: float = 0.65,
    free_thresh: float = 0.196,
    dialect: Dialect = "ros1",
) -> tuple[Path, Path, Path]:
    """Write a map another way and return the paths of its YAML, its picture and the run's record.

    The source is read as `dialect` reads it; `mode` is the source's if left out; `image_format` is pgm, png, bmp, tif or
    webp (pgm if left out, png in scale mode).

    Raises
    ------
    FormatError
        If the source cannot be read.
    UsageError
        If the target cannot be written, or would not read back.
    """
    found = read_map(source, dialect=dialect)
    target = _other_than(found, Path(target))
    image = target.with_suffix(f".{image_format.lower().lstrip('.')}") if image_format else None
    given: dict[str, Any] = {
        "mode": mode or found.mode,
        "negate": negate,
        "occupied_thresh": occupied_thresh,
        "free_thresh": free_thresh,
    }
    written = write_map(target, found.grid, image=image, **given)
    return _recorded("map-tools convert", found, written, given | {"read_as": dialect})


def _other_than(source: MapFile, target: Path) -> Path:
    """Return `target`; UsageError if it is the source, which would be lost."""
    if target.resolve() == source.path.resolve():
        raise UsageError(f"{target}: source and target are the same")
    return target


def _recorded(
    command: str, source: MapFile, written: tuple[Path, Path], parameters: Mapping[str, Any]
) -> tuple[Path, Path, Path]:
    """Write the run's record beside a map; return all that was written."""
    record = write_output_record(
        written,
        command=command,
        inputs=[source.path, source.image],
        parameters=parameters,
        changed={},
        summary={"outputs": [path.name for path in written]},
        log=RunLog(),
    )
    return *written, record


def crop_map(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    bounds: tuple[float, float, float, float] | None = None,
    margin_m: float = 0.0,
) -> tuple[Path, Path, Path]:
    """Write the part of a map within `bounds` (min x, min y, max x, max y; metres), or its known part; return the paths.

    Raises
    ------
    FormatError
        If the source cannot be read.
    UsageError
        If nothing is left, or the target cannot be written.
    """
    found = read_map(source)
    target = _other_than(found, Path(target))
    if not 0 <= margin_m < _LONGEST_MARGIN_M:
        raise UsageError(f"margin {margin_m:g} m: give metres from 0 to {_LONGEST_MARGIN_M:g}")
    if bounds is not None and not (bounds[0] < bounds[2] and bounds[1] < bounds[3]):
        raise UsageError("bounds: write them as MINX,MINY,MAXX,MAXY with MINX < MAXX and MINY < MAXY")
    box = known_box(found.grid) if bounds is None else box_of_bounds(found.grid, bounds)
    if box is None:
        raise UsageError(f"{found.path}: no cell is known: there is nothing to crop to; give --bounds")
    part = crop(found.grid, box, round(margin_m / found.grid.resolution_m))
    written = write_map(target, part, mode=found.mode)
    return _recorded("map-tools crop", found, written, {"bounds": bounds, "margin_m": margin_m})


def compare(first: str | os.PathLike[str], second: str | os.PathLike[str]) -> GridDifference:
    """Return where two saved maps differ.

    Raises
    ------
    FormatError
        If one cannot be read.
    """
    return difference(read_map(first).grid, read_map(second).grid)


def difference_document(found: GridDifference) -> dict[str, Any]:
    """Return a comparison as JSON has it."""
    names = (*STATES, "outside")
    return {
        "changed": found.changed_share,
        "changed_cells": found.num_changed,
        "known_in_both_cells": found.num_known_in_both,
        "appeared_cells": found.num_appeared,
        "vanished_cells": found.num_vanished,
        "cells": {
            state: {names[j]: int(found.counts[i, j]) for j in range(len(names))} for i, state in enumerate(STATES)
        },
    }


def check_limits(found: GridDifference, limits: Mapping[str, float]) -> None:
    """Raise ThresholdError where the comparison exceeds a limit; UsageError for a limit that does not exist."""
    document = difference_document(found)
    failed = []
    for name, limit in limits.items():
        if name not in _LIMITS:
            raise UsageError(f"--max {name}: no such figure; choose one of {', '.join(_LIMITS)}")
        if document[name] > limit:
            failed.append(f"{name} is {document[name]:g}, {document[name] - limit:g} above {limit:g}")
    if failed:
        raise ThresholdError("; ".join(failed))


def draw_difference(found: GridDifference, target: str | os.PathLike[str]) -> Path:
    """Write a PNG of what is known in either map: vermilion is newly occupied, blue newly free, pale green newly known, orange lost."""
    from slamcli.reports import scales
    from slamcli.reports.figures import raster

    target = Path(target)
    if target.suffix.lower() != ".png":
        raise UsageError(f"{target}: the picture of a comparison is a .png")
    free, occupied, unknown, light, pale = (
        (255, 255, 255),
        (26, 27, 30),
        (207, 214, 221),
        (178, 223, 205),
        (243, 217, 160),
    )
    first_row = [free, scales.VERMILION, pale, pale]
    colours = [*first_row, scales.BLUE, occupied, scales.ORANGE, scales.ORANGE, light, scales.GREEN, unknown, unknown]
    image = np.array(colours, dtype=np.uint8)[found.states[::-1]]
    rows, columns = np.nonzero(found.states[::-1] % 4 + found.states[::-1] // 4 < 4)  # not unknown in both
    if len(rows):
        image = image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    grow = max(1, 800 // max(image.shape[:2]))
    with atomic_file(target, "wb") as stream:
        stream.write(raster.png(image.repeat(grow, axis=0).repeat(grow, axis=1)))
    return target
