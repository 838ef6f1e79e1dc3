# SPDX-License-Identifier: MIT
"""What a sweep varies: the values or the range of one native parameter, as ``--set`` names them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.mapper import find_tier
from slamcli.parameters import Declaration, as_dict, convert, declarations
from slamcli.pipelines.config import load_native, parse_set

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"^\s*({_NUMBER})\s*:\s*({_NUMBER})\s*((?::[^:]*)*)$")
_BEGUN = re.compile(rf"^\s*({_NUMBER})\s*:")
_MOST_VALUES = 10_000
_DIGITS = 5
"""Significant digits of a drawn number: enough to search with, few enough to type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One parameter and what it is to be: values that are named, or a range to draw from."""

    name: str
    """Native name as it is declared."""
    declaration: Declaration
    values: tuple[Any, ...]
    """Typed values in the order in which they were given, each once; empty for a range to draw from."""
    low: float = math.nan
    high: float = math.nan
    log: bool = False
    """Whether the range is drawn from (and the plot drawn) by its logarithm."""
    whole: bool = False
    """Whether only whole numbers are drawn."""

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers, so that they have places on an axis."""
        return self.declaration.kind in (int, float)

    def draw(self, rng: np.random.Generator) -> Any:
        """Return one value: one of those that are named, or a number of the range with few digits."""
        if self.values:
            return self.values[int(rng.integers(len(self.values)))]
        if self.whole and not self.log:
            return self.typed(float(rng.integers(int(self.low), int(self.high) + 1)))
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        drawn = float(rng.uniform(low, high))
        value = math.exp(drawn) if self.log else drawn
        return self.typed(min(max(value, self.low), self.high))

    def typed(self, value: float) -> Any:
        """Return a number of the range as the parameter takes it: whole, or with few digits, and within the ends."""
        if self.whole:
            value = float(min(max(round(value), math.ceil(self.low)), math.floor(self.high)))
            return int(value) if self.declaration.kind is int else value
        rounded = float(f"{value:.{_DIGITS}g}")
        return rounded if self.low <= rounded <= self.high else value


def parse_axis(text: str, algo: str) -> Axis:
    """Return what one ``--set`` of a sweep says.

    ``KEY=V1,V2,...`` names values (commas within quotes or brackets belong to a value); ``KEY=LOW:HIGH`` is a range of
    numbers to draw from, with ``:log`` evenly over its logarithm, with ``:int`` whole numbers; ``KEY=LOW:HIGH:/STEPS`` are so
    many even steps. One value alone is an axis of one value: the same for all runs.

    Raises
    ------
    ConfigError
        If there is no such parameter (the message names the nearest), a value has the wrong type or range, or the text
        cannot be understood.
    """
    setting = parse_set(text)
    found = _RANGE.match(setting.value)
    begun = _BEGUN.match(setting.value)
    name = _canonical(setting.name, algo, begun.group(1) if begun else _split(setting.value, text)[0])
    declaration = next(entry for entry in declarations(find_tier(algo).parameters) if entry.name == name)
    if found and declaration.kind in (int, float):
        return _range_axis(text, setting.name, algo, declaration, found)
    if begun and found is None and declaration.kind in (int, float):
        raise ConfigError(f"--set {text}: write a range as LOW:HIGH, LOW:HIGH:log, LOW:HIGH:int or LOW:HIGH:/STEPS")
    values = [_value(setting.name, algo, declaration, part) for part in _split(setting.value, text)]
    unique = tuple(dict.fromkeys(values))
    if len(unique) > _MOST_VALUES:
        raise ConfigError(f"--set {setting.name}: {len(unique)} values: more than {_MOST_VALUES}")
    return Axis(name=name, declaration=declaration, values=unique, log=_spread(unique))


def _range_axis(text: str, key: str, algo: str, declaration: Declaration, found: re.Match[str]) -> Axis:
    low, high = float(found.group(1)), float(found.group(2))
    log, whole, steps = False, declaration.kind is int, 0
    for word in found.group(3).split(":")[1:]:
        if word == "log":
            log = True
        elif word == "int":
            whole = True
        elif re.fullmatch(r"/\d+", word):
            steps = int(word[1:])
            if not 2 <= steps <= _MOST_VALUES:
                raise ConfigError(f"--set {text}: between 2 and {_MOST_VALUES} steps, not {steps}")
        else:
            raise ConfigError(f"--set {text}: after LOW:HIGH stand log, int or /STEPS, not {word!r}")
    if not low < high:
        raise ConfigError(f"--set {text}: the lower end {low:g} is not below the upper end {high:g}")
    if log and low <= 0:
        raise ConfigError(f"--set {text}: a logarithmic range begins above 0")
    if whole and math.ceil(low) > math.floor(high):
        raise ConfigError(f"--set {text}: there is no whole number between {low:g} and {high:g}")
    for end in (math.ceil(low), math.floor(high)) if whole else (low, high):
        _value(key, algo, declaration, f"{end:.17g}")
    axis = Axis(name=declaration.name, declaration=declaration, values=(), low=low, high=high, log=log, whole=whole)
    if not steps:
        return axis
    values = tuple(dict.fromkeys(_even(axis, steps)))
    return Axis(name=axis.name, declaration=declaration, values=values, log=log)


def _even(axis: Axis, steps: int) -> Iterator[Any]:
    at: NDArray[np.float64] = np.linspace(0.0, 1.0, steps)
    for share in at.tolist():
        value = axis.low * (axis.high / axis.low) ** share if axis.log else axis.low + share * (axis.high - axis.low)
        yield axis.typed(min(max(value, axis.low), axis.high))


def _spread(values: Sequence[Any]) -> bool:
    """Whether named numbers are shown best by their logarithm: all above 0, and two decades or as good as even ratios."""
    numbers = sorted(float(v) for v in values if isinstance(v, (int, float)) and not isinstance(v, bool))
    if len(numbers) != len(values) or len(numbers) < 3 or numbers[0] <= 0:
        return False
    ratios = [b / a for a, b in itertools.pairwise(numbers)]
    return numbers[-1] / numbers[0] >= 50 or (min(ratios) >= 1.5 and max(ratios) <= 1.5 * min(ratios))


def _canonical(key: str, algo: str, value: str) -> str:
    """Return the declared name of a parameter that may be given under one of an older version.

    Raises
    ------
    ConfigError
        If there is no such parameter, or the value does not fit it.
    """
    return next(iter(load_native(algo, sets=[f"{key}={value}"]).sources))


def _value(key: str, algo: str, declaration: Declaration, text: str) -> Any:
    """Return a value as the parameter takes it; of a name of an older version as it is read today."""
    if key == declaration.name:
        try:
            return convert(declaration, text)
        except ConfigError as error:
            raise ConfigError(f"--set: {error}") from error
    config = load_native(algo, sets=[f"{key}={text}"])
    return as_dict(config.parameters)[next(iter(config.sources))]


def _split(text: str, whole: str) -> list[str]:
    """Return the parts between commas that stand outside of quotes and brackets; quotes around a part are taken off."""
    parts, part, quote, depth = [], "", "", 0
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "[({":
            depth += 1
        elif letter in "])}":
            depth -= 1
        if letter == "," and not quote and depth == 0:
            parts.append(part.strip())
            part = ""
        else:
            part += letter
    if quote or depth:
        raise ConfigError(f"--set {whole}: a quote or bracket is not closed")
    parts.append(part.strip())
    if any(not part for part in parts):
        raise ConfigError(f"--set {whole}: there is nothing between two commas, or at an end of the list")
    return [part[1:-1] if len(part) > 1 and part[0] == part[-1] and part[0] in "\"'" else part for part in parts]


def value_text(value: Any) -> str:
    """Return a value as ``--set`` takes it: the same value comes back from it.

    Examples
    --------
    >>> value_text(0.1), value_text(1e-07), value_text(True), value_text(1000)
    ('0.1', '1e-07', 'true', '1000')
    """
    if value is None:
        return "auto"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)
