# SPDX-License-Identifier: MIT
"""Number tables in text files: lines to fields, and time stamps without a detour through floating point."""

from __future__ import annotations

import decimal
import itertools
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from slamcli.errors import FormatError
from slamcli.runtime import RunLog

TimeUnit = Literal["auto", "s", "ms", "us", "ns"]
TIME_UNITS: tuple[str, ...] = get_args(TimeUnit)

_LONGEST_LINE = 1 << 16
_DIGITS_OF_UNIT = {"s": 9, "ms": 6, "us": 3, "ns": 0}
_NAME_OF_UNIT = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_PLAIN_NUMBER = re.compile(r"([+-]?)(\d{1,18})(?:\.(\d*))?")
_STAMP_LIMIT_NS = 1 << 63
_EXACT = decimal.Context(prec=60, Emax=9999, Emin=-9999, traps=[decimal.InvalidOperation])


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table."""

    line: int
    """Line number in the file, from 1."""
    fields: list[str]
    commas: bool = False
    """Whether commas separate the fields."""
    comment: bool = False
    """Whether the line is a comment; only where comments were asked for."""


def read_rows(path: str | os.PathLike[str], what: str, *, comments: bool = False) -> Iterator[Row]:
    """Yield the rows of a text table: blank lines and comments (from ``#`` on) are left out.

    Fields are separated by blanks or tabs, or by commas where a line has any. The file is read line by line.

    Parameters
    ----------
    path
        A text file in UTF-8, with or without a byte order mark.
    what
        What the file should be, for messages: ``a TUM trajectory``.
    comments
        Yield lines that are comments as well.

    Raises
    ------
    FormatError
        If the file cannot be opened or is not text.
    """
    path = Path(path)
    try:
        stream = path.open("rb")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read as {what}: {error.strerror or error}") from error
    with stream:
        number = 0
        while True:
            try:
                raw = stream.readline(_LONGEST_LINE)
            except OSError as error:
                raise FormatError(f"{path}: cannot be read as {what}: {error.strerror or error}") from error
            if not raw:
                return
            number += 1
            text = _decode(raw, path, number, what)
            data, _, remark = text.partition("#")
            if data.strip():
                yield _row(number, data, comment=False)
            elif comments and remark.strip():
                yield _row(number, remark, comment=True)


def _row(number: int, text: str, *, comment: bool) -> Row:
    if "," not in text:
        return Row(number, text.split(), comment=comment)
    fields = [field.strip() for field in text.split(",")]
    return Row(number, fields[:-1] if not fields[-1] else fields, commas=True, comment=comment)


def _decode(raw: bytes, path: Path, number: int, what: str) -> str:
    if len(raw) >= _LONGEST_LINE:
        raise FormatError(f"{path}, line {number}: longer than {_LONGEST_LINE} bytes: this is not {what}")
    try:
        text = raw.decode("utf-8-sig" if number == 1 else "utf-8")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FormatError(f"{path}, line {number}: not text: this is not {what}")
    return text


def parse_numbers(fields: Sequence[str], path: str | os.PathLike[str], line: int) -> list[float]:
    """Return fields as finite numbers.

    Raises
    ------
    FormatError
        If a field is not a finite number.
    """
    try:
        values = [float(field) for field in fields]
    except ValueError:
        wrong = next(field for field in fields if not _is_number(field))
        raise FormatError(f"{path}, line {line}: {shown(wrong)} is not a number") from None
    for field, value in zip(fields, values, strict=True):
        if not math.isfinite(value):
            raise FormatError(f"{path}, line {line}: {shown(field)} is not a finite number")
    return values


def parse_stamps_ns(texts: Sequence[str], lines: Sequence[int], path: str | os.PathLike[str], unit: str) -> list[int]:
    """Return decimal texts as whole nanoseconds, exactly; digits below the nanosecond are rounded half to even.

    Parameters
    ----------
    texts, lines
        Stamps as written and the lines they stand on.
    unit
        ``s``, ``ms``, ``us`` or ``ns``: see :func:`find_time_unit`.

    Raises
    ------
    FormatError
        If a text is not a number or does not fit 64 bits of nanoseconds.
    """
    digits = _DIGITS_OF_UNIT[unit]
    stamps = []
    for text, line in zip(texts, lines, strict=True):
        match = _PLAIN_NUMBER.fullmatch(text)
        if match and len(match[3] or "") <= digits:
            stamp = int(match[2]) * 10**digits + int((match[3] or "").ljust(digits, "0") or 0)
            stamp = -stamp if match[1] == "-" else stamp
        else:
            stamp = _decimal_stamp(text, digits, path, line)
        if not -_STAMP_LIMIT_NS <= stamp < _STAMP_LIMIT_NS:
            raise FormatError(f"{path}, line {line}: stamp {shown(text)} is out of range")
        stamps.append(stamp)
    return stamps


def _decimal_stamp(text: str, digits: int, path: str | os.PathLike[str], line: int) -> int:
    if len(text) > 60 or not _is_number(text):
        raise FormatError(f"{path}, line {line}: stamp {shown(text)} is not a number")
    value = decimal.Decimal(text)
    if not value.is_finite() or (value and value.adjusted() > 30):
        raise FormatError(f"{path}, line {line}: stamp {shown(text)} is out of range")
    scaled = value.scaleb(digits, _EXACT)
    return int(scaled.to_integral_value(rounding=decimal.ROUND_HALF_EVEN, context=_EXACT))


def find_time_unit(texts: Sequence[str], path: str | os.PathLike[str], log: RunLog | None = None) -> str:
    """Return the unit of time stamps, ``s``, ``ms``, ``us`` or ``ns``, from their size; other units than seconds are noted.

    Stamps since 1970 tell by their number of digits. Stamps that start near zero are seconds unless they are whole
    numbers whose usual step would be longer than a quarter of an hour.
    """
    values = [abs(float(text)) for text in texts[:1000] if _is_number(text)]
    largest = max(values, default=0.0)
    unit = "s"
    for limit, candidate in ((1e17, "ns"), (1e14, "us"), (1e11, "ms")):
        if largest >= limit:
            unit = candidate
            break
    else:
        whole = all(value.is_integer() for value in values) and not any("." in text for text in texts[:1000])
        steps = sorted(abs(b - a) for a, b in itertools.pairwise(values))
        step = steps[len(steps) // 2] if steps else 0.0
        if whole and step >= 1e3:
            unit = "ns" if step >= 5e5 else "us"
    if unit != "s" and log is not None:
        log.note(f"{path}: stamps are read as {_NAME_OF_UNIT[unit]}")
    return unit


def format_stamp_s(stamp_ns: int) -> str:
    """Return nanoseconds as seconds with nine decimals, exactly.

    Examples
    --------
    >>> format_stamp_s(1305031102160407001), format_stamp_s(-1)
    ('1305031102.160407001', '-0.000000001')
    """
    seconds, rest = divmod(abs(stamp_ns), 1_000_000_000)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{rest:09d}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def shown(text: str) -> str:
    """Return a field as messages quote it: shortened where it is long."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
