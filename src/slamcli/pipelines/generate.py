# SPDX-License-Identifier: MIT
"""A synthetic recording with ground truth: a world is simulated and written as a bag."""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from slamcli.errors import UsageError
from slamcli.formats.maps import read_map, write_map
from slamcli.formats.trajectories import write_tum
from slamcli.grids import OccupancyGrid
from slamcli.measurements import FrameTransform
from slamcli.outputs import atomic_file
from slamcli.parameters import as_dict
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.recordings import RecordingWriter, create_recording
from slamcli.runtime import RunLog
from slamcli.simulation import Message, Simulation, World, is_world_file, load_world, resolve_settings
from slamcli.simulation.builtin import find_world
from slamcli.simulation.simulate import MAP_FRAME, ODOM_FRAME, STATIC_TOPIC


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Generated:
    """What was simulated and written."""

    world: str
    path: Path
    truth: Path | None
    map: Path | None
    record: Path
    """The run's record, OUT's name with ``.run.json``."""
    seed: int
    duration_s: float
    length_m: float
    """Way that the robot truly drove."""
    messages: Mapping[str, int]
    """Number of messages by topic."""
    slips_s: tuple[tuple[float, float], ...]
    """Begin and end of every episode of slip, seconds from the start."""
    settings: Mapping[str, Any]
    """Every parameter of the simulation as it was used."""
    seconds: float
    """Time that the work took."""

    @property
    def speed(self) -> float:
        """Recorded time over the time that the work took."""
        return self.duration_s / max(self.seconds, 1e-9)


def generate(
    world: str,
    path: str | os.PathLike[str],
    *,
    seed: int = 0,
    duration_s: float | None = None,
    start: tuple[float, float, float] | None = None,
    settings: Mapping[str, Any] | None = None,
    truth: str | os.PathLike[str] | None = None,
    map_path: str | os.PathLike[str] | None = None,
    format: str | None = None,
    compression: str | None = None,
    log: RunLog | None = None,
) -> Generated:
    """Simulate a robot in `world` and write what its sensors say to `path`, and a record of the run beside it.

    Parameters
    ----------
    world
        Path of a world file or a map.yaml, or the name of a built-in world.
    path
        The recording; its suffix says the format unless `format` does.
    seed
        Of every random draw; the same seed gives the same bytes.
    duration_s
        Length of the recording; None: as long as the world's route takes (random drive: 120 s).
    start
        x, y (metres) and yaw (radians) of the robot in the map, instead of the world's own.
    settings
        Values of `SimulationParameters` by native name; they win over the world's.
    truth
        TUM file for the true pose of base_link at every scan.
    map_path
        map.yaml for the true map of the world.
    format, compression
        As `slamcli.recordings.create_recording` takes them.
    log
        Progress, times and remarks.

    Raises
    ------
    UsageError, ConfigError, FormatError
        If the world, a setting or an output cannot be used.
    PlanningError
        If the robot has no way through the world.
    """
    log = log or RunLog()
    place = open_world(world)
    record_path = record_beside(path)
    check_outputs(find_world(world), path, record_path, truth, map_path)
    if start is not None and place.path is not None:
        raise UsageError(f"world {place.name}: --start is for robots that drive; this rig follows the world's path")
    if start is not None:
        place = dataclasses.replace(place, start=start)
    parameters = resolve_settings(place.settings, settings or {})
    if place.carts or parameters.carts_count:
        log.warn("carts and obstacles that come and go are met by robots that navigate; this recording is without them")
    with log.stage("driving"):
        simulation = Simulation(place, parameters, seed=seed, duration_s=duration_s)
    with create_recording(path, format=format, compression=compression) as recording:
        with log.stage("measuring and writing", simulation.duration_s):
            counts = _write(recording, simulation, log)
        if truth is not None:
            write_tum(truth, simulation.truth())
        if map_path is not None:
            with log.stage("true map"):
                write_map(Path(map_path), simulation.true_map())
    if parameters.slip_count > len(simulation.slips_s):
        log.warn(f"slip.count={parameters.slip_count}: only {len(simulation.slips_s)} episodes fit into the recording")
    made = Generated(
        world=place.name,
        path=Path(path),
        record=record_path,
        truth=None if truth is None else Path(truth),
        map=None if map_path is None else Path(map_path),
        seed=seed,
        duration_s=simulation.duration_s,
        length_m=simulation.motion.length_m,
        messages=dict(sorted(counts.items())),
        slips_s=tuple((float(a), float(b)) for a, b in simulation.slips_s),
        settings=as_dict(parameters),
        seconds=sum(log.seconds.values()),
    )
    with atomic_file(record_path) as stream:
        stream.write(to_json(_run_record(made, find_world(world), settings or {}, log)))
    return made


def _run_record(made: Generated, world: Path, changed: Mapping[str, Any], log: RunLog) -> dict[str, Any]:
    outputs = [made.path, made.record, *(p for p in (made.truth, made.map) if p is not None)]
    return run_document(
        command="generate",
        algo="simulation",
        parameters=made.settings,
        changed=changed,
        seed=made.seed,
        jobs=1,
        inputs=describe_inputs([world]),
        topics=made.messages,
        frames={"map": MAP_FRAME, "odom": ODOM_FRAME, "base": made.settings["robot.base_frame"]},
        log=log,
        total_s=made.seconds,
        duration_s=made.duration_s,
        summary={
            "world": made.world,
            "duration_s": made.duration_s,
            "length_m": made.length_m,
            "slips_s": made.slips_s,
        },
        outputs=[path.name for path in outputs],
    )


def record_beside(path: str | os.PathLike[str]) -> Path:
    """Return where the record of a recording lies: its name with ``.run.json``; raise UsageError for a path without a name."""
    recording = Path(path)
    if not recording.name:
        raise UsageError(f"{os.fspath(path) or repr('')} names no file: name the recording, for example drive.mcap")
    return recording.with_suffix(".run.json")


def check_outputs(world: Path, *outputs: str | os.PathLike[str] | None) -> None:
    """Raise UsageError if an output is the world itself, or named twice; None is no output."""
    taken: set[Path] = set()
    for output in outputs:
        if output is None:
            continue
        resolved = Path(output).resolve()
        if resolved == world.resolve():
            raise UsageError(f"{output} is the world itself: name another file for the output")
        if resolved in taken:
            raise UsageError(f"{output} is named twice as an output: give each its own file")
        taken.add(resolved)


def open_world(world: str) -> World:
    """Return the world that a path (world file or map.yaml) or a built-in name means."""
    path = find_world(world)
    if is_world_file(path):
        return load_world(path, _read_grid)
    return World(name=path.stem, grid=_read_grid(path))


def _read_grid(path: Path) -> OccupancyGrid:
    return read_map(path).grid


def _write(recording: RecordingWriter, simulation: Simulation, log: RunLog) -> Counter[str]:
    """Write every message; the static transforms become one message, as a latched topic keeps only its last."""
    counts: Counter[str] = Counter()
    messages = simulation.messages()
    statics, first = _leading_statics(messages)
    if statics:
        recording.write_transforms(STATIC_TOPIC, statics)
        counts[STATIC_TOPIC] += 1
    began = statics[0].stamp_ns
    while first is not None:
        recording.write(first.topic, first.measurement, log_time_ns=first.log_time_ns, msgtype=first.msgtype)
        counts[first.topic] += 1
        if counts[first.topic] % 64 == 0:
            log.progress.update((first.log_time_ns - began) / 1e9)
        first = next(messages, None)
    return counts


def _leading_statics(messages: Iterator[Message]) -> tuple[list[FrameTransform], Message | None]:
    statics: list[FrameTransform] = []
    for message in messages:
        if not (isinstance(message.measurement, FrameTransform) and message.measurement.static):
            return statics, message
        statics.append(message.measurement)
    return statics, None
