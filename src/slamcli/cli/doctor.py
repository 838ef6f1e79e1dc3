# SPDX-License-Identifier: MIT
"""``slamcli doctor``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, verbosity_options
from slamcli.cli.recording_options import recording_options

if TYPE_CHECKING:
    from slamcli.recordings.checks import Finding
    from slamcli.recordings.diagnosis import Diagnosis
    from slamcli.recordings.mends import Mends


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@json_option
@recording_options
@verbosity_options
def command(bags: tuple[Path, ...], as_json: bool, mends: Mends, verbosity: int) -> int:
    """Say what is wrong with a recording, and the option that mends it while reading.

    Every message is read. The options below are applied first, so that a mend can be tried: what it mends is no longer
    reported.

    Exit codes: 0 no errors (warnings and notes do not count), 1 errors, 2 wrong usage or not a recording.
    """
    from slamcli.recordings import open_recording
    from slamcli.recordings.diagnosis import diagnose
    from slamcli.runtime import RunLog

    with Console(verbosity) as console:
        log = RunLog(console)
        with (
            open_recording(bags, mends=mends, log=log) as recording,
            log.stage("reading", (recording.end_ns - recording.start_ns) / 1e9),
        ):
            diagnosis = diagnose(recording)
    if as_json:
        print_json(_document(diagnosis), "doctor")
    else:
        click.echo(_text(diagnosis, notes=verbosity >= 0))
    return 1 if diagnosis.count("error") else 0


def _document(diagnosis: Diagnosis) -> dict[str, Any]:
    return {
        "files": [str(path) for path in diagnosis.contents.paths],
        "errors": diagnosis.count("error"),
        "warnings": diagnosis.count("warning"),
        "notes": diagnosis.count("note"),
        "findings": [
            {
                "check": finding.check,
                "severity": finding.severity,
                "topic": finding.topic or None,
                "message": finding.message,
                "stamp_ns": finding.stamp_ns,
                "count": finding.count,
                "mend": finding.mend or None,
            }
            for finding in diagnosis.findings
        ],
        "checks": list(diagnosis.checks),
    }


def _text(diagnosis: Diagnosis, *, notes: bool) -> str:
    lines = [", ".join(str(path) for path in diagnosis.contents.paths[:4])]
    lines += [line for finding in diagnosis.findings if notes or finding.severity != "note" for line in _lines(finding)]
    counts = [(diagnosis.count(severity), severity) for severity in ("error", "warning", "note")]
    told = ", ".join(f"{number} {severity}{'s' * (number != 1)}" for number, severity in counts)
    return "\n".join([*lines, f"{told} from {len(diagnosis.checks)} checks"])


def _lines(finding: Finding) -> list[str]:
    """Return a finding as a line, and a second one with where it begins and what mends it."""
    where = f"{finding.topic}: " if finding.topic else ""
    lines = [f"  {finding.severity:8}{where}{finding.message}"]
    details = [f"first at {finding.stamp_ns / 1e9:.6f} s"] if finding.stamp_ns is not None else []
    details += [f"mend: {finding.mend}"] if finding.mend else []
    if details:
        lines.append(f"          {'; '.join(details)}")
    return lines
