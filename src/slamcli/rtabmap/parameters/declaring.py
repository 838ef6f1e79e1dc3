# SPDX-License-Identifier: MIT
"""The kinds of values in RTAB-Map's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from slamcli.errors import ConfigError
from slamcli.parameters import parameter

LARGEST_COUNT = 1_000_000_000
LARGEST_LENGTH_M = 1e6


def switch(name: str, default: bool, help: str, **more: Any) -> Any:
    """Declare what is on or off."""
    return parameter(default, help, name=name, **more)


def count(
    name: str, default: int, help: str, unit: str = "", minimum: int = 0, maximum: int = LARGEST_COUNT, **more: Any
) -> Any:
    """Declare a number of things."""
    return parameter(default, help, name=name, unit=unit, minimum=minimum, maximum=maximum, **more)


def number(
    name: str, default: float, help: str, unit: str = "", minimum: float = 0.0, maximum: float = 1e9, **more: Any
) -> Any:
    """Declare a real number, not negative unless `minimum` says so."""
    return parameter(float(default), help, name=name, unit=unit, minimum=minimum, maximum=maximum, **more)


def length(name: str, default: float, help: str, minimum: float = 0.0, **more: Any) -> Any:
    """Declare a length in metres."""
    return number(name, default, help, "m", minimum, LARGEST_LENGTH_M, **more)


def share(name: str, default: float, help: str, **more: Any) -> Any:
    """Declare a share, similarity or probability between 0 and 1."""
    return number(name, default, help, "", 0.0, 1.0, **more)


def text(name: str, default: str, help: str, **more: Any) -> Any:
    """Declare a text."""
    return parameter(default, help, name=name, **more)


def choice(
    name: str, default: int, help: str, choices: Mapping[int, str], unavailable: Mapping[int, str] | None = None,
    **more: Any,
) -> Any:  # fmt: skip
    """Declare one of several ways that RTAB-Map numbers; `choices` and `unavailable` (what is not here) have their names."""
    listed = ", ".join(f"{key} {value}".rstrip() for key, value in choices.items())
    refused = {
        str(key): f"{value} is not available here: choose {' or '.join(f'{k} ({v})' for k, v in choices.items())}"
        for key, value in (unavailable or {}).items()
    }
    return parameter(
        default, f"{help}: {listed}", name=name, choices=map(str, choices), unavailable=refused, **more
    )  # fmt: skip


def absent(name: str, help: str) -> Any:
    """Declare a switch that can only be off here."""
    refused = {"True": "is not available here: leave it false"}
    return parameter(False, help, name=name, unavailable=refused, effective=False)


def numbers(name: str, value: str, how_many: int | None, what: str) -> tuple[float, ...]:
    """Return the numbers of a parameter that holds several in one text, separated by blanks.

    Raises
    ------
    ConfigError
        If they are not numbers, or not `how_many` (None: at least one).
    """
    try:
        found = tuple(float(word) for word in value.split())
    except ValueError as error:
        raise ConfigError(f"{name}={value!r}: write {what}, separated by blanks") from error
    if not found or (how_many is not None and len(found) != how_many):
        raise ConfigError(f"{name}={value!r}: write {what}, separated by blanks")
    return found


def region(name: str, value: str) -> tuple[float, float, float, float]:
    """Return the shares of an image that are left out on the left, right, top and bottom.

    Raises
    ------
    ConfigError
        If they are not four shares that leave something of the image.
    """
    what = "four shares of the image: left, right, top, bottom"
    left, right, top, bottom = numbers(name, value, 4, what)
    if not (all(0.0 <= x < 1.0 for x in (left, right, top, bottom)) and left + right < 1.0 and top + bottom < 1.0):
        raise ConfigError(f"{name}={value!r}: nothing is left of the image; write {what}, together below 1 each way")
    return left, right, top, bottom
