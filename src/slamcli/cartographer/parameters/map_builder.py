# SPDX-License-Identifier: MIT
"""``MAP_BUILDER`` and what ``TRAJECTORY_BUILDER`` holds besides the 2D and 3D builders."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.cartographer.parameters.tables import count
from slamcli.errors import ConfigError
from slamcli.parameters import group, parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class MapBuilder:
    """``MAP_BUILDER``."""

    use_trajectory_builder_2d: bool = parameter(
        None, "map in 2D; auto: unless 3D is asked for, or the recording has point clouds and no scans", kind=bool
    )
    use_trajectory_builder_3d: bool = parameter(
        None, "map in 3D; auto: unless 2D is asked for, if the recording has point clouds and no scans", kind=bool
    )
    num_background_threads: int = count(
        4, "threads of the loop search; here --jobs says how many run", 1, effective=False
    )
    collate_by_trajectory: bool = parameter(
        False,
        "wait for late sensors within one trajectory only; here all data is there from the start",
        effective=False,
    )

    def __post_init__(self) -> None:
        if self.use_trajectory_builder_2d and self.use_trajectory_builder_3d:
            raise ConfigError("MAP_BUILDER: use_trajectory_builder_2d and use_trajectory_builder_3d: set one of them")

    @property
    def dimensions(self) -> int | None:
        """2 or 3 as the configuration says; None where it leaves that to the recording."""
        if self.use_trajectory_builder_2d:
            return 2
        return 3 if self.use_trajectory_builder_3d else None


@dataclass(frozen=True, slots=True, kw_only=True)
class PureLocalizationTrimmer:
    """Keeps only the newest submaps of a trajectory: localisation in a loaded map."""

    max_submaps_to_keep: int = count(
        None,
        "newest submaps of this trajectory that are kept; auto: all (with a value the trimmer is on; typical: 3)",
        2,
    )

    @property
    def is_on(self) -> bool:
        """Whether the table was given."""
        return self.max_submaps_to_keep is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryBuilder:
    """``TRAJECTORY_BUILDER`` without the 2D and 3D builders."""

    pure_localization_trimmer: PureLocalizationTrimmer = group(PureLocalizationTrimmer())
    collate_fixed_frame: bool = parameter(
        True, "wait for GPS fixes that come late; here all data is there from the start", effective=False
    )
    collate_landmarks: bool = parameter(
        False, "wait for landmarks that come late; here all data is there from the start", effective=False
    )
