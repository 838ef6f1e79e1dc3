# SPDX-License-Identifier: MIT
"""Tables for the terminal: quiet, aligned, never wider than it; whole lines where the output goes to a file or a pipe."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from slamcli.reports.page import plain

_WIDE = 400
"""Columns for output that no terminal shows: nothing is wrapped."""


def table_text(
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    title: str = "",
    numeric: Sequence[int] = (),
    width: int | None = None,
) -> str:
    """Return a table as text without a line break at its end.

    Values are shown as they are: no markup is read in them, line breaks and control characters become spaces.

    Parameters
    ----------
    columns
        Headings; all empty for none.
    rows
        Values of any kind, one per column; floats get six digits, so format those that need other ones.
    title
        A line above it.
    numeric
        Columns that are set to the right.
    width
        Most characters of a line; None for the terminal's width, or unlimited where stdout is none.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    headings = any(columns)
    table = Table(box=box.SIMPLE_HEAD if headings else None, show_header=headings, pad_edge=False, show_edge=False)
    for i, name in enumerate(columns):
        right = i in numeric
        table.add_column(Text(_line(name)), justify="right" if right else "left", overflow="fold", no_wrap=right)
    for row in rows:
        table.add_row(*(Text(_line(plain(value))) for value in row))
    body = _render(table, width)
    return f"{_line(title)}\n{body}" if title else body


def facts_text(facts: Mapping[str, Any], *, title: str = "", width: int | None = None) -> str:
    """Return names and values below each other as text, see :func:`table_text`; empty without facts."""
    if not facts:
        return ""
    return table_text(["", ""], list(facts.items()), title=title, width=width)


def _render(renderable: Any, width: int | None) -> str:
    """Return what rich makes of it, without colours, so that it can go through `click.echo` anywhere."""
    import io

    from rich.console import Console

    if width is None:
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else _WIDE
    stream = io.StringIO()
    console = Console(file=stream, width=max(20, width), color_system=None, force_terminal=False, legacy_windows=False)
    console.print(renderable)
    return "\n".join(line.rstrip() for line in stream.getvalue().rstrip("\n").split("\n"))


def _line(words: str) -> str:
    return "".join(c if c.isprintable() else " " for c in words)
