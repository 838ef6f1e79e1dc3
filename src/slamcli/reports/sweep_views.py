# SPDX-License-Identifier: MIT
"""What the plots of a sweep show: the objective over the values of each parameter, over pairs of values, and over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.evaluation.figure_catalogue import BY_KEY

_MOST_CELLS = 25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ParameterView:
    """One parameter: V values in their order, R runs."""

    name: str
    label: str
    """With its unit."""
    values: tuple[Any, ...]
    at: NDArray[np.float64]
    """float64 (V,), place of each value on the axis: itself, its decimal logarithm, or its number."""
    log: bool
    numeric: bool
    best: NDArray[np.float64]
    """float64 (V, 3): first quartile, median and third quartile of the best set that has the value; NaN where all failed."""
    marginal: NDArray[np.float64]
    """float64 (V,): median over all runs that have the value."""
    run_at: NDArray[np.float64]
    """float64 (R,), place of each run that did not fail."""
    run_values: NDArray[np.float64]
    """float64 (R,)."""
    failed: NDArray[np.int64]
    """int64 (V,): runs that failed."""
    alone: bool
    """Whether no other parameter is varied, so that the best and the marginal are the same."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairView:
    """Two parameters: the median objective of each pair of values."""

    first: ParameterView
    second: ParameterView
    cells: NDArray[np.float64]
    """float64 (values of the second, values of the first); NaN where nothing was tried or all failed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CostView:
    """Time against objective, one point per set (S,)."""

    times_s: NDArray[np.float64]
    values: NDArray[np.float64]
    labels: tuple[str, ...]
    baseline: int
    """Index of the baseline."""
    front: tuple[int, ...]
    """Indices of the sets that no other beats in both, by rising time."""


def objective_label(document: Mapping[str, Any]) -> str:
    """Return the label of the objective's axis, with its unit where it is known."""
    objective = document["objective"]
    if objective["relative"]:
        return f"{objective['key']} (multiple of the baseline's)"
    known = BY_KEY.get(objective["key"])
    return f"{objective['key']}, {known.unit}" if known is not None and known.unit else str(objective["key"])


def digits(value: float) -> str:
    """Return a figure of the objective: four digits, also where the last are zeros, so that those of a column compare."""
    return f"{value:#.4g}".rstrip(".")


def baseline_median(document: Mapping[str, Any]) -> float:
    """Return the median of the baseline; NaN if it failed."""
    return _number(next(one["median"] for one in document["sets"] if one["baseline"]))


def parameter_views(document: Mapping[str, Any]) -> list[ParameterView]:
    """Return a view of each parameter that was varied."""
    return [_parameter(parameter, document) for parameter in document["parameters"]]


def _parameter(parameter: Mapping[str, Any], document: Mapping[str, Any]) -> ParameterView:
    name, sets = parameter["name"], document["sets"]
    numeric, log = bool(parameter["numeric"]), bool(parameter["log"])
    found = {_key(one["values"][name]): one["values"][name] for one in sets}
    values = list(found.values())
    if numeric and all(isinstance(value, (int, float)) for value in values):
        values.sort()
        log = log and values[0] > 0
    else:
        order = [_key(value) for value in parameter["values"]]
        values.sort(key=lambda value: order.index(_key(value)) if _key(value) in order else -1)
        numeric = log = False
    places = {_key(value): _place(value, i, numeric=numeric, log=log) for i, value in enumerate(values)}
    ranked = sorted(sets, key=lambda one: one["rank"])
    best, marginal, failed = [], [], []
    runs = _run_values(document)
    for key in places:
        own = [one for one in ranked if _key(one["values"][name]) == key]
        first = next((one for one in own if one["count"]), None)
        best.append([_number(first[q]) if first else math.nan for q in ("lower", "median", "upper")])
        with_value = [runs[one["id"]] for one in own]
        flat = np.concatenate(with_value) if with_value else np.zeros(0)
        marginal.append(float(np.median(flat)) if len(flat) else math.nan)
        failed.append(sum(one["failed"] for one in own))
    run_at = [places[_key(one["values"][name])] for one in sets for _ in runs[one["id"]]]
    run_values = [value for one in sets for value in runs[one["id"]]]
    unit = f" in {parameter['unit']}" if parameter["unit"] else ""
    return ParameterView(
        name=name, label=f"{name}{unit}", values=tuple(values), at=np.array(list(places.values())), log=log, numeric=numeric,
        best=np.array(best), marginal=np.array(marginal), run_at=np.array(run_at), run_values=np.array(run_values),
        failed=np.array(failed, dtype=np.int64), alone=len(document["parameters"]) == 1,
    )  # fmt: skip


def _run_values(document: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Return the objective of the runs of each set that did not fail; of several recordings as multiples of the baseline's."""
    by_set: dict[str, list[float]] = {one["id"]: [] for one in document["sets"]}
    base = next(one for one in document["sets"] if one["baseline"])["recordings"]
    single = not document["objective"]["relative"]
    for run in document["runs"]:
        value = _number(run["objective"])
        unit = 1.0 if single else abs(_number(base[run["recording"]]["median"]))
        if math.isfinite(value) and math.isfinite(unit) and unit > 0:
            by_set[run["set"]].append(value / unit)
    return {name: np.array(values, dtype=np.float64) for name, values in by_set.items()}


def pair_view(document: Mapping[str, Any]) -> PairView | None:
    """Return the two parameters of a sweep over two, if they have few enough values to make a table."""
    views = parameter_views(document)
    if len(views) != 2 or any(len(view.values) > _MOST_CELLS or len(view.values) < 2 for view in views):
        return None
    if len(views[0].values) * len(views[1].values) > 4 * len(document["sets"]):
        return None
    first, second = views
    cells = np.full((len(second.values), len(first.values)), np.nan)
    columns = [_key(value) for value in first.values]
    rows = [_key(value) for value in second.values]
    for one in document["sets"]:
        place = rows.index(_key(one["values"][second.name])), columns.index(_key(one["values"][first.name]))
        cells[place] = _number(one["median"])
    return PairView(first=first, second=second, cells=cells)


def cost_view(document: Mapping[str, Any]) -> CostView | None:
    """Return time against objective; None where fewer than two sets have both, or the objective is a time itself."""
    sets = [one for one in document["sets"] if one["count"] and one["timing"]["total_s"] is not None]
    if len(sets) < 2 or document["objective"]["key"].startswith("time."):
        return None
    times = np.array([_number(one["timing"]["total_s"]) for one in sets])
    values = np.array([_number(one["median"]) for one in sets])
    sign = -1.0 if document["objective"]["best"] == "largest" else 1.0
    front: list[int] = []
    for i in np.lexsort((sign * values, times)).tolist():
        if not front or sign * values[i] < sign * values[front[-1]]:
            front.append(i)
    return CostView(
        times_s=times, values=values, labels=tuple(one["label"] for one in sets),
        baseline=next((i for i, one in enumerate(sets) if one["baseline"]), -1), front=tuple(front),
    )  # fmt: skip


def value_label(value: Any) -> str:
    """Return a value as a tick's label."""
    if value is None:
        return "auto"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def thinned(places: Sequence[float], least: float) -> list[int]:
    """Return the indices of places that are at least so far apart."""
    kept: list[int] = []
    for i, place in enumerate(places):
        if not kept or place - places[kept[-1]] >= least:
            kept.append(i)
    return kept


def _place(value: Any, index: int, *, numeric: bool, log: bool) -> float:
    if not numeric:
        return float(index)
    return math.log10(value) if log else float(value)


def _key(value: Any) -> str:
    return repr(float(value)) if isinstance(value, (int, float)) and not isinstance(value, bool) else repr(value)


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
