# SPDX-License-Identifier: MIT
"""The commands of a tutorial, and what it says they print.

A page holds fenced blocks. `sh` and `python` are run in their order in one folder; `text` right behind one of them is what it
prints, in part: each line must come in the output in this order, with other lines between them. In a line, the word `…` stands for
any words, and a number for one that is near it. `console` is for the reader alone: what needs a keyboard or does not end.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

NEAR_RELATIVE = 0.25
NEAR_LAST_DIGITS = 2.0
"""A printed number is near the page's if it is within a quarter of it, or two of its last digit."""

_FENCE = re.compile(r"^( *)```(\w+)[^\n]*\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w]|\.\d)")


@dataclass(frozen=True)
class Step:
    """One block to run, and the lines that it prints among others."""

    language: str
    code: str
    line: int
    shown: tuple[str, ...]


def steps(page: Path) -> list[Step]:
    """Return what a page runs."""
    text = page.read_text()
    blocks = [
        (match[2], re.sub(rf"^{match[1]}", "", match[3], flags=re.MULTILINE), match.start(), match.end())
        for match in _FENCE.finditer(text)
    ]
    found: list[Step] = []
    for index, (language, code, start, end) in enumerate(blocks):
        if language not in ("sh", "python"):
            continue
        shown: tuple[str, ...] = ()
        if index + 1 < len(blocks) and blocks[index + 1][0] == "text" and not text[end : blocks[index + 1][2]].strip():
            shown = tuple(line for line in blocks[index + 1][1].splitlines() if line.strip(" …"))
        found.append(Step(language, code, text[:start].count("\n") + 1, shown))
    return found


def missing(shown: tuple[str, ...], printed: str) -> str | None:
    """Return the first of the shown lines that is not among the printed ones behind the last found, or None."""
    lines = iter(printed.splitlines())
    for line in shown:
        if not any(_says(line, other) for other in lines):
            return line
    return None


def _says(shown: str, printed: str) -> bool:
    return _words_say(shown.split(), printed.split())


def _words_say(shown: list[str], printed: list[str]) -> bool:
    if not shown:
        return not printed
    if shown[0] == "…":
        return any(_words_say(shown[1:], printed[skipped:]) for skipped in range(len(printed) + 1))
    return bool(printed) and _word_says(shown[0], printed[0]) and _words_say(shown[1:], printed[1:])


def _word_says(shown: str, printed: str) -> bool:
    numbers = _NUMBER.findall(shown)
    pattern = r"(-?\d+(?:\.\d+)?)".join(map(re.escape, _NUMBER.split(shown)))
    match = re.fullmatch(pattern, printed)
    return match is not None and all(_near(a, float(b)) for a, b in zip(numbers, match.groups(), strict=True))


def _near(shown: str, printed: float) -> bool:
    last_digit = 10.0 ** -len(shown.partition(".")[2])
    room = max(NEAR_RELATIVE * abs(float(shown)), NEAR_LAST_DIGITS * last_digit if "." in shown else 0.0)
    return math.isclose(float(shown), printed, rel_tol=0.0, abs_tol=room + 1e-12)
