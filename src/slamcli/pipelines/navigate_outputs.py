# SPDX-License-Identifier: MIT
"""What ``slamcli navigate -o DIR`` leaves in its folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.evaluation.drive_story import DriveStory
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import write_tum
from slamcli.parameters import as_dict
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigate_request import NavigateRequest, inputs_of
from slamcli.pipelines.navigation_config import NavigationConfig
from slamcli.pipelines.run_record import describe_inputs, run_document, to_json
from slamcli.reports.drive_report import drive_report
from slamcli.reports.figures import map_png
from slamcli.runtime import RunLog
from slamcli.simulation.simulate import MAP_FRAME, ODOM_FRAME
from slamcli.trajectory import Trajectory

RECORDING, FILM = "run.mcap", "run.gif"


def write_folder(
    folder: Path, request: NavigateRequest, document: dict[str, Any], story: DriveStory, config: NavigationConfig, log: RunLog
) -> dict[str, Any]:  # fmt: skip
    """Write trajectories, picture, report and ``run.json`` into `folder`; return what stands in the latter."""
    start_ns = round(float(document["parameters"]["simulation.clock.start"]) * 1e9)
    names = list(document["outputs"])
    with log.stage("write"):
        names += write_trajectories(folder, story, start_ns)
        truth = drive_trajectory(story, story.truth, start_ns)
        if story.grid is not None and len(truth):
            goal = story.goals[-1].goal
            picture = map_png(story.grid, trajectory=truth, start=story.truth[0], goal=goal, title=_title(request))
            (folder / "map.png").write_bytes(picture)
            names.append("map.png")
            if request.slam is not None:
                names += [path.name for path in write_map(folder / "map.yaml", story.grid)]
    document = {**document, "outputs": sorted([*names, "report.html", "run.json"])}
    document["timing"]["stages_s"] = {name: round(seconds, 3) for name, seconds in log.seconds.items()}
    page = drive_report(
        document, story, title=_title(request), declared=[replace(v.declaration, name=v.key) for v in config.values()]
    )
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "run.json").write_text(to_json(document), encoding="utf-8")
    return document


def navigation_document(
    request: NavigateRequest, robot: Navigator, story: DriveStory, topics: Mapping[str, int], log: RunLog, *,
    total_s: float, outputs: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """Return the ``run.json`` document."""
    config, plant = robot.config, robot.plant
    parameters = {v.key: v.value for v in config.values()} | {
        f"simulation.{name}": v for name, v in as_dict(plant.parameters).items()
    }
    document = run_document(
        command=request.command or "navigate",
        algo=config.local_planner,
        parameters=parameters,
        changed={name: parameters[name] for name in config.sources if name in parameters},
        seed=request.seed,
        jobs=1,
        inputs=describe_inputs([*inputs_of(request), *config.files]),
        topics=topics,
        frames={"map": MAP_FRAME, "odom": ODOM_FRAME, "base": plant.parameters.robot_base_frame},
        log=log,
        total_s=total_s,
        duration_s=robot.time_s,
        summary={
            "map": None if request.map_path is None else request.map_path.name, "world": request.world, "slam": request.slam,
            "start": story.truth[0].tolist() if len(story.truth) else None,
            "local_planner": config.local_planner, "global_planner": config.global_planner,
            "localization": request.localization, "people": request.people, **story.figures(),
        },
        outputs=outputs,
    )  # fmt: skip
    driving_s = log.seconds.get("drive", 0.0)
    document["timing"]["realtime_factor"] = round(robot.time_s / driving_s, 2) if driving_s > 0 else None
    return document


def _title(request: NavigateRequest) -> str:
    goals = len(request.waypoints)
    places = [
        p.stem for p in (request.map_path, None if request.world is None else Path(request.world)) if p is not None
    ]
    by = "" if request.slam is None else f" with {request.slam}"
    return f"{' in '.join(places)}: {goals} goal{'s' if goals != 1 else ''}{by}"


def write_trajectories(folder: Path, story: DriveStory, start_ns: int) -> list[str]:
    """Write where the robot was and where it thought it was; return the names of the files."""
    names = []
    for name, poses in (("trajectory.tum", story.truth), ("estimate.tum", story.estimate)):
        trajectory = drive_trajectory(story, poses, start_ns)
        if len(trajectory):
            write_tum(folder / name, trajectory)
            names.append(name)
    return names


def drive_trajectory(story: DriveStory, poses: Any, start_ns: int) -> Trajectory:
    """Return those of a story's poses (N, 3) that are known, with stamps."""
    known = np.isfinite(poses).all(axis=1)
    stamps = start_ns + np.rint(story.times_s[known] * 1e9).astype(np.int64)
    return Trajectory.from_se2(stamps, poses[known], MAP_FRAME, "base_link")
