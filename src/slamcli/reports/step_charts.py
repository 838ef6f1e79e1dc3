# SPDX-License-Identifier: MIT
"""Charts of per-step statistics: which columns a tier gives is its own business; known ones get their words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.reports import page, svg


@dataclass(frozen=True, slots=True)
class _Known:
    """Words for a column that several tiers may give."""

    title: str
    unit: str
    caption: str
    beside: str = ""
    """A column that is drawn into the same chart."""
    marks: str = ""
    """A column of 0 and 1 whose ones are marked at the top."""
    from_zero: bool = True
    label: str = ""
    """Name in the legend."""
    empty_first: bool = False
    """Whether the first step has no value (there is no map yet to match with)."""
    factor: float = 1.0
    """What values are multiplied with to be in `unit`."""


_KNOWN = {
    "score": _Known(
        "Score of local SLAM",
        "0 to 1",
        "How well each scan fits what it is matched with: the mean probability of the cells below its points, with planes the share of its points that agree. It "
        "falls when a new submap begins; a drop elsewhere is a place where the scan fits badly: people, glass, or a pose that is wrong.",
        empty_first=True,
    ),
    "shift_m": _Known(
        "Shift by the match",
        "mm",
        "How far the match moved each scan from its prediction; peaks are predictions that failed.",
        factor=1e3,
        empty_first=True,
    ),
    "turn_rad": _Known("Turn by the match", "°", "Likewise its heading.", factor=180.0 / np.pi, empty_first=True),
    "scan_odometry_quality": _Known(
        "Quality of the scan odometry",
        "share of points",
        "Share of each scan's points that lie on a surface that the scans before it saw.",
        empty_first=True,
    ),
    "points": _Known(
        "Points of each scan", "points", "After the voxel filter; few points are a sensor that sees little."
    ),
    "neff": _Known(
        "Effective number of particles",
        "particles",
        "How many particles carry weight. It falls while the filter collects evidence; at a resampling (tick) the unlikely ones are replaced.",
        beside="num_particles",
        marks="resampled",
        label="effective number",
    ),
    "best_score": _Known(
        "Score of the best match",
        "score",
        "How well the scan fits the best particle's map; a drop is a place where it fits badly.",
        empty_first=True,
    ),
    "log_likelihood": _Known(
        "Log-likelihood of the best particle", "", "Of this step's scan.", from_zero=False, empty_first=True
    ),
    "points_held": _Known(
        "Points tracked in each frame",
        "points",
        "How many points of the map agree with each frame's pose. Where they come near 30 the track is about to be lost; ticks are frames without a pose.",
        marks="untracked",
    ),
    "keyframes": _Known(
        "Keyframes of the map",
        "keyframes",
        "It falls where keyframes that show nothing of their own are taken out, and where another map is begun.",
    ),
    "map_points": _Known("Points of the map", "points", "Those of the map that is being built."),
    "fallbacks": _Known(
        "Failed matches",
        "particles",
        "Particles whose scan could not be matched at this step, so that their odometry was taken as it is.",
    ),
    "odometry_disagreement": _Known(
        "Disagreement of odometry and scans",
        "standard deviations",
        "How far the matched motion lies from what the wheels told, in standard deviations of the motion model; peaks are slip, bumps, or clocks that do not agree.",
    ),
    "particles": _Known(
        "Particles",
        "particles",
        "As many as their spread asks for; ticks are scans that moved and weighed them.",
        marks="used",
    ),
    "groups": _Known("Groups of particles", "groups", "Places where the robot may be; one where it is known."),
    "best_weight": _Known(
        "Weight of the best group", "share", "How much of all weight the place that is told has.", from_zero=True
    ),
    "scan_fit": _Known(
        "Fit of the scan to the map",
        "0 to 1",
        "1: all readings lie on walls. It falls where the surroundings have changed or people stand, and where the pose is wrong.",
    ),
    "deviation_m": _Known(
        "Standard deviation of the position", "m", "Of all particles about their mean, both coordinates together."
    ),
    "deviation_rad": _Known("Standard deviation of the heading", "°", "Likewise.", factor=180.0 / np.pi),
}
_BESIDE = {
    "used": "scan used",
    "num_particles": "number of particles",
    "resampled": "resampling",
    "untracked": "frame without a pose",
}
_HIDDEN = ("stamp_ns", "used", "resampled", "num_particles", "inserted", "node", "tracked", "untracked")


def figures(steps: Mapping[str, NDArray[Any]], began_ns: int | None = None) -> list[str]:
    """Return one chart per column, as markup; columns that never change are told in one line.

    Parameters
    ----------
    steps
        Columns (N,) of equal length; nothing is drawn without ``stamp_ns``.
    began_ns
        The stamp at which the time axis begins; None for the first step's.
    """
    stamps = steps.get("stamp_ns")
    if stamps is None or len(stamps) == 0:
        return []
    x, x_label = time_axis(stamps, began_ns)
    if "tracked" in steps:
        steps = {**steps, "untracked": np.asarray(steps["tracked"]) == 0}
    names = [n for n in _KNOWN if n in steps] + [n for n in steps if n not in _KNOWN]
    found, constant = [_totals(steps)], []
    for name in names:
        values = np.asarray(steps[name])
        if name in _HIDDEN or "index" in name or values.shape != x.shape or values.dtype.kind not in "biuf":
            continue
        y = values.astype(np.float64)
        finite = y[np.isfinite(y)]
        if not len(finite) or finite.min() == finite.max():
            constant.append((name, finite[0] if len(finite) else None))
            continue
        found.append(_figure(name, y, steps, x, x_label))
    if constant:
        found.append(
            page.figure(
                "", caption="The same at every step: " + ", ".join(f"{n} = {page.plain(v)}" for n, v in constant) + "."
            )
        )
    return [f for f in found if f]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepSeries:
    """One column as it is drawn."""

    title: str
    unit: str
    caption: str
    values: NDArray[np.float64]
    """float64 (N,) in `unit`; NaN where a step has none."""
    marks: NDArray[np.bool_] | None
    """bool (N,), the steps that are marked."""
    from_zero: bool


def series(steps: Mapping[str, NDArray[Any]]) -> list[StepSeries]:
    """Return the columns that are worth a chart, in the order and units of `figures`; those that never change are left out."""
    if "tracked" in steps:
        steps = {**steps, "untracked": np.asarray(steps["tracked"]) == 0}
    count = len(steps.get("stamp_ns", ()))
    found = []
    for name in [n for n in _KNOWN if n in steps] + [n for n in steps if n not in _KNOWN]:
        values = np.asarray(steps[name])
        if name in _HIDDEN or "index" in name or values.shape != (count,) or values.dtype.kind not in "biuf":
            continue
        y = values.astype(np.float64)
        finite = y[np.isfinite(y)]
        if not len(finite) or finite.min() == finite.max():
            continue
        known = _KNOWN.get(name, _Known(name.replace("_", " ").capitalize(), "", ""))
        if known.empty_first and y[0] == 0:
            y[0] = np.nan
        events = steps.get(known.marks)
        marks = np.asarray(events) != 0 if events is not None and np.shape(events) == (count,) else None
        found.append(StepSeries(
            title=known.title, unit=known.unit, caption=known.caption, values=y * known.factor, marks=marks, from_zero=known.from_zero,
        ))  # fmt: skip
    return found


def time_axis(stamps_ns: NDArray[Any], began_ns: int | None = None) -> tuple[NDArray[np.float64], str]:
    """Return the times float64 (N,) since `began_ns`, not decreasing, and the axis label with its unit.

    Where a clock ran backwards, the axis waits until it has caught up.
    """
    stamps = np.maximum.accumulate(np.asarray(stamps_ns, dtype=np.int64))
    elapsed = (stamps - (int(stamps[0]) if began_ns is None else began_ns)) / 1e9
    span = float(elapsed[-1] - elapsed[0]) if len(elapsed) else 0.0
    if span > 3 * 3600:
        return elapsed / 3600, "time in h"
    return (elapsed / 60, "time in min") if span > 600 else (elapsed, "time in s")


def _totals(steps: Mapping[str, NDArray[Any]]) -> str:
    """Return one line that sums up the events."""
    parts = [_counted(len(steps["stamp_ns"]), "step")]
    if "tracked" in steps:
        parts.append(_counted(int(np.count_nonzero(np.asarray(steps["tracked"]) == 0)), "frame") + " without a pose")
    if "resampled" in steps:
        parts.append(_counted(int(np.count_nonzero(steps["resampled"])), "resampling"))
    if "fallbacks" in steps:
        failed = np.asarray(steps["fallbacks"], dtype=np.float64)
        where = _counted(int(np.count_nonzero(failed)), "step")
        parts.append(f"{_counted(int(failed.sum()), 'failed match', 'es')} of single particles at {where}")
    return f'<p class="soft">{", ".join(parts)}.</p>'


def _counted(count: int, word: str, plural: str = "s") -> str:
    return f"{count:,} {word}{'' if count == 1 else plural}"


def _figure(
    name: str, y: NDArray[np.float64], steps: Mapping[str, NDArray[Any]], x: NDArray[np.float64], x_label: str
) -> str:
    known = _KNOWN.get(name, _Known(name.replace("_", " "), "", ""))
    if known.empty_first and y[0] == 0:
        y = np.concatenate([[np.nan], y[1:]])
    y = y * known.factor
    series = [svg.Series(label=known.label or name.replace("_", " "), x=x, y=y)]
    beside = steps.get(known.beside)
    if beside is not None and beside.shape == x.shape:
        other = np.asarray(beside, dtype=np.float64)
        series.insert(0, svg.Series(label=_BESIDE.get(known.beside, known.beside), x=x, y=other, colour=1))
    events = steps.get(known.marks)
    marks = x[np.asarray(events) != 0] if events is not None and events.shape == x.shape else np.zeros(0)
    chart = svg.Chart(
        title=known.title,
        x_label=x_label,
        y_label=known.unit or name.replace("_", " "),
        series=series,
        marks_x=marks,
        marks_label=_BESIDE.get(known.marks, known.marks),
        from_zero=known.from_zero,
    )
    return page.figure(svg.line_chart(chart), known.title, known.caption)
