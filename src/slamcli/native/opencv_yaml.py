# SPDX-License-Identifier: MIT
"""OpenCV FileStorage YAML: what ORB-SLAM's settings files are written in, and what standard YAML readers refuse.

``%YAML:1.0`` on top, ``key:value`` without a blank, ``!!opencv-matrix`` blocks, real numbers like ``1.``. Files are flat:
keys have dots, not levels.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native.settings import Setting, read_text

_ENTRY = re.compile(r"^(\s*)([A-Za-z_][\w.\-]*)\s*:(.*)$")
_NUMBER = re.compile(r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$")
_MATRIX_PARTS = ("rows", "cols", "dt", "data")
_MOST_LINES = 20_000


def is_opencv_yaml(text: str) -> bool:
    """Return whether a text is OpenCV's YAML rather than ROS's: by its head, or by keys with dots at the first level."""
    return (
        text.lstrip().startswith("%YAML:")
        or "!!opencv-matrix" in text
        or bool(re.search(r"^(Camera[12]?|ORBextractor|LEFT|RIGHT|Viewer)\.\w+\s*:", text, re.MULTILINE))
    )


def read_opencv_yaml(path: Path) -> tuple[Setting, ...]:
    """Return the entries of a file in its order: bool, int, float or str; a matrix as the text of its numbers, row by row.

    Raises
    ------
    ConfigError
        If a line cannot be understood, or a matrix has another number of values than rows times columns; with file and line.
    """
    return parse_opencv_yaml(read_text(Path(path)), str(path))


def parse_opencv_yaml(text: str, file: str) -> tuple[Setting, ...]:
    """Return the entries in a text; see `read_opencv_yaml`."""
    lines = text.splitlines()
    if len(lines) > _MOST_LINES:
        raise ConfigError(f"{file}: {len(lines)} lines: is this a settings file?")
    return tuple(_Reader(lines, file).settings())


class _Reader:
    """Goes through the lines once."""

    def __init__(self, lines: Sequence[str], file: str) -> None:
        self._lines = [_without_comment(line) for line in lines]
        self._file = file
        self._at = 0

    def settings(self) -> Iterator[Setting]:
        while self._at < len(self._lines):
            number, line = self._at + 1, self._lines[self._at]
            self._at += 1
            if not line.strip() or line.lstrip().startswith("%") or line.strip() in ("---", "..."):
                continue
            entry = _ENTRY.match(line)
            if entry is None:
                raise self._wrong(number, f"{line.strip()[:60]!r} is no `key: value`")
            indent, key, rest = entry.groups()
            if indent and indent.strip(" ") == "" and not rest.strip():
                raise self._wrong(number, f"{key}: levels are not read, keys have dots")
            rest = rest.strip()
            if rest.startswith("!!opencv-matrix"):
                yield Setting(key, self._matrix(key, number), self._file, number)
            elif rest.startswith("["):
                yield Setting(key, " ".join(self._list(rest, number)), self._file, number)
            else:
                yield Setting(key, _scalar(rest), self._file, number)

    def _matrix(self, key: str, number: int) -> str:
        parts: dict[str, Any] = {}
        while self._at < len(self._lines) and len(parts) < len(_MATRIX_PARTS):
            entry = _ENTRY.match(self._lines[self._at])
            if entry is None and not self._lines[self._at].strip():
                self._at += 1
                continue
            if entry is None or entry.group(2) not in _MATRIX_PARTS:
                break
            self._at += 1
            rest = entry.group(3).strip()
            parts[entry.group(2)] = self._list(rest, self._at) if entry.group(2) == "data" else _scalar(rest)
        if "data" not in parts:
            raise self._wrong(number, f"matrix {key} has no data")
        data, rows, cols = parts["data"], parts.get("rows"), parts.get("cols")
        if isinstance(rows, int) and isinstance(cols, int) and rows * cols != len(data):
            raise self._wrong(number, f"matrix {key} is said to be {rows} x {cols} and holds {len(data)} numbers")
        return " ".join(data)

    def _list(self, text: str, number: int) -> list[str]:
        """Return the numbers of a list that may run over several lines."""
        while "]" not in text:
            if self._at >= len(self._lines):
                raise self._wrong(number, "a list is not closed by ]")
            text += " " + self._lines[self._at].strip()
            self._at += 1
        inside = text.strip().lstrip("[").partition("]")[0]
        values = [value for value in re.split(r"[,\s]+", inside) if value]
        for value in values:
            if not _NUMBER.match(value):
                raise self._wrong(number, f"{value!r} is no number")
        return values

    def _wrong(self, number: int, message: str) -> ConfigError:
        return ConfigError(f"{self._file}:{number}: {message}")


def _without_comment(line: str) -> str:
    """Return a line up to a ``#`` that stands outside of quotes."""
    quoted = False
    for i, letter in enumerate(line):
        if letter == '"':
            quoted = not quoted
        elif letter == "#" and not quoted:
            return line[:i]
    return line


def _scalar(text: str) -> Any:
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    if _NUMBER.match(text):
        return int(text) if re.fullmatch(r"[+-]?\d+", text) else float(text)
    return {"true": True, "false": False}.get(text.lower(), text)
