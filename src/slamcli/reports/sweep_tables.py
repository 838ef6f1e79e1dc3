# SPDX-License-Identifier: MIT
"""The sets of a sweep as a table: for the terminal, Markdown and HTML; and its runs as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from slamcli.reports.sweep_views import digits, objective_label

_SHORT = {"within the spread": "within spread", "same": "same", "one run": "one run", "no value": "–"}


def short(value: Any) -> str:
    """Return a value for a person: four digits of a number, a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def set_columns(document: Mapping[str, Any]) -> list[str]:
    """Return the headings of the table of sets."""
    names = [parameter["name"] for parameter in document["parameters"]]
    objective = document["objective"]
    key = f"{objective['key']} / baseline" if objective["relative"] else objective_label(document)
    together = ["mean rank"] if objective["relative"] else []
    return [
        "rank",
        *names,
        *together,
        key,
        *(["quartiles", "range"] if _has_spread(document) else []),
        "failed",
        "against the baseline",
        "time s",
        "x real time",
        "MB",
    ]


def _has_spread(document: Mapping[str, Any]) -> bool:
    return any(one["count"] > 1 for one in document["sets"])


def set_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Return one row per set, the best first; the baseline's values are marked."""
    return [_row(one, document) for one in document["sets"]]


def _row(one: Mapping[str, Any], document: Mapping[str, Any]) -> list[str]:
    values = [short(one["values"][parameter["name"]]) for parameter in document["parameters"]]
    total = one["count"] + one["failed"]
    spread = [""] * 2
    if one["count"] > 1:
        spread = [
            f"{_figure(one[low])} … {_figure(one[high])}" for low, high in (("lower", "upper"), ("minimum", "maximum"))
        ]
    timing = one["timing"]
    return [
        str(one["rank"]),
        *values,
        *([short(one["mean_rank"])] if document["objective"]["relative"] else []),
        _figure(one["median"]),
        *(spread if _has_spread(document) else []),
        f"{one['failed']}/{total}" if one["failed"] else "0",
        _against(one),
        short(timing["total_s"]),
        short(timing["realtime_factor"]),
        f"{one['peak_memory_bytes'] / 1e6:.0f}" if one["peak_memory_bytes"] else "–",
    ]


def _figure(value: float | None) -> str:
    return "–" if value is None else digits(value)


def _against(one: Mapping[str, Any]) -> str:
    if one["baseline"]:
        return "baseline"
    against = one["against_baseline"]
    word = _SHORT.get(against["verdict"], against["verdict"])
    if against["pairs"] > 1 and against["verdict"] != "same":
        word += f" ({against['better_in']}/{against['pairs']})"
    return str(word)


def numeric_columns(document: Mapping[str, Any]) -> list[int]:
    """Return the columns of the table of sets that are set to the right."""
    columns = set_columns(document)
    return [i for i, name in enumerate(columns) if name != "against the baseline"]


def sweep_text(document: Mapping[str, Any], most: int = 30) -> str:
    """Return table and verdict for a terminal; of more than `most` sets the best ones and the baseline."""
    from slamcli.reports.tables import table_text

    rows = set_rows(document)
    shown = [row for i, row in enumerate(rows) if i < most or document["sets"][i]["baseline"]]
    parts = [table_text(set_columns(document), shown, numeric=numeric_columns(document))]
    if len(shown) < len(rows):
        parts.append(f"and {len(rows) - len(shown)} more sets (sweep.md, sweep.csv)")
    return "\n".join([*parts, "", document["verdict"]])


def sweep_markdown(document: Mapping[str, Any]) -> str:
    """Return table, verdict and remarks as Markdown."""
    objective, best = document["objective"], document["best"]
    names = ", ".join(recording["name"] for recording in document["recordings"])
    lines = [
        f"# Sweep of {document['algo']} on {names}",
        "",
        f"{document['verdict'][0].upper()}{document['verdict'][1:]}.",
        "",
    ]
    lines += [f"Ranked by `{objective['key']}` ({objective['best']} is best), seeds {_seeds(document['seeds'])}.", ""]
    columns, right = set_columns(document), numeric_columns(document)
    lines.append(f"| {' | '.join(map(_cell, columns))} |")
    lines.append("|" + "|".join("---:" if i in right else "---" for i in range(len(columns))) + "|")
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in set_rows(document)]
    if best.get("command"):
        lines += ["", "The best run again:", "", "```", best["command"], "```"]
    for title, key in (("Warnings", "warnings"), ("Notes", "notes")):
        if document[key]:
            lines += ["", f"## {title}", "", *(f"- {line}" for line in document[key])]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _seeds(seeds: Sequence[int]) -> str:
    return str(seeds[0]) if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"


def runs_csv(document: Mapping[str, Any]) -> str:
    """Return one line per run: what it was, its values, every figure, then what may differ from time to time."""
    runs = document["runs"]
    ranks = {one["id"]: one["rank"] for one in document["sets"]}
    names = [parameter["name"] for parameter in document["parameters"]]
    figures = sorted({key for run in runs for key in run["figures"]})
    timing = sorted({key for run in runs for key in run["timing"]})
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        ["run", "rank", "recording", "seed", *names, "objective", "failure", *figures,
         *(f"timing.{key}" for key in timing), "peak_memory_bytes"]
    )  # fmt: skip
    for run in runs:
        writer.writerow(
            [run["id"], ranks[run["set"]], run["recording"], run["seed"], *(_plain(run["values"][name]) for name in names),
             _plain(run["objective"]), run["failure"], *(_plain(run["figures"].get(key)) for key in figures),
             *(_plain(run["timing"].get(key)) for key in timing), run["peak_memory_bytes"]]
        )  # fmt: skip
    return stream.getvalue()


def _plain(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
