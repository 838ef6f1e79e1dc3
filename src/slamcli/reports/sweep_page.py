# SPDX-License-Identifier: MIT
"""The report of a sweep: one HTML page with the table, a plot per parameter, and what the time buys."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from slamcli.reports import page
from slamcli.reports.sweep_charts import cost_chart, pair_chart, parameter_chart
from slamcli.reports.sweep_tables import numeric_columns, set_columns, set_rows, short
from slamcli.reports.sweep_views import cost_view, pair_view, parameter_views


def sweep_page(document: Mapping[str, Any]) -> str:
    """Return the report as HTML that loads nothing; `document` is that of ``sweep.json``."""
    names = ", ".join(recording["name"] for recording in document["recordings"])
    title = f"{names} · sweep of {document['algo']}"
    return page.document(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            f'<p class="soft">slamcli {escape(document["slamcli"])}</p>',
            page.cards(_cards(document)),
            f"<p>{escape(document['verdict'][0].upper() + document['verdict'][1:])}.</p>",
            page.bullets(document["warnings"], "warnings"),
            page.section(
                "Sets", page.table(set_columns(document), set_rows(document), numeric=numeric_columns(document))
            ),
            page.section("Parameters", *_parameters(document)),
            page.section("Pairs of values", _pairs(document)),
            page.section("What time buys", _cost(document)),
            page.section("Runs that failed", _failures(document)),
            page.section("Notes", page.bullets(document["notes"])),
            page.section("How to make this again", _again(document)),
        ],
    )


def _cards(document: Mapping[str, Any]) -> list[tuple[str, str, bool]]:
    best = document["sets"][0]
    failed = sum(one["failed"] for one in document["sets"])
    objective = document["objective"]
    unit = " × baseline" if objective["relative"] else ""
    return [
        (f"{short(best['median'])}{unit}", f"{objective['key']} of the best set, median", False),
        (str(len(document["sets"])), "sets of parameters", False),
        (str(len(document["seeds"])), "seed" if len(document["seeds"]) == 1 else "seeds of each", False),
        (str(len(document["runs"])), "runs", False),
        (str(failed), "failed", failed > 0),
    ]


def _parameters(document: Mapping[str, Any]) -> list[str]:
    told = {parameter["name"]: parameter for parameter in document["parameters"]}
    return [
        page.figure(parameter_chart(view, document), view.label, str(told[view.name]["help"]))
        for view in parameter_views(document)
    ]


def _pairs(document: Mapping[str, Any]) -> str:
    pair = pair_view(document)
    if pair is None:
        return ""
    return page.figure(
        pair_chart(pair, document), caption="Median over the seeds; the stronger the colour, the better."
    )


def _cost(document: Mapping[str, Any]) -> str:
    cost = cost_view(document)
    if cost is None:
        return ""
    return page.figure(
        cost_chart(cost, document),
        caption="Each point is a set: time and objective of its median run. On the line are those that no other beats in both.",
    )


def _failures(document: Mapping[str, Any]) -> str:
    failed = [run for run in document["runs"] if run["failure"]]
    labels = {one["id"]: one["label"] for one in document["sets"]}
    rows = [[labels[run["set"]], run["recording"], run["seed"], run["failure"]] for run in failed]
    return page.table(["set", "recording", "seed", "why"], rows, numeric=(2,))


def _again(document: Mapping[str, Any]) -> str:
    parts = [f"<pre>{escape(document['command'])}</pre>"] if document["command"] else []
    best = document["best"]
    if best.get("command"):
        parts.append(f"<p>The best run alone:</p><pre>{escape(best['command'])}</pre>")
    return "".join(parts)
