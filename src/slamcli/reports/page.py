# SPDX-License-Identifier: MIT
"""The parts that an HTML report is put together from: the page around it, tables and figures; everything is escaped."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from slamcli.reports.page_style import SCRIPT, STYLE


def document(title: str, body: Iterable[str]) -> str:
    """Return a whole page that loads nothing from anywhere (its own policy forbids it)."""
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none';img-src data:;style-src 'unsafe-inline';"
        "script-src 'unsafe-inline'\">"
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + f"\n<script>{SCRIPT}</script>\n</body></html>\n"
    )


def section(title: str, *parts: str) -> str:
    """Return a section, or nothing if it has no content."""
    content = "\n".join(part for part in parts if part)
    return f"<section><h2>{escape(title)}</h2>\n{content}</section>" if content else ""


def figure(content: str, title: str = "", caption: str = "") -> str:
    """Return a figure; `content` is markup."""
    heading = f"<h3>{escape(title)}</h3>" if title else ""
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"{heading}<figure>{content}{below}</figure>"


def zoomable(content: str) -> str:
    """Return a box in which a picture or a drawing is enlarged by wheel, fingers, double click and buttons."""
    tools = "".join(
        f'<button type="button" data-zoom="{zoom}" aria-label="{name}">{sign}</button>'
        for zoom, name, sign in (("2", "zoom in", "+"), ("0.5", "zoom out", "−"), ("0", "whole map", "⤢"))
    )
    return f'<div class="map"><div class="pane">{content}</div><div class="tools">{tools}</div></div>'


def layered(switches: Sequence[tuple[str, bool, str]], content: str) -> str:
    """Return `content` below one switch for each of its layers, which have the classes ``l0``, ``l1`` and so on.

    A switch is its label, whether the layer is shown at first, and markup of what stands for the layer. No script is needed.
    """
    boxes = "".join(
        f'<label><input type="checkbox" class="s{i}"{" checked" if shown else ""}>{key}{escape(label)}</label>'
        for i, (label, shown, key) in enumerate(switches)
    )
    return f'<div class="layered"><div class="switches">{boxes}</div>{content}</div>'


def table(
    columns: Sequence[str], rows: Iterable[Sequence[Any]], *, numeric: Sequence[int] = (), wordy: bool = False
) -> str:
    """Return a table of texts, or nothing if it has no rows; `numeric` columns are set to the right.

    In a `wordy` table the last column has sentences, and keeps room for them where the page is narrow.
    """
    kinds = [' class="n"' if i in numeric else "" for i in range(len(columns))]
    head = "".join(f"<th{kind}>{escape(name)}</th>" for kind, name in zip(kinds, columns, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{kind}>{escape(plain(v))}</td>" for kind, v in zip(kinds, row, strict=True)) + "</tr>\n"
        for row in rows
    )
    look = ' class="wordy"' if wordy else ""
    return (
        f'<div class="scroll"><table{look}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        if body
        else ""
    )


def bullets(items: Sequence[str], kind: str = "", most: int = 200) -> str:
    """Return a list of texts, or nothing; those beyond `most` are only counted."""
    if not items:
        return ""
    lines = [f"<li>{escape(str(item))}</li>" for item in items[:most]]
    if len(items) > most:
        lines.append(f"<li>and {len(items) - most:,} more, see run.json</li>")
    return f'<ul class="{kind}">{"".join(lines)}</ul>'


def cards(facts: Sequence[tuple[str, str, bool]]) -> str:
    """Return headline figures: value, what it is, and whether it is a warning."""
    return (
        '<div class="cards">'
        + "".join(
            f'<div class="card{" warn" if bad else ""}"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
            for value, name, bad in facts
        )
        + "</div>"
    )


def plain(value: Any) -> str:
    """Return a value from a JSON document as text for a person."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) < 10**12 else str(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, (list, tuple)) and len(value) > 24:
        return f"{len(value):,} values"
    if isinstance(value, (dict, list, tuple)):
        return json.dumps(value, ensure_ascii=False, default=str)[:2000]
    return str(value)
