# SPDX-License-Identifier: MIT
"""What Lua values are in Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from slamcli.errors import ConfigError

_MAX_DEPTH = 16
_MAX_VALUES = 20_000
_MAX_TEXT_BYTES = 10_000


class TableReader:
    """Reads tables of one Lua state as dicts, sorted by name; a table that stands in two places is one dict.

    Parameters
    ----------
    file
        The file they come from, for messages.
    same
        Lua's ``rawequal``.
    kind
        lupa's ``lua_type``.
    """

    def __init__(self, file: str, same: Callable[[Any, Any], bool], kind: Callable[[Any], str | None]) -> None:
        self._file = file
        self._same = same
        self._kind = kind
        self._known: list[tuple[Any, dict[str, Any]]] = []
        self._values = 0

    def read(self, value: Any, name: str) -> Any:
        """Return a Lua value as bool, int, float, str, None, or a dict for a table; `name` is for messages.

        Raises
        ------
        ConfigError
            If it is or holds something that no configuration has: a function, text that is not UTF-8, a value without
            a name, a table in itself, too much of anything.
        """
        return self._read(value, name, ())

    def _read(self, value: Any, name: str, around: tuple[Any, ...]) -> Any:
        if value is None or isinstance(value, (bool, int, float)):
            return value
        if isinstance(value, bytes):
            return self._text(value, name)
        kind = self._kind(value)
        if kind != "table":
            raise ConfigError(f"{self._file}: {name} is a {kind or 'Python object'}, not a value")
        for table, plain in self._known:
            if self._same(table, value):
                return plain
        if any(self._same(value, outer) for outer in around):
            raise ConfigError(f"{self._file}: {name} is a table that holds itself")
        if len(around) >= _MAX_DEPTH:
            raise ConfigError(f"{self._file}: {name} is nested more than {_MAX_DEPTH} deep: is this a configuration?")
        named = sorted(((self._key(key, name), inner) for key, inner in value.items()), key=lambda item: item[0])
        plain = {key: self._read(inner, f"{name}.{key}", (*around, value)) for key, inner in named}
        self._known.append((value, plain))
        return plain

    def _key(self, key: Any, name: str) -> str:
        self._values += 1
        if self._values > _MAX_VALUES:
            raise ConfigError(f"{self._file}: {name} holds more than {_MAX_VALUES} values: is this a configuration?")
        if isinstance(key, bytes):
            return self._text(key, f"a name in {name}")
        raise ConfigError(f"{self._file}: {name} holds a value without a name: write name = value")

    def _text(self, value: bytes, name: str) -> str:
        if len(value) > _MAX_TEXT_BYTES:
            raise ConfigError(f"{self._file}: {name} is a text of {len(value)} bytes: is this a configuration?")
        try:
            text = value.decode()
        except ValueError as error:
            raise ConfigError(f"{self._file}: {name} is not UTF-8 text") from error
        if not text.isprintable():
            raise ConfigError(f"{self._file}: {name} holds characters that cannot be printed")
        return text
