# SPDX-License-Identifier: MIT
"""Evaluates configuration files in Lua, as Cartographer does, without files, processes, network, clocks or chance.

A file may use the language, ``math``, and what is harmless of ``string`` and ``table``; ``include "file.lua"`` and
``choose(condition, a, b)`` are Cartographer's own. Time, memory and the size of what comes out are limited.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native._lua_values import TableReader
from slamcli.native.settings import read_text

MAX_MEMORY_BYTES = 32_000_000
MAX_INSTRUCTIONS = 10_000_000
MAX_SECONDS = 2.0
MAX_FILES = 50

# Runs before any configuration: keeps what it needs for itself, then takes the rest away. A hook counts instructions;
# without pcall and coroutines nothing can catch or evade it. Functions of string and table that can run for long in
# C, where no hook is called, go as well (patterns, rep, move, sort by length), and so does what differs between runs.
#
# Lua never calls Python: where memory ends Lua jumps out of what it called, and Python would not survive that. To
# include a file the configuration's coroutine stops, and Python goes on with it when the text is in the box. Only
# truth values are returned while memory may be short, as they need none.
_SANDBOX = """
local box, instructions, seconds = ...
local load, error, type, pairs, pcall = load, error, type, pairs, pcall
local sethook, getinfo, clock = debug.sethook, debug.getinfo, os.clock
local create, resume, yield, status = coroutine.create, coroutine.resume, coroutine.yield, coroutine.status
local keep = {
  _G = true, _VERSION = true, assert = true, error = true, ipairs = true, next = true, pairs = true, select = true,
  tonumber = true, tostring = true, type = true,
  math = {
    abs = 1, acos = 1, asin = 1, atan = 1, ceil = 1, cos = 1, deg = 1, exp = 1, floor = 1, fmod = 1, huge = 1, log = 1,
    max = 1, maxinteger = 1, min = 1, mininteger = 1, modf = 1, pi = 1, rad = 1, sin = 1, sqrt = 1, tan = 1,
    tointeger = 1, type = 1, ult = 1,
  },
  string = { byte = 1, char = 1, format = 1, len = 1, lower = 1, sub = 1, upper = 1 },
  table = { concat = 1, insert = 1, remove = 1, unpack = 1 },
}
for name, value in pairs(_G) do
  if not keep[name] then
    _G[name] = nil
  elseif type(keep[name]) == "table" then
    for inner in pairs(value) do
      if not keep[name][inner] then value[inner] = nil end
    end
  end
end
local globals = _G
local function run()
  local text, label = box.text, box.label
  box.text = false
  local compiled, problem = load(text, "=" .. label, "t", globals)
  if not compiled then error(problem, 0) end
  return compiled()
end
function print() end
function choose(condition, first, second)
  if type(condition) ~= "boolean" then error("choose(condition, a, b): the condition is no truth value", 2) end
  if condition then return first end
  return second
end
function include(...)
  local name, more = ...
  if type(name) ~= "string" or more ~= nil then error("include takes the name of one file", 2) end
  local caller = getinfo(2, "Sl")
  box.name, box.label, box.line = name, caller and caller.short_src or "", caller and caller.currentline or 0
  yield()
  return run()
end
local thread = create(function() box.fine, box.value = pcall(run) end)
local used, started = 0, clock()
local step = 100
sethook(thread, function()
  used = used + step
  if used > instructions or clock() - started > seconds then
    error("it does not end: more than " .. instructions .. " instructions or " .. seconds .. " s", 2)
  end
end, "", step)
return function()
  resume(thread)
  return status(thread) == "suspended"
end
"""
_BOX = "return {text = false, label = false, name = false, line = false, fine = false, value = false}"
_NO_MEMORY = b"not enough memory"

_PLACE = re.compile(r"([0-9]{1,3}):([0-9]{1,9}): (.*)", re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class LuaResult:
    """What a file came to."""

    returned: Any
    """What it returns: a table as a dict, or a bool, int, float or str; None where it returns nothing."""
    tables: Mapping[str, Any]
    """The global variables asked for, tables as dicts; a table that is also part of `returned` is the same dict."""
    files: tuple[tuple[str, str], ...]
    """Every file that was run with its text, in the order of inclusion; the file itself is the first."""


def evaluate(path: Path, folders: Sequence[Path] = (), names: Sequence[str] = ()) -> LuaResult:
    """Return what a Lua file comes to.

    Parameters
    ----------
    path
        The file.
    folders
        Where included files are looked for after the including file's folder and this one's.
    names
        Global variables that are wanted besides what the file returns.

    Raises
    ------
    ConfigError
        If a file cannot be read, is wrong, does not end, takes too much memory or comes to something that is no
        configuration; the message has file and line where Lua tells them.
    """
    from lupa import lua54

    sources = _Sources(Path(path), folders)
    lua = lua54.LuaRuntime(
        encoding=None,
        register_eval=False,
        register_builtins=False,
        attribute_filter=_no_attributes,
        max_memory=MAX_MEMORY_BYTES,
    )
    same = lua.globals()[b"rawequal"]
    box = lua.execute(_BOX)
    advance = lua.execute(_SANDBOX, box, MAX_INSTRUCTIONS, MAX_SECONDS)
    box[b"label"], box[b"text"] = sources.first()
    while advance():
        lua.set_max_memory(2 * MAX_MEMORY_BYTES)  # so that what Python does here never fails
        box[b"label"], box[b"text"] = sources.fetch(box[b"name"], box[b"label"], box[b"line"])
        lua.set_max_memory(MAX_MEMORY_BYTES)
    lua.set_max_memory(2 * MAX_MEMORY_BYTES)
    value = box[b"value"]
    if not box[b"fine"]:
        if value in (False, _NO_MEMORY):
            limit = f"more than {MAX_MEMORY_BYTES // 1_000_000} MB"
            raise ConfigError(f"{path}: takes {limit}: is this a configuration?")
        raise ConfigError(sources.located(value.decode(errors="replace") if isinstance(value, bytes) else ""))
    reader = TableReader(str(path), same, lua54.lua_type)
    return LuaResult(
        returned=reader.read(value, "what it returns"),
        tables={name: reader.read(lua.globals()[name.encode()], name) for name in names},
        files=tuple(sources.texts),
    )


def _no_attributes(*_: Any) -> Any:
    raise AttributeError("no access to Python")


class _Sources:
    """The files of one evaluation."""

    def __init__(self, path: Path, folders: Sequence[Path]) -> None:
        self._path = path
        self._folders = [path.parent, *folders]
        self._places: dict[Path, str] = {}
        self.texts: list[tuple[str, str]] = []

    def first(self) -> tuple[bytes, bytes]:
        """Return label and text of the file itself."""
        return self._add(self._path, str(self._path))

    def fetch(self, name: bytes, label: bytes, line: int) -> tuple[bytes, bytes]:
        """Return label and text of a file that is included at a line of the file of another label."""
        including = self.texts[int(label)][0] if label.isdigit() else str(self._path)
        place = f"{including}:{line}" if line > 0 else including
        return self._add(self._find(name, Path(including).parent, place), place)

    def located(self, message: str) -> str:
        """Return a message of Lua with the name of the file instead of its label."""
        match = _PLACE.match(message)
        if match is None or int(match[1]) >= len(self.texts):
            return f"{self._path}: {_one_line(message) or 'stopped by an error without a message'}"
        return f"{self.texts[int(match[1])][0]}:{match[2]}: {_one_line(match[3])}"

    def _add(self, path: Path, place: str) -> tuple[bytes, bytes]:
        where = path.resolve()
        if where in self._places:
            raise ConfigError(
                f"{place}: {path.name} is included a second time (first: {self._places[where]}); Cartographer aborts here"
            )
        if len(self.texts) >= MAX_FILES:
            raise ConfigError(f"{place}: more than {MAX_FILES} files are included")
        self._places[where] = place
        self.texts.append((str(path), read_text(path)))
        return str(len(self.texts) - 1).encode(), self.texts[-1][1].encode()

    def _find(self, name: bytes, beside: Path, place: str) -> Path:
        text = name.decode(errors="replace")
        relative = Path(text)
        if not text.isprintable() or len(text) > 200 or relative.is_absolute() or relative.suffix != ".lua":
            raise ConfigError(f"{place}: include {_one_line(text)!r}: name a .lua file, relative to this one")
        folders = dict.fromkeys([beside, *self._folders])
        for folder in folders:
            if (folder / relative).is_file():
                return folder / relative
        there = ", ".join(map(str, folders))
        raise ConfigError(f"{place}: include {text!r}: not found in {there}")


def _one_line(text: str) -> str:
    """Return text as one printable line of bounded length."""
    line = " ".join(text.split())
    line = "".join(letter if letter.isprintable() else "?" for letter in line)
    return line if len(line) <= 200 else line[:199] + "…"
