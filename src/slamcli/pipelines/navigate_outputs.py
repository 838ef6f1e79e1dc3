# SPDX-License-Identifier: MIT
"""What ``slamcli navigate -o DIR`` leaves in its folder."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.evaluation.drive_story import DriveStory
from slamcli.formats.maps import write_map
from slamcli.formats.trajectories import write_tum
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.parameters import Declaration, as_dict, declarations
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
        truth = _trajectory(story, story.truth, start_ns)
        for name, trajectory in (
            ("trajectory.tum", truth),
            ("estimate.tum", _trajectory(story, story.estimate, start_ns)),
        ):
            if len(trajectory):
                write_tum(folder / name, trajectory)
                names.append(name)
        if story.grid is not None and len(truth):
            goal = story.goals[-1].goal
            picture = map_png(story.grid, trajectory=truth, start=story.truth[0], goal=goal, title=_title(request))
            (folder / "map.png").write_bytes(picture)
            names.append("map.png")
            if request.slam is not None:
                names += [path.name for path in write_map(folder / "map.yaml", story.grid)]
    document = {**document, "outputs": sorted([*names, "report.html", "run.json"])}
    document["timing"]["stages_s"] = {name: round(seconds, 3) for name, seconds in log.seconds.items()}
    page = drive_report(document, story, title=_title(request), declared=_declared(config))
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "run.json").write_text(to_json(document), encoding="utf-8")
    return document


def navigation_document(
    request: NavigateRequest, robot: Navigator, story: DriveStory, topics: Mapping[str, int], log: RunLog, *,
    total_s: float, outputs: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """Return the ``run.json`` document."""
    config, plant = robot.config, robot.plant
    parameters = _parameters(config) | {f"simulation.{name}": v for name, v in as_dict(plant.parameters).items()}
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
            "local_planner": config.local_planner, "global_planner": request.global_planner,
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


def _trajectory(story: DriveStory, poses: Any, start_ns: int) -> Trajectory:
    known = np.isfinite(poses).all(axis=1)
    stamps = start_ns + np.rint(story.times_s[known] * 1e9).astype(np.int64)
    return Trajectory.from_se2(stamps, poses[known], MAP_FRAME, "base_link")


def _parts(config: NavigationConfig) -> list[tuple[str, Any]]:
    """Return the parameters of each part under the name of its section; of a costmap each layer is a part."""
    parts: list[tuple[str, Any]] = [("amcl", config.amcl)]
    for name, costmap in (("global_costmap", config.global_costmap), ("local_costmap", config.local_costmap)):
        seeing = [layer for layer in costmap.layers if layer.kind in ("obstacle", "voxel")]
        parts += [(name, costmap.costmap), *((f"{name}.{layer.name}", layer.obstacle) for layer in seeing)]
    parts += [(name, getattr(config, name)) for name in ("planner", "move_base", "recovery")]
    return [*parts, (LOCAL_PLANNERS[config.local_planner].section, config.local_parameters)]


def _parameters(config: NavigationConfig) -> dict[str, Any]:
    values = {f"{section}.{name}": value for section, part in _parts(config) for name, value in as_dict(part).items()}
    for name, costmap in (("global_costmap", config.global_costmap), ("local_costmap", config.local_costmap)):
        for layer in costmap.layers:
            for source in layer.sources:
                told = dataclasses.asdict(source)
                section = f"{name}.{layer.name}.{told.pop('name')}"
                values |= {f"{section}.{key}": value for key, value in told.items()}
    return values


def _declared(config: NavigationConfig) -> list[Declaration]:
    return [
        dataclasses.replace(declaration, name=f"{section}.{declaration.name}")
        for section, part in _parts(config)
        for declaration in declarations(type(part))
    ]
