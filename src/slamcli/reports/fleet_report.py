# SPDX-License-Identifier: MIT
"""What a fleet came to, for a person: a table on the terminal, in Markdown, and as a page with links to every report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any
from urllib.parse import quote

from slamcli.reports import page
from slamcli.reports.tables import table_text

_MOST_FIGURES = 4
_FIRST = ("ate.rmse", "rpe.rmse", "relations.trans.mean", "relations.rot_deg.mean", "poses", "path_length_m")
"""Figures that say most, if there are such: they get a column each; all others stand in summary.csv."""
_OTHERS = {"missed": "missed a threshold", "failed": "failed"}
_NAMES = {"path_length_m": "path, m", "poses": "poses", "realtime_factor": "× real time"}


def fleet_text(document: Mapping[str, Any], width: int | None = None) -> str:
    """Return the table for a terminal; where it is narrower than the table, what says least is left out (it stands in the files)."""
    columns, rows, numeric = _table(document)
    spare = ["message", "warnings", "× real time", "MB", *reversed(columns[3:-5]), "s"]
    while width is not None and spare and _width(columns, rows) > width:
        gone = columns.index(spare.pop(0))
        columns, rows = columns[:gone] + columns[gone + 1 :], [row[:gone] + row[gone + 1 :] for row in rows]
    return table_text(
        columns, rows, numeric=[i for i in numeric if i < len(columns) and columns[i] != "message"], width=width
    )


def _width(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> int:
    """Return how many characters the table is wide."""
    cells = zip(columns, *([_plain(value) for value in row] for row in rows), strict=True)
    return sum(max(map(len, column)) + 3 for column in cells)


def fleet_markdown(document: Mapping[str, Any]) -> str:
    """Return the table as Markdown, headed by the counts."""
    columns, rows, numeric = _table(document)
    rule = ["---:" if i in numeric else "---" for i in range(len(columns))]
    cells = [columns, rule, *[[_plain(value) for value in row] for row in rows]]
    lines = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in cells]
    return f"# slamcli {document['command']}: {_counts(document)}\n\n" + "\n".join(lines) + "\n"


def fleet_page(document: Mapping[str, Any]) -> str:
    """Return the page."""
    columns, rows, numeric = _table(document)
    links = [run["report"] for run in document["runs"]]
    counts = document["counts"]
    facts = [(f"{counts['inputs']}", "inputs", False), (f"{counts['done']}", "done", False)]
    facts += [(f"{counts[state]}", words, True) for state, words in _OTHERS.items() if counts[state]]
    return page.document(
        f"slamcli {document['command']}: {_counts(document)}",
        [
            f"<h1>slamcli {escape(document['command'])}: {escape(_counts(document))}</h1>",
            f"<pre>{escape(' '.join(document['options']))}</pre>" if document["options"] else "",
            page.cards(facts),
            page.bullets(document["warnings"], "warnings"),
            page.section("What went wrong", page.bullets(_troubles(document), "warnings", most=1000)),
            page.section("Runs", _linked_table(columns[:-1], [row[:-1] for row in rows], numeric, links)),
        ],
    )


def _troubles(document: Mapping[str, Any]) -> list[str]:
    return [f"{run['name']}: {run['message']}" for run in document["runs"] if run["message"]]


def _counts(document: Mapping[str, Any]) -> str:
    counts = document["counts"]
    others = [f", {counts[state]} {words}" for state, words in _OTHERS.items() if counts[state]]
    return f"{counts['done']} of {counts['inputs']} done{''.join(others)}"


def _table(document: Mapping[str, Any]) -> tuple[list[str], list[list[Any]], list[int]]:
    """Return columns, rows, and which columns hold numbers."""
    runs: Sequence[Mapping[str, Any]] = document["runs"]
    known = list(dict.fromkeys(key for run in runs for key in run["figures"]))
    telling = sorted((key for key in known if _rank(key) < len(_FIRST)), key=_rank)
    keys = sorted((telling or known)[:_MOST_FIGURES], key=known.index)
    columns = [
        "name",
        "state",
        *(_NAMES.get(key, key) for key in keys),
        "× real time",
        "s",
        "MB",
        "warnings",
        "message",
    ]
    rows = [
        [
            run["name"], run["state"], *(_short(run["figures"].get(key)) for key in keys), run["timing"]["realtime_factor"] or None,
            round(run["timing"]["wall_s"], 1), round(run["peak_memory_bytes"] / 1e6), run["warnings"], run["message"],
        ]
        for run in runs
    ]  # fmt: skip
    return columns, rows, list(range(2, len(columns) - 1))


def _short(value: Any) -> Any:
    """Return a figure with four digits; all of them stand in summary.csv."""
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _rank(key: str) -> int:
    """Return how early a figure comes."""
    return next((i for i, end in enumerate(_FIRST) if key == end or key.endswith(f".{end}")), len(_FIRST))


def _linked_table(
    columns: Sequence[str], rows: Sequence[Sequence[Any]], numeric: Sequence[int], links: Sequence[str | None]
) -> str:
    kinds = [' class="n"' if i in numeric else "" for i in range(len(columns))]
    head = "".join(f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, columns, strict=True))
    body = []
    for row, link in zip(rows, links, strict=True):
        cells = [escape(_plain(value)) for value in row]
        if link is not None:
            cells[0] = f'<a style="color:var(--c0)" href="{escape(quote(link))}">{cells[0]}</a>'
        body.append("".join(f"<td{kind}>{cell}</td>" for kind, cell in zip(kinds, cells, strict=True)))
    lines = "".join(f"<tr>{cells}</tr>\n" for cells in body)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div>'


def _plain(value: Any) -> str:
    return page.plain(value)
