# SPDX-License-Identifier: MIT
"""What a pixel of a map means: the modes trinary, scale and raw, as ROS 1 and nav2 read them.

Both map servers decide by one number per pixel, so every mode is a table over the sum of the colour channels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.formats.map_images import MapImage
from slamcli.grids import OccupancyGrid

Mode = Literal["trinary", "scale", "raw"]
Dialect = Literal["ros1", "nav2"]
MODES: tuple[Mode, ...] = ("trinary", "scale", "raw")

FREE_GREY, OCCUPIED_GREY, UNKNOWN_GREY = 254, 0, 205
"""What map_saver writes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelRule:
    """How pixels turn into occupancy: the keys of a map YAML that say so."""

    mode: Mode = "trinary"
    negate: bool = False
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196


def occupancy_from_image(image: MapImage, rule: PixelRule, dialect: Dialect = "ros1") -> NDArray[np.int8]:
    """Return int8 (H, W) occupancy, 0 to 100 and -1, lowest y first, of a picture.

    In trinary mode an alpha channel is averaged in with the colours; in scale mode a transparent pixel is unknown.
    ROS 1 calls a pixel transparent if its alpha is 0, nav2 if it is below 255.
    """
    total, num_channels = image.channel_sum, image.num_channels
    if image.alpha is not None and rule.mode == "trinary":
        total, num_channels = total + image.alpha, num_channels + 1
    cells = table(num_channels, rule, dialect)[total]
    if image.alpha is not None and rule.mode == "scale":
        cells[image.alpha < (255 if dialect == "nav2" else 1)] = OccupancyGrid.UNKNOWN
    return np.ascontiguousarray(cells[::-1])


def table(num_channels: int, rule: PixelRule, dialect: Dialect = "ros1") -> NDArray[np.int8]:
    """Return int8 (255 * num_channels + 1,), the occupancy for every sum of `num_channels` channels."""
    average = np.arange(255 * num_channels + 1, dtype=np.float64) / num_channels
    if dialect == "nav2":
        return _table_nav2(average / 255.0, rule)
    if rule.negate:
        average = 255.0 - average
    if rule.mode == "raw":
        return average.astype(np.uint8).view(np.int8)
    occupancy = (255.0 - average) / 255.0
    between = np.full(len(average), -1.0)
    if rule.mode == "scale":
        between = np.trunc(1.0 + 98.0 * _ratio(occupancy, rule))
    return _thresholded(occupancy, between, rule)


def _table_nav2(shade: NDArray[np.float64], rule: PixelRule) -> NDArray[np.int8]:
    if rule.mode == "raw":
        value = np.round(shade * 255.0)
        return np.where(value <= OccupancyGrid.OCCUPIED, value, -1.0).astype(np.int8)
    occupancy = shade if rule.negate else 1.0 - shade
    between = np.full(len(shade), -1.0)
    if rule.mode == "scale":
        between = np.rint(100.0 * _ratio(occupancy, rule))
    return _thresholded(occupancy, between, rule)


def _ratio(occupancy: NDArray[np.float64], rule: PixelRule) -> NDArray[np.float64]:
    span = rule.occupied_thresh - rule.free_thresh
    return np.clip((occupancy - rule.free_thresh) / span, 0.0, 1.0) if span > 0 else np.zeros(len(occupancy))


def _thresholded(occupancy: NDArray[np.float64], between: NDArray[np.float64], rule: PixelRule) -> NDArray[np.int8]:
    value = np.where(occupancy < rule.free_thresh, float(OccupancyGrid.FREE), between)
    return np.where(occupancy > rule.occupied_thresh, float(OccupancyGrid.OCCUPIED), value).astype(np.int8)


def image_from_occupancy(
    cells: NDArray[np.int8], rule: PixelRule, *, occupied_percent: int = 65, free_percent: int = 25
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return grey (H, W) and, in scale mode with unknown cells, alpha (H, W), top row first.

    Trinary is what map_saver writes: 254 up to `free_percent`, 0 from `occupied_percent` on, else 205. Scale takes for
    every occupancy the grey value that `occupancy_from_image` reads back as the nearest to it. Raw writes the value itself, 255 for
    unknown.

    Raises
    ------
    UsageError
        If the picture would not read back as what was written: thresholds that do not fit.
    """
    by_value = np.arange(256, dtype=np.uint8).view(np.int8).astype(np.int64)
    known = (by_value >= 0) & (by_value <= 100)
    if rule.mode == "trinary":
        greys = _trinary_greys(by_value, known, rule, occupied_percent, free_percent)
    elif rule.mode == "scale":
        greys = _scale_greys(by_value, known, rule)
    else:
        greys = np.where(known, by_value, 255).astype(np.uint8)
        greys = 255 - greys if rule.negate else greys
    upright = cells[::-1]
    grey = greys[upright.view(np.uint8)]
    unknown = ~known[upright.view(np.uint8)]
    alpha = np.where(unknown, 0, 255).astype(np.uint8) if rule.mode == "scale" and unknown.any() else None
    return np.ascontiguousarray(grey), alpha


def _trinary_greys(
    by_value: NDArray[np.int64], known: NDArray[np.bool_], rule: PixelRule, occupied_percent: int, free_percent: int
) -> NDArray[np.uint8]:
    greys = np.full(256, UNKNOWN_GREY, dtype=np.uint8)
    greys[known & (by_value >= occupied_percent)] = OCCUPIED_GREY
    greys[known & (by_value <= free_percent)] = FREE_GREY
    if rule.negate:
        greys = 255 - greys
    read = table(1, rule)
    expected = {FREE_GREY: ("free", 0), OCCUPIED_GREY: ("occupied", 100), UNKNOWN_GREY: ("unknown", -1)}
    for grey, (name, value) in expected.items():
        if read[255 - grey if rule.negate else grey] != value:
            raise UsageError(
                f"occupied_thresh {rule.occupied_thresh:g} and free_thresh {rule.free_thresh:g} would not read {name} cells"
                f" (grey {grey}) back as {name}: map_saver's are 0.65 and 0.196"
            )
    return greys


def _scale_greys(by_value: NDArray[np.int64], known: NDArray[np.bool_], rule: PixelRule) -> NDArray[np.uint8]:
    read = table(1, rule).astype(np.int64)
    if not (np.isin(read, 0).any() and np.isin(read, 100).any()):
        raise UsageError(
            f"occupied_thresh {rule.occupied_thresh:g} and free_thresh {rule.free_thresh:g} leave no grey for free or for"
            " occupied cells: map_saver's are 0.65 and 0.196"
        )
    # Among greys that read as the same value the middle one is taken, for it survives rounding best.
    distance = np.abs(read[None, :] - np.clip(by_value, 0, 100)[:, None])
    nearest = distance == distance.min(axis=1, keepdims=True)
    order = np.cumsum(nearest, axis=1)
    greys = np.argmax(order >= (order[:, -1:] + 1) // 2, axis=1).astype(np.uint8)
    return np.where(known, greys, UNKNOWN_GREY).astype(np.uint8)
