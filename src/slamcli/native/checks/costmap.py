# SPDX-License-Identifier: MIT
"""costmap_2d parameters: layers from a plugins list or from before Hydro, sources, traps."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Mapping

from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at, below, check_declared, check_value, number
from slamcli.native.checks.navigation_traps import check_finite
from slamcli.native.ros_parameters.costmap import COSTMAP, LAYERS, PLUGIN_TYPES, PRE_HYDRO, SOURCE
from slamcli.native.settings import Setting
from slamcli.parameters import unknown_name

_LISTS = {"footprint", "plugins"}


def check_costmap(
    settings: Mapping[str, Setting], *, partial: bool = False, cleared: Collection[str] = ("obstacles",)
) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of one costmap.

    With `partial` the settings are one of several files of it (``costmap_common_params.yaml``). `cleared` are the layers that
    recoveries clear.
    """
    yield from check_finite(settings)
    layers = yield from _layers(settings)
    modern = "plugins" in settings
    own = {**{e.name: e for e in COSTMAP}, **({} if modern else {e.name: e for e in PRE_HYDRO})}
    top_sources = _source_names(settings.get("observation_sources"))
    for name, setting in settings.items():
        head, _, rest = name.partition("/")
        if head in _LISTS or (rest and (head in layers or head in top_sources)):
            continue
        if name in own:
            yield from check_value(setting, own[name])
        elif rest:
            yield at(setting, ERROR, f"{unknown_name(head, [*layers, *top_sources])} (no such layer or source)")
        else:
            yield at(setting, ERROR, f"{unknown_name(name, own)} (costmap_2d does not read it)")
    for layer, kind in layers.items():
        yield from _check_layer(below(settings, layer), kind)
    yield from _check_sources(settings, "observation_sources", top_sources)
    yield from _traps(settings, layers, partial, cleared)


def _layers(settings: Mapping[str, Setting]) -> Generator[Finding, None, dict[str, str]]:
    """Yield findings on the plugins list; return layer name -> kind."""
    plugins = settings.get("plugins")
    if plugins is None:
        return dict(zip(LAYERS, LAYERS, strict=True))  # before Hydro the layers have fixed names
    found: dict[str, str] = {}
    for plugin in plugins.value if isinstance(plugins.value, list) else []:
        if not isinstance(plugin, dict) or not {"name", "type"} <= set(plugin):
            yield at(plugins, ERROR, "each entry of plugins needs a name and a type")
            continue
        kind = PLUGIN_TYPES.get(str(plugin["type"]))
        if kind is None:
            yield at(plugins, NOTE, f"layer type {plugin['type']!r} is not checked")
        found[str(plugin["name"])] = kind or ""
    return found


def _check_layer(settings: Mapping[str, Setting], kind: str) -> Iterator[Finding]:
    if kind not in LAYERS:
        return
    sources = _source_names(settings.get("observation_sources"))
    own = {name: s for name, s in settings.items() if name.partition("/")[0] not in sources}
    yield from check_declared(own, LAYERS[kind], kind)
    yield from _check_sources(settings, "observation_sources", sources)
    if kind in ("obstacle_layer", "voxel_layer"):
        yield from _ranges(settings)


def _source_names(setting: Setting | None) -> tuple[str, ...]:
    return tuple(str(setting.value).split()) if setting is not None else ()


def _check_sources(settings: Mapping[str, Setting], key: str, sources: tuple[str, ...]) -> Iterator[Finding]:
    for source in sources:
        entries = below(settings, source)
        if not entries:
            yield at(settings[key], ERROR, f"source {source!r} is named here and described nowhere: nothing is sensed")
            continue
        yield from check_declared(entries, SOURCE, f"source {source!r}")
        first = next(iter(entries.values()))
        if "data_type" not in entries:
            yield at(
                first, WARNING, f"source {source!r} has no data_type: PointCloud is assumed, a laser scan is not read"
            )
        if "clearing" not in entries:
            yield at(first, NOTE, f"source {source!r} does not clear (clearing is false unless set): obstacles stay")
        if number(entries, "min_obstacle_height", 0) > number(entries, "max_obstacle_height", 2):
            yield at(first, ERROR, f"source {source!r}: min_obstacle_height is above max_obstacle_height")
        yield from _ranges(entries)


def _ranges(settings: Mapping[str, Setting]) -> Iterator[Finding]:
    mark, clear = number(settings, "obstacle_range", 2.5), number(settings, "raytrace_range", 3.0)
    if mark > clear and ("obstacle_range" in settings or "raytrace_range" in settings):
        setting = settings.get("obstacle_range") or settings["raytrace_range"]
        yield at(
            setting,
            WARNING,
            f"obstacle_range {mark:g} is above raytrace_range {clear:g}: far obstacles are never cleared",
        )


def _who_clears(cleared: Collection[str]) -> str:
    if set(cleared) == {"obstacles"}:
        return "clear_costmap_recovery clears the layer named 'obstacles' unless told otherwise"
    return f"clear_costmap_recovery is told to clear {', '.join(map(repr, cleared))}"


def _traps(
    settings: Mapping[str, Setting], layers: Mapping[str, str], partial: bool, cleared: Collection[str]
) -> Iterator[Finding]:
    static = settings.get("static_map")
    if static is not None and "plugins" not in settings:
        names = [*(["static_layer"] if static.value is True else []), "obstacle_layer", "inflation_layer"]
        yield at(static, NOTE, f"no plugins list: the layers are those from before Hydro, {', '.join(names)}")
        if "obstacle_layer" not in cleared:
            yield at(
                static,
                WARNING,
                f"{_who_clears(cleared)}; here it is 'obstacle_layer', so that both default recoveries clear nothing: set "
                "layer_names: [obstacle_layer]",
            )
    elif static is not None:
        yield at(static, WARNING, "static_map is not read when there is a plugins list")
    sensing = [layer for layer, kind in layers.items() if kind in ("obstacle_layer", "voxel_layer")]
    if "plugins" in settings and sensing and not set(sensing) & set(cleared):
        message = f"{_who_clears(cleared)}; here there is {', '.join(sensing)}, so that recoveries clear nothing: set layer_names: [{', '.join(sensing)}]"
        yield at(settings["plugins"], WARNING, message)
    rolling = settings.get("rolling_window")
    if rolling is not None and rolling.value is True and static is not None and static.value is True:
        yield at(rolling, WARNING, "rolling_window with static_map: the window shows the static map around the robot")
    if not partial and "robot_radius" in settings and "footprint" in settings:
        yield at(settings["robot_radius"], WARNING, "footprint is set as well: robot_radius is not used")
    for layer, kind in layers.items():
        name = f"{layer}/inflation_radius"
        if kind == "inflation_layer" and name in settings and "robot_radius" in settings:
            radius, robot = number(settings, name, 0.55), number(settings, "robot_radius", 0.46)
            if radius < robot:
                message = f"inflation_radius {radius:g} is below robot_radius {robot:g}: paths may lead through walls"
                yield at(settings[name], WARNING, message)
