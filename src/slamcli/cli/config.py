# SPDX-License-Identifier: MIT
"""``slamcli config``: resolved parameters, and a lint of native configuration files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option

if TYPE_CHECKING:
    from slamcli.native.checks import Finding
    from slamcli.pipelines.config_show import ResolvedParameter


@click.group()
def command() -> None:
    """Show resolved parameters; check native configuration files."""


@command.command("show", short_help="Print every parameter, its value and its source.")
@click.option(
    "--algo",
    default="gmapping",
    show_default=True,
    help="A SLAM system, or navigation (the whole stack), plan (what plan reads), simulation (what generate reads).",
)
@click.option(
    "--config",
    "files",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Native file of the system (launch, YAML, Lua, .ini); may be given several times, later ones win.",
)
@click.option("--set", "sets", multiple=True, metavar="KEY=VALUE", help="One parameter under its native name.")
@click.option("--arg", "arguments", multiple=True, metavar="NAME=VALUE", help="Value for an argument of a launch file.")
@click.option("--changed", is_flag=True, help="Only parameters that were given.")
@click.option("--ini", "as_ini", is_flag=True, help="Print an .ini file that RTAB-Map's own tools read (rtabmap only).")
@json_option
def show_command(
    algo: str, files: Sequence[Path], sets: Sequence[str], arguments: Sequence[str], changed: bool, as_ini: bool, as_json: bool,
) -> int:  # fmt: skip
    """Print every parameter with its value, unit, range, default and source.

    Values come from the defaults, over them the files in their order, over them --set. An asterisk marks what differs
    from the default.
    """
    from slamcli.pipelines.config_show import show
    from slamcli.runtime import RunLog

    if as_ini and (algo != "rtabmap" or as_json):
        raise click.UsageError("--ini prints the file format of rtabmap: with --algo rtabmap, without --json")
    log = RunLog()
    shown = show(algo, files, sets, log, _launch_arguments(arguments))
    rows = [row for row in shown.parameters if row.source != "default" or not changed]
    with Console() as console:
        console.tell(log)
    if as_ini:
        from slamcli.native.rtabmap_ini import format_rtabmap_ini

        click.echo(format_rtabmap_ini({row.declaration.name: row.value for row in rows}), nl=False)
    elif as_json:
        print_json(
            {"algo": algo, "parameters": [_as_record(row) for row in rows], "remaps": dict(shown.remaps)},
            "config-show",
        )
    else:
        _print_list(rows)
    return 0


@command.command("check", short_help="Say what is wrong with native configuration files.")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="FILE...")
@click.option("--beams", type=click.IntRange(min=1), help="Beams of your scanner, for parameters that depend on it.")
@click.option(
    "--range",
    "range_m",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="METRES",
    help="How far your scanner sees, likewise.",
)
@click.option("--strict", is_flag=True, help="Exit with 1 for warnings as well.")
@json_option
def check_command(files: Sequence[Path], beams: int | None, range_m: float | None, strict: bool, as_json: bool) -> int:
    """Say what is wrong with native files: launch files, ROS parameter YAML, map YAML, Lua, .ini of RTAB-Map.

    An error is what the real system refuses or ignores: an unknown name, a wrong type, a value out of range. A warning
    is a value that does not do what it seems to. Exits with 1 if there is an error.
    """
    from slamcli.pipelines.config import check

    findings = check(files, beams, range_m)
    counts = {kind: sum(f.severity == kind for f in findings) for kind in ("error", "warning", "note")}
    if as_json:
        print_json({"findings": [_as_finding(finding) for finding in findings], "counts": counts}, "config-check")
    else:
        for finding in findings:
            click.echo(f"{finding.place}: {finding.severity}: {finding.message}")
        click.echo(", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in counts.items()), err=True)
    return 1 if counts["error"] or (strict and counts["warning"]) else 0


def _launch_arguments(texts: Sequence[str]) -> dict[str, str]:
    arguments = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator or not name.rstrip(":"):
            raise click.BadParameter(f"{text!r}: write NAME=VALUE", param_hint="--arg")
        arguments[name.rstrip(":")] = value  # roslaunch writes NAME:=VALUE
    return arguments


def _as_finding(finding: Finding) -> dict[str, Any]:
    return {
        "severity": finding.severity,
        "file": finding.file,
        "line": finding.line or None,
        "message": finding.message,
    }


def _as_record(row: ResolvedParameter) -> dict[str, Any]:
    entry = row.declaration
    return {
        "name": entry.name,
        "value": row.value,
        "source": row.source,
        "changed": row.changed,
        "default": entry.default,
        "type": entry.kind.__name__,
        "unit": entry.unit,
        "minimum": entry.minimum,
        "maximum": entry.maximum,
        "choices": list(entry.choices),
        "effective": entry.effective,
        "extension": entry.extension,
        "help": entry.help,
    }


def _print_list(rows: Sequence[ResolvedParameter]) -> None:
    """One line per parameter, its meaning below; an asterisk marks what differs from the default."""
    for row in rows:
        entry = row.declaration
        value = f"{shown_value(row.value)} {entry.unit}".strip()
        facts = [
            f"default {shown_value(entry.default)}" if row.changed else "",
            bounds(entry.minimum, entry.maximum, entry.choices),
        ]
        facts.append(f"from {row.source}" if row.source != "default" else "")
        facts.append("slamcli's own" if entry.extension else "")
        facts.append("no effect here" if not entry.effective else "")
        told = "; ".join(fact for fact in facts if fact)
        line = click.style(f"{'*' if row.changed else ' '} {entry.name} = {value}", bold=row.changed)
        click.echo(f"{line}   ({told})" if told else line)
        click.echo(f"      {entry.help}")


def shown_value(value: Any) -> str:
    """Return a value as it is written in a configuration; auto is what is derived from the data."""
    if value is None:
        return "auto"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def bounds(minimum: float | None, maximum: float | None, choices: Sequence[str]) -> str:
    """Return the range of a parameter in words."""
    if choices:
        return " | ".join(choices)
    if minimum is None and maximum is None:
        return ""
    if maximum is None:
        return f"≥ {minimum:g}"
    return f"≤ {maximum:g}" if minimum is None else f"{minimum:g} … {maximum:g}"
