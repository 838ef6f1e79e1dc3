# SPDX-License-Identifier: MIT
"""What makes Cartographer abort, and traps of its parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from slamcli.native.cartographer_lua import CartographerFile, is_preset
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, check_declared
from slamcli.native.settings import Setting, merge
from slamcli.parameters import Declaration

_2D, _3D = "TRAJECTORY_BUILDER_2D", "TRAJECTORY_BUILDER_3D"
_PER_LOOP = "POSE_GRAPH.constraint_builder"
# Keys that Cartographer reads only where they are there; of a table with one of them it reads all.
_OPTIONAL_KEYS = {"publish_to_tf", "publish_tracked_pose", "use_pose_extrapolator", "ignore_out_of_order"}
_OPTIONAL_TABLES = ("pure_localization_trimmer", "overlapping_submaps_trimmer_2d", "intensity_cost_function_options_0")


class _Values:
    """Numbers and switches as a file sets them, defaults where it does not."""

    def __init__(self, settings: Mapping[str, Setting], table: Iterable[Declaration]) -> None:
        self.settings = settings
        self._defaults = {entry.name: entry.default for entry in table}

    def number(self, name: str) -> float:
        """Return a number; NaN where there is none."""
        value = self._value(name)
        return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan

    def switch(self, name: str) -> bool:
        return self._value(name) is True

    def text(self, name: str) -> str:
        value = self._value(name)
        return value if isinstance(value, str) else ""

    def changed(self, start: str) -> list[Setting]:
        """Return the settings of a table that differ from their defaults."""
        found = [s for name, s in self.settings.items() if name.startswith(start)]
        return [s for s in found if s.name in self._defaults and s.value != self._defaults[s.name]]

    def _value(self, name: str) -> Any:
        setting = self.settings.get(name)
        return self._defaults.get(name) if setting is None else setting.value


def check_cartographer(found: CartographerFile, table: tuple[Declaration, ...]) -> Iterator[Finding]:
    """Yield what is wrong with a Lua file of Cartographer: what makes it abort, then what does not do what it seems to.

    Parameters
    ----------
    found
        What the file sets.
    table
        The declarations of the cartographer tier.
    """
    file = found.files[0]
    settings = merge(found.settings)
    own = {s.name: s for s in settings.values() if not is_preset(s.file)}
    for misfit in found.misfits:
        yield Finding(ERROR if misfit.fatal else WARNING, file, 0, misfit.message)
    yield from _declared(own, table)
    values = _Values(settings, table)
    if found.is_node:
        yield from _missing(settings, table, file)
        yield from _builders(values, file)
        yield from _inputs(values, file)
        yield from _frames(values, file)
        yield from _other_builder(values)
    for rule in _TRAPS:
        yield from rule(values, own)


def _declared(own: Mapping[str, Setting], table: tuple[Declaration, ...]) -> Iterator[Finding]:
    """Yield what the declarations alone say: names, types and ranges; no word about defaults that are written out."""
    known = {entry.name: entry for entry in table}
    for setting in own.values():
        entry = known.get(setting.name)
        if entry is not None and entry.kind is bool and not isinstance(setting.value, bool):
            yield at(setting, ERROR, f"{setting.name}={setting.value!r} is no truth value: Cartographer aborts")
        elif entry is not None and entry.extension:
            yield at(setting, WARNING, f"{setting.name} is slamcli's own: Cartographer aborts on it")
            yield from check_declared({setting.name: setting}, table, "Cartographer")
        elif entry is None or setting.value != entry.default:
            yield from check_declared({setting.name: setting}, table, "Cartographer aborts: it")


def _missing(settings: Mapping[str, Setting], table: tuple[Declaration, ...], file: str) -> Iterator[Finding]:
    absent: dict[str, list[str]] = {}
    for entry in table:
        owner, _, key = entry.name.rpartition(".")
        optional = owner.rpartition(".")[2] in _OPTIONAL_TABLES or key in _OPTIONAL_KEYS or entry.extension
        needed = not optional or (
            owner.rpartition(".")[2] in _OPTIONAL_TABLES and any(name.startswith(owner + ".") for name in settings)
        )
        if needed and entry.name not in settings:
            absent.setdefault(entry.name.partition(".")[0] if owner else "options", []).append(entry.name)
    for owner, names in absent.items():
        message = f"Cartographer aborts: {owner} lacks {', '.join(name.removeprefix(owner + '.') for name in names)}"
        yield Finding(ERROR, file, 0, message + "; here they take their defaults")


def _builders(values: _Values, file: str) -> Iterator[Finding]:
    plane, space = (values.switch(f"MAP_BUILDER.use_trajectory_builder_{kind}") for kind in ("2d", "3d"))
    if plane and space:
        yield Finding(ERROR, file, 0, "Cartographer aborts: both use_trajectory_builder_2d and _3d are true")
    elif not plane and not space:
        yield Finding(
            ERROR,
            file,
            0,
            "Cartographer aborts: neither MAP_BUILDER.use_trajectory_builder_2d nor _3d is true; "
            "here the recording decides",
        )
    if space or (plane and values.switch(f"{_2D}.use_imu_data")):
        if values.number("imu_sampling_ratio") == 0:
            message = "no IMU message is used, but the trajectory builder waits for them: nothing is mapped"
            yield at(values.settings["imu_sampling_ratio"], WARNING, f"imu_sampling_ratio 0: {message}")
        frame = values.text("tracking_frame")
        yield Finding(
            NOTE,
            file,
            0,
            f"{'3D' if space else 'use_imu_data'}: Cartographer maps nothing without an IMU and aborts unless "
            f"tracking_frame {frame!r} is at the IMU's place",
        )


def _inputs(values: _Values, file: str) -> Iterator[Finding]:
    names = ("num_laser_scans", "num_multi_echo_laser_scans", "num_point_clouds")
    counts = [values.number(name) for name in names]
    if not any(count > 0 or count < 0 for count in counts):
        yield Finding(ERROR, file, 0, f"Cartographer aborts: {', '.join(names)} are all 0")
    parts = values.number("num_subdivisions_per_laser_scan")
    builder = _3D if values.switch("MAP_BUILDER.use_trajectory_builder_3d") else _2D
    collected = values.number(f"{builder}.num_accumulated_range_data")
    where = values.settings.get("num_subdivisions_per_laser_scan")
    if where is None or not parts > 1 or not collected >= 1:
        return
    if collected < parts:
        message = f"each scan is cut into {parts:g} parts, and every {collected:g} of them are matched alone"
        yield at(where, WARNING, f"{message}: set {builder}.num_accumulated_range_data to {parts:g}")
    elif collected % parts:
        message = f"{builder}.num_accumulated_range_data {collected:g} is no multiple of the {parts:g} parts of a scan"
        yield at(where, WARNING, f"{message}: what is matched begins in the middle of one")


def _frames(values: _Values, file: str) -> Iterator[Finding]:
    names = {role: values.text(f"{role}_frame") for role in ("map", "tracking", "published", "odom")}
    for role, frame in names.items():
        setting = values.settings.get(f"{role}_frame")
        if setting is not None and frame.startswith("/"):
            yield at(setting, ERROR, f"{role}_frame {frame!r}: tf2 refuses names with a leading slash")
        if setting is not None and not frame:
            yield at(setting, ERROR, f"{role}_frame is empty: tf2 refuses it")
    provides = values.switch("provide_odom_frame")
    if provides and names["published"] == names["odom"]:
        message = f"provide_odom_frame with published_frame = odom_frame = {names['odom']!r}: a frame above itself"
        yield Finding(ERROR, file, 0, f"{message}; tf2 refuses it")
    elif provides and values.switch("use_odometry"):
        yield Finding(
            WARNING,
            file,
            0,
            f"provide_odom_frame with use_odometry: where the robot broadcasts {names['odom']} -> "
            f"{names['published']} itself, that frame has two parents; usual is published_frame = "
            f"{names['odom']!r} and provide_odom_frame = false",
        )
    if names["map"] in (names["published"], names["odom"]):
        yield Finding(ERROR, file, 0, f"map_frame {names['map']!r} is also published_frame or odom_frame")


def _other_builder(values: _Values) -> Iterator[Finding]:
    plane, space = (values.switch(f"MAP_BUILDER.use_trajectory_builder_{kind}") for kind in ("2d", "3d"))
    if plane == space:
        return
    other, used = (_3D, "2D") if plane else (_2D, "3D")
    for setting in values.changed(other + "."):
        yield at(setting, WARNING, f"{setting.name} has no effect: the map is built in {used}")


def _ranges(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    for builder in (_2D, _3D):
        low, high = values.number(f"{builder}.min_range"), values.number(f"{builder}.max_range")
        setting = own.get(f"{builder}.max_range") or own.get(f"{builder}.min_range")
        if setting is not None and low >= high:
            yield at(setting, ERROR, f"min_range {low:g} is not below max_range {high:g}: no reading is left")
    ray = own.get(f"{_2D}.missing_data_ray_length")
    if ray is None:
        return
    length, reach = values.number(ray.name), values.number(f"{_2D}.max_range")
    if length > reach:
        message = (
            f"missing_data_ray_length {length:g} is above max_range {reach:g}: free space is drawn where walls may be"
        )
        yield at(ray, WARNING, message)
    else:
        message = "missing_data_ray_length is for finite readings beyond max_range: inf and NaN are dropped before"
        yield at(ray, NOTE, message)


def _filters(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    pairs = {
        _2D: ("adaptive_voxel_filter", "loop_closure_adaptive_voxel_filter"),
        _3D: ("high_resolution_adaptive_voxel_filter", "low_resolution_adaptive_voxel_filter"),
    }
    for builder, filters in pairs.items():
        edge = values.number(f"{builder}.voxel_filter_size")
        for name in filters:
            setting = own.get(f"{builder}.{name}.max_length") or own.get(f"{builder}.voxel_filter_size")
            if setting is not None and values.number(f"{builder}.{name}.max_length") < edge:
                yield at(
                    setting, WARNING, f"{name}.max_length is below voxel_filter_size {edge:g}: the filter does nothing"
                )


def _search(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    for builder in (_2D, _3D):
        if values.switch(f"{builder}.use_online_correlative_scan_matching"):
            continue
        for setting in values.changed(f"{builder}.real_time_correlative_scan_matcher."):
            if setting.name in own:
                yield at(
                    setting, WARNING, f"{setting.name} has no effect: use_online_correlative_scan_matching is false"
                )


def _grids(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    names = [f"{_2D}.submaps.grid_options_2d.grid_type", f"{_2D}.submaps.range_data_inserter.range_data_inserter_type"]
    grid, inserter = map(values.text, names)
    setting = own.get(names[1]) or own.get(names[0])
    if setting is not None and grid in ("PROBABILITY_GRID", "TSDF") and inserter != f"{grid}_INSERTER_2D":
        yield at(setting, ERROR, f"Cartographer aborts: {inserter} does not go with grid_type {grid}")


def _loops(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    score, anywhere = own.get(f"{_PER_LOOP}.min_score"), own.get(f"{_PER_LOOP}.global_localization_min_score")
    least = values.number(f"{_PER_LOOP}.min_score")
    if score is not None and 0.75 < least <= 1:
        yield at(score, WARNING, f"min_score {least:g}: few loop closures fit so well (default 0.55)")
    elif score is not None and 0 <= least < 0.45:
        yield at(score, WARNING, f"min_score {least:g}: wrong loop closures fit as well (default 0.55)")
    elif score is not None and 0.6 <= least <= 0.75:
        yield at(score, NOTE, f"min_score {least:g} is stricter than the default 0.55: fewer loop closures")
    if values.number(f"{_PER_LOOP}.global_localization_min_score") < least and (anywhere or score):
        message = (
            "global_localization_min_score is below min_score: matches without a prior pose are accepted more easily"
        )
        yield at(anywhere or own[f"{_PER_LOOP}.min_score"], WARNING, message)
    for name, effect in (
        ("POSE_GRAPH.optimize_every_n_nodes", "the graph is optimised at the end only"),
        (f"{_PER_LOOP}.sampling_ratio", "no loop closure is looked for"),
        (f"{_PER_LOOP}.max_constraint_distance", "no loop closure is looked for"),
    ):
        if name in own and values.number(name) == 0:
            yield at(own[name], WARNING, f"{name} 0: {effect}")


def _motion(values: _Values, own: Mapping[str, Setting]) -> Iterator[Finding]:
    for builder in (_2D, _3D):
        setting = own.get(f"{builder}.motion_filter.max_angle_radians")
        if setting is not None and 1 <= values.number(setting.name) <= 2 * math.pi:
            message = "max_angle_radians is in radians: a scan is left out until the robot turned by "
            yield at(
                setting, WARNING, f"{message}{math.degrees(values.number(setting.name)):.0f}°; write math.rad(...)"
            )


_TRAPS: tuple[Callable[[_Values, Mapping[str, Setting]], Iterator[Finding]], ...] = (
    _ranges,
    _filters,
    _search,
    _grids,
    _loops,
    _motion,
)
