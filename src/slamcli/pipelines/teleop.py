# SPDX-License-Identifier: MIT
"""A robot driven by hand or by a script, recorded: exercise 1 of the mission."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import ConfigError, DataError, EstimationError, UsageError
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import write_tum
from slamcli.grids import OccupancyGrid
from slamcli.outputs import atomic_file
from slamcli.parameters import as_dict
from slamcli.pipelines.navigation_recording import RecordingRates
from slamcli.pipelines.rhythm import TICK_S
from slamcli.pipelines.robot_recording import recording_of
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.pipelines.teleop_request import TeleopRequest, check_request
from slamcli.pipelines.teleop_robot import TeleopRobot
from slamcli.pipelines.velocity_script import VelocityScript
from slamcli.runtime import RunLog
from slamcli.simulation import Contact, free_space
from slamcli.simulation.builtin import find_world
from slamcli.simulation.simulate import MAP_FRAME, ODOM_FRAME
from slamcli.trajectory import Trajectory

_AT_ONCE_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Driven:
    """What was driven and written."""

    world: str
    path: Path
    truth: Path | None
    map: Path | None
    record: Path
    seed: int
    duration_s: float
    length_m: float
    """Way that the robot truly drove."""
    collisions: tuple[Contact, ...]
    messages: Mapping[str, int]
    """Number of messages by topic."""
    settings: Mapping[str, Any]
    """Every parameter of the simulation as it was used."""
    seconds: float
    """Time that the whole took."""


class Teleop:
    """A drive from its first to its last command; everything asked for is written when the block of `driving` ends.

    Examples
    --------
    >>> from slamcli.pipelines.teleop import Teleop, TeleopRequest
    >>> drive = Teleop(TeleopRequest(world="office", path=Path("drive.mcap")))  # doctest: +SKIP
    >>> with drive.driving() as robot:  # doctest: +SKIP
    ...     robot.command(np.array([0.4, 0.0, 0.1]))
    ...     robot.advance_to(5.0)
    >>> drive.driven.length_m  # doctest: +SKIP

    Parameters
    ----------
    request
        Where, with what, and what to leave behind.
    log
        Gets remarks and times.

    Raises
    ------
    InputError
        If the world, a setting, the start or an output cannot be used.
    """

    def __init__(self, request: TeleopRequest, log: RunLog | None = None) -> None:
        self._request, self._log = request, log or RunLog()
        self._began = time.perf_counter()
        check_request(request)
        with self._log.stage("prepare"):
            self.robot = TeleopRobot(request, self._log)
        self._driven: Driven | None = None

    @property
    def driven(self) -> Driven:
        """What came of it, once the block of `driving` has ended."""
        if self._driven is None:
            raise UsageError("nothing has been driven yet")
        return self._driven

    def true_map(self) -> OccupancyGrid:
        """Return the map that a perfect survey of the world would give (cells of `map.resolution`)."""
        robot = self.robot
        return free_space.true_map(robot.world, robot.start[:2], robot.plant.parameters.map_resolution)

    @contextlib.contextmanager
    def driving(self) -> Iterator[TeleopRobot]:
        """Give the robot; when the block ends without an error it stops, and the recording is moved into place.

        Raises
        ------
        EstimationError
            If a map was to be made and nothing was seen; the recording is there nevertheless.
        """
        request, robot = self._request, self.robot
        recording = recording_of(request.path, robot.plant, rates=RecordingRates(truth_s=0.0))
        with recording:
            robot.listeners.append(recording)
            with self._log.stage("drive"):
                yield robot
                robot.stop()
        with self._log.stage("write"):
            self._write_beside()
        self._driven = self._told(dict(sorted(recording.counts.items())))
        with atomic_file(request.record) as stream:
            stream.write(to_json(self._document(self._driven)))

    def play(self, script: VelocityScript) -> None:
        """Drive as a script says, as fast as the machine can.

        Raises
        ------
        ConfigError
            If the script ends where it begins.
        """
        end = script.end_s if self._request.max_time_s is None else min(script.end_s, self._request.max_time_s)
        if end < TICK_S:
            raise ConfigError(f"{self._request.script}: the drive lasts {end:g} s: the last time is where it ends")
        self._log.progress.stage("drive", end)
        with self.driving() as robot:
            for begin, twist in zip(script.times_s.tolist(), script.twists, strict=True):
                if begin >= end:
                    break
                self._play_until(robot, begin)
                robot.command(twist)
            self._play_until(robot, end)

    def _play_until(self, robot: TeleopRobot, end_s: float) -> None:
        while robot.time_s < end_s:
            before = robot.time_s
            robot.advance_to(min(before + _AT_ONCE_S, end_s))
            self._log.progress.update(robot.time_s)
            if robot.time_s <= before:  # less than half a tick is left
                return

    def _write_beside(self) -> None:
        request, robot = self._request, self.robot
        if request.truth is not None:
            p = robot.plant.parameters
            stamps = np.array(robot.scan_stamps_ns, dtype=np.int64)
            poses = np.array(robot.scan_poses).reshape(-1, 3)
            write_tum(request.truth, Trajectory.from_se2(stamps, poses, MAP_FRAME, p.robot_base_frame))
        if request.map_path is not None:
            write_map(request.map_path, self._map())

    def _map(self) -> OccupancyGrid:
        robot = self.robot
        if robot.localiser is None:
            return self.true_map()
        try:
            made = robot.localiser.mapper.finish().grid
        except (DataError, EstimationError) as error:
            raise EstimationError(f"the recording is in {self._request.path}; no map was made: {error}") from error
        if made is None:
            raise ConfigError(f"--slam {self._request.slam}: this configuration makes no occupancy grid")
        return robot.localiser.placed(made)

    def _told(self, messages: Mapping[str, int]) -> Driven:
        request, robot = self._request, self.robot
        return Driven(
            world=robot.world.name, path=request.path, truth=request.truth, map=request.map_path, record=request.record,
            seed=request.seed, duration_s=robot.time_s, length_m=robot.length_m, collisions=robot.plant.collisions,
            messages=messages, settings=as_dict(robot.plant.parameters), seconds=time.perf_counter() - self._began,
        )  # fmt: skip

    def _document(self, driven: Driven) -> dict[str, Any]:
        request = self._request
        outputs = [driven.path, driven.record, *(p for p in (driven.truth, driven.map) if p is not None)]
        inputs = [
            find_world(request.world),
            *([] if request.script is None else [request.script]),
            *request.native_files,
        ]
        return run_document(
            command=request.command, algo=request.slam or "simulation", parameters=driven.settings, changed=request.settings,
            seed=driven.seed, jobs=1, inputs=describe_inputs(inputs), topics=driven.messages,
            frames={"map": MAP_FRAME, "odom": ODOM_FRAME, "base": driven.settings["robot.base_frame"]}, log=self._log,
            total_s=driven.seconds, duration_s=driven.duration_s,
            summary={
                "world": driven.world, "start": self.robot.start.tolist(), "duration_s": driven.duration_s,
                "length_m": driven.length_m, "collisions": len(driven.collisions), "slam": request.slam,
            },
            outputs=[path.name for path in outputs],
        )  # fmt: skip
