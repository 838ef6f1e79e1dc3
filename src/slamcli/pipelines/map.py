# SPDX-License-Identifier: MIT
"""From a recording to a map and a trajectory: the recipe of ``slamcli map``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamcli.errors import CalibrationError, EstimationError, UsageError
from slamcli.formats.pbstream.writing import write_state
from slamcli.mapper import DatabaseChoice, MappingResult, Setup, Tier, find_resuming_tier, find_tier
from slamcli.outputs import atomic_directory, check_directory, check_file
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.camera_request import depth_unit
from slamcli.pipelines.config import NativeConfig, load_native
from slamcli.pipelines.database_input import are_databases, open_databases
from slamcli.pipelines.databases import is_scratch, leave_behind, localising, put_into, remove_running
from slamcli.pipelines.dense import DenseModel, check_dense, dense_model, is_empty, model_of_views
from slamcli.pipelines.feeds import Feed, find_feed
from slamcli.pipelines.map_outputs import RECORDS, RESULT_MCAP, summarise, write_mcap, write_records, write_result
from slamcli.pipelines.map_request import MapRequest
from slamcli.pipelines.run_record import describe_inputs, run_document
from slamcli.pipelines.saved_state import check_dimensions, load_states, result_of
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.posegraph import MapState
from slamcli.recordings import Recording, open_recording
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.vision.vocabulary import Vocabulary

if TYPE_CHECKING:
    from slamcli.pipelines.trajectory_score import TrajectoryScore


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
    EstimationError
        If there is no map, and nothing is written; or if it cannot be scored against the truth, after it is written.
    """
    began = time.perf_counter()
    if not request.inputs and not request.load_states and not request.load_frozen_states and not request.atlas.files:
        raise UsageError("nothing to map: name a recording, or a state with --load-state")
    for option, value in (
        ("--load-state", [*request.load_states, *request.load_frozen_states]),
        ("--save-state", request.save_state),
    ):
        if value:
            find_resuming_tier(request.algo, option)
    tier = find_tier(request.algo)
    request.atlas.check(tier)
    if request.choices.octomap and not tier.remembers:
        raise UsageError("--octomap: octrees are made by systems that keep what their sensors saw (--algo rtabmap)")
    output = request.output or default_output(request.inputs or request.files)
    config = load_native(request.algo, request.config_files, request.sets, log, request.launch_arguments)
    config, localise_only = localising(tier, config, request.atlas.localise_only)
    request.database.check(tier, request.inputs, output, localise_only=localise_only)
    check_directory(output)
    if request.save_state is not None:
        check_file(request.save_state)
    reference = None if request.truth is None else load_trajectory(request.truth, log=log)
    with ThreadPoolExecutor(1) as background:
        digests = background.submit(describe_inputs, request.files) if all(p.exists() for p in request.files) else None
        state = load_states(request.load_states, request.load_frozen_states, log)
        if request.inputs or state is None:
            run = _from_recording(request, config, state, output, log, localise_only=localise_only)
        else:
            run = _from_state(request, config, state, log)
        inputs = digests.result() if digests is not None else []
    result = run.result
    score, unscored = _score(result.trajectory, reference, log)
    with atomic_directory(output) as folder:
        with log.stage("write"):
            written = write_result(folder, result, score=score, choices=request.choices, log=log, dense=run.dense)
            moved = put_into(folder, result, run.database)
        document = run_document(
            command=request.command, algo=request.algo, parameters=as_dict(run.parameters), changed=_changed(config), seed=request.seed,
            jobs=request.jobs, inputs=inputs, topics=run.topics, frames=run.frames, log=log, total_s=time.perf_counter() - began,
            duration_s=run.duration_s, summary=summarise(result, score),
            outputs=(*written.names, *moved, *RECORDS, *((RESULT_MCAP,) if request.choices.mcap else ())),
        )  # fmt: skip
        declared = declarations(type(config.parameters))
        document = write_records(folder, document, result, written, score=score, declared=declared)
        if request.choices.mcap:
            write_mcap(folder, [] if are_databases(request.inputs) else request.inputs, request.mends, request.truth)
    if moved or is_scratch(run.database):
        remove_running(run.database)
    if request.save_state is not None and result.state is not None:
        write_state(request.save_state, result.state)
    request.atlas.write_atlas(result)
    if unscored is not None:
        raise EstimationError(f"--truth {request.truth}: {unscored} (the map is in {output})") from unscored
    return MapOutcome(output=output, result=result, run=document)


def _score(
    estimate: Trajectory, reference: Trajectory | None, log: RunLog
) -> tuple[TrajectoryScore | None, EstimationError | None]:
    """Return the score, or why there is none: a map that took long is written before that is told."""
    if reference is None:
        return None, None
    from slamcli.pipelines.evaluate import score_trajectory  # it takes long to import

    try:
        return score_trajectory(estimate, reference, log=log), None
    except EstimationError as error:
        return None, error


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """A result and what ``run.json`` says of where it is from."""

    result: MappingResult
    parameters: Any
    topics: Mapping[str, Any]
    frames: Mapping[str, Any]
    duration_s: float
    dense: DenseModel | None = None
    database: DatabaseChoice | None = None


def _from_recording(
    request: MapRequest, config: NativeConfig, state: MapState | None, output: Path, log: RunLog, *, localise_only: bool
) -> _Run:
    """Map the recording, from the state on if there is one."""
    tier = find_tier(request.algo)
    with _opened(request, config, tier, log) as feed:
        check_dense(request.choices.of_dense, feed.cameras, remembered=tier.remembers)
        check_dimensions(state, spatial=feed.plan.spatial)
        setup = replace(_setup(request, feed, state, log), localise_only=localise_only)
        database = request.database.begin(output, log, localise_only=localise_only) if tier.remembers else None
        result = _mapped(feed, tier, replace(setup, database=database), log)
        dense = _dense(request, feed, result, log)
    return _Run(
        result=result, parameters=feed.plan.parameters, topics=feed.topics, frames=feed.frames, duration_s=feed.length_s,
        dense=dense, database=database,
    )  # fmt: skip


def _dense(request: MapRequest, feed: Feed, result: MappingResult, log: RunLog) -> DenseModel | None:
    """Return the dense model that is asked for; say why where there is none."""
    choices, frame = request.choices.of_dense, result.trajectory.frame_id
    if request.choices.octomap and result.octree is None:
        log.warn("--octomap: nothing was seen that has a height, so there is no octree")
    if choices.kind == "none":
        return None
    with log.stage("dense"):
        if result.views is not None:
            model: DenseModel = model_of_views(result.views, choices, frame, int(result.trajectory.stamps_ns[0]))
        elif feed.cameras is not None and result.keyframes is not None:
            model = dense_model(feed.cameras, result.keyframes, choices, frame, log)
        else:
            log.warn(f"--dense {choices.kind}: the nodes have no depth images, so there is no dense model")
            return None
    if is_empty(model):
        log.warn(f"--dense {choices.kind}: no depth lies within --dense-range {choices.range_m:g} m")
        return None
    return model


@contextmanager
def _opened(request: MapRequest, config: NativeConfig, tier: Tier, log: RunLog) -> Iterator[Feed]:
    """Open the recording, or the databases that stand for one."""
    if tier.remembers and are_databases(request.inputs):
        with open_databases(request.inputs, tier, config, request.sensors, log) as feed:
            yield feed
        return
    with open_recording(request.inputs, mends=depth_unit(request.mends, config), log=log) as recording:
        _check_frame(request.base_frame, recording)
        yield find_feed(recording, tier, config, request.sensors, log)


def _mapped(feed: Feed, tier: Tier, setup: Setup, log: RunLog) -> MappingResult:
    """Return what the tier makes of the measurements; a database into which nothing went is removed if it fails or is interrupted."""
    try:
        mapper = tier.build(feed.plan.parameters, setup)
        with log.stage("read"):
            for measurement in feed.measurements():
                mapper.process(measurement)
        return mapper.finish()
    except BaseException:
        leave_behind(setup.database, log)
        raise


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
        octree=request.choices.octomap,
        vocabulary=_vocabulary(request, feed, log),
        no_return=request.mends.no_return,
        log=log,
    )


def _vocabulary(request: MapRequest, feed: Feed, log: RunLog) -> Vocabulary | None:
    """Return the words of a tier that has no memory of its own to learn them from."""
    if feed.cameras is None or find_tier(request.algo).remembers:
        return None
    return request.atlas.find_vocabulary(feed.plan.parameters, request.inputs, feed.cameras.main, log)


def _changed(config: NativeConfig) -> dict[str, Any]:
    defaults = {entry.name: entry.default for entry in declarations(type(config.parameters))}
    return {name: value for name, value in as_dict(config.parameters).items() if value != defaults[name]}
