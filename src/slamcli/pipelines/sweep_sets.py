# SPDX-License-Identifier: MIT
"""The sets of parameters that a sweep tries: a grid over all values, or draws; the baseline first."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slamcli.errors import ConfigError, UsageError
from slamcli.mapper import find_tier
from slamcli.parameters import as_dict, resolve
from slamcli.pipelines.sweep_axes import Axis, value_text

BASELINE = "baseline"
_MOST_SETS = 100_000
_TRIES = 200
"""Draws in a row that may bring nothing new, before the search is said to be exhausted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSet:
    """One combination of values."""

    name: str
    """``baseline``, or a short digest of what differs from it: the same whatever else is swept."""
    values: Mapping[str, Any]
    """Of every swept parameter by native name."""
    changes: Mapping[str, Any]
    """Those that differ from the baseline."""

    @property
    def is_baseline(self) -> bool:
        """Whether nothing differs."""
        return not self.changes

    @property
    def label(self) -> str:
        """What differs, for a person."""
        return ", ".join(f"{name}={value_text(value)}" for name, value in self.changes.items()) or BASELINE


def parameter_sets(
    axes: Sequence[Axis], base: Any, algo: str, *, draws: int | None, seed: int
) -> tuple[ParameterSet, ...]:
    """Return the baseline and, after it, every combination of values or `draws` random ones, no two of them the same.

    Draws are the first of one sequence: more of them bring only new ones.

    Parameters
    ----------
    axes
        What is varied; of different parameters.
    base
        The tier's parameters without what is swept.
    draws
        How many sets are drawn; None for the whole grid.
    seed
        Of the draws.

    Raises
    ------
    ConfigError
        If a range is given and nothing is drawn, or values do not fit together.
    UsageError
        If the grid has too many sets.
    """
    ranges = [axis for axis in axes if not axis.values]
    if draws is None and ranges:
        axis = ranges[0]
        span = f"{axis.low:g}:{axis.high:g}"
        raise ConfigError(
            f"--set {axis.name}={span}: a range is drawn from: add --random N, or name steps: {axis.name}={span}:/5"
        )
    size = math.prod(len(axis.values) or _MOST_SETS for axis in axes)
    if draws is None and size > _MOST_SETS:
        raise UsageError(f"the grid has {size} sets, more than {_MOST_SETS}: take --random N")
    known = as_dict(base)
    baseline = {axis.name: known[axis.name] for axis in axes}
    found: dict[str, ParameterSet] = {}
    rows = _grid(axes) if draws is None or (not ranges and size <= draws) else _drawn(axes, draws, seed)
    for values in itertools.chain([baseline], rows):
        one = _named(values, baseline)
        if one.name not in found:
            _check(one, known, algo)
            found[one.name] = one
    return tuple(found.values())


def _grid(axes: Sequence[Axis]) -> Iterator[dict[str, Any]]:
    for values in itertools.product(*(axis.values for axis in axes)):
        yield {axis.name: value for axis, value in zip(axes, values, strict=True)}


def _drawn(axes: Sequence[Axis], draws: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield different draws; each parameter has a sequence of its own, so that the order of options does not matter."""
    streams = [np.random.default_rng([seed, *axis.name.encode()]) for axis in axes]
    seen: set[tuple[Any, ...]] = set()
    idle = 0
    while len(seen) < draws and idle < _TRIES:
        values = tuple(axis.draw(stream) for axis, stream in zip(axes, streams, strict=True))
        idle = idle + 1 if values in seen else 0
        if values not in seen:
            seen.add(values)
            yield {axis.name: value for axis, value in zip(axes, values, strict=True)}


def _named(values: Mapping[str, Any], baseline: Mapping[str, Any]) -> ParameterSet:
    changes = {name: value for name, value in values.items() if value != baseline[name]}
    text = json.dumps({name: value_text(value) for name, value in changes.items()}, sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:10] if changes else BASELINE
    return ParameterSet(name=name, values=values, changes=changes)


def _check(one: ParameterSet, base: Mapping[str, Any], algo: str) -> None:
    """Refuse values that do not fit together.

    Raises
    ------
    ConfigError
        With the set.
    """
    try:
        resolve(find_tier(algo).parameters, base, one.changes)
    except ConfigError as error:
        raise ConfigError(f"--set {one.label}: {error}") from error
