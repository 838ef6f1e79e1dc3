# SPDX-License-Identifier: MIT
"""RTAB-Map's own configuration files (``.ini``)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native.settings import Setting, read_text

_SECTION = "Core"
_ESCAPED = re.compile(r"%([0-9A-Fa-f]{2}|U[0-9A-Fa-f]{4})")
_BACKSLASHED = {"n": "\n", "t": "\t", "r": "\r", '"': '"', "\\": "\\"}


@dataclass(frozen=True, slots=True, kw_only=True)
class RtabmapIni:
    """What such a file says."""

    settings: tuple[Setting, ...]
    """Of the section ``[Core]`` under native names, values as text."""
    skipped: tuple[str, ...]
    """Other sections: of the window, of cameras."""


def read_rtabmap_ini(path: Path) -> RtabmapIni:
    r"""Return the parameters of an ``.ini`` file, as RTAB-Map and its window write them.

    Keys are ``Group\Name`` or ``Group/Name``, in Qt's files with escapes (``%20``); values may be quoted.

    Raises
    ------
    ConfigError
        If the file cannot be read, a line is none of a section, a comment and ``key = value``, or there is no section
        ``[Core]``, the only one that RTAB-Map reads.
    """
    section, settings, sections = "", [], dict[str, None]()
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        text = text.strip()
        if not text or text[0] in ";#":
            continue
        if text[0] == "[" and text[-1] == "]":
            section = text[1:-1].strip()
            sections[section] = None
            continue
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError(f"{path}:{line}: {text[:60]!r} is neither a [section] nor KEY = VALUE")
        if not section:
            raise ConfigError(f"{path}:{line}: stands before any section; RTAB-Map reads what is below [{_SECTION}]")
        if section == _SECTION and key.strip() != "Version":
            settings.append(Setting(_name(key), _value(value), str(path), line))
    if _SECTION not in sections:
        there = ", ".join(f"[{name}]" for name in sections) or "none"
        raise ConfigError(
            f"{path}: has no section [{_SECTION}], from which RTAB-Map reads parameters (sections: {there})"
        )
    return RtabmapIni(settings=tuple(settings), skipped=tuple(name for name in sections if name != _SECTION))


def format_rtabmap_ini(values: Mapping[str, Any]) -> str:
    """Return the text of an ``.ini`` file that RTAB-Map and its tools read.

    Parameters
    ----------
    values
        By native name; only names of groups (``Kp/MaxFeatures``) are RTAB-Map's own, others are left out.
    """
    own = sorted(name for name in values if "/" in name)
    lines = (f"{name.replace('/', chr(92))} = {_text(values[name])}" for name in own)
    return "\n".join([f"[{_SECTION}]", *lines]) + "\n"


def _name(key: str) -> str:
    plain = _ESCAPED.sub(lambda found: chr(int(found.group(1).removeprefix("U"), 16)), key.strip())
    return plain.replace("\\", "/").strip("/")


def _value(text: str) -> str:
    text = text.strip()
    if len(text) >= 2 and text[0] == text[-1] == '"':
        return re.sub(r"\\(.)", lambda found: _BACKSLASHED.get(found.group(1), found.group(0)), text[1:-1])
    return text


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
