# SPDX-License-Identifier: MIT
"""What a robot explored, as part of the report of its drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slamcli.reports import page, svg
from slamcli.reports.drive_report import Task

_DEFINED = (
    "Share of the free cells that hold together with the start in the true world, and that lie within 0.1 m of a cell which the"
    " map has as free."
)


def exploration_task(summary: Mapping[str, Any], columns: Mapping[str, Sequence[float]]) -> Task:
    """Return the section and the head figures of an exploration.

    Parameters
    ----------
    summary
        That of ``run.json``.
    columns
        ``time_s``, ``coverage`` (0 to 1), ``driven_m`` and ``frontiers``, of one length.
    """
    share = summary["coverage"]
    facts = [("–" if share is None else f"{100.0 * share:.1f} %", "of the reachable area covered", share is None or share < 0.98)]  # fmt: skip
    facts.append((str(summary["status"]), "explored", summary["status"] != "done"))
    times = np.asarray(columns["time_s"])
    parts = [page.bullets([_told(summary)])]
    if len(times) > 1:
        for name, title, unit, factor, words in (
            ("coverage", "Coverage", "%", 100.0, _DEFINED),
            (
                "frontiers",
                "Frontiers",
                "number",
                1.0,
                "Frontiers that can be reached, at the last search before each moment.",
            ),
        ):
            line = svg.Series(label=title, x=times, y=factor * np.asarray(columns[name]), colour=0)
            chart = svg.Chart(
                title=title, x_label="time in s", y_label=f"{title.lower()} in {unit}" if unit == "%" else title.lower(),
                series=[line],
            )  # fmt: skip
            parts.append(page.figure(svg.line_chart(chart), title, words))
    return Task(title="Exploration", parts=parts, facts=facts)


def _told(summary: Mapping[str, Any]) -> str:
    after = [f"{100 * float(level):g} % after {time_s:.0f} s" for level, time_s in summary["coverage_after_s"].items() if time_s]  # fmt: skip
    words = f"{summary['message']}; {summary['goals']} goals, {summary['goals_reached']} of them driven up to, {summary['goals_given_up']} given up"
    return f"{words}; coverage {', '.join(after)}" if after else words
