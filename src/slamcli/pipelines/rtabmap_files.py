# SPDX-License-Identifier: MIT
"""RTAB-Map's own files for the tier: ``.ini``, launch files, parameter YAML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from slamcli.errors import ConfigError
from slamcli.native import Setting, read_launch, read_ros_yaml
from slamcli.native.rtabmap_ini import read_rtabmap_ini
from slamcli.native.rtabmap_names import NODES, ODOMETRY_NODES, of_today
from slamcli.native.rtabmap_nodes import CONFIG_PATH, Combined, combine, launched_nodes, yaml_nodes
from slamcli.native.settings import merge
from slamcli.parameters import Declaration, convert
from slamcli.runtime import RunLog

_COMPLETE = 200
"""A file with so many parameters was written by RTAB-Map itself and lists all of them."""


def read_rtabmap(
    path: Path, log: RunLog, arguments: Mapping[str, str], known: Mapping[str, Declaration]
) -> tuple[tuple[Setting, ...], Mapping[str, str]]:
    """Return the settings of a native file, later ones winning, and the topics that it remaps.

    Names of older versions become those of today, with a note; so are those left out that nothing reads any more or that
    belong to libraries that are not here. Of a file that lists everything what differs from the default counts as given.

    Raises
    ------
    ConfigError
        If the file cannot be read or holds nothing for RTAB-Map.
    """
    suffix = path.suffix.lower()
    if suffix == ".ini":
        return _read_ini(path, log, known), {}
    if suffix in (".launch", ".xml"):
        return _read_launch(path, log, arguments, known)
    if suffix == ".db":
        return _read_database(path, log, known), {}
    if suffix in (".yaml", ".yml"):
        found = combine(yaml_nodes(read_ros_yaml(path)))
        return _told(found, path, log, known), found.remaps
    hint = "; copy the parameters of a Python launch file to YAML or .ini" if suffix == ".py" else ""
    raise ConfigError(
        f"{path}: rtabmap reads .ini files, launch files (.launch, .xml), parameter files (.yaml) and databases (.db){hint}"
    )


def names_of_today(settings: Iterable[Setting], log: RunLog, *, complete: bool = False) -> Iterator[Setting]:
    """Yield settings under their names of today; notes say what was renamed or left out.

    Of a `complete` list it goes without saying that parts are in it that are not here.
    """
    absent: dict[str, dict[str, None]] = {}
    for setting in settings:
        today = of_today(setting)
        if today.setting is not None:
            yield today.setting
        if today.absent and complete:
            continue
        if today.absent:
            absent.setdefault(setting.file, {})[today.absent] = None
        elif today.remark:
            log.note(f"{setting.source}: {today.remark}")
    for file, groups in absent.items():
        log.note(f"{file}: left out, as these parts are not here: {', '.join(f'{group}/' for group in groups)}")


def _read_ini(path: Path, log: RunLog, known: Mapping[str, Declaration]) -> tuple[Setting, ...]:
    found = read_rtabmap_ini(path)
    if found.skipped:
        log.note(f"{path}: sections {', '.join(f'[{name}]' for name in found.skipped)} are not RTAB-Map's: skipped")
    complete = len(found.settings) >= _COMPLETE
    settings = tuple(names_of_today(found.settings, log, complete=complete))
    if not complete:
        return settings
    return tuple(_changed(settings, path, log, known))


def _read_database(path: Path, log: RunLog, known: Mapping[str, Declaration]) -> tuple[Setting, ...]:
    """Return what a database of RTAB-Map or slamcli was made with."""
    from slamcli.rtabmap.database import Database

    if not path.is_file():
        raise ConfigError(f"{path}: no such file")
    with Database.read(path) as database:
        kept = [Setting(name, value, str(path), 0) for name, value in database.parameters().items()]
    return tuple(_changed(names_of_today(kept, log, complete=True), path, log, known))


def _changed(
    settings: Iterable[Setting], path: Path, log: RunLog, known: Mapping[str, Declaration]
) -> Iterator[Setting]:
    """Yield what differs from the defaults in a file that lists everything."""
    newer = []
    for setting in settings:
        entry = known.get(setting.name)
        if entry is None:
            newer.append(setting.name)
        elif setting.value in entry.unavailable or convert(entry, setting.value) != entry.default:
            yield setting
    log.note(f"{path}: lists all parameters: what differs from the default counts as given")
    if newer:
        log.warn(f"{path}: unknown here and left out: {', '.join(newer)}")


def _read_launch(
    path: Path, log: RunLog, arguments: Mapping[str, str], known: Mapping[str, Declaration]
) -> tuple[tuple[Setting, ...], Mapping[str, str]]:
    launch = read_launch(path, arguments)
    for note in launch.notes:
        log.note(note)
    nodes = launched_nodes(launch)
    if not nodes:
        there = ", ".join(f"{node.package}/{node.type}" for node in launch.nodes) or "none"
        wanted = ", ".join((*NODES, *ODOMETRY_NODES))
        raise ConfigError(f"{path}: starts no node of rtabmap ({wanted}; nodes: {there})")
    found = combine(nodes)
    return _told(found, path, log, known), found.remaps


def _told(found: Combined, path: Path, log: RunLog, known: Mapping[str, Declaration]) -> tuple[Setting, ...]:
    """Return what the nodes are given; what is of the node alone and unknown here is named once."""
    for note in found.notes:
        log.note(note)
    ini = [
        s for setting in found.settings if setting.name == CONFIG_PATH for s in _named_ini(setting, path, log, known)
    ]
    own = [setting for setting in found.settings if setting.name != CONFIG_PATH]
    settings = [*ini, *names_of_today(own, log)]
    foreign = [setting for setting in settings if "/" not in setting.name and setting.name not in known]
    if foreign:
        log.note(f"{path}: no effect here: {', '.join(dict.fromkeys(setting.name for setting in foreign))}")
    kept = [setting for setting in settings if setting not in foreign]
    return tuple(merge(kept).values())


def _named_ini(setting: Setting, path: Path, log: RunLog, known: Mapping[str, Declaration]) -> Sequence[Setting]:
    """Return what the file says that a node is given as ``config_path``."""
    wanted = Path(str(setting.value)).expanduser()
    if not str(setting.value):
        return ()
    place = next((file for file in (wanted, path.parent / wanted, path.parent / wanted.name) if file.is_file()), None)
    if place is None:
        log.note(f"{setting.source}: {wanted} is not here: not read")
        return ()
    return _read_ini(place, log, known)
