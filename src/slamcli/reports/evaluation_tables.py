# SPDX-License-Identifier: MIT
"""What `slamcli evaluate` found, as text for a person."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

_COLUMNS = ("rmse", "mean", "median", "std", "min", "max")
_WIDTH = 110
_ALIGNED = {
    "none": "not aligned",
    "se3": "aligned by SE(3)",
    "sim3": "aligned by Sim(3)",
    "scale": "scale corrected only",
    "posyaw": "aligned in position and yaw",
    "origin": "first poses aligned",
}
_RELATIONS = {
    "full": "full transformation",
    "trans_part": "translation",
    "rot_part": "rotation part",
    "angle_deg": "rotation angle",
    "angle_rad": "rotation angle",
    "point_distance": "point distance",
    "point_distance_error_ratio": "distance error ratio",
}

_MAP_FIGURES = {
    "accuracy": "share of the map's walls within {tolerance:g} m of a reference wall",
    "completeness": "share of the reference's walls within {tolerance:g} m of a wall of the map",
    "f_score": "harmonic mean of the two",
    "to_reference.mean": "mean distance from the map's walls to the reference's, m",
    "to_reference.median": "median of it, m",
    "to_reference.p95": "95th percentile of it, m",
    "to_map.mean": "mean distance from the reference's walls to the map's, m",
    "to_map.median": "median of it, m",
    "to_map.p95": "95th percentile of it, m",
    "two_way.mean": "mean of the two means, m",
    "agreement": "share of cells known in both that agree",
    "occupied_iou": "occupied cells in common over occupied cells in either",
    "free_iou": "free cells in common over free cells in either",
    "coverage": "share of the reference's known cells that the map knows",
    "ssim": "structural similarity of the pictures, 1 if equal",
}


def evaluation_text(document: Mapping[str, Any]) -> str:
    """Return the tables for a document of `slamcli.pipelines.evaluate` (a score's ``as_dict()``)."""
    texts = {"trajectory": _trajectory_text, "relations": _relations_text, "map": _map_text}
    return texts[document["kind"]](document)


def _trajectory_text(document: Mapping[str, Any]) -> str:
    poses, coverage, alignment = document["poses"], document["coverage"], document["alignment"]
    few = f" on the first {alignment['num_poses']}" if alignment["num_poses"] != -1 else ""
    scale = f", scale {alignment['scale']:.6g}" if alignment["scale"] != 1.0 else ""
    counts = f"{poses['matched']} poses matched (estimate {poses['estimate']}, reference {poses['reference']})"
    covered = f"{100 * coverage['time']:.0f} % of the reference's time"
    lengths = f"path {document['length_m']['estimate']:.2f} m, reference {document['length_m']['reference']:.2f} m"
    lines = [f"{counts}, {covered}; {lengths}; {_ALIGNED[alignment['mode']]}{few}{scale}"]
    table = _table("error", "unit", *_COLUMNS)
    for key, name in (("ate", "ATE"), ("ate_rot", "ATE"), ("rpe", "RPE"), ("rpe_rot", "RPE")):
        if key in document:
            _add_statistics(table, f"{name} {_RELATIONS[document[key]['pose_relation']]}", document[key])
    parts = [_drawn(table)] if table.row_count else []
    if "rpe" in document:
        rpe = document["rpe"]
        kind = "all pairs" if rpe["all_pairs"] else "consecutive pairs"
        lines.append(f"RPE over {kind} {rpe['delta']:g} {rpe['delta_unit']} apart, {rpe['count']} of them")
    parts += _segment_tables(document)
    return "\n".join([*lines, *parts])


def _segment_tables(document: Mapping[str, Any]) -> list[str]:
    parts = []
    if "kitti" in document:
        kitti = document["kitti"]
        table = _table("KITTI segments", "count", "translation %", "rotation deg/m")
        for row in kitti["lengths"]:
            table.add_row(f"{row['length_m']:g} m", *_cells(row["count"], row["trans_percent"], row["rot_deg_per_m"]))
        table.add_row("mean", *_cells(kitti["count"], kitti["trans_percent"], kitti["rot_deg_per_m"]))
        parts.append(_drawn(table))
    if "segments" in document:
        table = _table("sub-trajectories (mean)", "count", "trans m", "trans %", "rot deg", "yaw deg", "gravity deg")
        names = ("rel_trans", "rel_trans_perc", "rel_rot", "rel_yaw", "rel_gravity")
        for row in document["segments"]:
            values = [row[name]["mean"] for name in names]
            table.add_row(f"{row['length_m']:g} m", *_cells(row["rel_trans"]["count"], *values))
        parts.append(_drawn(table))
    return parts


def _relations_text(document: Mapping[str, Any]) -> str:
    relations = document["relations"]
    line = f"{relations['matched']} of {relations['count']} relations matched, {document['poses']['estimate']} poses"
    table = _table("relations error", "unit", "mean", "± std", *(c for c in _COLUMNS if c not in ("mean", "std")))
    for name, unit, label in (("trans", "m", "translation"), ("rot", "deg", "rotation")):
        figures = relations[name]
        values = [figures["mean"], figures["std"], *(figures[c] for c in _COLUMNS if c not in ("mean", "std"))]
        table.add_row(label, unit, *_cells(*values))
    squared = (
        f"squared: translation {relations['trans_squared']['mean']:.6g} ± {relations['trans_squared']['std']:.6g} m²,"
        f" rotation {relations['rot_squared']['mean']:.6g} ± {relations['rot_squared']['std']:.6g} deg²"
    )
    return "\n".join([line, _drawn(table), squared])


def _map_text(document: Mapping[str, Any]) -> str:
    registration = document["registration"]
    line = (
        f"map moved by x {registration['x_m']:.4f} m, y {registration['y_m']:.4f} m,"
        f" yaw {registration['yaw_deg']:.4f} deg onto the reference; overlap {100 * registration['overlap']:.1f} %"
    )
    table = _table("map", "value", "what")
    for key, what in _MAP_FIGURES.items():
        value = document["map"]
        for part in key.split("."):
            value = value[part]
        table.add_row(key, _number(value), what.format(tolerance=document["map"]["tolerance_m"]))
    return "\n".join([line, _drawn(table)])


def _table(first: str, *columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for column in columns:
        table.add_column(column, justify="left" if column in ("unit", "what") else "right", no_wrap=column != "what")
    return table


def _add_statistics(table: Table, label: str, figures: Mapping[str, Any]) -> None:
    table.add_row(label, figures["unit"], *_cells(*(figures[column] for column in _COLUMNS)))


def _cells(*values: float) -> Sequence[str]:
    return [_number(value) for value in values]


def _number(value: float) -> str:
    if isinstance(value, int):
        return str(value)
    return f"{value:.4f}" if 1e-3 <= abs(value) < 1e4 or value == 0 else f"{value:.3e}"


def _drawn(table: Table) -> str:
    stream = io.StringIO()
    Console(file=stream, width=_WIDTH, color_system=None, highlight=False).print(table)
    return stream.getvalue().rstrip("\n")
