# SPDX-License-Identifier: MIT
"""What ``slamcli map`` is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from slamcli.pipelines.databases import DatabaseRequest
from slamcli.pipelines.map_outputs import OutputChoices
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.pipelines.visual_places import AtlasChoices
from slamcli.recordings import Mends
from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.sensor_picks import TopicNames


@dataclass(frozen=True, slots=True, kw_only=True)
class MapRequest:
    """What to map, and how; None means "found from the recording"."""

    algo: str
    inputs: Sequence[Path]
    output: Path | None = None
    """Folder for the result; default: the recording's name with ``-maps`` beside the recording."""
    config_files: Sequence[Path] = ()
    sets: Sequence[str] = ()
    """``KEY=VALUE`` with native keys."""
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    scan_topics: Sequence[str] = ()
    points_topics: Sequence[str] = ()
    odom_topic: str | None = None
    """A topic, ``tf`` or ``none``."""
    imu_topic: str | None = None
    """A topic or ``none``, as of the next two."""
    fix_topic: str | None = None
    landmark_topic: str | None = None
    mode: str | None = None
    """One of the tier's modes: ``2d`` or ``3d`` of cartographer, ``mono`` to ``rgbd-inertial`` of orbslam3."""
    cameras: CameraNames = field(default_factory=CameraNames)
    """Image topics, for tiers that see."""
    camera_files: Sequence[Path] = ()
    """Calibration files of the cameras (``--camera``); later wins."""
    base_frame: str | None = None
    odom_frame: str | None = None
    map_frame: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
    seed: int = 0
    jobs: int = 1
    choices: OutputChoices = field(default_factory=OutputChoices)
    truth: str | None = None
    """True trajectory to score against: a file, or a topic of a recording."""
    mends: Mends = field(default_factory=Mends)
    load_states: Sequence[Path] = ()
    """Saved states to go on from; without a recording, what to draw."""
    load_frozen_states: Sequence[Path] = ()
    """Saved states that must not change: to localise in."""
    save_state: Path | None = None
    """Where else the state goes; it always lies in the folder, as ``state.pbstream``."""
    atlas: AtlasChoices = field(default_factory=AtlasChoices)
    """Maps to go on from and words to know places by, for tiers that see."""
    database: DatabaseRequest = field(default_factory=DatabaseRequest)
    """Long-term memory of tiers that keep one."""
    command: str = ""
    """The command line that asks for this, for ``run.json``."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that is read and not changed: the recording, the states, the atlas, the database to localise in."""
        database = (self.database.file,) if self.database.file is not None and self.atlas.localise_only else ()
        return (*self.inputs, *self.load_states, *self.load_frozen_states, *self.atlas.files, *database)

    @property
    def sensors(self) -> SensorRequest:
        """Which sensors are asked for."""
        names = TopicNames(
            scans=tuple(self.scan_topics), points=tuple(self.points_topics), odometry=self.odom_topic,
            imu=self.imu_topic, fixes=self.fix_topic, landmarks=self.landmark_topic, base_frame=self.base_frame,
            odom_frame=self.odom_frame,
        )  # fmt: skip
        return SensorRequest(
            names=names, cameras=self.cameras, camera_files=self.camera_files, mode=self.mode,
            start_s=self.start_s, duration_s=self.duration_s,
        )  # fmt: skip
