# SPDX-License-Identifier: MIT
"""The picture of an evaluation: both paths, coloured by error, and the errors over time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slamcli.trajectory import Trajectory

_AXES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
_DPI = 120


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """Errors over time."""

    label: str
    at: NDArray[np.float64]
    """float64 (N,), seconds from the start, or the number of the pose."""
    values: NDArray[np.float64]
    """float64 (N,)."""


def trajectory_plot(
    reference: Trajectory, estimate: Trajectory, errors: Series | None, series: Sequence[Series]
) -> bytes:
    """Return a PNG of two matched trajectories seen along their flattest direction, and their errors over time.

    Parameters
    ----------
    reference, estimate
        Trajectories of equal length; the estimate aligned.
    errors
        One error per pose, which colours the estimate, or None.
    series
        Errors to draw over time, one axis each.
    """
    figure = Figure(figsize=(10, 4.2 + 1.8 * len(series)), dpi=_DPI, layout="constrained")
    grid = figure.add_gridspec(1 + len(series), 1, height_ratios=[4.2, *[1.8] * len(series)])
    _draw_paths(figure, figure.add_subplot(grid[0]), reference, estimate, errors)
    for row, one in enumerate(series, start=1):
        _draw_series(figure.add_subplot(grid[row]), one, timed=reference.timed, last=row == len(series))
    return _png(figure)


def relations_plot(trajectory: Trajectory, series: Sequence[Series]) -> bytes:
    """Return a PNG of a trajectory and the errors of its relations over time."""
    figure = Figure(figsize=(10, 4.2 + 1.8 * len(series)), dpi=_DPI, layout="constrained")
    grid = figure.add_gridspec(1 + len(series), 1, height_ratios=[4.2, *[1.8] * len(series)])
    axes = figure.add_subplot(grid[0])
    axes.plot(*trajectory.positions_m[:, :2].T, color="#1f77b4", linewidth=1.0)
    _label(axes, "xy")
    for row, one in enumerate(series, start=1):
        below = figure.add_subplot(grid[row])
        below.plot(one.at, one.values, ".", color="#d62728", markersize=3)
        below.set_ylabel(one.label)
        below.grid(alpha=0.3)
        if row == len(series):
            below.set_xlabel("time from the start in s")
    return _png(figure)


def map_plot(
    walls_m: NDArray[np.float64],
    distances_m: NDArray[np.float64],
    reference_m: NDArray[np.float64],
    reference_distances_m: NDArray[np.float64],
) -> bytes:
    """Return a PNG of the walls of two maps, coloured by distance, and how the distances are spread.

    Parameters
    ----------
    walls_m, distances_m
        float64 (K, 2) walls of the map in the frame of the reference, and (K,) distances to the reference's nearest wall.
    reference_m, reference_distances_m
        float64 (M, 2) walls of the reference, and (M,) distances to the map's nearest wall.
    """
    figure = Figure(figsize=(10, 10), dpi=_DPI, layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=[7, 2])
    axes = figure.add_subplot(grid[0])
    size = float(np.clip(12_000 / max(len(walls_m), len(reference_m)), 1.5, 14))
    axes.scatter(reference_m[:, 0], reference_m[:, 1], color="0.75", s=2 * size, marker="s", linewidths=0)
    top = float(np.percentile(distances_m, 99)) or 0.01
    points = axes.scatter(
        walls_m[:, 0], walls_m[:, 1], c=distances_m, s=size, cmap="viridis", vmin=0, vmax=top, linewidths=0
    )
    figure.colorbar(points, ax=axes, label="distance to the reference's walls in m")
    _label(axes, "xy")
    axes.set_title("walls of the map (coloured) on the reference (grey)", fontsize="medium")
    below = figure.add_subplot(grid[1])
    for values, label in ((distances_m, "map to reference"), (reference_distances_m, "reference to map")):
        below.plot(np.sort(values), np.linspace(0, 100, len(values)), label=label)
    below.set_xlim(0, max(float(np.percentile(np.concatenate([distances_m, reference_distances_m]), 98)), 0.02))
    below.set_xlabel("distance in m")
    below.set_ylabel("share of walls in %")
    below.legend(loc="lower right", fontsize="small")
    below.grid(alpha=0.3)
    return _png(figure)


def _draw_paths(figure: Figure, axes: Axes, reference: Trajectory, estimate: Trajectory, errors: Series | None) -> None:
    plane = _plane(reference.positions_m)
    i, j = _AXES[plane]
    axes.plot(
        reference.positions_m[:, i], reference.positions_m[:, j], "--", color="0.45", linewidth=1, label="reference"
    )
    x, y = estimate.positions_m[:, i], estimate.positions_m[:, j]
    if errors is None:
        axes.plot(x, y, color="#1f77b4", linewidth=1.2, label="estimate")
    else:
        axes.plot(x, y, color="0.8", linewidth=0.8, zorder=1)
        points = axes.scatter(x, y, c=errors.values, s=5, cmap="viridis", label="estimate", zorder=2)
        figure.colorbar(points, ax=axes, label=errors.label)
    axes.legend(loc="best", fontsize="small")
    _label(axes, plane)


def _draw_series(axes: Axes, series: Series, *, timed: bool, last: bool) -> None:
    axes.plot(series.at, series.values, color="#d62728", linewidth=0.9)
    rmse = float(np.sqrt(np.mean(series.values**2)))
    axes.axhline(rmse, color="0.4", linestyle=":", linewidth=1, label=f"rmse {rmse:.4g}")
    axes.legend(loc="upper right", fontsize="small")
    axes.set_ylabel(series.label)
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    if last:
        axes.set_xlabel("time from the start in s" if timed else "pose")


def _plane(positions: NDArray[np.float64]) -> str:
    """Return the plane that shows most: without the axis along which the path is thinnest."""
    thinnest = int(np.argmin(np.ptp(positions, axis=0)[::-1]))  # z before y before x where equal
    return ("xy", "xz", "yz")[thinnest]


def _label(axes: Axes, plane: str) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{plane[0]} in m")
    axes.set_ylabel(f"{plane[1]} in m")
    axes.grid(alpha=0.3)


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    FigureCanvasAgg(figure).print_png(stream)  # type: ignore[no-untyped-call, unused-ignore]
    return stream.getvalue()
