# SPDX-License-Identifier: MIT
"""XML to a small tree that knows its lines; documents that declare types or entities are refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from slamcli.errors import ConfigError
from slamcli.native.settings import read_text

_MAX_DEPTH = 60


@dataclass(slots=True)
class Element:
    """One XML element."""

    tag: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""
    text_line: int = 0
    """Line on which the text begins."""


def parse_xml(path: Path) -> Element:
    """Return the root element of an XML file.

    Raises
    ------
    ConfigError
        If it cannot be read, is not well formed, declares a document type or entities, or is nested too deeply.
    """
    text = read_text(path)
    builder = _Builder(str(path))
    try:
        builder.parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        raise ConfigError(f"{path}:{error.lineno}: not XML: {expat.ErrorString(error.code)}") from error
    except (LookupError, ValueError) as error:  # an encoding declaration that Python does not know
        raise ConfigError(f"{path}: not XML: {error}") from error
    if builder.root is None:
        raise ConfigError(f"{path}: not XML: no element")
    return builder.root


class _Builder:
    def __init__(self, file: str) -> None:
        self.root: Element | None = None
        self._file = file
        self._open: list[Element] = []
        self._texts: list[list[str]] = []
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._data
        self.parser.StartDoctypeDeclHandler = self._refuse
        self.parser.EntityDeclHandler = self._refuse

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if len(self._open) >= _MAX_DEPTH:
            raise ConfigError(f"{self._file}:{element.line}: elements are nested more than {_MAX_DEPTH} deep")
        if self._open:
            self._open[-1].children.append(element)
        elif self.root is None:
            self.root = element
        self._open.append(element)
        self._texts.append([])

    def _end(self, tag: str) -> None:  # noqa: ARG002
        self._open.pop().text = "".join(self._texts.pop())

    def _data(self, text: str) -> None:
        element = self._open[-1]
        if not self._texts[-1]:
            element.text_line = self.parser.CurrentLineNumber
        self._texts[-1].append(text)  # in small pieces: the parser does not buffer, so that the line is right

    def _refuse(self, *_: object) -> NoReturn:
        raise ConfigError(
            f"{self._file}:{self.parser.CurrentLineNumber}: document types and entities are not read from launch files"
        )
