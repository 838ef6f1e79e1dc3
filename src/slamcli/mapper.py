# SPDX-License-Identifier: MIT
"""What every tier takes and gives: the `Mapper` protocol and its `MappingResult`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import UsageError
from slamcli.grids import OccupancyGrid
from slamcli.grids.octree import Octree
from slamcli.measurements import CameraRig, Measurement, PointCloud
from slamcli.posegraph import LoopSearch, MapState
from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.posegraph.place_closure import PlaceClosure
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.particle_track import ParticleTrack
from slamcli.vision.pictures import KeyframeView, PlaceView
from slamcli.vision.posed_view import DepthViews
from slamcli.vision.visual_atlas import VisualAtlas
from slamcli.vision.vocabulary import Vocabulary


@dataclass(frozen=True, slots=True, kw_only=True)
class MappingResult:
    """What a tier ends with."""

    trajectory: Trajectory
    """One pose of the base frame in the map for every scan or frame that was given, in their order."""
    grid: OccupancyGrid | None = None
    steps: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """Per-step statistics: columns of equal length, with ``stamp_ns`` among them."""
    summary: Mapping[str, Any] = field(default_factory=dict)
    """Figures for ``run.json``: counts and what was found."""
    keyframes: Trajectory | None = None
    """Poses of the nodes of the graph, where there is one."""
    state: MapState | None = None
    """Submaps, nodes and constraints, from which mapping can go on; graph-based tiers have one."""
    loop_searches: tuple[LoopSearch, ...] = ()
    """Searches for loop closures that found a candidate, accepted or not, in the order in which they were made."""
    cloud: PointCloud | None = None
    """The mapped points in the map frame (3D)."""
    keyframe_graph: KeyframeGraph | None = None
    """What ties the `keyframes` of a tier that sees, in their order."""
    keyframe_views: tuple[KeyframeView, ...] = ()
    """Some of them as pictures, for the report."""
    place_views: tuple[PlaceView, ...] = ()
    """Both sides of loops that were closed."""
    atlas: VisualAtlas | None = None
    """All maps of a tier that sees, from which mapping can go on."""
    octree: Octree | None = None
    """What is free and what is occupied in space."""
    views: DepthViews | None = None
    """What the cameras saw at the nodes, for dense models; None: the recording is read again."""
    closures: tuple[PlaceClosure, ...] = ()
    """Closures that a tier with a memory of places tried, accepted or not, in their order."""
    database: Path | None = None
    """The long-term memory of a tier that keeps one (`Setup.database`), closed."""
    particles: ParticleTrack | None = None
    """Where the particles of a filter were over time."""


class Mapper(Protocol):
    """A SLAM system: measurements in, one result out."""

    def process(self, measurement: Measurement) -> None:
        """Take the next measurement; scans or frames in the order in which they were recorded."""

    def finish(self) -> MappingResult:
        """End the run and return its result; the mapper is of no use afterwards."""


class LiveMapper(Mapper, Protocol):
    """A SLAM system that says after each measurement where the robot is and what the map is, knowing nothing that comes later.

    A scan is placed by the odometry that came before it: give odometry up to a scan's stamp before the scan. `finish` may
    adjust everything once more, as the tier does with a whole recording.
    """

    @property
    def T_map_odom(self) -> NDArray[np.float64]:  # noqa: N802 - frames as everywhere
        """float64 (3,), x, y, yaw: the correction after the newest scan, ``T_map_base(now) = T_map_odom @ T_odom_base(now)``.

        The identity before the first scan. It jumps where the map is adjusted.
        """

    def grid(self) -> OccupancyGrid:
        """Return the map so far; what changed since the last call is drawn, so that it can be asked for once a second.

        Raises
        ------
        EstimationError
            If nothing was seen yet.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class DatabaseChoice:
    """Where the long-term memory of a tier that keeps one lies while the mapper runs."""

    path: Path
    """In a folder that can be written to."""
    append: bool = False
    """Whether the file is there, and its map is gone on from; otherwise there is no such file yet."""
    keep: bool = False
    """Whether the user named it, and it stays where it is; otherwise it ends in the folder of the result, or, if it is a copy to
    localise in (`append`), nowhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """What a mapper is built with besides its parameters."""

    T_base_laser: Mapping[str, NDArray[np.float64]]
    """Mount of each range sensor (laser, point cloud) by topic: float64 (4, 4)."""
    T_base_sensor: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Mount of each other sensor (IMU, fixed-frame pose, landmark detector) by topic: float64 (4, 4)."""
    rig: CameraRig | None = None
    """The cameras, for tiers that see."""
    map_frame: str = "map"
    base_frame: str = "base_link"
    seed: int = 0
    jobs: int = 1
    state: MapState | None = None
    """Where mapping goes on from (``--load-state``); None for a new map."""
    atlas: VisualAtlas | None = None
    """The same for tiers that see (``--load-atlas``)."""
    localise_only: bool = False
    """Whether the maps of `atlas` or `database` stay as they are, and no others are begun."""
    database: DatabaseChoice | None = None
    """The long-term memory, for tiers that keep one (`Tier.remembers`)."""
    vocabulary: Vocabulary | None = None
    """By which tiers that see know places again; None: by descriptors alone."""
    octree: bool = False
    """Whether an octree is asked for, of tiers that can make one."""
    no_return: str = "ignore"
    """What an inf or maximum-range beam means: ignore, free (clears up to the usable range) or max (an end point)."""
    log: RunLog = field(default_factory=RunLog)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorOffer:
    """What a recording holds for a tier to use, of the roles that it has; where the user named topics of a kind, only those."""

    num_laser_scans: int
    num_multi_echo_laser_scans: int = 0
    num_point_clouds: int = 0
    flat_clouds: bool = False
    """Whether clouds are all there is, and those of a planar scanner."""
    odometry: bool = False
    imu: bool = False
    fixes: bool = False
    landmarks: bool = False
    named: frozenset[str] = frozenset()
    """Roles (see `Tier.roles`; ``images`` for any camera topic) whose topics the user named: they are used whatever a configuration says."""
    mode: str | None = None
    """The mode (see `Tier.modes`) that the user asks for."""
    cameras: frozenset[str] = frozenset()
    """How the recording's images can be used: of ``mono``, ``stereo`` and ``rgbd``."""
    imu_placed: bool = False
    """Whether the IMU's place at the camera is known."""
    imu_calibrated: bool = False
    """Whether that and its noise are known."""

    @property
    def spatial(self) -> bool:
        """Whether the range sensors are such that a map in three dimensions is to be expected: clouds of depth alone."""
        return self.num_point_clouds > 0 and not (
            self.flat_clouds or self.num_laser_scans or self.num_multi_echo_laser_scans
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class InputPlan:
    """Which sensors a tier takes from a recording, and its parameters for them."""

    parameters: Any
    num_laser_scans: int = 1
    num_multi_echo_laser_scans: int | None = None
    """None: scanners of several echoes count as laser scans."""
    num_point_clouds: int = 0
    spatial: bool = False
    """Whether the map has three dimensions: then a tilted scanner is no mistake, and odometry is not flattened."""
    keep_scans: bool = False
    """Whether scans stay scans in a map of three dimensions; otherwise they become clouds there."""
    clouds_as_scans: bool = False
    """Whether clouds are those of a planar scanner, and come as scans."""
    samples_first: bool = False
    """Whether odometry and IMU samples up to the end of each scan or cloud, and the first one after it, come before it;
    otherwise all come as they were recorded. Where there are images they always do."""
    odometry: bool = True
    imu: bool = False
    fixes: bool = False
    landmarks: bool = False
    base_frame: str | None = None
    """The frame that the configuration calls the robot's; None: found from the recording."""
    odom_frame: str | None = None
    """The frame that it calls the odometry's."""
    map_frame: str = "map"
    camera_mode: str | None = None
    """How images are used: ``mono``, ``stereo`` or ``rgbd``; None for a tier that does not see."""
    ratios: Mapping[str, float] = field(default_factory=dict)
    """Which share of the messages is used, by role; scans and clouds together are ``ranges``."""


class Tier(Protocol):
    """What an entry point of the group ``slamcli.mappers`` names."""

    name: str
    parameters: type
    """Parameter dataclass; see `slamcli.parameters`."""
    roles: frozenset[str]
    """What it can use: of ``scans``, ``points``, ``odometry``, ``imu``, ``fixes``, ``landmarks`` and ``images``."""
    modes: tuple[str, ...]
    """Ways in which it can run that the user can choose between (``--mode``)."""
    resumes: bool
    """Whether it goes on from a saved state (`Setup.state`) and ends with one."""
    remembers: bool
    """Whether it keeps its map in a database (`Setup.database`), and takes such databases as recordings."""

    def plan(self, parameters: Any, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
        """Return which sensors to take of those that are offered; `given` are the parameters that the user set, by native name."""

    def build(self, parameters: Any, setup: Setup) -> Mapper:
        """Return a mapper."""


class LiveTier(Tier, Protocol):
    """A tier that also maps as it goes."""

    def build_live(self, parameters: Any, setup: Setup) -> LiveMapper:
        """Return a mapper that answers after each scan; `parameters` are those of the tier's `plan`.

        Raises
        ------
        UsageError
            If the parameters ask for what cannot be done as it goes.
        """


class StateDrawing(NamedTuple):
    """What can be seen in a state."""

    grid: OccupancyGrid
    cloud: PointCloud | None = None
    """In the map frame (3D)."""


class ResumingTier(Tier, Protocol):
    """A tier that ends with a state and goes on from one (`Tier.resumes`)."""

    def draw(self, parameters: Any, state: MapState, map_frame: str) -> StateDrawing:
        """Return the map and the points that are in a state, as it is: nothing is searched or optimised.

        Raises
        ------
        EstimationError
            If there is nothing to draw in it.
        """


def find_tier(name: str) -> Tier:
    """Return the tier of that name from the installed entry points.

    Raises
    ------
    UsageError
        If no such tier is installed.
    """
    from importlib.metadata import entry_points

    found = {point.name: point for point in entry_points(group="slamcli.mappers")}
    if name not in found:
        raise UsageError(f"no SLAM system {name!r}: installed are {', '.join(sorted(found)) or 'none'}")
    tier: Tier = found[name].load()
    return tier


def find_resuming_tier(name: str, option: str) -> ResumingTier:
    """Return the tier of that name; `option` is what a tier without states cannot do, for the message.

    Raises
    ------
    UsageError
        If no such tier is installed, or it has no states.
    """
    tier = find_tier(name)
    if not tier.resumes:
        raise UsageError(f"{option}: {name} has no state that can be saved; --algo cartographer has")
    return cast(ResumingTier, tier)


def find_live_tier(name: str) -> LiveTier:
    """Return the tier of that name if it maps as it goes.

    Raises
    ------
    UsageError
        If no such tier is installed, or it needs the whole recording first.
    """
    tier = find_tier(name)
    if not hasattr(tier, "build_live"):
        raise UsageError(f"--slam {name}: this tier does not map as it goes; gmapping and cartographer do")
    return cast(LiveTier, tier)
