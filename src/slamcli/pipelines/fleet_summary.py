# SPDX-License-Identifier: MIT
"""The summary of a fleet: what became of each input, as JSON, CSV, Markdown and a page."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from slamcli import __version__
from slamcli.outputs import atomic_file
from slamcli.pipelines.job_process import JobOutcome
from slamcli.pipelines.remote_files import plain_url
from slamcli.pipelines.run_record import run_document, to_json
from slamcli.pipelines.schemas import stamped
from slamcli.pipelines.sources import Source, is_url
from slamcli.reports.fleet_report import fleet_markdown, fleet_page
from slamcli.reports.junit import JunitCase, junit_xml
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
    document = {
        "slamcli": __version__, "command": command, "options": [_shown(word) for word in words], "counts": {"inputs": len(rows), **counts},
        "runs": rows, "warnings": list(log.warnings),
    }  # fmt: skip
    return stamped("summary", document)


def write_summary(output: Path, document: Mapping[str, Any], log: RunLog, total_s: float) -> None:
    """Write summary.json, .csv and .md, report.html and run.json."""
    for name, content in (
        ("summary.json", json.dumps(document, indent=2) + "\n"), ("summary.md", fleet_markdown(document)),
        ("summary.csv", _csv(document["runs"])), ("report.html", fleet_page(document)),
        ("run.json", to_json(_run_record(output, document, log, total_s))),
    ):  # fmt: skip
        with atomic_file(output / name) as stream:
            stream.write(content)


def _run_record(output: Path, document: Mapping[str, Any], log: RunLog, total_s: float) -> dict[str, Any]:
    """Return the ``run.json`` of the whole: what the runs read, and what is the same for all of them."""
    runs = [_read_run(output / row["output"]) for row in document["runs"] if row["output"] is not None]
    first = runs[0] if runs else {}
    return run_document(
        command=f"{document['command']} --each", algo=first.get("algo", ""), seed=first.get("seed", 0), jobs=1,
        parameters={"options": document["options"]}, changed={}, topics={}, frames={}, log=log,
        inputs=[entry for run in runs for entry in run.get("inputs", ())], total_s=total_s,
        duration_s=sum(run.get("timing", {}).get("recording_s", 0.0) for run in runs), summary=document["counts"],
        outputs=["report.html", "run.json", "summary.csv", "summary.json", "summary.md"],
    )  # fmt: skip


def junit_of(document: Mapping[str, Any]) -> str:
    """Return the summary as JUnit XML: a test case per input, a failure for a missed threshold, an error for a failed run."""
    cases = [
        JunitCase(
            name=row["name"], classname=f"slamcli.{document['command']}", seconds=row["timing"]["wall_s"],
            failure=row["message"] if row["state"] == "missed" else None,
            error=row["message"] if row["state"] == "failed" else None,
            output="\n".join(f"{key} = {value:.9g}" for key, value in row["figures"].items()),
        )
        for row in document["runs"]
    ]  # fmt: skip
    return junit_xml(f"slamcli {document['command']}", cases, {"slamcli": __version__})


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


def _shown(word: str) -> str:
    """Return a word of a command line without what an address hides."""
    flag, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return f"{flag}{equals}{plain_url(value) if is_url(value) else value}"


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


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    keys = list(dict.fromkeys(key for row in rows for key in row["figures"]))
    plain = ["name", "state", "input", "exit_code", "message", "warnings"]
    timing = ["wall_s", "cpu_s", "realtime_factor"]
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow([*plain, *keys, *timing, "peak_memory_bytes"])
    for row in rows:
        figures = [row["figures"].get(key, "") for key in keys]
        times = [row["timing"][key] if row["timing"][key] is not None else "" for key in timing]
        table.writerow([*(row[key] for key in plain), *figures, *times, row["peak_memory_bytes"]])
    return stream.getvalue()
