# SPDX-License-Identifier: MIT
"""The text of each system's own file for given values: launch XML, Cartographer's Lua, ORB-SLAM's settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

from slamcli.native.cartographer_lua import TABLES

_INDENT = "  "


def format_launch(
    package: str, kind: str, values: Mapping[str, Any], remaps: Mapping[str, str], remarks: Sequence[str] = ()
) -> str:
    """Return a launch file that starts one node with private parameters.

    Parameters
    ----------
    package, kind
        Of the node; it is named as its type.
    values
        Its parameters by name: bool, int, float or str.
    remaps
        Topics by the names that the node gives them.
    remarks
        Lines of a comment on top.
    """
    head = [f"<!-- {line.replace('--', '-')} -->" for line in remarks]
    params = [f"<param name={quoteattr(name)} value={quoteattr(_plain(value))}/>" for name, value in values.items()]
    topics = [f"<remap from={quoteattr(name)} to={quoteattr(topic)}/>" for name, topic in remaps.items()]
    node = f'<node pkg={quoteattr(package)} type={quoteattr(kind)} name={quoteattr(kind)} output="screen">'
    inside = [f"{_INDENT * 2}{line}" for line in (*params, *topics)]
    return "\n".join([*head, "<launch>", f"{_INDENT}{node}", *inside, f"{_INDENT}</node>", "</launch>"]) + "\n"


def format_cartographer_lua(
    options: Mapping[str, Any], values: Mapping[str, Any], *, absent: Sequence[str] = (), remarks: Sequence[str] = ()
) -> str:
    """Return a Lua file of Cartographer: its own defaults included, the node's options, then single values over the defaults.

    Parameters
    ----------
    options
        Of the ROS node: ``tracking_frame`` and so on.
    values
        By native name: ``POSE_GRAPH.constraint_builder.min_score``.
    absent
        Native names of tables that the defaults do not have, so that they are made before a value goes into them.
    remarks
        Lines of a comment on top.
    """
    own = {name: value for name, value in values.items() if name.partition(".")[0] in TABLES.values()}
    foreign: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if name not in own:
            table, _, key = name.partition(".")
            foreign.setdefault(table, {})[key] = value
    lines = [f"-- {line}" for line in remarks]
    lines += ['include "map_builder.lua"', 'include "trajectory_builder.lua"', "", "options = {"]
    lines += [f"{_INDENT}map_builder = MAP_BUILDER,", f"{_INDENT}trajectory_builder = TRAJECTORY_BUILDER,"]
    lines += [f"{_INDENT}{name} = {_lua(value)}," for name, value in options.items()]
    for table, inside in foreign.items():
        entries = ", ".join(f"{key} = {_lua(value)}" for key, value in inside.items())
        lines.append(f"{_INDENT}{table} = {{ {entries} }},")
    lines += ["}", ""]
    for name, value in own.items():
        table = name.rpartition(".")[0]
        if table in absent and f"{table} = {table} or {{}}" not in lines:
            lines.append(f"{table} = {table} or {{}}")
        lines.append(f"{name} = {_lua(value)}")
    return "\n".join([*lines, "", "return options"]) + "\n"


def format_opencv_yaml(
    values: Mapping[str, Any], *, real: Sequence[str] = (), matrices: Mapping[str, tuple[int, int]] | None = None,
    remarks: Sequence[str] = (),
) -> str:  # fmt: skip
    """Return a settings file of ORB-SLAM as OpenCV reads it.

    Parameters
    ----------
    values
        By key: bool (as 0 or 1), int, float or str; a matrix as the text of its numbers, row by row.
    real
        Keys whose numbers must have a decimal point.
    matrices
        Rows and columns of those that are matrices.
    remarks
        Lines of a comment on top.
    """
    lines = ["%YAML:1.0", "", *(f"# {line}" for line in remarks)]
    for name, value in values.items():
        shape = (matrices or {}).get(name)
        if shape is not None:
            data = ", ".join(_real(float(word)) for word in str(value).replace(",", " ").split())
            lines += [f"{name}: !!opencv-matrix", f"   rows: {shape[0]}", f"   cols: {shape[1]}", "   dt: d"]
            lines.append(f"   data: [{data}]")
        elif isinstance(value, bool):
            lines.append(f"{name}: {int(value)}")
        elif isinstance(value, (int, float)):
            lines.append(f"{name}: {_real(float(value)) if name in real or isinstance(value, float) else value}")
        else:
            lines.append(f'{name}: "{value}"')
    return "\n".join(lines) + "\n"


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return _real(value) if isinstance(value, float) else str(value)


def _lua(value: Any) -> str:
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
        return f'"{escaped}"'
    if isinstance(value, float) and value in (float("inf"), float("-inf")):
        return "math.huge" if value > 0 else "-math.huge"
    return _plain(value)


def _real(value: float) -> str:
    """Return a number with a decimal point, as OpenCV tells real numbers from whole ones."""
    text = repr(value)
    if "e" in text and "." not in text:
        mantissa, _, exponent = text.partition("e")
        return f"{mantissa}.0e{exponent}"
    return text
