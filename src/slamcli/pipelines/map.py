# SPDX-License-Identifier: MIT
"""From a recording to a map and a trajectory: the recipe of ``slamcli map``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slamcli.errors import CalibrationError
from slamcli.formats.map_modes import Mode
from slamcli.mapper import MappingResult, Setup, find_tier
from slamcli.outputs import atomic_directory, check_directory
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.config import NativeConfig, load_native
from slamcli.pipelines.evaluate import score_trajectory
from slamcli.pipelines.map_outputs import RECORDS, summarise, write_records, write_result
from slamcli.pipelines.range_input import SensorFeed, feed_sensors
from slamcli.pipelines.run_record import describe_inputs, run_document
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.recordings import Mends, Recording, open_recording
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog


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
    """One of the tier's modes: ``2d`` or ``3d`` of cartographer."""
    base_frame: str | None = None
    odom_frame: str | None = None
    map_frame: str | None = None
    start_s: float | None = None
    duration_s: float | None = None
    seed: int = 0
    jobs: int = 1
    map_mode: Mode = "trinary"
    truth: str | None = None
    """True trajectory to score against: a file, or a topic of a recording."""
    mends: Mends = field(default_factory=Mends)
    command: str = ""
    """The command line that asks for this, for ``run.json``."""


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
    config = load_native(request.algo, request.config_files, request.sets, log, request.launch_arguments)
    output = request.output or default_output(request.inputs)
    check_directory(output)
    reference = None if request.truth is None else load_trajectory(request.truth, log=log)
    with ThreadPoolExecutor(1) as background:
        digests = (
            background.submit(describe_inputs, request.inputs) if all(p.exists() for p in request.inputs) else None
        )
        with open_recording(request.inputs, mends=request.mends, log=log) as recording:
            _check_frame(request.base_frame, recording)
            tier = find_tier(request.algo)
            feed = feed_sensors(
                recording, tier, config.parameters, config.sources, _names(request, config), log,
                mode=request.mode, start_s=request.start_s, duration_s=request.duration_s,
            )  # fmt: skip
            mapper = tier.build(feed.plan.parameters, _setup(request, feed, log))
            with log.stage("read"):
                for measurement in feed.measurements():
                    mapper.process(measurement)
            duration_s = feed.length_s
        result = mapper.finish()
        inputs = digests.result() if digests is not None else []
    score = None if reference is None else score_trajectory(result.trajectory, reference, log=log)
    with atomic_directory(output) as folder:
        with log.stage("write"):
            written = write_result(folder, result, score=score, map_mode=request.map_mode, log=log)
        run = run_document(
            command=request.command, algo=request.algo, parameters=as_dict(feed.plan.parameters), changed=_changed(config), seed=request.seed,
            jobs=request.jobs, inputs=inputs, topics=feed.topics, frames=feed.frames, log=log, total_s=time.perf_counter() - began,
            duration_s=duration_s, summary=summarise(result, score), outputs=(*written.names, *RECORDS),
        )  # fmt: skip
        run = write_records(folder, run, result, written, score=score, declared=declarations(type(config.parameters)))
    return MapOutcome(output=output, result=result, run=run)


def default_output(inputs: Sequence[Path]) -> Path:
    """Return the folder beside the recording that bears its name and ``-maps``."""
    first = inputs[0]
    name = first.name
    for suffix in (".gz", *first.suffixes[::-1]):
        name = name.removesuffix(suffix)
    return first.parent / f"{name}-maps"


def _names(request: MapRequest, config: NativeConfig) -> TopicNames:
    """Return the topics and frames that the user names: flags before native files."""
    scans = request.scan_topics or (() if config.scan_topic is None else (config.scan_topic,))
    return TopicNames(
        scans=tuple(scans),
        points=tuple(request.points_topics),
        odometry=request.odom_topic,
        imu=request.imu_topic,
        fixes=request.fix_topic,
        landmarks=request.landmark_topic,
        base_frame=request.base_frame,
        odom_frame=request.odom_frame,
    )


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


def _setup(request: MapRequest, feed: SensorFeed, log: RunLog) -> Setup:
    return Setup(
        T_base_laser=feed.T_base_laser,
        T_base_sensor=feed.T_base_sensor,
        map_frame=request.map_frame or feed.plan.map_frame,
        base_frame=feed.base_frame,
        seed=request.seed,
        jobs=request.jobs,
        no_return=request.mends.no_return,
        log=log,
    )


def _changed(config: NativeConfig) -> dict[str, Any]:
    defaults = {entry.name: entry.default for entry in declarations(type(config.parameters))}
    return {name: value for name, value in as_dict(config.parameters).items() if value != defaults[name]}
