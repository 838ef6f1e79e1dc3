# SPDX-License-Identifier: MIT
"""From a recording to a map and a trajectory: the recipe of ``slamcli map``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import CalibrationError, UsageError
from slamcli.formats.pbstream.writing import write_state
from slamcli.grids.depth_mesh import Mesh
from slamcli.mapper import MappingResult, Setup, find_resuming_tier, find_tier
from slamcli.measurements import PointCloud
from slamcli.outputs import atomic_directory, check_directory, check_file
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.camera_request import depth_unit
from slamcli.pipelines.config import NativeConfig, load_native
from slamcli.pipelines.dense import check_dense, dense_model
from slamcli.pipelines.evaluate import score_trajectory
from slamcli.pipelines.feeds import Feed, SensorRequest, find_feed
from slamcli.pipelines.map_outputs import RECORDS, OutputChoices, summarise, write_records, write_result
from slamcli.pipelines.run_record import describe_inputs, run_document
from slamcli.pipelines.saved_state import check_dimensions, load_states, result_of
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.visual_places import AtlasChoices
from slamcli.posegraph import MapState
from slamcli.recordings import Mends, Recording, open_recording
from slamcli.recordings.camera_topics import CameraNames
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog
from slamcli.vision.vocabulary import Vocabulary


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
    command: str = ""
    """The command line that asks for this, for ``run.json``."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Everything that is read: the recording, the states, the atlas."""
        return (*self.inputs, *self.load_states, *self.load_frozen_states, *self.atlas.files)


@dataclass(frozen=True, slots=True, kw_only=True)
class MapOutcome:
    """What came of it."""

    output: Path
    result: MappingResult
    run: Mapping[str, Any]
    """The ``run.json`` document."""


def run_map(request: MapRequest, log: RunLog) -> MapOutcome:
    """Build a map and write it into a folder that appears whole or not at all.

    Raises
    ------
    InputError
        If the recording, a parameter or an option is wrong; nothing is written then.
    """
    began = time.perf_counter()
    if not request.files:
        raise UsageError("nothing to map: name a recording, or a state with --load-state")
    for option, value in (
        ("--load-state", [*request.load_states, *request.load_frozen_states]),
        ("--save-state", request.save_state),
    ):
        if value:
            find_resuming_tier(request.algo, option)
    request.atlas.check(find_tier(request.algo))
    config = load_native(request.algo, request.config_files, request.sets, log, request.launch_arguments)
    output = request.output or default_output(request.files)
    check_directory(output)
    if request.save_state is not None:
        check_file(request.save_state)
    reference = None if request.truth is None else load_trajectory(request.truth, log=log)
    with ThreadPoolExecutor(1) as background:
        digests = background.submit(describe_inputs, request.files) if all(p.exists() for p in request.files) else None
        state = load_states(request.load_states, request.load_frozen_states, log)
        if request.inputs or state is None:
            run = _from_recording(request, config, state, log)
        else:
            run = _from_state(request, config, state, log)
        inputs = digests.result() if digests is not None else []
    result = run.result
    score = None if reference is None else score_trajectory(result.trajectory, reference, log=log)
    with atomic_directory(output) as folder:
        with log.stage("write"):
            written = write_result(folder, result, score=score, choices=request.choices, log=log, dense=run.dense)
        document = run_document(
            command=request.command, algo=request.algo, parameters=as_dict(run.parameters), changed=_changed(config), seed=request.seed,
            jobs=request.jobs, inputs=inputs, topics=run.topics, frames=run.frames, log=log, total_s=time.perf_counter() - began,
            duration_s=run.duration_s, summary=summarise(result, score), outputs=(*written.names, *RECORDS),
        )  # fmt: skip
        declared = declarations(type(config.parameters))
        document = write_records(folder, document, result, written, score=score, declared=declared)
    if request.save_state is not None and result.state is not None:
        write_state(request.save_state, result.state)
    request.atlas.write_atlas(result)
    return MapOutcome(output=output, result=result, run=document)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """A result and what ``run.json`` says of where it is from."""

    result: MappingResult
    parameters: Any
    topics: Mapping[str, Any]
    frames: Mapping[str, Any]
    duration_s: float
    dense: PointCloud | Mesh | None = None


def _from_recording(request: MapRequest, config: NativeConfig, state: MapState | None, log: RunLog) -> _Run:
    """Map the recording, from the state on if there is one."""
    tier = find_tier(request.algo)
    with open_recording(request.inputs, mends=depth_unit(request.mends, config), log=log) as recording:
        _check_frame(request.base_frame, recording)
        feed = find_feed(recording, tier, config, _asked(request), log)
        check_dense(request.choices.of_dense, feed.cameras)
        check_dimensions(state, spatial=feed.plan.spatial)
        mapper = tier.build(feed.plan.parameters, _setup(request, feed, state, log))
        with log.stage("read"):
            for measurement in feed.measurements():
                mapper.process(measurement)
        duration_s = feed.length_s
        result = mapper.finish()
        dense = None
        if feed.cameras is not None and request.choices.dense != "none" and result.keyframes is not None:
            with log.stage("dense"):
                dense = dense_model(
                    feed.cameras, result.keyframes, request.choices.of_dense, result.trajectory.frame_id, log
                )
    return _Run(
        result=result, parameters=feed.plan.parameters, topics=feed.topics, frames=feed.frames, duration_s=duration_s,
        dense=dense,
    )  # fmt: skip


def _from_state(request: MapRequest, config: NativeConfig, state: MapState, log: RunLog) -> _Run:
    """Take map and trajectory out of the state; there is no recording.

    Raises
    ------
    UsageError
        If an option is about a recording.
    """
    of_recordings = {
        "--start": request.start_s, "--duration": request.duration_s, "--mode": request.mode,
        "--scan-topic": request.scan_topics or None, "--points-topic": request.points_topics or None,
        "--dense": request.choices.dense if request.choices.dense != "none" else None,
        "--odom-topic": request.odom_topic, "--imu-topic": request.imu_topic, "--fix-topic": request.fix_topic,
        "--landmark-topic": request.landmark_topic, "--camera": request.camera_files or None, **request.cameras.named(),
    }  # fmt: skip
    for option, value in of_recordings.items():
        if value is not None:
            raise UsageError(f"{option} is for a recording, and none was named")
    frames = {"map": request.map_frame or "map", "base": request.base_frame or "base_link"}
    result = result_of(
        state, request.algo, config.parameters, map_frame=frames["map"], base_frame=frames["base"], log=log
    )
    stamps = result.trajectory.stamps_ns
    return _Run(
        result=result, parameters=config.parameters, topics={}, frames=frames,
        duration_s=float(stamps.max() - stamps.min()) / 1e9,
    )  # fmt: skip


def default_output(inputs: Sequence[Path]) -> Path:
    """Return the folder beside the recording that bears its name and ``-maps``."""
    first = inputs[0]
    name = first.name
    for suffix in (".gz", *first.suffixes[::-1]):
        name = name.removesuffix(suffix)
    return first.parent / f"{name}-maps"


def _check_frame(name: str | None, recording: Recording) -> None:
    """Refuse a base frame that the user named and the recording's transforms do not know.

    Raises
    ------
    CalibrationError
        If there are transforms, and none of that frame.
    """
    known = recording.frames().frames if name is not None else ()
    if known and name not in known:
        raise CalibrationError(f"--base-frame {name}: {recording.name} has no such frame; it has {', '.join(known)}")


def _setup(request: MapRequest, feed: Feed, state: MapState | None, log: RunLog) -> Setup:
    return Setup(
        T_base_laser=feed.T_base_laser,
        T_base_sensor=feed.T_base_sensor,
        rig=feed.rig,
        map_frame=request.map_frame or feed.plan.map_frame,
        base_frame=feed.base_frame,
        seed=request.seed,
        jobs=request.jobs,
        state=state,
        atlas=request.atlas.read_atlas(log),
        localise_only=request.atlas.localise_only,
        vocabulary=_vocabulary(request, feed, log),
        no_return=request.mends.no_return,
        log=log,
    )


def _asked(request: MapRequest) -> SensorRequest:
    names = TopicNames(
        scans=tuple(request.scan_topics), points=tuple(request.points_topics), odometry=request.odom_topic,
        imu=request.imu_topic, fixes=request.fix_topic, landmarks=request.landmark_topic, base_frame=request.base_frame,
        odom_frame=request.odom_frame,
    )  # fmt: skip
    return SensorRequest(
        names=names, cameras=request.cameras, camera_files=request.camera_files, mode=request.mode,
        start_s=request.start_s, duration_s=request.duration_s,
    )  # fmt: skip


def _vocabulary(request: MapRequest, feed: Feed, log: RunLog) -> Vocabulary | None:
    """Return the words of a tier that has no memory of its own to learn them from."""
    if feed.cameras is None or find_tier(request.algo).remembers:
        return None
    return request.atlas.find_vocabulary(feed.plan.parameters, request.inputs, feed.cameras.main, log)


def _changed(config: NativeConfig) -> dict[str, Any]:
    defaults = {entry.name: entry.default for entry in declarations(type(config.parameters))}
    return {name: value for name, value in as_dict(config.parameters).items() if value != defaults[name]}
