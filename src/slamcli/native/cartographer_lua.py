# SPDX-License-Identifier: MIT
"""Cartographer's configuration: what its Lua files set, under native names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native._lua_places import LuaPlaces
from slamcli.native.lua import LuaResult, evaluate
from slamcli.native.settings import Setting, shipped_folders

TABLES: Mapping[str, str] = {
    "map_builder": "MAP_BUILDER",
    "map_builder.pose_graph": "POSE_GRAPH",
    "trajectory_builder": "TRAJECTORY_BUILDER",
    "trajectory_builder.trajectory_builder_2d": "TRAJECTORY_BUILDER_2D",
    "trajectory_builder.trajectory_builder_3d": "TRAJECTORY_BUILDER_3D",
}
"""Tables inside of ``options`` by the global variable that they usually come from."""
PRESETS = ("map_builder.lua", "pose_graph.lua", "trajectory_builder.lua", "trajectory_builder_2d.lua", "trajectory_builder_3d.lua")  # fmt: skip
"""The files of Cartographer itself that others include; slamcli brings its own with the same values."""
OPTIONS = "options"
_MAX_SETTINGS = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """A way in which a file does not do what Cartographer wants, or what it seems to do."""

    fatal: bool
    """Whether Cartographer aborts."""
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CartographerFile:
    """What a Lua file sets."""

    settings: tuple[Setting, ...]
    """Native names: ``POSE_GRAPH.constraint_builder.min_score``; options of the ROS node without a table's name."""
    files: tuple[str, ...]
    """The file itself and all that it includes."""
    is_node: bool
    """Whether it returns options of the ROS node, which must be complete; else it only sets tables."""
    misfits: tuple[Misfit, ...]


def read_cartographer_lua(path: Path, folders: Sequence[Path] = ()) -> CartographerFile:
    """Return what a Lua file sets.

    Parameters
    ----------
    path
        A file that returns ``options``, or one of tables only, such as ``pose_graph.lua``.
    folders
        Where included files are looked for besides the file's own folder.

    Raises
    ------
    ConfigError
        As `slamcli.native.lua.evaluate`, and if it sets nothing of Cartographer's.
    """
    result = evaluate(path, folders, [OPTIONS, *TABLES.values()])
    chosen, is_node, misfits = _chosen(result, str(path))
    presets = [file for file, _ in result.files[1:] if is_preset(file)]
    places = LuaPlaces(result.files)
    roots = (OPTIONS, *TABLES.values())
    settings = []
    for table, values in chosen.items():
        for name, value in _leaves(values, table):
            place = places.find(_ways(name), roots, presets) or (str(path), 0)
            settings.append(Setting(name, value, *place))
            if len(settings) > _MAX_SETTINGS:
                raise ConfigError(f"{path}: sets more than {_MAX_SETTINGS} values: is this a configuration?")
    return CartographerFile(
        settings=tuple(settings),
        files=tuple(file for file, _ in result.files),
        is_node=is_node,
        misfits=tuple(misfits),
    )


def is_preset(file: str) -> bool:
    """Whether a file is one of slamcli's copies of Cartographer's defaults."""
    path = Path(file)
    return path.name in PRESETS and path.parent.resolve() in shipped_folders()


def _chosen(result: LuaResult, path: str) -> tuple[dict[str, dict[str, Any]], bool, list[Misfit]]:
    """Return the tables that count by their global names ("" for the node's options), and what is odd."""
    globals_ = {name: table for name, table in result.tables.items() if isinstance(table, dict)}
    misfits = []
    options = result.returned
    if options is None:
        options = globals_.get(OPTIONS)
        if options is not None:
            misfits.append(Misfit(fatal=True, message="it returns nothing: end it with 'return options'"))
    if options is not None and not isinstance(options, dict):
        raise ConfigError(f"{path}: returns {options!r}, not a table: end it with 'return options'")
    own = {name: globals_[name] for name in TABLES.values() if name in globals_}
    if options is None or any(options is table for table in own.values()):
        if not own:
            names = ", ".join(TABLES.values())
            raise ConfigError(f"{path}: sets nothing of Cartographer's: neither {OPTIONS} nor {names}")
        return _unnested(_with_nested(own)), False, misfits
    chosen = {"": {key: value for key, value in options.items() if key not in ("map_builder", "trajectory_builder")}}
    for way, name in TABLES.items():
        table = _at(options, way)
        if isinstance(table, dict):
            chosen[name] = table
            if name in own and own[name] is not table:
                misfits.append(Misfit(fatal=False, message=_detached(name, way)))
        elif name in own:
            chosen[name] = own[name]
            outer, _, key = way.rpartition(".")
            if not outer or isinstance(_at(options, outer), dict):  # else the outer table's absence says it all
                misfits.append(Misfit(fatal=True, message=f"options.{way} is missing: write {key} = {name}"))
        elif table is not None:
            chosen.setdefault("", {})[way] = table  # a value where a table belongs: an unknown name
    return _unnested(chosen), True, misfits


def _with_nested(own: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return global tables and those that stand in them and are no global tables."""
    found = dict(own)
    for way, name in TABLES.items():
        first, _, last = way.rpartition(".")
        inside = own.get(TABLES.get(first, ""), {}).get(last)
        if isinstance(inside, dict):
            found.setdefault(name, inside)
    return found


def _detached(name: str, way: str) -> str:
    return (
        f"{name} was replaced after options.{way} took it: what is set in the new table has no effect; "
        f"change single values ({name}.key = ...) instead"
    )


def _at(options: Mapping[str, Any], way: str) -> Any:
    found: Any = options
    for part in way.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    return found


def _unnested(chosen: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the tables without those that stand in them under a name of their own."""
    inner = {way.partition(".")[2]: TABLES[way.partition(".")[0]] for way in TABLES if "." in way}
    return {
        name: {key: value for key, value in table.items() if not (inner.get(key) == name and isinstance(value, dict))}
        for name, table in chosen.items()
    }


def _leaves(values: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{prefix}.{key}" if prefix else key
        if isinstance(value, dict):
            yield from _leaves(value, name)
        else:
            yield name, value


def _ways(name: str) -> list[str]:
    """Return the ways in which a file may write a native name."""
    table, _, rest = name.partition(".")
    by_name = {name: way for way, name in TABLES.items()}
    if table not in by_name:
        return [f"{OPTIONS}.{name}", name]
    first, _, last = by_name[table].rpartition(".")
    inside = [f"{TABLES[first]}.{last}.{rest}"] if first else []
    return [name, *inside, f"{OPTIONS}.{by_name[table]}.{rest}"]
