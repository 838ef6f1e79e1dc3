# SPDX-License-Identifier: MIT
"""Finds the lines of Lua files that assign a value, from the text alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

_TOKEN = re.compile(
    r"""
    (?P<comment>--\[(?P<level>=*)\[.*?\](?P=level)\]|--[^\n]*)
  | (?P<long>\[(?P<depth>=*)\[.*?\](?P=depth)\])
  | (?P<text>"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')
  | (?P<number>(?:[0-9]|\.[0-9])(?:[eEpP][+-]|[A-Za-z_0-9.])*)
  | (?P<word>[A-Za-z_][A-Za-z_0-9]*)
  | (?P<sign>==|~=|<=|>=|[={}.\[\],;()])
    """,
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    line: int


class LuaPlaces:
    """Where values are assigned in a set of files.

    Assignments are found by their text (``A.b.c = 1`` and ``b = {c = 1}`` in a table), so that one made in a loop or
    through another variable is found by its last name only, or not at all.

    Parameters
    ----------
    files
        Names and texts; where several assign one value the earlier file counts, as it includes the later ones.
    """

    def __init__(self, files: Sequence[tuple[str, str]]) -> None:
        self._exact: dict[str, tuple[str, int]] = {}
        self._roots: dict[str, list[tuple[str, str, int]]] = {}
        for file, text in reversed(files):
            for path, line in assignments(text):
                self._exact[path] = (file, line)
                root, _, last = path.partition(".")[0], "", path.rpartition(".")[2]
                self._roots.setdefault(last, []).append((root, file, line))

    def find(self, paths: Sequence[str], roots: Sequence[str], presets: Sequence[str]) -> tuple[str, int] | None:
        """Return file and line of an assignment to one of `paths` (the ways to write one value).

        Parameters
        ----------
        paths
            Names joined by dots.
        roots
            First names that mean something: another first name may be another word for the same table.
        presets
            Files whose assignments count only if no other file has one.
        """
        found = [self._exact[path] for path in paths if path in self._exact]
        own = [place for place in found if place[0] not in presets]
        if own:
            return own[0]
        last = paths[0].rpartition(".")[2]
        others = [
            (file, line)
            for root, file, line in self._roots.get(last, ())
            if root not in roots and root != last and file not in presets
        ]
        return others[-1] if others else found[0] if found else None


def assignments(text: str) -> Iterator[tuple[str, int]]:
    """Yield what a Lua text assigns to, as names joined by dots, with the line."""
    tokens = [_Token("end", "", 0), *_tokens(text), _Token("end", "", 0), _Token("end", "", 0)]
    tables: list[str | None] = []
    opened: str | None = None
    i = 1
    while i < len(tokens) - 2:
        token = tokens[i]
        if token.text == "{" and token.kind == "sign":
            tables.append(opened)
        elif token.text == "}" and token.kind == "sign" and tables:
            tables.pop()
        opened = None
        name, after = _target(tokens, i)
        if name and tokens[after].kind == "sign" and tokens[after].text == "=":
            prefix = tables[-1] if tables else ""
            if prefix is not None:
                opened = f"{prefix}.{name}" if prefix else name
                yield opened, token.line
            i = after
        i += 1


def _target(tokens: Sequence[_Token], i: int) -> tuple[str, int]:
    """Return the name that may be assigned to at a token, and the index of what follows; "" for none."""
    if tokens[i].text == "[" and tokens[i + 1].kind == "text" and tokens[i + 2].text == "]":
        return tokens[i + 1].text[1:-1], i + 3
    if tokens[i].kind != "word" or tokens[i - 1].text in (".", "]"):
        return "", i
    parts = [tokens[i].text]
    i += 1
    while i + 2 < len(tokens):
        if tokens[i].text == "." and tokens[i + 1].kind == "word":
            parts.append(tokens[i + 1].text)
            i += 2
        elif tokens[i].text == "[" and tokens[i + 1].kind == "text" and tokens[i + 2].text == "]":
            parts.append(tokens[i + 1].text[1:-1])
            i += 3
        else:
            break
    return ".".join(parts), i


def _tokens(text: str) -> Iterator[_Token]:
    line, at = 1, 0
    for match in _TOKEN.finditer(text):
        line += text.count("\n", at, match.start())
        at = match.start()
        for kind in ("word", "sign", "text"):
            if match[kind] is not None:
                yield _Token(kind, match[kind], line)
