# SPDX-License-Identifier: MIT
"""What a check finds, and the checks that follow from a declaration alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from slamcli.errors import ConfigError
from slamcli.native.settings import Setting
from slamcli.parameters import Declaration, convert, unknown_name

ERROR, WARNING, NOTE = "error", "warning", "note"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing worth knowing about a native file."""

    severity: str
    """``error`` (the real system refuses or ignores it), ``warning`` (it does not do what it seems to) or ``note``."""
    file: str
    line: int
    """0 where the file as a whole is meant."""
    message: str

    @property
    def place(self) -> str:
        """``file:line``."""
        return f"{self.file}:{self.line}" if self.line else self.file


def at(setting: Setting, severity: str, message: str) -> Finding:
    """Return a finding at a setting."""
    return Finding(severity, setting.file, setting.line, message)


def check_declared(
    settings: Mapping[str, Setting], table: Iterable[Declaration], owner: str, *, strict: bool = True
) -> Iterator[Finding]:
    """Yield what is wrong with each setting by the declarations of its owner: name, type, range.

    With `strict` an unknown name is an error, otherwise it is left to another table.
    """
    known = {entry.name: entry for entry in table}
    for name, setting in settings.items():
        if name in known:
            yield from check_value(setting, known[name])
        elif strict:
            yield at(setting, ERROR, f"{unknown_name(name, known)} ({owner} does not read it)")


def check_value(setting: Setting, declaration: Declaration) -> Iterator[Finding]:
    """Yield what is wrong with the value of one setting."""
    value, kind = setting.value, declaration.kind
    if value is None:
        yield at(setting, WARNING, f"{setting.name} has no value: the default {declaration.default} is used")
        return
    try:
        convert(declaration, value)
    except ConfigError as error:
        yield at(setting, ERROR, str(error))
        return
    if kind in (int, float) and isinstance(value, str) and not declaration.choices and value != "auto":
        yield at(
            setting,
            ERROR,
            f"{setting.name}={value!r} is text: ROS ignores it and takes the default {declaration.default}",
        )
    elif kind is bool and not isinstance(value, bool):
        yield at(setting, WARNING, f"{setting.name}={value!r} is no truth value: ROS ignores it; write true or false")
    elif not declaration.effective:
        yield at(setting, NOTE, f"{setting.name} is accepted and has no effect: {declaration.help}")


def number(settings: Mapping[str, Setting], name: str, default: float) -> float:
    """Return a setting as a number; the default where it is absent or none."""
    setting = settings.get(name)
    if setting is None or isinstance(setting.value, bool) or not isinstance(setting.value, (int, float)):
        return default
    return float(setting.value)


def below(settings: Mapping[str, Setting], prefix: str) -> dict[str, Setting]:
    """Return the settings whose names begin with ``prefix/``, by the rest of the name."""
    start = prefix + "/"
    return {name[len(start) :]: setting for name, setting in settings.items() if name.startswith(start)}
