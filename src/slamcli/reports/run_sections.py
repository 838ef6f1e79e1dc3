# SPDX-License-Identifier: MIT
"""Sections that the report of any run has: what its ``run.json`` says as tables."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from slamcli.parameters import Declaration
from slamcli.reports import page

_NO_STAGE = ("total_s", "realtime_factor", "recording_s", "jobs")


def timing_table(timing: Mapping[str, Any]) -> str:
    """Return the time that stages took, with their share of the whole."""
    total = timing.get("total_s")
    nested = timing.get("stages_s") or timing.get("stages")
    stages = nested if isinstance(nested, Mapping) else timing
    rows = [
        (str(name), float(value))
        for name, value in stages.items()
        if isinstance(value, (int, float)) and name not in _NO_STAGE
    ]
    if not rows:
        return ""
    whole = max(float(total or 0.0), sum(v for _, v in rows), 1e-9)
    body = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{value:.3f} s</td><td class="n">{100 * value / whole:.1f} %</td>'
        f'<td class="wide"><div class="bar" style="width:{100 * value / whole:.1f}%"></div></td></tr>\n'
        for name, value in rows
    )
    return f'<div class="scroll"><table><tbody>{body}</tbody></table></div>'


def value_table(values: Mapping[str, Any]) -> str:
    """Return the values of a document, those of inner documents under their path of names."""
    return page.table(["what", "value"], [(name.replace("_", " "), value) for name, value in _leaves(values)])


def _leaves(values: Mapping[str, Any], prefix: str = "", depth: int = 3) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a document, those of inner documents under their path of names."""
    for key, value in values.items():
        name = f"{prefix} {key}" if prefix else str(key)
        if isinstance(value, Mapping) and value and depth > 0:
            yield from _leaves(value, name, depth - 1)
        elif value or not isinstance(value, Mapping):  # of an empty document there is nothing to say
            yield name, value


def flat(run: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return the values of one part of a run's document under the part's name."""
    value = run.get(key) or {}
    word = key.removesuffix("s")
    return {f"{word} {k}": v for k, v in value.items()} if isinstance(value, Mapping) else {key: value}


def parameter_table(run: Mapping[str, Any], declared: Sequence[Declaration]) -> str:
    """Return every parameter with what it does, changed ones first."""
    values: Mapping[str, Any] = run.get("parameters") or {}
    changed = set(run.get("changed_parameters") or run.get("changed") or ())
    known = {d.name: d for d in declared}
    rows = []
    for name, value in values.items():
        d = known.get(name)
        is_changed = name in changed if d is None else not _same(value, d.default)
        cells = [
            name,
            _exact(value),
            d.unit if d else "",
            _exact(d.default) if d else "",
            "changed" if is_changed else "",
            d.help if d else "",
        ]
        row = "".join(
            f"<td>{'<code>' if i == 0 else ''}{escape(c)}{'</code>' if i == 0 else ''}</td>"
            for i, c in enumerate(cells)
        )
        rows.append((not is_changed, f"<tr{' class=changed' if is_changed else ''}>{row}</tr>\n"))
    if not rows:
        return ""
    rows.sort(key=lambda row: row[0])  # changed ones first, else in the order in which they are declared
    head = "".join(f"<th>{h}</th>" for h in ("parameter", "value", "unit", "default", "", "what it does"))
    body = "".join(row for _, row in rows)
    count = sum(not unchanged for unchanged, _ in rows)
    told = f'<p class="soft">{len(rows)} parameters, {count} changed from the default.</p>'
    return f'{told}<div class="scroll"><table class="wordy"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _same(value: Any, default: Any) -> bool:
    """Whether a value out of JSON, where tuples are lists, is the default: files may say what holds anyway."""
    return bool(
        (list(value) if isinstance(value, tuple) else value)
        == (list(default) if isinstance(default, tuple) else default)
    )


def _exact(value: Any) -> str:
    """Return a parameter's value as it would be written to set it."""
    if value is None:
        return "auto"
    return str(value).lower() if isinstance(value, bool) else str(value)


def input_table(run: Mapping[str, Any]) -> str:
    """Return the files that were read."""
    rows = [
        (
            i.get("name", ""),
            f"{i['size_bytes']:,} bytes" if isinstance(i.get("size_bytes"), int) else "",
            i.get("sha256", ""),
        )
        for i in run.get("inputs") or ()
        if isinstance(i, Mapping)
    ]
    return page.table(["file", "size", "SHA-256"], rows, numeric=[1])


def reproduction(run: Mapping[str, Any]) -> str:
    """Return the command line, and the versions of what it ran on."""
    command = run.get("command") or ""
    line = shlex.join(str(c) for c in command) if isinstance(command, (list, tuple)) else str(command)
    shown = f"<pre>{escape(line)}</pre>" if line else ""
    versions = page.table(["software", "version"], sorted((run.get("versions") or {}).items()))
    return shown + versions
