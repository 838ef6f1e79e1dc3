# SPDX-License-Identifier: MIT
"""Write Cartographer's own tables into configs/*.lua from their declarations: python .ci/parameter_tables.py"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from slamcli.cartographer import CartographerParameters
from slamcli.parameters import Declaration, declarations

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
WIDTH = 120
FILES = {
    "map_builder.lua": ("MAP_BUILDER", ["pose_graph.lua"], {"pose_graph": "POSE_GRAPH"}),
    "pose_graph.lua": ("POSE_GRAPH", [], {}),
    "trajectory_builder.lua": (
        "TRAJECTORY_BUILDER",
        ["trajectory_builder_2d.lua", "trajectory_builder_3d.lua"],
        {"trajectory_builder_2d": "TRAJECTORY_BUILDER_2D", "trajectory_builder_3d": "TRAJECTORY_BUILDER_3D"},
    ),
    "trajectory_builder_2d.lua": ("TRAJECTORY_BUILDER_2D", [], {}),
    "trajectory_builder_3d.lua": ("TRAJECTORY_BUILDER_3D", [], {}),
}
# Cartographer's value where slamcli's default is "found from the recording".
NATIVE = {"MAP_BUILDER.use_trajectory_builder_2d": False, "MAP_BUILDER.use_trajectory_builder_3d": False}


def render(file: str) -> str:
    """Return the text of one preset."""
    table, includes, links = FILES[file]
    lines = [
        "-- SPDX-License-Identifier: MIT",
        f"-- Cartographer's {table} with its defaults, for other files to include.",
        "-- Written by .ci/parameter_tables.py from slamcli's declarations.",
        "",
    ]
    lines += [f'include "{name}"' for name in includes] + [""] * bool(includes)
    entries = [e for e in declarations(CartographerParameters) if e.name.startswith(table + ".") and not e.extension]
    entries = [e for e in entries if NATIVE.get(e.name, e.default) is not None]  # a table that is there is switched on
    lines += [f"{table} = {{", *(f"  {key} = {value}," for key, value in links.items())]
    opened: list[str] = []
    for entry in entries:
        *tables, key = entry.name.split(".")[1:]
        lines += _moved(opened, tables)
        indent = "  " * (len(tables) + 1)
        assignment = f"{indent}{key} = {_lua(NATIVE.get(entry.name, entry.default), entry)},"
        unit = f" [{entry.unit}]" if entry.unit else ""
        comment = f"  -- {entry.help}{unit}" if entry.effective and entry.name not in NATIVE else ""
        lines += (
            [assignment + comment] if len(assignment + comment) <= WIDTH else [indent + comment.strip(), assignment]
        )
        opened = tables
    lines += [*_moved(opened, []), "}"]
    return "\n".join(lines) + "\n"


def _moved(opened: list[str], tables: list[str]) -> list[str]:
    """Return the lines that close and open tables from one place to another."""
    shared = 0
    while shared < min(len(opened), len(tables)) and opened[shared] == tables[shared]:
        shared += 1
    closing = ["  " * (depth + 1) + "}," for depth in range(len(opened) - 1, shared - 1, -1)]
    return closing + ["  " * (depth + 1) + f"{tables[depth]} = {{" for depth in range(shared, len(tables))]


def _lua(value: Any, entry: Declaration) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if entry.unit == "rad" and math.radians(round(math.degrees(value))) == value:
        return f"math.rad({round(math.degrees(value))})" if value else "0."
    return repr(value)


if __name__ == "__main__":
    for name in FILES:
        (CONFIGS / name).write_text(render(name))
