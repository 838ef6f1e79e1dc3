# SPDX-License-Identifier: MIT
"""A comparison as one self-contained page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from slamcli.reports import page
from slamcli.reports.compare_tables import facts, figure_rows, number
from slamcli.reports.svg import Chart, Series, line_chart

_GROUPS = (
    ("Against the truth", ("ate", "rpe", "relations", "truth.", "coverage.time")),
    ("Consistency", ("map.", "revisit.", "scan.", "loop.")),
    ("Agreement between results", ("agreement.",)),
    ("Cost and size", ("",)),
)
_CAPTIONS = {
    "maps.png": "Each map in the same frame (that of the first), at the same scale, with its own trajectory; places with double walls are ringed.",
    "overlay.png": "Walls of all maps over each other: where they agree the colours darken.",
    "trajectories.png": "Trajectories in the same frame, turned and moved onto the truth or the first result.",
}


def comparison_page(
    document: Mapping[str, Any],
    pictures: Mapping[str, bytes],
    errors: Sequence[Series],
    residuals: Sequence[Series],
    against: str,
    command: str,
) -> str:
    """Return the page.

    Parameters
    ----------
    document
        ``compare.json``.
    pictures
        PNG by file name; empty ones are left out.
    errors, residuals
        Distance over time to `against`, and from scans to each result's own map.
    command
        What made it.
    """
    names = [entry["name"] for entry in document["results"]]
    title = " · ".join(names)
    told = "".join(f"<li><b>{escape(e['name'])}</b>: {escape(e['sentence'])}</li>" for e in document["results"])
    images = "".join(
        page.figure(_image(name, data), caption=_CAPTIONS[name]) for name, data in pictures.items() if data
    )
    charts = _chart(f"Distance from {against}", "m", errors) + _chart(
        "Scans to the result's own map, median of each second", "m", residuals
    )
    notes = [
        *document["warnings"],
        *document["notes"],
        *(f"{e['name']}: {note}" for e in document["results"] for note in e["notes"]),
    ]
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="soft">{escape("; ".join(facts(document)))}</p>',
        page.bullets(notes, "warnings") if notes else "",
        page.section("Where each failed", f"<ul>{told}</ul>"),
        page.section("Figures", _tables(document)),
        page.section("Maps and trajectories", images),
        page.section("Over time", charts),
        page.section("Pairs", _pairs(document, names)),
        page.section("What the figures are", page.table(
            ["figure", "key", "unit", "better", "what"],
            [(f["label"], key, f["unit"], f["better"], f["about"]) for key, f in document["figures"].items()], wordy=True,
        )),
        page.section("Runs", _runs(document), f"<pre>{escape(command)}</pre>" if command else ""),
    ]  # fmt: skip
    return page.document(title, body)


def _tables(document: Mapping[str, Any]) -> str:
    """Return a table for each group of figures: a bar behind each value, the best of each row in bold, ranks behind them."""
    rows = figure_rows(document)
    left = list(rows)
    parts = []
    for title, starts in _GROUPS:
        mine = [row for row in left if row[0].startswith(starts)]
        left = [row for row in left if row not in mine]
        if mine:
            parts.append(f"<h3>{escape(title)}</h3>{_table(document, mine)}")
    return "".join(parts)


def _table(
    document: Mapping[str, Any], rows: Sequence[tuple[str, Mapping[str, Any], list[float | None], list[int]]]
) -> str:
    names = [entry["name"] for entry in document["results"]]
    head = "<th>figure</th><th>unit</th>" + "".join(f"<th>{escape(name)}</th>" for name in names)
    lines = []
    for key, figure, values, best in rows:
        most = max((abs(value) for value in values if value is not None), default=0.0)
        cells = ""
        for i, value in enumerate(values):
            text = escape(number(value))
            rank = document["results"][i]["ranks"].get(key)
            if value is not None and i in best:
                text = f"<b>{text}</b>"
            if rank is not None:
                text += f' <span class="soft">{rank}.</span>'
            # A bar says how large a figure is; of one that may be negative it would say nothing.
            shown = value is not None and value > 0 and most > 0 and figure["unit"] != "nat"
            share = 100.0 * value / most if value is not None and shown else 0.0
            bar = f'<div class="bar" style="width:{share:.0f}%;height:.25rem;opacity:.55"></div>' if shown else ""
            cells += f'<td style="min-width:7rem">{text}{bar}</td>'
        arrow = {"lower": "↓", "higher": "↑"}.get(figure["better"], "")
        lines.append(
            f'<tr><td title="{escape(figure["about"])}">{escape(figure["label"])} {arrow}</td><td>{escape(figure["unit"])}</td>{cells}</tr>'
        )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'


def _pairs(document: Mapping[str, Any], names: Sequence[str]) -> str:
    rows = [
        (*pair.split(" "), number(values.get("ate")), number(values.get("map")))
        for pair, values in document["agreement"].items()
    ]
    return (
        page.table(["one", "other", "trajectories apart, m", "maps' F score"], rows, numeric=(2, 3))
        if len(names) > 1
        else ""
    )


def _runs(document: Mapping[str, Any]) -> str:
    rows = []
    for entry in document["results"]:
        given = [*(f"--config {path}" for path in entry["config"]), *(f"--set {setting}" for setting in entry["set"])]
        given += [f"--mode {entry['mode']}"] if entry["mode"] else []
        rows.append((entry["name"], entry["algo"], entry["state"], entry["folder"], " ".join(given) or "as it is"))
    return page.table(["name", "system", "state", "folder", "settings"], rows)


def _chart(title: str, unit: str, series: Sequence[Series]) -> str:
    if not series:
        return ""
    return page.figure(line_chart(Chart(title=title, x_label="time, s", y_label=unit, series=series)), title=title)


def _image(name: str, data: bytes) -> str:
    text = base64.b64encode(data).decode("ascii")
    return page.zoomable(f'<img alt="{escape(name)}" src="data:image/png;base64,{text}">')
