# SPDX-License-Identifier: MIT
"""The summary of a fleet: what became of each input, as JSON, CSV, Markdown and a page."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli import __version__
from slamcli.outputs import atomic_file
from slamcli.pipelines.job_process import JobOutcome
from slamcli.pipelines.remote_files import plain_url
from slamcli.pipelines.sources import Source
from slamcli.reports.fleet_report import fleet_markdown, fleet_page
from slamcli.runtime import RunLog

_STATES = ("done", "missed", "failed")
"""With its result; with its result, and a threshold missed; without."""


def summarise(
    command: str,
    words: Sequence[str],
    sources: Sequence[Source],
    outcomes: Sequence[JobOutcome],
    output: Path,
    log: RunLog,
) -> dict[str, Any]:
    """Return the ``summary.json`` document; what may differ from run to run lies under ``timing`` and ``peak_memory_bytes``."""
    rows = [_row(source, outcome, output) for source, outcome in zip(sources, outcomes, strict=True)]
    counts = {state: sum(row["state"] == state for row in rows) for state in _STATES}
    return {
        "schema": "slamcli.summary.1",
        "slamcli": __version__,
        "command": command,
        "options": list(words),
        "counts": {"inputs": len(rows), **counts},
        "runs": rows,
        "warnings": list(log.warnings),
    }


def write_summary(output: Path, document: Mapping[str, Any]) -> None:
    """Write summary.json, .csv and .md, report.html and run.json."""
    text = json.dumps(document, indent=2) + "\n"
    names = ["report.html", "run.json", "summary.csv", "summary.json", "summary.md"]
    run = {**document, "schema": "slamcli.run.1", "outputs": names}
    del run["runs"]
    for name, content in (
        ("summary.json", text), ("summary.md", fleet_markdown(document)), ("report.html", fleet_page(document)),
        ("run.json", json.dumps(run, indent=2) + "\n"),
    ):  # fmt: skip
        with atomic_file(output / name) as stream:
            stream.write(content)
    with atomic_file(output / "summary.csv") as stream:
        _write_csv(stream, document["runs"])


def _row(source: Source, outcome: JobOutcome, output: Path) -> dict[str, Any]:
    state = "done" if outcome.done else "missed" if outcome.missed else "failed"
    there = state != "failed"
    run = _read_run(output / source.name) if there else {}
    timing = run.get("timing", {})
    report = output / source.name / "report.html"
    return {
        "name": source.name,
        "state": state,
        "input": plain_url(source.text) if source.is_remote else source.text,
        "output": source.name if there else None,
        "report": f"{source.name}/report.html" if there and report.exists() else None,
        "exit_code": outcome.exit_code,
        "message": "" if outcome.done else reason(outcome),
        "figures": dict(_figures(run.get("summary", {}))),
        "warnings": len(run.get("warnings", ())),
        "timing": {
            "wall_s": round(outcome.wall_s, 3),
            "cpu_s": round(outcome.cpu_s, 3),
            "realtime_factor": timing.get("realtime_factor"),
            "reused": outcome.reused,
        },
        "peak_memory_bytes": outcome.peak_memory_bytes,
    }


def reason(outcome: JobOutcome) -> str:
    """Return why a run was not done."""
    return outcome.message.removeprefix("slamcli: ").removeprefix("warning: ")


def _read_run(folder: Path) -> dict[str, Any]:
    try:
        document = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}


def _figures(value: Any, key: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of a nested summary, by its keys joined with dots."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _figures(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value):
        yield key, value


def _write_csv(stream: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    keys = list(dict.fromkeys(key for row in rows for key in row["figures"]))
    plain = ["name", "state", "input", "exit_code", "message", "warnings"]
    timing = ["wall_s", "cpu_s", "realtime_factor"]
    table = csv.writer(stream, lineterminator="\n")
    table.writerow([*plain, *keys, *timing, "peak_memory_bytes"])
    for row in rows:
        figures = [row["figures"].get(key, "") for key in keys]
        times = [row["timing"][key] if row["timing"][key] is not None else "" for key in timing]
        table.writerow([*(row[key] for key in plain), *figures, *times, row["peak_memory_bytes"]])
