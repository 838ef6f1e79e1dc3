# SPDX-License-Identifier: MIT
"""Scores a map against a reference map: load, lay on each other, measure."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.evaluation.map_errors import MapErrors, WallDistance, map_errors
from slamcli.evaluation.map_layers import MapLayers, map_layers
from slamcli.evaluation.map_registration import MapRegistration, measure_overlap, register
from slamcli.formats.maps import read_map
from slamcli.geometry import se2
from slamcli.grids import OccupancyGrid
from slamcli.runtime import RunLog

PathLike = str | os.PathLike[str]

_TOLERANCE_M = 0.1
_TOLERANCE_CELLS = 2.0
_POOR_OVERLAP = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class MapScore:
    """A map against a reference map."""

    layers: MapLayers
    reference: MapLayers
    registration: MapRegistration
    errors: MapErrors

    @property
    def walls_m(self) -> NDArray[np.float64]:
        """float64 (K, 2), walls of the map in the frame of the reference, metres."""
        return se2.transform_points(self.registration.T_reference_map, self.layers.walls_m)

    def figures(self) -> dict[str, float]:
        """Return every figure that a threshold can be set on, by its key."""
        return {f"map.{key}": value for key, value in self._figures().items()}

    def as_dict(self) -> dict[str, Any]:
        """Return everything as one document."""
        errors, (x, y, yaw) = self.errors, self.registration.T_reference_map.tolist()
        return {
            "kind": "map",
            "registration": {
                "x_m": x,
                "y_m": y,
                "yaw_deg": math.degrees(yaw),
                "overlap": self.registration.overlap,
            },
            "walls": {"map": len(errors.to_reference_m), "reference": len(errors.to_map_m)},
            "map": {
                "tolerance_m": errors.tolerance_m,
                "accuracy": errors.accuracy,
                "completeness": errors.completeness,
                "f_score": errors.f_score,
                "to_reference": asdict(WallDistance.of(errors.to_reference_m)),
                "to_map": asdict(WallDistance.of(errors.to_map_m)),
                "two_way": asdict(_two_way(errors)),
                "agreement": errors.agreement,
                "occupied_iou": errors.occupied_iou,
                "free_iou": errors.free_iou,
                "coverage": errors.coverage,
                "ssim": errors.ssim,
            },
        }

    def _figures(self) -> dict[str, float]:
        errors = self.errors
        found = {
            name: getattr(errors, name)
            for name in (
                "accuracy",
                "completeness",
                "f_score",
                "agreement",
                "occupied_iou",
                "free_iou",
                "coverage",
                "ssim",
            )
        }
        distances = {
            "to_reference": WallDistance.of(errors.to_reference_m),
            "to_map": WallDistance.of(errors.to_map_m),
            "two_way": _two_way(errors),
        }
        for name, figures in distances.items():
            found |= {f"{name}.{key}": value for key, value in asdict(figures).items()}
        return found | {"overlap": self.registration.overlap}


def evaluate_map(
    estimate: PathLike,
    reference: PathLike,
    *,
    registration: Literal["search", "refine", "none"] = "search",
    tolerance_m: float | None = None,
    log: RunLog | None = None,
) -> MapScore:
    """Return the figures of a saved map against a saved reference map.

    Parameters
    ----------
    estimate, reference
        YAML files of maps.
    registration
        ``search`` finds how the map lies on the reference, ``refine`` does so from where they are, ``none`` leaves them.
    tolerance_m
        Distance up to which two walls are the same, metres; None: 0.1 m, or two cells of the coarser map if that is more.
    log
        Takes notes and warnings.

    Raises
    ------
    InputError
        If a map cannot be read, or the estimate is none.
    EstimationError
        If a map has no walls, or nothing of the maps meets.
    """
    log = log or RunLog()
    if Path(estimate).suffix.lower() not in (".yaml", ".yml"):
        raise UsageError(f"{reference} is a map, so {estimate} must be one too (a .yaml); --mode says what else REF is")
    with log.stage("load"):
        grids = [_load(path, log) for path in (estimate, reference)]
    return score_map(
        *grids, registration=registration, tolerance_m=tolerance_m, names=(str(estimate), str(reference)), log=log
    )


def score_map(
    grid: OccupancyGrid,
    reference: OccupancyGrid,
    *,
    registration: Literal["search", "refine", "none"] = "search",
    tolerance_m: float | None = None,
    names: tuple[str, str] = ("the map", "the reference"),
    log: RunLog | None = None,
) -> MapScore:
    """Return the figures of a map against a reference map; see :func:`evaluate_map`."""
    log = log or RunLog()
    layers, ref = map_layers(grid, names[0]), map_layers(reference, names[1])
    if tolerance_m is None:
        tolerance_m = max(_TOLERANCE_M, _TOLERANCE_CELLS * max(grid.resolution_m, reference.resolution_m))
    with log.stage("register"):
        if registration == "none":
            found = measure_overlap(layers, ref, np.zeros(3))
        else:
            found = register(layers, ref, search=registration == "search")
    if found.overlap < _POOR_OVERLAP:
        log.warn(
            f"the maps overlap by {100 * found.overlap:.0f} % only: the map may be broken, of another place, or laid wrongly on"
            " the reference (look at --plot; --map-align refine starts from where they are)"
        )
    with log.stage("measure"):
        errors = map_errors(layers, ref, found.T_reference_map, tolerance_m=tolerance_m)
    return MapScore(layers=layers, reference=ref, registration=found, errors=errors)


def _load(path: PathLike, log: RunLog) -> OccupancyGrid:
    loaded = read_map(path)
    for warning in loaded.warnings:
        log.warn(warning)
    return loaded.grid


def _two_way(errors: MapErrors) -> WallDistance:
    """Return the mean of the figures of both directions (of the maxima the larger one: the Hausdorff distance)."""
    a, b = WallDistance.of(errors.to_reference_m), WallDistance.of(errors.to_map_m)
    return WallDistance(
        mean=(a.mean + b.mean) / 2,
        median=(a.median + b.median) / 2,
        p95=(a.p95 + b.p95) / 2,
        max=max(a.max, b.max),
        rmse=math.sqrt((a.rmse**2 + b.rmse**2) / 2),
    )
