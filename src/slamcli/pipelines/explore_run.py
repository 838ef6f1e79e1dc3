# SPDX-License-Identifier: MIT
"""A whole exploration: driven, recorded, filmed, summed up and its map saved."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import ProcessError, UsageError
from slamcli.evaluation.drive_story import DriveStory, GoalStory
from slamcli.evaluation.reachable_area import ReachableArea
from slamcli.outputs import atomic_directory
from slamcli.pipelines.animation import Animation
from slamcli.pipelines.explore import DEFAULT_TIMEOUT_S, Explored, Explorer
from slamcli.pipelines.explore_outputs import exploration_document, write_folder
from slamcli.pipelines.explore_request import ExploreRequest
from slamcli.pipelines.generate import open_world
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigate_request import NavigateRequest, build_robot
from slamcli.pipelines.navigate_run import ProgressTeller, Targets, check_outputs, collision_events, filmed, recorded
from slamcli.pipelines.story_teller import StoryTeller
from slamcli.runtime import RunLog
from slamcli.simulation.free_space import true_map

_RESOLUTION_M = 0.05
_STATUS = {"done": "succeeded", "stuck": "aborted", "timeout": "timeout"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExploreOutcome:
    """What came of it."""

    explored: Explored
    story: DriveStory
    document: Mapping[str, Any]
    """The ``run.json`` document."""
    written: tuple[Path, ...]

    @property
    def failure(self) -> str:
        """Why the exploration was not finished, in one line; empty if it was."""
        if self.explored.status == "done":
            return ""
        kept = (
            "the map so far is saved" if any(path.name == "map.yaml" for path in self.written) else "no map was saved"
        )
        return f"{self.explored.message} ({kept})"


def run_exploration(request: ExploreRequest, log: RunLog) -> ExploreOutcome:
    """Explore, drive home, and write everything that is asked for.

    Raises
    ------
    InputError
        If the world, a parameter, the start or an output cannot be used.
    DependencyError
        If an MP4 is asked for and there is no ffmpeg.
    """
    began = time.perf_counter()
    drive = request.drive
    timeout_s = DEFAULT_TIMEOUT_S if drive.timeout_s is None else drive.timeout_s
    if not 0.0 < timeout_s < math.inf:
        raise UsageError(f"--timeout {timeout_s:g}: give simulated seconds above 0")
    check_outputs(drive)
    with log.stage("prepare"):
        robot, area = _prepared(drive, log)
    teller = StoryTeller()
    robot.listen(teller)
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(atomic_directory(drive.output)) if drive.output is not None else None
        targets = Targets(drive, folder)
        animation = Animation(robot.plant.T_base_laser, upside_down=robot.plant.parameters.laser_upside_down)
        if targets.film is not None:
            robot.listen(animation)
        counts: Mapping[str, int] = {}
        with recorded(targets.recording, robot) as recording:
            with log.stage("drive", timeout_s):
                robot.listen(ProgressTeller(log))
                explored = Explorer(robot, request.parameters, area=area).explore(timeout_s)
            counts = {} if recording is None else dict(sorted(recording.counts.items()))
        story = teller.story([_goal(robot, explored, teller)], collision_events(robot))
        made = [targets.recording, filmed(animation, targets.film, log)]
        document = exploration_document(
            request, robot, story, explored, area, counts, log, total_s=time.perf_counter() - began,
            outputs=[p.name for p in made if p is not None and p.parent == folder],
        )  # fmt: skip
        if folder is not None:
            document = write_folder(folder, request, document, story, explored, robot.config, log)
    written = [p for p in made if p is not None and p.parent != folder]
    if drive.output is not None:
        written += [drive.output / name for name in document["outputs"]]
    return ExploreOutcome(explored=explored, story=story, document=document, written=tuple(written))


def _prepared(drive: NavigateRequest, log: RunLog) -> tuple[Navigator, ReachableArea]:
    """Return the robot at its start, and what there is to explore."""
    robot = build_robot(drive, log)
    start = np.asarray(robot.true_pose)[:2]
    return robot, ReachableArea(true_map(open_world(drive.world or ""), start, _RESOLUTION_M), start)


def _goal(robot: Navigator, explored: Explored, teller: StoryTeller) -> GoalStory:
    """Return the exploration as a drive to where it began."""
    way = teller.story([])
    contacts = robot.plant.collisions
    home = way.truth[0] if len(way.truth) else robot.true_pose
    return GoalStory(
        name="home", goal=(float(home[0]), float(home[1]), float(home[2])), status=_STATUS[explored.status],
        message=explored.message, begin_s=explored.begin_s, end_s=explored.end_s, length_m=way.length_m, optimum_m=math.nan,
        clearance_m=explored.clearance_m, collisions=len(contacts), caused=sum(c.by_robot for c in contacts),
        recoveries=explored.recoveries, plans=explored.plans,
    )  # fmt: skip


def require_explored(outcome: ExploreOutcome) -> None:
    """Raise if the exploration was not finished.

    Raises
    ------
    ProcessError
        With the reason.
    """
    if outcome.failure:
        raise ProcessError(outcome.failure)
