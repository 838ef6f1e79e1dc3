# SPDX-License-Identifier: MIT
"""A comparison as tables: for the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from slamcli.reports.tables import table_text

_TIMED = ("realtime_factor", "cpu_s", "peak_memory_mb")
_STATES = {"ran": "", "given": "given", "failed": "failed", "cannot run": "cannot run"}


def figure_rows(document: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any], list[float | None], list[int]]]:
    """Return for each figure its key, what it is, its value for each result (None: not there) and the places of the best ones."""
    results = document["results"]
    rows = []
    for key, figure in document["figures"].items():
        values = [_value(entry, key) for entry in results]
        known = [value for value in values if value is not None]
        best: list[int] = []
        if figure["better"] != "neither" and len(set(known)) > 1:
            top = min(known) if figure["better"] == "lower" else max(known)
            best = [i for i, value in enumerate(values) if value == top]
        rows.append((key, figure, values, best))
    return rows


def comparison_text(document: Mapping[str, Any], width: int | None = None) -> str:
    """Return the table of figures, the best of each row with a star, and a sentence for each result."""
    names = [entry["name"] for entry in document["results"]]
    rows = [
        [figure["label"], figure["unit"], *(_starred(value, i in best) for i, value in enumerate(values)), key]
        for key, figure, values, best in figure_rows(document)
    ]
    table = table_text(
        ["figure", "unit", *names, "key"], rows, numeric=range(2, 2 + len(names)), width=width
    )  # fmt: skip
    return "\n".join([table, "", *_sentences(document)])


def comparison_markdown(document: Mapping[str, Any]) -> str:
    """Return the comparison as Markdown: inputs, the table with the best of each row in bold, sentences, what figures mean."""
    names = [_cell(entry["name"]) for entry in document["results"]]
    lines = [f"# {_title(document)}", "", *(f"- {line}" for line in facts(document)), ""]
    lines += [f"| figure | unit | {' | '.join(names)} |", f"|---|---|{'---:|' * len(names)}"]
    for _, figure, values, best in figure_rows(document):
        cells = [f"**{number(v)}**" if i in best else number(v) for i, v in enumerate(values)]
        lines.append(f"| {figure['label']} | {figure['unit']} | {' | '.join(cells)} |")
    lines += ["", "## Where each failed", "", *(f"- {_escaped(sentence)}" for sentence in _sentences(document))]
    lines += ["", "## What the figures are", "", "| figure | key | better | what |", "|---|---|---|---|"]
    lines += [
        f"| {figure['label']} | `{key}` | {figure['better']} | {figure['about']} |"
        for key, figure in document["figures"].items()
    ]
    notes = [
        *document["warnings"],
        *document["notes"],
        *(f"{e['name']}: {note}" for e in document["results"] for note in e["notes"]),
    ]
    if notes:
        lines += ["", "## Notes", "", *(f"- {_escaped(note)}" for note in notes)]
    return "\n".join(lines) + "\n"


def facts(document: Mapping[str, Any]) -> list[str]:
    """Return what was compared on what, line by line."""
    inputs = ", ".join(entry["name"] for entry in document["inputs"]) or "finished results alone"
    truth = ", ".join(f"{kind} {path}" for kind, path in document["references"].items())
    lines = [f"recording: {inputs}", f"ground truth: {truth or 'none'}"]
    if document["workers"] > 1:
        lines.append(f"{document['workers']} runs at once: they disturbed each other's times")
    return lines


def number(value: float | None) -> str:
    """Return a figure with three to four digits; a dash for none."""
    if value is None:
        return "–"
    size = abs(value)
    if size >= 1000 or (size >= 1 and float(value).is_integer()):
        return f"{value:,.0f}"
    return (
        f"{value:.1f}"
        if size >= 100
        else f"{value:.2f}"
        if size >= 10
        else f"{value:.3f}"
        if size >= 1
        else f"{value:.4f}"
    )


def _title(document: Mapping[str, Any]) -> str:
    return " · ".join(entry["name"] for entry in document["results"])


def _value(entry: Mapping[str, Any], key: str) -> float | None:
    source = entry["timing"] if key in _TIMED else entry["figures"]
    value = source.get(key)
    return None if value is None else float(value)


def _starred(value: float | None, best: bool) -> str:
    return number(value) + (" *" if best else "  ")


def _sentences(document: Mapping[str, Any]) -> Sequence[str]:
    return [f"{entry['name']}: {entry['sentence']}" for entry in document["results"]]


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _escaped(text: str) -> str:
    return " ".join(text.split()).replace("<", "&lt;")
