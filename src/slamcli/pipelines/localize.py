# SPDX-License-Identifier: MIT
"""Where a robot was on a known map while a recording was made: the recipe of ``slamcli localize``."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError, UsageError
from slamcli.evaluation import AlignMode
from slamcli.formats.maps import MapFile, read_map
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.localization.likelihood_field import OCCUPIED_FROM
from slamcli.localization.recorded import AmclInput
from slamcli.mapper import MappingResult, Setup
from slamcli.outputs import atomic_directory, check_directory
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.config import NativeConfig, load_declared
from slamcli.pipelines.evaluate import ErrorOptions, score_trajectory
from slamcli.pipelines.feeds import remapped_names
from slamcli.pipelines.localize_outputs import RECORDS, after_convergence, write_localization, write_records
from slamcli.pipelines.range_input import SensorFeed, feed_sensors
from slamcli.pipelines.run_record import describe_inputs, run_document
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.trajectory_score import TrajectoryScore
from slamcli.recordings import Mends, open_recording
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog

ALGO = "amcl"


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizeRequest:
    """What to localise in what, and how; None means "found from the recording"."""

    inputs: Sequence[Path]
    map: Path
    output: Path | None = None
    """Folder for the result; default: the recording's name with ``-localized`` beside the recording."""
    config_files: Sequence[Path] = ()
    sets: Sequence[str] = ()
    launch_arguments: Mapping[str, str] = field(default_factory=dict)
    start: tuple[float, float, float] | None = None
    """x, y (metres) and yaw (radians) at the first scan; None: the parameters' initial pose."""
    everywhere: bool = False
    """Begin with particles all over the map."""
    scan_topics: Sequence[str] = ()
    odom_topic: str | None = None
    base_frame: str | None = None
    odom_frame: str | None = None
    begin_s: float | None = None
    duration_s: float | None = None
    seed: int = 0
    reference: str | None = None
    """True trajectory in the map's frame, or another localiser's: a file, or a topic of a recording."""
    reference_align: AlignMode = AlignMode.NONE
    mends: Mends = field(default_factory=Mends)
    command: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Localized:
    """What came of it."""

    output: Path
    result: MappingResult
    score: TrajectoryScore | None
    run: Mapping[str, Any]
    """The ``run.json`` document."""


def run_localize(request: LocalizeRequest, log: RunLog) -> Localized:
    """Localise every scan of a recording and write the result into a folder that appears whole or not at all.

    Raises
    ------
    InputError
        If the recording, the map, a parameter or an option is wrong; nothing is written then.
    """
    began = time.perf_counter()
    if not request.inputs:
        raise UsageError("nothing to localise: name a recording")
    for path in request.inputs:  # before anything is said of the map or the start
        if not path.exists():
            raise FormatError(f"{path}: no such file")
    if request.start is not None and request.everywhere:
        raise UsageError("--start says where the robot begins, --global that nobody knows: give one of them")
    config = load_declared(ALGO, AmclParameters, request.config_files, request.sets, log, request.launch_arguments)
    parameters: AmclParameters = config.parameters
    output = request.output or _default_output(request.inputs)
    check_directory(output)
    with log.stage("read map"):
        map_file = read_map(request.map)
    for warning in map_file.warnings:
        log.warn(warning)
    if not request.everywhere:
        _check_start(map_file, request, parameters, config, log)
    reference = None if request.reference is None else load_trajectory(request.reference, mends=request.mends, log=log)
    result, covariances, feed = _localized(request, config, map_file, log)
    score = None
    if reference is not None:
        options = ErrorOptions(align=request.reference_align, parts=("ape",))
        score = score_trajectory(result.trajectory, reference, errors=options, log=log)
    inputs = describe_inputs([*request.inputs, request.map])
    with atomic_directory(output) as folder:
        with log.stage("write"):
            written = write_localization(folder, result, covariances, score, log)
        summary = {**result.summary, "path_length_m": result.trajectory.length_m, "poses": len(result.trajectory)}
        if score is not None:
            summary |= {"truth": score.figures() | after_convergence(score)}
        document = run_document(
            command=request.command, algo=ALGO, parameters=as_dict(parameters), changed=_changed(config), seed=request.seed,
            jobs=1, inputs=inputs, topics=feed.topics, frames=feed.frames, log=log, total_s=time.perf_counter() - began,
            duration_s=feed.length_s, summary=summary, outputs=(*written.names, *RECORDS),
        )  # fmt: skip
        write_records(folder, document, result, written, score, declarations(AmclParameters))
    return Localized(output=output, result=result, score=score, run=document)


def _localized(
    request: LocalizeRequest, config: NativeConfig, map_file: MapFile, log: RunLog
) -> tuple[MappingResult, NDArray[np.float64], SensorFeed]:
    source = AmclInput(map_file.grid, request.start, everywhere=request.everywhere)
    names = TopicNames(
        scans=tuple(request.scan_topics), odometry=request.odom_topic, base_frame=request.base_frame,
        odom_frame=request.odom_frame,
    )  # fmt: skip
    with open_recording(request.inputs, mends=request.mends, log=log) as recording:
        names = remapped_names(names, config, recording)
        feed = feed_sensors(
            recording, source, config.parameters, config.sources, names, log,
            start_s=request.begin_s, duration_s=request.duration_s,
        )  # fmt: skip
        setup = Setup(
            T_base_laser=feed.T_base_laser, map_frame=config.parameters.global_frame_id, base_frame=feed.base_frame,
            seed=request.seed, log=log,
        )  # fmt: skip
        localisation = source.build(config.parameters, setup)
        with log.stage("read", feed.length_s):
            for measurement in feed.measurements():
                localisation.process(measurement)
        result = localisation.finish()
    return result, localisation.covariances, feed


def _check_start(
    map_file: MapFile, request: LocalizeRequest, parameters: AmclParameters, config: NativeConfig, log: RunLog
) -> None:
    """Refuse a start from which nothing can come.

    Raises
    ------
    UsageError
        If it is outside the map or in a wall.
    """
    p, grid = parameters, map_file.grid
    x, y, yaw = request.start or (p.initial_pose_x, p.initial_pose_y, p.initial_pose_a)
    given = request.start is not None or any(name.startswith("initial_pose") for name in config.sources)
    what = "--start" if request.start is not None else "the initial pose"
    hint = "" if given else "; say where the robot begins with --start x,y,yaw, or --global if nobody knows"
    cell = grid.map_to_cell([[x, y]])
    if not grid.contains(cell)[0]:
        corners = grid.cell_to_map([[-0.5, -0.5], [grid.height - 0.5, grid.width - 0.5]])
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        raise UsageError(
            f"{what} {x:g},{y:g} is outside the map {request.map} (x {x0:.2f} to {x1:.2f}, y {y0:.2f} to {y1:.2f}){hint}"
        )
    value = int(grid.cells[cell[0, 0], cell[0, 1]])
    if value >= OCCUPIED_FROM:
        raise UsageError(f"{what} {x:g},{y:g} is in a wall of the map {request.map}{hint}")
    if value == grid.UNKNOWN:
        log.warn(f"{what} {x:g},{y:g} is where the map knows nothing{hint}")
    if not given:
        log.note(f"begins at {x:g},{y:g},{yaw:g}, the initial pose of the parameters; --start x,y,yaw says otherwise, --global that nobody knows")  # fmt: skip


def _default_output(inputs: Sequence[Path]) -> Path:
    first, name = inputs[0], inputs[0].name
    for suffix in (".gz", *first.suffixes[::-1]):
        name = name.removesuffix(suffix)
    return first.parent / f"{name}-localized"


def _changed(config: NativeConfig) -> dict[str, Any]:
    defaults = {entry.name: entry.default for entry in declarations(type(config.parameters))}
    return {name: value for name, value in as_dict(config.parameters).items() if value != defaults[name]}
