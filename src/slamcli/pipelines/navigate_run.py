# SPDX-License-Identifier: MIT
"""A whole run of the navigation stack: waypoint after waypoint, recorded, filmed and summed up."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ProcessError, UsageError
from slamcli.evaluation.drive_story import DriveStory, Event, GoalStory
from slamcli.outputs import atomic_directory, check_directory, check_file
from slamcli.pipelines.animation import Animation
from slamcli.pipelines.loop_listener import LoopListener
from slamcli.pipelines.mission import Waypoint
from slamcli.pipelines.navigate import Arrival, Navigator
from slamcli.pipelines.navigate_outputs import FILM, RECORDING, navigation_document, write_folder
from slamcli.pipelines.navigate_request import NavigateRequest, build_robot, inputs_of
from slamcli.pipelines.navigation_recording import NavigationRecording
from slamcli.pipelines.robot_recording import recording_of
from slamcli.pipelines.story_teller import StoryTeller
from slamcli.recordings.containers import create_raw
from slamcli.reports.film import check_film
from slamcli.runtime import RunLog


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NavigateOutcome:
    """What came of it."""

    story: DriveStory
    document: Mapping[str, Any]
    """The ``run.json`` document."""
    written: tuple[Path, ...]

    @property
    def failure(self) -> str:
        """Which goal was not reached, and why, in one line; empty if all were."""
        failed = [goal for goal in self.story.goals if not goal.succeeded]
        if not failed:
            return ""
        x, y, _ = failed[0].goal
        others = f" (and {len(failed) - 1} of {len(self.story.goals)} more)" if len(failed) > 1 else ""
        return f"goal {failed[0].name} ({x:g},{y:g}) {failed[0].status}: {failed[0].message}{others}"


def run_navigation(request: NavigateRequest, log: RunLog) -> NavigateOutcome:
    """Drive to all waypoints in turn; one that cannot be reached does not keep the robot from the next.

    Everything asked for is written when the run has ended; a run that is broken off leaves nothing.

    Raises
    ------
    InputError
        If the map, a parameter, the start or an output cannot be used.
    DependencyError
        If an MP4 is asked for and there is no ffmpeg.
    """
    began = time.perf_counter()
    _check(request)
    with log.stage("prepare"):
        robot = build_robot(request, log)
    teller = StoryTeller()
    robot.listen(teller)
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(atomic_directory(request.output)) if request.output is not None else None
        targets = Targets(request, folder)
        counts: Mapping[str, int] = {}
        animation = Animation(robot.plant.T_base_laser, upside_down=robot.plant.parameters.laser_upside_down)
        if targets.film is not None:
            robot.listen(animation)
        with recorded(targets.recording, robot) as recording:
            goals, collisions = _drive(request, robot, log)
            counts = {} if recording is None else dict(sorted(recording.counts.items()))
        story = teller.story(goals, collisions)
        made = [targets.recording, filmed(animation, targets.film, log)]
        document = navigation_document(
            request, robot, story, counts, log, total_s=time.perf_counter() - began,
            outputs=[p.name for p in made if p is not None and p.parent == folder],
        )  # fmt: skip
        if folder is not None:
            document = write_folder(folder, request, document, story, robot.config, log)
    written = [p for p in made if p is not None and p.parent != folder]
    if request.output is not None:
        written += [request.output / name for name in document["outputs"]]
    return NavigateOutcome(story=story, document=document, written=tuple(written))


def filmed(animation: Animation, target: Path | None, log: RunLog) -> Path | None:
    """Write the animation if one is asked for and something happened; return where."""
    if target is None:
        return None
    if animation.is_empty:
        log.note("the robot did not set out: there is no animation")
        return None
    with log.stage("animation"):
        animation.write(target)
    return target


class Targets:
    """Where recording and animation go, None for nowhere; `folder` is the one that is being made."""

    def __init__(self, request: NavigateRequest, folder: Path | None) -> None:
        into = None if request.lean else folder
        self.recording = request.recording or (None if into is None else into / RECORDING)
        self.film = request.film or (None if into is None else into / FILM)


def _check(request: NavigateRequest) -> None:
    """Refuse outputs that could not be written, before any work is done."""
    if not request.waypoints:
        raise UsageError("no goal: give x,y or x,y,yaw (any number), or --mission FILE")
    if (request.map_path is None) == (request.slam is None):
        raise UsageError(
            "give --map FILE, or --slam gmapping|cartographer with --world WORLD to make the map on the way"
        )
    if request.slam is not None and request.world is None:
        raise UsageError(
            f"--slam {request.slam}: say where: --world WORLD (a world file, a map.yaml or a built-in name)"
        )
    if request.slam is None and request.slam_sets:
        raise UsageError(f"--slam-set {request.slam_sets[0]}: there is nothing that maps; give --slam, too")
    if request.slam is not None and request.localization == "truth":
        raise UsageError("--localization truth needs --map: with --slam the robot is where its SLAM says")
    if request.timeout_s is not None and not 0.0 < request.timeout_s < math.inf:
        raise UsageError(f"--timeout {request.timeout_s:g}: give seconds above 0")
    check_outputs(request)


def check_outputs(request: NavigateRequest) -> None:
    """Refuse outputs that could not be written."""
    taken = {path.resolve() for path in inputs_of(request)}
    for target in (request.recording, request.film):
        if target is None:
            continue
        if target.resolve() in taken:
            raise UsageError(f"{target} is an input or named twice as an output: give each its own file")
        taken.add(target.resolve())
        if target.suffix:
            check_file(target)
    if request.recording is not None:
        create_raw(request.recording)
    if request.film is not None:
        check_film(request.film)
    if request.output is not None:
        check_directory(request.output)


@contextlib.contextmanager
def recorded(target: Path | None, robot: Navigator) -> Iterator[NavigationRecording | None]:
    """Record what happens to a robot, if there is a place for it."""
    if target is None:
        yield None
        return
    with recording_of(target, robot.plant, robot.config) as listener:
        robot.listen(listener)
        yield listener


def _drive(request: NavigateRequest, robot: Navigator, log: RunLog) -> tuple[list[GoalStory], list[Event]]:
    goals = []
    with log.stage("drive"):
        robot.listen(ProgressTeller(log))
        for waypoint in request.waypoints:
            begin_s = robot.time_s
            arrival = robot.go_to(waypoint.x, waypoint.y, waypoint.yaw, timeout_s=request.timeout_s)
            goals.append(_goal_story(waypoint, arrival, begin_s))
            if waypoint.wait_s > 0.0:
                robot.wait(waypoint.wait_s)
    return goals, collision_events(robot)


def collision_events(robot: Navigator) -> list[Event]:
    """Return what the robot has collided with so far."""
    collisions = []
    for contact in robot.plant.collisions:
        fault = "caused by the robot" if contact.by_robot else "not its fault"
        words = f"{contact.kind} at {contact.speed_m_s:.2f} m/s, {fault}"
        collisions.append(Event(time_s=contact.time_s, kind="collision", message=words))
    return collisions


def _goal_story(waypoint: Waypoint, arrival: Arrival, begin_s: float) -> GoalStory:
    drive = arrival.drive
    return GoalStory(
        name=waypoint.name,
        goal=arrival.goal,
        status=arrival.status,
        message=arrival.message,
        begin_s=begin_s if drive is None else drive.begin_s,
        end_s=begin_s if drive is None else drive.end_s,
        length_m=0.0 if drive is None else drive.length_m,
        optimum_m=arrival.optimum_m,
        clearance_m=math.inf if drive is None else drive.clearance_m,
        collisions=0 if drive is None else len(drive.collisions),
        caused=0 if drive is None else sum(c.by_robot for c in drive.collisions),
        recoveries=() if drive is None else drive.recoveries,
        plans=0 if drive is None else drive.plans,
    )


class ProgressTeller(LoopListener):
    """Passes the simulated time on to who waits."""

    def __init__(self, log: RunLog) -> None:
        self._progress = log.progress

    def on_truth(self, time_s: float, pose_map: Any, twist: Any) -> None:  # noqa: ARG002
        """Report it."""
        self._progress.update(time_s)


def require_all_reached(outcome: NavigateOutcome) -> None:
    """Raise if a goal was not reached.

    Raises
    ------
    ProcessError
        With the first such goal and why.
    """
    if outcome.failure:
        raise ProcessError(outcome.failure)
