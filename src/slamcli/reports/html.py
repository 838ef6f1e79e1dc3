# SPDX-License-Identifier: MIT
"""The report of one run: a single HTML file that a browser shows without any network."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Iterator, Mapping, Sequence
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
from slamcli.trajectory import Trajectory
from slamcli.vision.pictures import KeyframeView, PlaceView

_NO_STAGE = ("total_s", "realtime_factor", "recording_s", "jobs")


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
            page.section("Time per stage", _timing(run.get("timing") or {})),
            page.section("Notes", page.bullets([str(n) for n in run.get("notes") or ()])),
            page.section("Counts", _pairs(run.get("counts") or {})),
            page.section("Summary", _pairs(run.get("summary") or {})),
            page.section("Parameters", _parameters(run, declared)),
            page.section(
                "Input, topics and frames", _inputs(run), _pairs({**_flat(run, "topics"), **_flat(run, "frames")})
            ),
            page.section("How to make this again", _reproduce(run)),
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


def _timing(timing: Mapping[str, Any]) -> str:
    total = timing.get("total_s")
    nested = timing.get("stages_s") or timing.get("stages")
    stages = nested if isinstance(nested, Mapping) else timing
    rows = [
        (str(name), float(value))
        for name, value in stages.items()
        if isinstance(value, (int, float)) and name not in _NO_STAGE
    ]
    if not rows:
        return ""
    whole = max(float(total or 0.0), sum(v for _, v in rows), 1e-9)
    body = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{value:.3f} s</td><td class="n">{100 * value / whole:.1f} %</td>'
        f'<td class="wide"><div class="bar" style="width:{100 * value / whole:.1f}%"></div></td></tr>\n'
        for name, value in rows
    )
    return f'<div class="scroll"><table><tbody>{body}</tbody></table></div>'


def _pairs(values: Mapping[str, Any]) -> str:
    return page.table(["what", "value"], [(name.replace("_", " "), value) for name, value in _leaves(values)])


def _leaves(values: Mapping[str, Any], prefix: str = "", depth: int = 3) -> Iterator[tuple[str, Any]]:
    """Yield names and values of a document, those of inner documents under their path of names."""
    for key, value in values.items():
        name = f"{prefix} {key}" if prefix else str(key)
        if isinstance(value, Mapping) and value and depth > 0:
            yield from _leaves(value, name, depth - 1)
        elif value or not isinstance(value, Mapping):  # of an empty document there is nothing to say
            yield name, value


def _flat(run: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = run.get(key) or {}
    word = key.removesuffix("s")
    return {f"{word} {k}": v for k, v in value.items()} if isinstance(value, Mapping) else {key: value}


def _parameters(run: Mapping[str, Any], declared: Sequence[Declaration]) -> str:
    values: Mapping[str, Any] = run.get("parameters") or {}
    changed = set(run.get("changed_parameters") or run.get("changed") or ())
    known = {d.name: d for d in declared}
    rows = []
    for name, value in values.items():
        d = known.get(name)
        is_changed = name in changed or (d is not None and value != d.default)
        cells = [
            name,
            _exact(value),
            d.unit if d else "",
            _exact(d.default) if d else "",
            "changed" if is_changed else "",
            d.help if d else "",
        ]
        row = "".join(
            f"<td>{'<code>' if i == 0 else ''}{escape(c)}{'</code>' if i == 0 else ''}</td>"
            for i, c in enumerate(cells)
        )
        rows.append((not is_changed, f"<tr{' class=changed' if is_changed else ''}>{row}</tr>\n"))
    if not rows:
        return ""
    rows.sort(key=lambda row: row[0])  # changed ones first, else in the order in which they are declared
    head = "".join(f"<th>{h}</th>" for h in ("parameter", "value", "unit", "default", "", "what it does"))
    body = "".join(row for _, row in rows)
    count = sum(not unchanged for unchanged, _ in rows)
    told = f'<p class="soft">{len(rows)} parameters, {count} changed from the default.</p>'
    return f'{told}<div class="scroll"><table class="wordy"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _exact(value: Any) -> str:
    """Return a parameter's value as it would be written to set it."""
    if value is None:
        return "auto"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _inputs(run: Mapping[str, Any]) -> str:
    rows = [
        (
            i.get("name", ""),
            f"{i['size_bytes']:,} bytes" if isinstance(i.get("size_bytes"), int) else "",
            i.get("sha256", ""),
        )
        for i in run.get("inputs") or ()
        if isinstance(i, Mapping)
    ]
    return page.table(["file", "size", "SHA-256"], rows, numeric=[1])


def _reproduce(run: Mapping[str, Any]) -> str:
    command = run.get("command") or ""
    line = shlex.join(str(c) for c in command) if isinstance(command, (list, tuple)) else str(command)
    shown = f"<pre>{escape(line)}</pre>" if line else ""
    versions = page.table(["software", "version"], sorted((run.get("versions") or {}).items()))
    return shown + versions
