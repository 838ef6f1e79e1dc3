# SPDX-License-Identifier: MIT
"""``SLAMCLI_3D``: what slamcli does in space that Cartographer does not."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.cartographer.parameters.tables import angle, count, length
from slamcli.parameters import parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Extensions3d:
    """``SLAMCLI_3D``."""

    scan_matcher: str = parameter(
        "surfel",
        "what scans are matched with: surfel, planes of a map that moves along, or grid, the submap's grids as in Cartographer",
        choices=("surfel", "grid"),
        extension=True,
    )
    surfel_size: float = length(0.4, "smallest voxel of the map of planes", 0.01, extension=True)
    surfel_levels: int = parameter(
        3, "sizes of voxels, each twice the one before", unit="levels", minimum=1, maximum=4, extension=True
    )
    surfel_capacity: int = parameter(
        100, "points that a voxel takes before its plane is left as it is", minimum=6, maximum=10000, extension=True
    )
    matched_points: int = count(2000, "points of a scan that are matched, about", 10, extension=True)
    point_noise: float = length(0.02, "standard deviation of a point's distance from its plane", 1e-4, extension=True)
    prior_translation: float = length(
        0.5, "standard deviation of the predicted position, where planes leave it open", 1e-4, extension=True
    )
    prior_rotation: float = angle(
        0.1, "standard deviation of the predicted orientation, where planes leave it open", extension=True
    )
    search_spacing: float = length(
        1.0,
        "loops are searched from nodes this far apart along the path; 0: from all, as sampling_ratio says",
        extension=True,
    )
    search_rounds: int = parameter(
        3, "at the end: search all pairs, optimise, search again until nothing is added, at most so often; 0: no global SLAM, the path is that of local SLAM",
        unit="rounds", minimum=0, maximum=100, extension=True,
    )  # fmt: skip
    refine_loops: bool = parameter(True, "align what a loop search found with planes as well", extension=True)
    projection_min_z: float = parameter(
        0.15, "lower edge of the height band that makes the 2D map, above the ground", unit="m", minimum=-1e4, maximum=1e4,
        extension=True,
    )  # fmt: skip
    projection_max_z: float = parameter(
        2.0, "upper edge of the height band that makes the 2D map, above the ground", unit="m", minimum=-1e4, maximum=1e4,
        extension=True,
    )  # fmt: skip
    projection_resolution: float = length(0.05, "edge of a cell of the 2D map", 1e-3, extension=True)
    projection_max_range: float = length(30.0, "points farther away do not enter the 2D map", 0.1, extension=True)
    cloud_voxel_size: float = length(
        0.1, "the mapped cloud keeps one point per voxel of this edge", 1e-3, extension=True
    )
