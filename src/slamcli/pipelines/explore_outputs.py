# SPDX-License-Identifier: MIT
"""What ``slamcli explore -o DIR`` leaves in its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from slamcli.evaluation.drive_story import DriveStory
from slamcli.evaluation.reachable_area import ReachableArea
from slamcli.formats.maps import write_map
from slamcli.navigation.explore_parameters import ExploreParameters
from slamcli.parameters import as_dict, declarations
from slamcli.pipelines.explore import Explored
from slamcli.pipelines.explore_request import SECTION, ExploreRequest
from slamcli.pipelines.navigate import Navigator
from slamcli.pipelines.navigate_outputs import drive_trajectory, navigation_document, write_trajectories
from slamcli.pipelines.navigation_config import NavigationConfig
from slamcli.pipelines.run_record import to_json
from slamcli.reports.drive_report import drive_report
from slamcli.reports.exploration_section import exploration_task
from slamcli.reports.figures import map_png
from slamcli.runtime import RunLog

_LEVELS = (0.5, 0.9, 0.95, 0.98)
"""Coverages whose times ``run.json`` tells."""


def exploration_document(
    request: ExploreRequest, robot: Navigator, story: DriveStory, explored: Explored, area: ReachableArea, topics: Mapping[str, int],
    log: RunLog, *, total_s: float, outputs: Sequence[str],
) -> dict[str, Any]:  # fmt: skip
    """Return the ``run.json`` document: that of a drive, and what the exploration was and found."""
    drive = request.drive
    document = navigation_document(drive, robot, story, topics, log, total_s=total_s, outputs=outputs)
    document["parameters"] |= {f"{SECTION}.{name}": value for name, value in as_dict(request.parameters).items()}
    document["changed"] |= {f"{SECTION}.{name}": value for name, value in request.given.items()}
    last = explored.history[-1] if explored.history else None
    figures = {
        name: value
        for name, value in document["summary"].items()
        if name not in ("map", "localization", "goals", "reached", "optimum_m", "ratio", "by_goal")
    }
    document["algo"] = drive.slam
    document["summary"] = {
        "status": explored.status,
        "message": explored.message,
        "coverage": None if last is None else last.coverage,
        "reachable_m2": area.area_m2,
        "free_m2": None if last is None else last.free_m2,
        "frontiers_left": None if last is None else last.frontiers,
        "goals": explored.goals,
        "goals_reached": explored.reached,
        "goals_given_up": explored.given_up,
        "coverage_after_s": {f"{level:g}": _first_s(explored, level) for level in _LEVELS},
        **figures,
    }
    return document


def _first_s(explored: Explored, level: float) -> float | None:
    return next((round(point.time_s, 3) for point in explored.history if point.coverage >= level), None)


def write_folder(
    folder: Path, request: ExploreRequest, document: dict[str, Any], story: DriveStory, explored: Explored, config: NavigationConfig,
    log: RunLog,
) -> dict[str, Any]:  # fmt: skip
    """Write map, coverage, trajectories, picture, report and ``run.json`` into `folder`; return what stands in the latter."""
    start_ns = round(float(document["parameters"]["simulation.clock.start"]) * 1e9)
    title = f"{Path(request.drive.world or '').stem}: explored with {request.drive.slam}"
    names = list(document["outputs"])
    with log.stage("write"):
        names += write_trajectories(folder, story, start_ns)
        if explored.grid is not None:
            names += [path.name for path in write_map(folder / "map.yaml", explored.grid)]
            picture = map_png(
                explored.grid,
                trajectory=drive_trajectory(story, story.truth, start_ns),
                start=story.truth[0],
                title=title,
            )
            (folder / "map.png").write_bytes(picture)
            names.append("map.png")
        _write_coverage(folder / "coverage.csv", explored)
    document = {**document, "outputs": sorted([*names, "coverage.csv", "report.html", "run.json"])}
    document["timing"]["stages_s"] = {name: round(seconds, 3) for name, seconds in log.seconds.items()}
    declared = [replace(v.declaration, name=v.key) for v in config.values()]
    declared += [replace(entry, name=f"{SECTION}.{entry.name}") for entry in declarations(ExploreParameters)]
    page = drive_report(
        document, story, title=title, declared=declared, task=exploration_task(document["summary"], _columns(explored))
    )
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "run.json").write_text(to_json(document), encoding="utf-8")
    return document


def _columns(explored: Explored) -> dict[str, list[float]]:
    return {
        name: [float(getattr(point, name)) for point in explored.history]
        for name in ("time_s", "coverage", "free_m2", "driven_m", "frontiers")
    }


def _write_coverage(target: Path, explored: Explored) -> None:
    lines = ["time_s,coverage,free_m2,driven_m,frontiers"]
    for point in explored.history:
        share = f"{point.coverage:.5f}" if math.isfinite(point.coverage) else ""
        lines.append(f"{point.time_s:.2f},{share},{point.free_m2:.3f},{point.driven_m:.3f},{point.frontiers}")
    target.write_text("\n".join(lines) + "\n", encoding="utf-8")
