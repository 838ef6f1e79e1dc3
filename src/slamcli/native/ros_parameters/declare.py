# SPDX-License-Identifier: MIT
"""Rows of the parameter tables: what a ROS node reads, declared as `slamcli.parameters` declares it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from slamcli.parameters import Declaration

Table = tuple[Declaration, ...]


def row(
    name: str,
    default: Any,
    help: str,
    unit: str = "",
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Iterable[str] = (),
) -> Declaration:
    """Return one declaration; the type is that of the default."""
    return Declaration(
        name=name,
        field=name,
        kind=type(default),
        default=default,
        unit=unit,
        help=help,
        minimum=minimum,
        maximum=maximum,
        choices=tuple(choices),
        effective=True,
        extension=False,
    )


def names(table: str) -> Table:
    """Return declarations from lines of ``name=default`` (help: the node's own documentation)."""
    return tuple(row(name, _typed(default), "") for name, default in (entry.split("=") for entry in table.split()))


def _typed(text: str) -> Any:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text) if any(c in text for c in ".e") else int(text)
    except ValueError:
        return text.strip("'")
