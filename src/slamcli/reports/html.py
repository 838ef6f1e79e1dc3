# SPDX-License-Identifier: MIT
"""The report of one run: a single HTML file that a browser shows without any network."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.measurements import PointCloud
from slamcli.parameters import Declaration
from slamcli.posegraph import LoopSearch, MapState
from slamcli.posegraph.keyframe_graph import KeyframeGraph
from slamcli.posegraph.place_closure import PlaceClosure
from slamcli.reports import page, scales, step_charts, svg
from slamcli.reports.closure_section import closure_sections
from slamcli.reports.cloud_section import cloud_figures
from slamcli.reports.graph_section import graph_sections
from slamcli.reports.keyframe_section import keyframe_sections
from slamcli.reports.memory_section import memory_sections
from slamcli.reports.node_axis import NodeAxis
from slamcli.reports.run_sections import flat, input_table, parameter_table, reproduction, timing_table, value_table
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, PlaceView


def report(
    run: Mapping[str, Any],
    *,
    map_image: bytes = b"",
    steps: Mapping[str, NDArray[Any]] | None = None,
    trajectory: Trajectory | None = None,
    truth: Trajectory | None = None,
    errors: Mapping[str, NDArray[Any]] | None = None,
    grid: OccupancyGrid | None = None,
    declared: Sequence[Declaration] = (),
    state: MapState | None = None,
    loop_searches: Sequence[LoopSearch] = (),
    cloud: PointCloud | None = None,
    keyframes: KeyframeGraph | None = None,
    keyframe_views: Sequence[KeyframeView] = (),
    place_views: Sequence[PlaceView] = (),
    closures: Sequence[PlaceClosure] = (),
) -> str:
    """Return the report as HTML; the same input gives the same text.

    Everything is inlined, and the page forbids itself to load anything. Keys of `run` that are missing leave their
    section out.

    Parameters
    ----------
    run
        The ``run.json`` document.
    map_image
        PNG of the map with the trajectory; empty for none.
    steps
        Per-step statistics, columns (N,) of equal length with ``stamp_ns`` among them; see `slamcli.mapper.MappingResult`.
    trajectory, truth
        Where the robot was, and where it really was (in the same frame); drawn over each other if both are there.
    errors
        Error over time: ``stamp_ns`` int64 (N,), ``translation_m`` and ``rotation_rad`` float64 (N,).
    grid
        The map, for its size and areas.
    declared
        Declarations of the system's parameters, for units, defaults and help.
    state, loop_searches
        The pose graph that the run ended with, and every search for a loop closure.
    cloud
        The mapped points in the map frame.
    keyframes, keyframe_views, place_views
        Of a system that sees: the graph of its keyframes or nodes, some of them as pictures, and both sides of loops.
    closures
        Of a system with a memory of places: all that were tried.
    """
    name = _input_name(run)
    title = f"{name} · {run.get('algo', 'slamcli')}"
    began_ns = _began(trajectory, steps)
    return page.document(
        title,
        [
            f"<h1>{escape(title)}</h1>",
            f'<p class="soft">{escape(_subtitle(run))}</p>',
            page.cards(_headline(run, trajectory, grid, errors)),
            page.bullets([str(w) for w in run.get("warnings") or ()], "warnings"),
            page.section("Map", _map(map_image)),
            page.section("Points", *cloud_figures(cloud, trajectory)),
            *graph_sections(state, loop_searches, run, grid, trajectory),
            *keyframe_sections(keyframes, keyframe_views, place_views, grid, trajectory, began_ns, closures),
            *_memory(run, steps or {}, closures, began_ns),
            page.section("Error against ground truth", *_errors(errors, began_ns), _overlay(trajectory, truth)),
            page.section("Steps", *_steps(steps or {}, began_ns)),
            page.section("Time per stage", timing_table(run.get("timing") or {})),
            page.section("Notes", page.bullets([str(n) for n in run.get("notes") or ()])),
            page.section("Counts", value_table(run.get("counts") or {})),
            page.section("Summary", value_table(run.get("summary") or {})),
            page.section("Parameters", parameter_table(run, declared)),
            page.section(
                "Input, topics and frames",
                input_table(run),
                value_table({**flat(run, "topics"), **flat(run, "frames")}),
            ),
            page.section("How to make this again", reproduction(run)),
        ],
    )


def _memory(
    run: Mapping[str, Any], steps: Mapping[str, NDArray[Any]], closures: Sequence[PlaceClosure], began_ns: int | None
) -> list[str]:
    """Return the sections of a system whose steps are the updates of a memory of places."""
    if "hypothesis" not in steps:
        return []
    axis = NodeAxis(steps, began_ns)
    return [*closure_sections(steps, closures, run, axis), *memory_sections(steps, run, axis)]


def _steps(steps: Mapping[str, NDArray[Any]], began_ns: int | None) -> list[str]:
    """Return the charts of steps, none where they have sections of their own."""
    return [] if "hypothesis" in steps else step_charts.figures(steps, began_ns)


def _began(trajectory: Trajectory | None, steps: Mapping[str, NDArray[Any]] | None) -> int | None:
    """Return when time axes begin: with the first pose, or the first step where that came earlier and has no pose."""
    if trajectory is None or not len(trajectory):
        return None
    stepped = () if steps is None else steps.get("stamp_ns", ())[:1]
    return int(min([trajectory.stamps_ns[0], *stepped]))


def _input_name(run: Mapping[str, Any]) -> str:
    inputs = run.get("inputs") or ()
    names = [str(i.get("name", "")).rsplit("/", 1)[-1] for i in inputs if isinstance(i, Mapping)]
    return ", ".join(n for n in names[:3] if n) + (" …" if len(names) > 3 else "") or "slamcli"


def _subtitle(run: Mapping[str, Any]) -> str:
    parts = [f"slamcli {run['slamcli']}" if run.get("slamcli") else ""]
    parts += [f"seed {run['seed']}" if run.get("seed") is not None else ""]
    return " · ".join(p for p in parts if p)


def _headline(
    run: Mapping[str, Any],
    trajectory: Trajectory | None,
    grid: OccupancyGrid | None,
    errors: Mapping[str, NDArray[Any]] | None,
) -> list[tuple[str, str, bool]]:
    timing = run.get("timing") or {}
    facts: list[tuple[str, str, bool]] = []
    if grid is not None:
        known = grid.cells != OccupancyGrid.UNKNOWN
        rows, columns = known.any(axis=1).nonzero()[0], known.any(axis=0).nonzero()[0]
        size = [(int(i[-1] - i[0]) + 1) * grid.resolution_m if len(i) else 0.0 for i in (columns, rows)]
        facts.append((f"{size[0]:.1f} × {size[1]:.1f} m", f"mapped, cells of {grid.resolution_m:g} m", False))
        facts.append((f"{known.sum() * grid.resolution_m**2:.0f} m²", "known area", False))
    if trajectory is not None and len(trajectory):
        span = float(trajectory.stamps_ns.max() - trajectory.stamps_ns.min()) / 1e9
        facts.append((f"{trajectory.length_m:.1f} m", f"driven in {scales.duration(span)}", False))
        facts.append((f"{len(trajectory):,}", "poses", False))
    if errors is not None and len(errors.get("translation_m", ())):
        rmse = float(np.sqrt(np.nanmean(np.square(errors["translation_m"]))))
        facts.append((f"{rmse:.3f} m", "error, root mean square", False))
    if timing.get("realtime_factor"):
        facts.append((f"{float(timing['realtime_factor']):.1f} ×", "real time", False))
    if timing.get("total_s"):
        facts.append((scales.duration(float(timing["total_s"])), "computing", False))
    if run.get("peak_memory_bytes"):
        facts.append((f"{float(run['peak_memory_bytes']) / 1e6:.0f} MB", "peak memory", False))
    warnings = len(run.get("warnings") or ())
    facts.append((str(warnings), "warning" if warnings == 1 else "warnings", warnings > 0))
    return facts


def _map(image: bytes) -> str:
    if not image:
        return ""
    data = base64.b64encode(image).decode("ascii")
    picture = page.zoomable(f'<img src="data:image/png;base64,{data}" alt="map with trajectory">')
    return page.figure(
        picture,
        caption="Black is wall, white is free, bluish grey was never seen. The trajectory runs from dark blue (disc) to orange (square).",
    )


def _errors(errors: Mapping[str, NDArray[Any]] | None, began_ns: int | None) -> list[str]:
    if errors is None or not len(errors.get("stamp_ns", ())):
        return []
    x, x_label = step_charts.time_axis(errors["stamp_ns"], began_ns)
    found: list[str] = []
    for key, factor, title, unit in (
        ("translation_m", 1.0, "Translation", "m"),
        ("rotation_rad", 180 / np.pi, "Rotation", "°"),
    ):
        if key in errors:
            values = np.asarray(errors[key], dtype=np.float64) * factor
            finite = values[np.isfinite(values)]
            line = svg.Series(label=title, x=x, y=values, colour=len(found))
            chart = svg.Chart(
                title=f"{title} error", x_label=x_label, y_label=f"{title.lower()} error in {unit}", series=[line]
            )
            told = ""
            if len(finite):
                rmse = float(np.sqrt(np.mean(finite**2)))
                told = f"root mean square {rmse:.4g} {unit}, mean {finite.mean():.4g} {unit}, largest {finite.max():.4g} {unit}"
            found.append(page.figure(svg.line_chart(chart), f"{title} error", told))
    return found


def _overlay(trajectory: Trajectory | None, truth: Trajectory | None) -> str:
    if trajectory is None or truth is None or not len(truth):
        return ""
    lines = [("ground truth", truth.positions_m[:, :2]), ("trajectory", trajectory.positions_m[:, :2])]
    return page.figure(svg.plane_chart("Trajectory and ground truth from above", lines), "Trajectory and ground truth")
