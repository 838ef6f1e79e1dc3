# SPDX-License-Identifier: MIT
"""The report of a robot that drove itself: one page, as that of a mapping run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from slamcli.evaluation.drive_story import DriveStory, GoalStory
from slamcli.parameters import Declaration
from slamcli.reports import page, scales, svg
from slamcli.reports.drive_map import drive_map
from slamcli.reports.run_sections import (
    flat,
    input_table,
    parameter_table,
    reproduction,
    timing_table,
    value_table,
)

_MOST_EVENTS = 120


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What else than driving to goals a robot was to do, in words and figures for the report."""

    title: str
    parts: Sequence[str]
    """HTML of its section."""
    facts: Sequence[tuple[str, str, bool]]
    """Figure, what it is, and whether it is a bad one, for the head of the page."""


def drive_report(
    run: Mapping[str, Any], story: DriveStory, *, title: str, declared: Sequence[Declaration] = (),
    task: Task | None = None,
) -> str:  # fmt: skip
    """Return the report as HTML; the same input gives the same text.

    Parameters
    ----------
    run
        The ``run.json`` document.
    story
        What happened.
    title
        Heading of the page.
    declared
        Declarations of the parameters, for units, defaults and help.
    task
        What the robot was to do, instead of driving to the story's goals.
    """
    subtitle = f"slamcli {run.get('slamcli', '')} · seed {run.get('seed', 0)}"
    return page.document(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            f'<p class="soft">{escape(subtitle)}</p>',
            page.cards(_headline(run, story, task)),
            page.bullets([str(w) for w in run.get("warnings") or ()], "warnings"),
            page.section("Goals", _goals(story.goals)) if task is None else page.section(task.title, *task.parts),
            page.section("Way", _way(story)),
            page.section("Localisation", *_localisation(story)),
            page.section("Speed", *_speeds(story)),
            page.section("What happened", _events(story)),
            page.section("Time per stage", timing_table(run.get("timing") or {})),
            page.section("Notes", page.bullets([str(n) for n in run.get("notes") or ()])),
            page.section("Summary", value_table({k: v for k, v in (run.get("summary") or {}).items() if k != "by_goal"})),
            page.section("Parameters", parameter_table(run, declared)),
            page.section(
                "Input, topics and frames", input_table(run), value_table({**flat(run, "topics"), **flat(run, "frames")})
            ),
            page.section("How to make this again", reproduction(run)),
        ],
    )  # fmt: skip


def _headline(run: Mapping[str, Any], story: DriveStory, task: Task | None) -> list[tuple[str, str, bool]]:
    figures, timing = story.figures(), run.get("timing") or {}
    reached, goals = figures["reached"], figures["goals"]
    facts = [(f"{reached} of {goals}", "goal reached" if goals == 1 else "goals reached", reached < goals)]
    if task is not None:
        facts = list(task.facts)
    facts.append((scales.duration(story.duration_s), "simulated time", False))
    facts.append((f"{story.length_m:.1f} m", "driven", False))
    if figures["ratio"] is not None:
        facts.append((f"{figures['ratio']:.2f} ×", "shortest way", False))
    if figures["clearance_m"] is not None:
        facts.append((f"{figures['clearance_m']:.2f} m", "least clearance", False))
    facts.append((str(figures["collisions"]), "collision" if figures["collisions"] == 1 else "collisions", figures["collisions"] > 0))  # fmt: skip
    facts.append((str(figures["recoveries"]), "recovery" if figures["recoveries"] == 1 else "recoveries", False))
    if figures["localisation_rmse_m"] is not None:
        facts.append((f"{figures['localisation_rmse_m']:.3f} m", "localisation error, root mean square", False))
    if timing.get("realtime_factor"):
        facts.append((f"{float(timing['realtime_factor']):.1f} ×", "real time", False))
    return facts


def _goals(goals: Sequence[GoalStory]) -> str:
    rows = [
        (
            goal.name,
            ", ".join(f"{v:.2f}" for v in goal.goal if math.isfinite(v)),
            f"{goal.end_s - goal.begin_s:.1f}",
            f"{goal.length_m:.2f}",
            _or_dash(goal.optimum_m),
            _or_dash(goal.ratio),
            _or_dash(goal.clearance_m),
            f"{goal.collisions}" + (f" ({goal.caused} caused)" if goal.caused else ""),
            ", ".join(goal.recoveries).replace("_", " ") or "–",
            goal.plans,
            goal.status + (f": {goal.message}" if not goal.succeeded else ""),
        )
        for goal in goals
    ]
    columns = ["goal", "x, y, yaw", "time in s", "driven in m", "shortest in m", "ratio", "clearance in m", "collisions", "recoveries", "plans", "what became of it"]  # fmt: skip
    return page.table(columns, rows, numeric=[2, 3, 4, 5, 6, 9])


def _or_dash(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"


def _way(story: DriveStory) -> str:
    drawing = drive_map(story)
    if not drawing:
        return ""
    told = "Rings are the start and the goals (red: not reached); switches show and hide each way."
    return page.figure(drawing, caption=told)


def _localisation(story: DriveStory) -> list[str]:
    if not np.isfinite(story.estimate).any():
        return []
    found: list[str] = []
    position, heading = story.errors()
    for values, factor, name, unit in ((position, 1e2, "Position", "cm"), (heading, 180.0 / math.pi, "Heading", "°")):
        scaled = values * factor
        known = scaled[np.isfinite(scaled)]
        line = svg.Series(label=name, x=story.times_s, y=scaled, colour=len(found))
        chart = svg.Chart(
            title=f"{name} error", x_label="time in s", y_label=f"{name.lower()} error in {unit}", series=[line]
        )
        rms = float(np.sqrt(np.mean(known**2)))
        told = f"root mean square {rms:.3g} {unit}, mean {known.mean():.3g} {unit}, largest {known.max():.3g} {unit}"
        found.append(page.figure(svg.line_chart(chart), f"{name} error", told))
    return found


def _speeds(story: DriveStory) -> list[str]:
    marks = np.array([event.time_s for event in story.events if event.kind == "recovery"])
    found: list[str] = []
    for column, factor, name, unit in ((0, 1.0, "Forward speed", "m/s"), (2, 180.0 / math.pi, "Turning speed", "°/s")):
        lines = [
            svg.Series(label="asked for", x=story.command_times_s, y=story.commands[:, column] * factor, colour=5),
            svg.Series(label="true", x=story.times_s, y=story.twists[:, column] * factor, colour=0),
        ]
        if not any(len(line.x) for line in lines):
            continue
        chart = svg.Chart(
            title=name, x_label="time in s", y_label=f"{name.lower()} in {unit}",
            series=[line for line in lines if len(line.x)], marks_x=marks, marks_label="recovery" if len(marks) else "",
        )  # fmt: skip
        found.append(page.figure(svg.line_chart(chart), name))
    return found


def _events(story: DriveStory) -> str:
    shown = story.events[:_MOST_EVENTS]
    rows: list[tuple[str, str, str]] = [(f"{e.time_s:.2f}", e.kind, e.message) for e in shown]
    if len(story.events) > len(shown):
        rows.append(("", "", f"and {len(story.events) - len(shown)} more"))
    return page.table(["time in s", "what", "why"], rows, numeric=[0], wordy=True)
