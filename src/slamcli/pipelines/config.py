# SPDX-License-Identifier: MIT
"""A tier's parameters from its native files and from the command line; a lint of those files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slamcli.errors import ConfigError
from slamcli.mapper import find_tier
from slamcli.native import Setting, merge
from slamcli.native.checks import Finding
from slamcli.native.orbslam_names import canonical
from slamcli.native.orbslam_names import renamed as of_new_schema
from slamcli.native.rtabmap_names import of_today
from slamcli.native.settings import find_native, read_text
from slamcli.parameters import Declaration, as_dict, convert, declarations, resolve, unknown_name
from slamcli.pipelines.native_files import RTABMAP, read_native
from slamcli.runtime import RunLog

FROM_COMMAND_LINE = "--set"

# What nodes call the topics of a role; of several the names end in _1, _2 ...
_TOPICS = {
    "scans": ("scan", "echoes"),
    "points": ("points2", "scan_cloud"),
    "odometry": ("odom",),
    "imu": ("imu",),
    "fixes": ("fix",),
    "landmarks": ("landmark",),
    "left": ("camera/left/image_raw", "left/image_raw", "left/image_rect"),
    "right": ("camera/right/image_raw", "right/image_raw", "right/image_rect"),
    "rgb": ("camera/rgb/image_raw", "rgb/image_raw", "rgb/image", "camera/image_raw"),
    "depth": ("camera/depth_registered/image_raw", "camera/depth/image_raw", "depth/image_raw", "depth/image"),
}
# What switches a role off: naming its topic in a launch file does not switch it on.
_SWITCHES = {
    "odometry": ("use_odometry", "subscribe_odom"),
    "imu": ("TRAJECTORY_BUILDER_2D.use_imu_data",),
    "fixes": ("use_nav_sat",),
    "landmarks": ("use_landmarks",),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeConfig:
    """What native files and the command line say to one tier."""

    algo: str
    parameters: Any
    """The tier's parameter dataclass, resolved: defaults, then files in their order, then ``--set``."""
    sources: Mapping[str, str]
    """Where each value that was given stands: ``file:line`` or ``--set``; defaults are not in it."""
    remaps: Mapping[str, str]
    """Topics as the files remap them: ``{"scan": "/base_scan"}``."""

    def topics(self, role: str) -> tuple[str, ...]:
        """Return the topics that the files name for a role (see `slamcli.mapper.Tier.roles`) that is in use."""
        values = as_dict(self.parameters)
        if any(values.get(switch) is False for switch in _SWITCHES.get(role, ())):
            return ()
        return tuple(
            topic
            for name in _TOPICS[role]
            for remapped, topic in sorted(self.remaps.items(), key=lambda item: (len(item[0]), item[0]))
            if remapped == name or re.fullmatch(rf"{name}_[0-9]+", remapped)
        )


def load_native(
    algo: str,
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> NativeConfig:
    """Return a tier's parameters: defaults, overridden by files (later wins), overridden by `sets`.

    Parameters
    ----------
    algo
        Name of the tier.
    files
        Native files of the system: launch files (``.launch``, ``.xml``) of each; ROS parameter YAML for gmapping and
        rtabmap; Lua for cartographer; ``.ini`` for rtabmap. A bare name that is not here means slamcli's own file of that name.
    sets
        ``KEY=VALUE`` with native keys.
    log
        Gets a note for each parameter that has no effect here, and for what was skipped in a file.
    arguments
        Values for the arguments of launch files.

    Raises
    ------
    ConfigError
        If a file cannot be read or holds nothing for this tier, or a name is unknown, or a value has the wrong type or
        range. The message has the place.
    UsageError
        If there is no such tier.
    """
    return load_declared(algo, find_tier(algo).parameters, files, sets, log, arguments)


def load_declared(
    algo: str,
    kind: type,
    files: Sequence[Path] = (),
    sets: Sequence[str] = (),
    log: RunLog | None = None,
    arguments: Mapping[str, str] | None = None,
) -> NativeConfig:
    """Do as `load_native` for a system that is no tier, whose parameter dataclass is `kind`."""
    log = log or RunLog()
    known = {entry.name: entry for entry in declarations(kind)}
    settings: list[Setting] = []
    remaps: dict[str, str] = {}
    for file in files:
        found = read_native(algo, find_native(Path(file)), log, arguments or {}, known)
        settings.extend(found.settings)
        remaps.update(found.remaps)
    settings.extend(_own_names([parse_set(text) for text in sets], algo, known, log))
    merged = merge(settings)
    for setting in merged.values():
        _check(setting, known)
    _tell_what_has_no_effect(merged.values(), known, log)
    parameters: Any = resolve(kind, {name: setting.value for name, setting in merged.items()})
    sources = {name: setting.source for name, setting in merged.items()}
    return NativeConfig(algo=algo, parameters=parameters, sources=sources, remaps=remaps)


def check(files: Iterable[Path], beams: int | None = None, range_m: float | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with native files: unknown names, types, ranges, values that do not do what they seem to.

    Raises
    ------
    ConfigError
        If a file does not exist or is not text.
    """
    from slamcli.native.checks.files import check_file  # what it knows of planners takes long to import

    tables = {
        algo: declarations(find_tier(algo).parameters) for algo in ("gmapping", "cartographer", "orbslam3", RTABMAP)
    }
    files = [find_native(Path(file)) for file in files]
    for file in files:
        read_text(file)  # what cannot be read at all is wrong usage, not a finding
    found = (finding for file in files for finding in check_file(file, tables, beams, range_m))
    return tuple(dict.fromkeys(found))  # of files that load each other


def parse_set(text: str) -> Setting:
    """Return what ``KEY=VALUE`` sets."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise ConfigError(f"--set {text!r}: write KEY=VALUE")
    return Setting(name.strip(), value.strip(), FROM_COMMAND_LINE, 0)


def _own_names(
    settings: Iterable[Setting], algo: str, known: Mapping[str, Declaration], log: RunLog
) -> Iterator[Setting]:
    """Yield settings of the command line under the names of their declarations, where they have those of older versions."""
    for setting in settings:
        if setting.name in known:
            yield setting
        elif algo == RTABMAP:
            today = of_today(setting)
            if today.setting is None:
                raise ConfigError(f"{setting.source}: {today.remark}")
            if today.remark:
                log.note(f"{setting.source}: {today.remark}")
            yield today.setting
        else:
            yield of_new_schema(setting) if canonical(setting.name) in known else setting


def _check(setting: Setting, known: Mapping[str, Declaration]) -> None:
    if setting.name not in known:
        raise ConfigError(unknown_name(setting.name, known, setting.source))
    try:
        convert(known[setting.name], setting.value)
    except ConfigError as error:
        raise ConfigError(f"{setting.source}: {error}") from error


def _tell_what_has_no_effect(settings: Iterable[Setting], known: Mapping[str, Declaration], log: RunLog) -> None:
    """Note what was given in vain; Lua files set everything, so of theirs only what differs from the default.

    What a viewer would take is named in one line.
    """
    brief: dict[str, list[str]] = {}
    for setting in settings:
        entry = known[setting.name]
        if entry.effective:
            continue
        if entry.name.startswith("Viewer.") and setting.line:
            brief.setdefault(setting.file, []).append(setting.name)
        elif Path(setting.file).suffix not in (".lua", ".ini", ".db"):
            log.note(f"{setting.name} ({setting.source}) has no effect here: {entry.help}")
        elif convert(entry, setting.value) != entry.default:
            brief.setdefault(setting.file, []).append(setting.name)
    for file, names in brief.items():
        log.note(f"{file}: no effect here: {', '.join(names)} (`slamcli config show` says why)")
