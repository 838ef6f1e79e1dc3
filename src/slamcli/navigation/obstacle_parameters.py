# SPDX-License-Identifier: MIT
"""Parameters of costmap_2d's obstacle and voxel layers and of what they sense with."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.parameters import parameter

_NO_TF = "Accepted; poses are known without waiting."


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceParameters:
    """What files say of one sensor of an obstacle layer."""

    topic: str = parameter(
        "", "Accepted; a simulated robot has one scanner, which every source hears.", effective=False
    )
    sensor_frame: str = parameter("", "Accepted; beams begin where the scanner is.", effective=False)
    observation_persistence: float = parameter(
        0.0, "How long a reading is applied anew; 0: until the next one.", unit="s", minimum=0.0, maximum=1e6
    )
    expected_update_rate: float = parameter(
        0.0, "Longest time between readings before the costmap counts as out of date; 0: any.", unit="s", minimum=0.0, maximum=1e6
    )  # fmt: skip
    data_type: str = parameter(
        "PointCloud",
        "Accepted; a simulated robot has a laser scanner, which every source hears.",
        choices=("PointCloud", "PointCloud2", "LaserScan"),
        effective=False,
    )
    min_obstacle_height: float = parameter(
        0.0, "Lower points are not taken at all.", unit="m", minimum=-1000.0, maximum=1000.0
    )
    max_obstacle_height: float = parameter(
        2.0, "Higher points are not taken at all.", unit="m", minimum=-1000.0, maximum=1000.0
    )
    inf_is_valid: bool | None = parameter(
        None,
        "Beams of a LaserScan that meet nothing clear what is before them, up to just below range_max. auto: true (costmap_2d:"
        " false, which leaves obstacles standing that have gone).",
        kind=bool,
    )
    clearing: bool = parameter(False, "Its beams free the cells that they cross.")
    marking: bool = parameter(True, "Its points are obstacles.")
    obstacle_range: float | None = parameter(
        None, "Farther points do not mark. auto: the layer's.", kind=float, unit="m", minimum=0.0, maximum=1e4
    )
    obstacle_min_range: float | None = parameter(
        None, "Nearer points do not mark. auto: the layer's.", kind=float, unit="m", minimum=0.0, maximum=1e4
    )
    raytrace_range: float | None = parameter(
        None, "How far beams clear. auto: the layer's.", kind=float, unit="m", minimum=0.0, maximum=1e4
    )
    raytrace_min_range: float | None = parameter(
        None, "From where on beams clear. auto: the layer's.", kind=float, unit="m", minimum=0.0, maximum=1e4
    )

    def __post_init__(self) -> None:
        if self.min_obstacle_height > self.max_obstacle_height:
            raise ConfigError(
                f"min_obstacle_height={self.min_obstacle_height:g} is above"
                f" max_obstacle_height={self.max_obstacle_height:g}: the source would see nothing"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationSource(SourceParameters):
    """One sensor of an obstacle layer."""

    name: str = "laser_scan"
    """What the layer calls it; `Observation.source` refers to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleParameters:
    """An obstacle layer or a voxel layer."""

    enabled: bool = parameter(True, "Use the layer at all.")
    footprint_clearing_enabled: bool = parameter(True, "The cells under the robot are free.")
    max_obstacle_height: float = parameter(2.0, "Higher points do not mark.", unit="m", minimum=-1000.0, maximum=1000.0)
    min_obstacle_height: float = parameter(
        -1000.0, "Lower points do not mark (nav2; costmap_2d's layer has no such limit).", unit="m", minimum=-1000.0, maximum=1000.0
    )  # fmt: skip
    combination_method: int = parameter(
        1, "How it joins the layers below: 0 overwrites what it knows, 1 takes the greater cost, 99 nothing.", minimum=0, maximum=99
    )  # fmt: skip
    obstacle_range: float = parameter(2.5, "Farther points do not mark.", unit="m", minimum=0.0, maximum=1e4)
    obstacle_min_range: float = parameter(0.0, "Nearer points do not mark (nav2).", unit="m", minimum=0.0, maximum=1e4)
    raytrace_range: float = parameter(3.0, "How far beams clear.", unit="m", minimum=0.0, maximum=1e4)
    raytrace_min_range: float = parameter(0.0, "From where on beams clear (nav2).", unit="m", minimum=0.0, maximum=1e4)
    track_unknown_space: bool | None = parameter(
        None, "Cells that no beam has met are unknown, not free. auto: the costmap's.", kind=bool
    )
    transform_tolerance: float = parameter(0.2, _NO_TF, unit="s", minimum=0.0, effective=False)
    origin_z: float = parameter(
        0.0, "Voxel layer: height of the lowest voxel.", unit="m", minimum=-1000.0, maximum=1000.0
    )
    z_resolution: float = parameter(0.2, "Voxel layer: height of a voxel.", unit="m", minimum=1e-3, maximum=100.0)
    z_voxels: int = parameter(10, "Voxel layer: voxels on each other.", minimum=1, maximum=16)
    unknown_threshold: int = parameter(
        15, "Voxel layer: a column with at most so many unknown voxels (and no more marked than allowed) is known.", minimum=0, maximum=16
    )  # fmt: skip
    mark_threshold: int = parameter(
        0, "Voxel layer: a column with more marked voxels than this is an obstacle.", minimum=0, maximum=16
    )
    publish_voxel_map: bool = parameter(False, "Accepted; nothing is published.", effective=False)

    def __post_init__(self) -> None:
        if self.combination_method not in (0, 1, 99):
            raise ConfigError(f"combination_method={self.combination_method}: choose 0, 1 or 99")

    def obstacle_ranges(self, source: ObservationSource) -> tuple[float, float]:
        """Return least and greatest distance in metres at which points of a source mark."""
        least = self.obstacle_min_range if source.obstacle_min_range is None else source.obstacle_min_range
        return least, self.obstacle_range if source.obstacle_range is None else source.obstacle_range

    def raytrace_ranges(self, source: ObservationSource) -> tuple[float, float]:
        """Return from and up to which distance in metres beams of a source clear."""
        least = self.raytrace_min_range if source.raytrace_min_range is None else source.raytrace_min_range
        return least, self.raytrace_range if source.raytrace_range is None else source.raytrace_range
