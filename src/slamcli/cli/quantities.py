# SPDX-License-Identifier: MIT
"""Sizes, times and durations as text for a person."""

from __future__ import annotations

import datetime as dt
import re

from slamcli.errors import UsageError

_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kMGT]?)(i?)B?", re.IGNORECASE)


def size_text(size_bytes: int) -> str:
    """Return a size with its unit: ``4.49 MB``."""
    size = float(size_bytes)
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.4g} {unit}"
        size /= 1000
    return f"{size:.4g} GB"


def duration_text(seconds: float) -> str:
    """Return a duration: ``95.123 s``, ``421.0 s (0:07:01)``."""
    if seconds < 120:
        return f"{seconds:.3f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{seconds:.1f} s ({minutes // 60}:{minutes % 60:02}:{rest:02})"


def time_text(stamp_ns: int | None) -> str:
    """Return a time as a date, or as seconds where it is none that a person would recognise."""
    if stamp_ns is None:
        return "?"
    if not 10**17 < stamp_ns < 10**19 // 2:
        return f"{stamp_ns / 1e9:.3f} s"
    moment = dt.datetime.fromtimestamp(stamp_ns // 10**9, tz=dt.UTC)
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def parse_size(text: str, option: str) -> int:
    """Return a size in bytes: ``2GB`` (powers of 1000), ``512 MiB`` (of 1024), ``1.5G``.

    Raises
    ------
    UsageError
        If it is none.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"{option} {text!r} is no size: write it as 2GB or 512MiB")
    power = " kmgt".index(match[2].lower() or " ")
    return int(float(match[1]) * (1024 if match[3] else 1000) ** power)
