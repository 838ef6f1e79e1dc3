# SPDX-License-Identifier: MIT
"""The two costmaps of move_base from its parameter files: sections, lists of plugins, pre-Hydro flags, nav2's spellings."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from slamcli.errors import ConfigError
from slamcli.navigation.costmap_parameters import ALIASES, LAYER_TYPES, CostmapParameters
from slamcli.navigation.layered_parameters import CostmapName, Kind, LayeredParameters, LayerParameters
from slamcli.navigation.obstacle_parameters import ObservationSource, ObstacleParameters, SourceParameters
from slamcli.parameters import Declaration, convert_at, declarations, unknown_name

Entry = tuple[str, Any, str]
"""Name (parts joined by ``/`` or ``.``), value, and where it stands."""

_SECTIONS: dict[str, CostmapName] = {"global_costmap": "global", "local_costmap": "local"}
_KINDS: dict[str, Kind] = {
    "StaticLayer": "static",
    "ObstacleLayer": "obstacle",
    "VoxelLayer": "voxel",
    "InflationLayer": "inflation",
}
_NAV2_SPELLINGS = {"obstacle_max_range": "obstacle_range", "raytrace_max_range": "raytrace_range"}
_SEARCHED = ("obstacle_range", "raytrace_range")
"""What costmap_2d looks for in the source, then its layer, then the costmap."""
_VOXEL_NAMES = ("origin_z", "z_resolution", "z_voxels", "mark_threshold", "unknown_threshold", "publish_voxel_map")
_MOVED = ("max_obstacle_height", *_SEARCHED, *_VOXEL_NAMES)
"""What was the costmap's before Hydro and is its obstacle layer's now."""
_NO_MEANING = {
    "map_subscribe_transient_local",
    "use_sim_time",
    "filters",
    "layers",
    "map_vis_z",
    "transform_tolerance",
}
_COSTMAP = {d.name: d for d in declarations(CostmapParameters)}
_OBSTACLE = {d.name: d for d in declarations(ObstacleParameters)}
_SOURCE = {d.name: d for d in declarations(SourceParameters)}
_USUAL_LAYERS = frozenset({*LAYER_TYPES.values(), "voxel_layer", "obstacles"})


@dataclass(frozen=True, slots=True, kw_only=True)
class CostmapPair:
    """What move_base works with."""

    global_costmap: LayeredParameters
    local_costmap: LayeredParameters
    notes: tuple[str, ...]
    """What was accepted without effect, and why."""
    sources: Mapping[str, str]
    """Where each value stands that was taken: ``local_costmap.obstacle_layer.raytrace_range``."""
    rest: tuple[Entry, ...]
    """Entries that are not of a costmap."""


def read_costmaps(entries: Iterable[Entry]) -> CostmapPair:
    """Return what parameters say of the global and the local costmap; later ones win, without any both are standard.

    Names below ``global_costmap`` or ``local_costmap`` are of one, others that a costmap knows are of both.

    Raises
    ------
    ConfigError
        If a name of a costmap is unknown (the message names the nearest one), or a value has the wrong type or range.
    """
    readers: dict[CostmapName, _Reader] = {"global": _Reader("global"), "local": _Reader("local")}
    loose: list[tuple[list[str], Entry]] = []
    for entry in entries:
        parts = [p for p in entry[0].replace("/", ".").split(".") if p and p != "ros__parameters"]
        sections = [name for name in parts if name in _SECTIONS]
        if sections:
            # nav2 has the name twice: that of the node and that of the costmap
            below = parts[len(parts) - parts[::-1].index(sections[-1]) :]
            if below:
                readers[_SECTIONS[sections[-1]]].take(below, entry[1], entry[2])
        else:
            loose.append((parts, entry))
            for reader in readers.values():
                reader.take_if_known(parts, entry[1], entry[2])
    notes: list[str] = []
    built = {name: reader.build(notes) for name, reader in readers.items()}
    without_effect = dict.fromkeys(name for reader in readers.values() for name in reader.without_effect)
    if without_effect:
        notes.append(f"accepted without effect: {', '.join(without_effect)} (no meaning for a simulated robot)")
    if built["local"].costmap.global_frame == built["global"].costmap.global_frame:
        notes.append("the local costmap stays in frame odom, which does not jump")
        built["local"] = built["local"].replaced(global_frame="odom")
    rest = tuple(entry for parts, entry in loose if not any(reader.knows(parts) for reader in readers.values()))
    return CostmapPair(
        global_costmap=built["global"],
        local_costmap=built["local"],
        notes=tuple(dict.fromkeys(notes)),
        sources=readers["global"].sources | readers["local"].sources,
        rest=rest,
    )


@dataclass(slots=True)
class _Layer:
    name: str
    kind: Kind
    own: dict[str, tuple[Any, str]] = field(default_factory=dict)
    """Entries below the layer's name."""


class _Reader:
    """Collects the entries of one costmap, then builds it."""

    def __init__(self, name: CostmapName) -> None:
        self._name = name
        self._entries: dict[str, tuple[Any, str]] = {}
        self._loose: set[str] = set()
        self._foreign: set[str] = set()
        self.sources: dict[str, str] = {}
        """Where each value stands that was taken, by costmap, layer, source and name."""
        self.without_effect: list[str] = []
        """Names of parameters that were accepted and mean nothing here."""

    def take(self, parts: list[str], value: Any, source: str) -> None:
        """Take an entry of this costmap."""
        self._loose.discard(self._put(parts, value, source))

    def take_if_known(self, parts: list[str], value: Any, source: str) -> None:
        """Take an entry that may or may not be of a costmap."""
        self._loose.add(self._put(parts, value, source))

    def _put(self, parts: list[str], value: Any, source: str) -> str:
        parts = [*parts[:-1], _NAV2_SPELLINGS.get(parts[-1], parts[-1])] if parts else parts
        name = ".".join(parts)
        self._entries.pop(name, None)
        self._entries[name] = (value, source)
        return name

    @property
    def _has_section(self) -> bool:
        return len(self._loose) < len(self._entries)

    def knows(self, parts: list[str]) -> bool:
        """Return whether an entry without a section is of a costmap."""
        return bool(parts) and (parts[0] in self._heads() or (len(parts) == 1 and self._is_own(parts[0])))

    def _heads(self) -> set[str]:
        return {*_USUAL_LAYERS, *(layer.name for layer in self._layers([])), *self._top_sources()}

    def _is_own(self, name: str) -> bool:
        return name in _COSTMAP or name in ALIASES or name in _MOVED or name in ("plugins", "observation_sources")

    def _top_sources(self) -> tuple[str, ...]:
        return _names(self._entries.get("observation_sources", ("", ""))[0])

    def _layers(self, notes: list[str]) -> list[_Layer]:
        """Return the layers in their order."""
        plugins = self._entries.get("plugins")
        if plugins is None:
            voxel = self._entries.get("map_type", ("costmap", ""))[0] == "voxel"
            static = self._entries.get("static_map", (None, ""))[0]
            wanted = self._name == "global" if static is None else str(static).lower() in ("true", "1", "yes", "on")
            layers = [_Layer("static_layer", "static")] if wanted else []
            layers.append(_Layer("obstacle_layer", "voxel" if voxel else "obstacle"))
            return [*layers, _Layer("inflation_layer", "inflation")]
        value, source = plugins
        if not isinstance(value, list):
            raise ConfigError(f"{source}: plugins is not a list of layers")
        found = []
        for plugin in value:
            name, kind = self._plugin(plugin, source)
            if kind.rpartition(":")[2] in _KINDS:
                found.append(_Layer(name, _KINDS[kind.rpartition(":")[2]]))
            else:
                self._foreign.add(name)
                notes.append(
                    f"{self._name} costmap: layer {name!r} of type {kind or 'unknown'!r} has no counterpart here"
                )
        self._check(found, source, notes)
        return found

    def _plugin(self, plugin: Any, source: str) -> tuple[str, str]:
        if isinstance(plugin, dict) and {"name", "type"} <= set(plugin):
            return str(plugin["name"]), str(plugin["type"])
        if isinstance(plugin, str):
            return plugin, str(self._entries.get(f"{plugin}.plugin", ("", ""))[0])
        raise ConfigError(f"{source}: each entry of plugins needs a name and a type")

    def _check(self, layers: list[_Layer], source: str, notes: list[str]) -> None:
        kinds = [layer.kind for layer in layers]
        for kind in ("static", "inflation"):
            if kinds.count(kind) > 1:
                raise ConfigError(f"{source}: two layers of kind {kind}: only one works here")
        if "inflation" in kinds and kinds[-1] != "inflation":
            notes.append(f"{self._name} costmap: inflation is not the last layer: it is put on top of all layers here")

    @property
    def _is_modern(self) -> bool:
        return "plugins" in self._entries

    def build(self, notes: list[str]) -> LayeredParameters:
        """Return the costmap, checked."""
        layers = self._layers(notes)
        if not self._entries:
            return LayeredParameters.standard(self._name)
        by_name = {layer.name: layer for layer in layers}
        costmap: dict[str, Any] = self._defaults()
        top: dict[str, tuple[Any, str]] = {}
        for name, (value, source) in self._entries.items():
            head, _, rest = name.partition(".")
            if rest and head in by_name:
                by_name[head].own[rest] = (value, source)
            elif not rest and name in _COSTMAP:
                costmap[_COSTMAP[name].field] = self._converted(_COSTMAP[name], value, source)
            elif self._has_meaning_at_top(name, source, notes):
                top[name] = (value, source)
        self._alias(top, costmap, notes)
        built = [self._layer(layer, top, costmap, notes) for layer in layers]
        try:
            return LayeredParameters(costmap=CostmapParameters(**costmap), layers=tuple(built))
        except ConfigError as error:  # of all entries only the footprint is looked at once more
            raise ConfigError(f"{self._entries['footprint'][1]}: {error}") from error

    def _defaults(self) -> dict[str, Any]:
        """Return what holds where nothing is said: costmap_2d's own, but a local costmap is one."""
        if not self._has_section:
            standard = LayeredParameters.standard(self._name).costmap
            return {f.name: getattr(standard, f.name) for f in dataclasses.fields(standard)}
        return {"global_frame": "odom", "rolling_window": True} if self._name == "local" else {}

    def _has_meaning_at_top(self, name: str, source: str, notes: list[str]) -> bool:
        head, _, rest = name.partition(".")
        if name in ALIASES or name in _MOVED or name == "observation_sources" or head in self._top_sources():
            return True
        if name == "plugins" or name in _NO_MEANING or rest == "plugin" or head in self._foreign:
            return False
        if rest and head in _USUAL_LAYERS:
            if name not in self._loose:
                notes.append(f"{source}: the {self._name} costmap has no layer {head!r}")
            return False
        if name in self._loose:
            return False
        known = [n for n in _COSTMAP if "." not in n] + [*ALIASES, *_MOVED, *sorted(self._heads())]
        raise ConfigError(unknown_name(name, known, source))

    def _alias(self, top: dict[str, tuple[Any, str]], costmap: dict[str, Any], notes: list[str]) -> None:
        """Move the costmap's values to the static layer and to inflation, as costmap_2d does without a list of plugins."""
        nav2 = any(name.endswith(".plugin") for name in self._entries)
        for name, target in ALIASES.items():
            found = self._entries.get(name)
            if found is None:
                continue
            if not self._is_modern or (nav2 and target.startswith("static_layer")):
                costmap[_COSTMAP[target].field] = self._converted(_COSTMAP[target], *found)
            elif name in top:
                notes.append(
                    f"{found[1]}: {name} of the {self._name} costmap is not read where there is a list of plugins"
                )

    def _layer(
        self, layer: _Layer, top: dict[str, tuple[Any, str]], costmap: dict[str, Any], notes: list[str]
    ) -> LayerParameters:
        if layer.kind in ("static", "inflation"):
            prefix = f"{layer.kind}_layer."
            for name, (value, source) in layer.own.items():
                declaration = _COSTMAP.get(prefix + name)
                if declaration is not None:
                    moved = not self._is_modern and ALIASES.get(name) == prefix + name and name in self._entries
                    if not moved:
                        costmap[declaration.field] = self._converted(declaration, value, source, f"{layer.name}.{name}")
                elif name not in _NO_MEANING and name != "plugin":
                    known = [n.removeprefix(prefix) for n in _COSTMAP if n.startswith(prefix)]
                    raise ConfigError(unknown_name(name, known, f"{source}, {layer.name}"))
            return LayerParameters(name=layer.name, kind=layer.kind)
        for name, found in top.items():
            if not self._is_modern and name not in ALIASES:
                layer.own[name] = found  # as costmap_2d moves them: over what stands in the layer
            elif name in _SEARCHED:
                layer.own.setdefault(name, found)
            elif name not in ALIASES and name in _MOVED:
                notes.append(
                    f"{found[1]}: {name} of the {self._name} costmap is not read where there is a list of plugins"
                )
        return self._sensing(layer)

    def _sensing(self, layer: _Layer) -> LayerParameters:
        names = _names(layer.own.get("observation_sources", ("", ""))[0])
        values: dict[str, Any] = {}
        sensed: dict[str, dict[str, tuple[Any, str]]] = {name: {} for name in names}
        for name, (value, source) in layer.own.items():
            head, _, rest = name.partition(".")
            if rest and head in sensed:
                sensed[head][rest] = (value, source)
            elif name in _OBSTACLE:
                values[_OBSTACLE[name].field] = self._converted(_OBSTACLE[name], value, source, f"{layer.name}.{name}")
            elif name not in ("observation_sources", "plugin"):
                known = [*_OBSTACLE, "observation_sources", *names]
                raise ConfigError(unknown_name(name, known, f"{source}, {layer.name}"))
        sources = tuple(self._source(layer.name, name, entries) for name, entries in sensed.items())
        return LayerParameters(name=layer.name, kind=layer.kind, obstacle=ObstacleParameters(**values), sources=sources)

    def _source(self, layer: str, name: str, entries: dict[str, tuple[Any, str]]) -> ObservationSource:
        values = {}
        for key, (value, source) in entries.items():
            if key not in _SOURCE:
                raise ConfigError(unknown_name(key, _SOURCE, f"{source}, source {name!r}"))
            values[_SOURCE[key].field] = self._converted(_SOURCE[key], value, source, f"{layer}.{name}.{key}")
        try:
            return ObservationSource(name=name, **values)
        except ConfigError as error:
            place = next(source for key, (_, source) in entries.items() if key in str(error))
            raise ConfigError(f"{place}: source {name!r}: {error}") from error

    def _converted(self, declaration: Declaration, value: Any, source: str, key: str = "") -> Any:
        if not declaration.effective:
            self.without_effect.append(declaration.name)
        self.sources[f"{self._name}_costmap.{key or declaration.name}"] = source
        return convert_at(declaration, value, source)


def _names(value: Any) -> tuple[str, ...]:
    """Return the names in a text or a list."""
    return tuple(str(v) for v in value) if isinstance(value, list) else tuple(str(value or "").split())
