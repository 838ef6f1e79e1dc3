# SPDX-License-Identifier: MIT
"""What costmap_2d's parameter files say: sections, layers under any name, pre-Hydro spellings, sensor sources."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from slamcli.errors import ConfigError
from slamcli.navigation.costmap_parameters import (
    ALIASES,
    LAYER_TYPES,
    OBSTACLE_LAYER_NAMES,
    SOURCE_NAMES,
    WITHOUT_EFFECT_ON_A_SAVED_MAP,
    CostmapParameters,
)
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import Declaration, convert, declarations, resolve, unknown_name

_OURS = ("global_costmap", "ros__parameters")
_PLANNER_SECTIONS = ("NavfnROS", "GlobalPlanner", "navfn")
_SENSOR_LAYERS = ("obstacle_layer", "obstacles", "voxel_layer")


@dataclass(slots=True)
class NavigationSettings:
    """Values that files and options have set, by declared name."""

    costmap: dict[str, Any] = field(default_factory=dict)
    planner: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """What was accepted but has no meaning here."""

    def build(self) -> tuple[CostmapParameters, PlannerParameters]:
        """Return the parameters, checked."""
        return resolve(CostmapParameters, self.costmap), resolve(PlannerParameters, self.planner)


def read_settings(entries: Iterable[tuple[str, Any, str]]) -> NavigationSettings:
    """Return what parameters say that come as name (parts joined by ``/`` or ``.``), value and source; later ones win.

    Raises
    ------
    ConfigError
        If a name is unknown (the message names the nearest one), or a value has the wrong type or range.
    """
    settings = NavigationSettings()
    reader = _Reader(settings)
    stripped = [(_strip(name.replace("/", ".").split(".")), value, source) for name, value, source in entries]
    reader.learn(stripped)
    for parts, value, source in stripped:
        reader.take(parts, value, source)
    reader.summarise()
    return settings


def _strip(parts: list[str]) -> list[str]:
    while len(parts) > 1 and parts[0] in _OURS:
        parts = parts[1:]
    return parts


class _Reader:
    def __init__(self, settings: NavigationSettings) -> None:
        self._settings = settings
        self._costmap = {d.name: d for d in declarations(CostmapParameters)}
        self._planner = {d.name: d for d in declarations(PlannerParameters)}
        self._layers = {layer: layer for layer in (*LAYER_TYPES.values(), *_SENSOR_LAYERS)}
        self._sources: set[str] = set()
        self._ignored: dict[str, list[str]] = {}

    def learn(self, entries: list[tuple[list[str], Any, str]]) -> None:
        """Find out what the layers and the sensor sources are called."""
        for parts, value, _ in entries:
            if parts == ["plugins"] and isinstance(value, list):
                for plugin in value:
                    if isinstance(plugin, dict) and "name" in plugin:
                        kind = str(plugin.get("type", "")).rsplit(":", 1)[-1]
                        self._layers[str(plugin["name"])] = LAYER_TYPES.get(kind, "other")
            elif len(parts) == 2 and parts[1] == "plugin":
                self._layers[parts[0]] = LAYER_TYPES.get(str(value).rsplit(":", 1)[-1], "other")
            elif parts[-1] == "observation_sources":
                self._sources.update(str(value).split())

    def take(self, parts: list[str], value: Any, source: str) -> None:
        """Put one value where it belongs."""
        head, name = parts[0], ".".join(parts)
        if head in _PLANNER_SECTIONS and len(parts) == 2:
            self._take_planner(parts[1], value, source)
        elif head == "local_costmap":
            self._ignore("local_costmap", "configures the local costmap, which planning on a map does not have")
        elif parts[0] in ("plugins", "layers") or parts[-1] == "plugin":
            self._ignore(parts[-1], "the layers here are always the static layer and inflation")
        elif head in self._layers and len(parts) > 1:
            self._take_layer(self._layers[head], parts[1:], value, source)
        elif (
            name in ALIASES
        ):  # before Hydro's track_unknown_space is the map's, too: that is what counts on a saved map
            self._set(self._settings.costmap, self._costmap[ALIASES[name]], value, source)
        elif name in self._costmap:
            self._set(self._settings.costmap, self._costmap[name], value, source)
        elif self._is_sensor(parts):
            self._ignore(head, "there are no live sensor data to put on the map")
        elif name in self._planner:
            self._take_planner(name, value, source)
        else:
            raise ConfigError(unknown_name(name, [*self._costmap, *ALIASES, *self._planner], source))

    def _take_layer(self, layer: str, rest: list[str], value: Any, source: str) -> None:
        if layer == "other":
            self._ignore(".".join(rest), "its layer has no counterpart here")
            return
        if layer in _SENSOR_LAYERS:
            if not self._is_sensor(rest):
                known = [*OBSTACLE_LAYER_NAMES, *(f"{s}.{n}" for s in sorted(self._sources) for n in SOURCE_NAMES)]
                raise ConfigError(unknown_name(".".join(rest), known, f"{source}, {layer}"))
            self._ignore(layer, "there are no live sensor data to put on the map")
            return
        name = ".".join([layer, *rest])
        if name not in self._costmap:
            raise ConfigError(unknown_name(name, [k for k in self._costmap if k.startswith(layer)], source))
        self._set(self._settings.costmap, self._costmap[name], value, source)

    def _is_sensor(self, parts: list[str]) -> bool:
        if len(parts) == 1:
            return parts[0] in OBSTACLE_LAYER_NAMES
        return len(parts) == 2 and parts[0] in self._sources and parts[1] in SOURCE_NAMES

    def _take_planner(self, name: str, value: Any, source: str) -> None:
        if name not in self._planner:
            raise ConfigError(unknown_name(name, self._planner, source))
        self._set(self._settings.planner, self._planner[name], value, source)

    def _set(self, values: dict[str, Any], declaration: Declaration, value: Any, source: str) -> None:
        try:
            values[declaration.name] = convert(declaration, value)
        except ConfigError as error:
            raise ConfigError(f"{source}: {error}") from error
        if declaration.name in WITHOUT_EFFECT_ON_A_SAVED_MAP or not declaration.effective:
            self._ignore(declaration.name, "no meaning when planning on a saved map")

    def _ignore(self, name: str, why: str) -> None:
        names = self._ignored.setdefault(why, [])
        if name not in names:
            names.append(name)

    def summarise(self) -> None:
        """Say once per reason what was ignored."""
        for why, names in self._ignored.items():
            self._settings.notes.append(f"accepted without effect: {', '.join(names)} ({why})")
