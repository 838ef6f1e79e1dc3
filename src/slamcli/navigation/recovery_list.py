# SPDX-License-Identifier: MIT
"""Which recovery behaviours there are, what ROS calls them, and how files list them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from slamcli.errors import ConfigError

BehaviourKind = Literal["clear_costmap", "rotate_recovery", "move_slow_and_clear", "back_up"]
KINDS: tuple[BehaviourKind, ...] = ("clear_costmap", "rotate_recovery", "move_slow_and_clear", "back_up")

TYPES: Mapping[str, BehaviourKind] = {
    "clear_costmap_recovery/ClearCostmapRecovery": "clear_costmap",
    "rotate_recovery/RotateRecovery": "rotate_recovery",
    "move_slow_and_clear/MoveSlowAndClear": "move_slow_and_clear",
}
"""Behaviours by their ROS type."""

USUAL_NAMES: Mapping[str, BehaviourKind] = {
    "conservative_reset": "clear_costmap",
    "aggressive_reset": "clear_costmap",
    "rotate_recovery": "rotate_recovery",
    "move_slow_and_clear": "move_slow_and_clear",
    "back_up": "back_up",
}
"""Names that need no type."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Behaviour:
    """One entry of ``recovery_behaviors``."""

    name: str
    """Also the namespace of its parameters."""
    kind: BehaviourKind


def parse_behaviours(text: str) -> tuple[Behaviour, ...]:
    """Return the behaviours that a text names, in its order.

    Parameters
    ----------
    text
        ``NAME`` or ``NAME:TYPE``, separated by blanks or commas: ``conservative_reset
        far_reset:clear_costmap_recovery/ClearCostmapRecovery``. A usual name needs no type.

    Raises
    ------
    ConfigError
        If a name without type is not a usual one, or there is no such type.
    """
    return tuple(_behaviour(entry) for entry in text.replace(",", " ").split())


def _behaviour(entry: str) -> Behaviour:
    name, colon, kind = entry.partition(":")
    if not colon:
        if name not in USUAL_NAMES:
            raise ConfigError(
                f"recovery_behaviors: no behaviour {name!r}: there are {', '.join(USUAL_NAMES)}, and NAME:TYPE with a type of ROS"
            )
        return Behaviour(name=name, kind=USUAL_NAMES[name])
    by_class = {known.rpartition("/")[2]: found for known, found in TYPES.items()}
    found = by_class.get(kind.replace("::", "/").rpartition("/")[2]) or next((k for k in KINDS if k == kind), None)
    if found is None or not name:
        raise ConfigError(f"recovery_behaviors: {name!r} of type {kind!r}: types are {', '.join(TYPES)}")
    return Behaviour(name=name, kind=found)


def behaviours_as_text(entries: Sequence[Any]) -> str:
    """Return ROS's list of maps ``{name: ..., type: ...}`` (or of plain names) as `parse_behaviours` reads it.

    Raises
    ------
    ConfigError
        If an entry is neither, or a name stands there twice, which move_base refuses.
    """
    words: list[str] = []
    names: list[str] = []
    for entry in entries:
        if isinstance(entry, dict) and {"name", "type"} <= set(entry):
            name, word = str(entry["name"]), f"{entry['name']}:{entry['type']}"
        elif isinstance(entry, str):
            name = word = entry
        else:
            raise ConfigError("recovery_behaviors: each entry needs a name and a type")
        if name in names and isinstance(entry, dict):
            raise ConfigError(f"recovery_behaviors: {name!r} stands there twice, which move_base refuses")
        if not name or len(word.replace(",", " ").split()) != 1:
            raise ConfigError(f"recovery_behaviors: {word!r}: names and types have no blanks or commas")
        names.append(name)
        words.append(word)
    return " ".join(words)
