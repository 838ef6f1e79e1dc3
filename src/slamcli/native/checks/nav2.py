# SPDX-License-Identifier: MIT
"""Parameter files of nav2, as far as slamcli reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from slamcli.errors import ConfigError
from slamcli.localization.amcl_parameters import AmclParameters
from slamcli.native.checks.findings import ERROR, NOTE, Finding, at, below, check_declared
from slamcli.native.checks.navigation_traps import check_finite, check_scanner, check_together
from slamcli.native.nav2_yaml import translate_nav2
from slamcli.native.settings import Setting, merge
from slamcli.navigation.layered_files import read_costmaps
from slamcli.navigation.local_planners import LOCAL_PLANNERS
from slamcli.navigation.planner_parameters import PlannerParameters
from slamcli.parameters import declarations


def check_nav2(settings: Mapping[str, Setting], file: str, range_m: float | None = None) -> Iterator[Finding]:
    """Yield what is wrong with the parameters of nav2's nodes, and which of them slamcli does not read."""
    translated = translate_nav2(settings.values())
    found = merge(translated.settings)
    yield from check_declared(below(found, "amcl"), declarations(AmclParameters), "amcl")
    yield from check_declared(below(found, "planner"), declarations(PlannerParameters), "planner_server")
    for planner in LOCAL_PLANNERS.values():
        yield from check_declared(below(found, planner.section), declarations(planner.parameters), planner.section)
    yield from _costmaps(found, file)
    yield from check_finite(found)
    yield from check_scanner(found, range_m)
    yield from check_together(found, whole=False)
    for note in translated.notes:
        yield Finding(NOTE, file, 0, note)


def _costmaps(settings: Mapping[str, Setting], file: str) -> Iterator[Finding]:
    entries = [(name, s) for name, s in settings.items() if name.startswith(("global_costmap/", "local_costmap/"))]
    if not entries:
        return
    try:
        read = read_costmaps((name, setting.value, setting.source) for name, setting in entries)
    except ConfigError as error:
        text = str(error)
        place = next((s for _, s in entries if s.source in text), None)
        yield (
            Finding(ERROR, file, 0, text) if place is None else at(place, ERROR, text.removeprefix(f"{place.source}: "))
        )
        return
    lines = {setting.source: setting for _, setting in entries}
    for note in read.notes:
        source, _, rest = note.partition(": ")
        yield at(lines[source], NOTE, rest) if source in lines else Finding(NOTE, file, 0, note)
