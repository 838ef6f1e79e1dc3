# SPDX-License-Identifier: MIT
"""Databases of RTAB-Map as recordings: their nodes' images, scans and odometry are measured once more."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from slamcli.errors import ConfigError, RecordingError, UsageError
from slamcli.mapper import SensorOffer, Tier
from slamcli.native.rtabmap_names import of_today
from slamcli.native.settings import Setting
from slamcli.parameters import as_dict, convert, declarations, resolve
from slamcli.pipelines.config import NativeConfig
from slamcli.pipelines.database_feed import DatabaseFeed
from slamcli.pipelines.database_nodes import StoredSession, sessions_of
from slamcli.pipelines.sensor_request import SensorRequest
from slamcli.recordings.sensor_picks import NONE
from slamcli.rtabmap.database import Database, is_database
from slamcli.runtime import RunLog

_OF_THE_RUN = ("Mem/IncrementalMemory",)
"""Parameters that say what a run was for, not how it maps."""
_RATE, _ODOMETRY = "Rtabmap/DetectionRate", "slamcli.odometry"


def are_databases(paths: Sequence[Path]) -> bool:
    """Return whether databases are meant, not a recording.

    Raises
    ------
    UsageError
        If only some of the files are.
    """
    found = [path for path in paths if is_database(path)]
    if found and len(found) < len(paths):
        other = next(path for path in paths if path not in found)
        raise UsageError(f"{found[0]} is a database of RTAB-Map and {other} is not: go on from it with --database")
    return bool(found)


@contextmanager
def open_databases(
    paths: Sequence[Path], tier: Tier, config: NativeConfig, asked: SensorRequest, log: RunLog
) -> Iterator[DatabaseFeed]:
    """Open databases, one session after the other, with the parameters of the first beneath those that the user gave.

    Raises
    ------
    FormatError
        If one is damaged, or of a version that is not read.
    RecordingError
        If there is nothing in them to map with.
    UsageError
        If an option is about topics or the like, which they do not have, or their cameras differ.
    """
    _check_options(asked, tier)
    with ExitStack() as stack:
        databases = [stack.enter_context(Database.read(path)) for path in paths]
        sessions = [
            session
            for database in databases
            for session in sessions_of(database, start_s=asked.start_s, duration_s=asked.duration_s)
        ]
        if not sessions:
            raise RecordingError(f"{paths[0]}: no node with images or a scan in this part of it")
        _check_alike(sessions, log)
        config = _with_stored(config, databases[0], log, own_odometry=asked.names.odometry == NONE)
        offer = _offer(sessions[0], sessions, asked)
        plan = tier.plan(config.parameters, config.sources, offer, log)
        yield DatabaseFeed(
            sessions=tuple(sessions), plan=plan, base_frame=asked.names.base_frame or plan.base_frame or "base_link",
            log=log,
        )  # fmt: skip


def _check_options(asked: SensorRequest, tier: Tier) -> None:
    if asked.mode is not None and asked.mode not in tier.modes:
        raise UsageError(f"--mode {asked.mode}: {tier.name} has {', '.join(tier.modes)}")
    named = dict(asked.names.named())
    options = {
        **{f"--{role}-topic": topics[0] for role, topics in named.items()}, **asked.cameras.named(),
        **({"--camera": str(asked.camera_files[0])} if asked.camera_files else {}),
    }  # fmt: skip
    short = {
        "--scans-topic": "--scan-topic",
        "--odometry-topic": "--odom-topic",
        "--landmarks-topic": "--landmark-topic",
    }
    for option, value in options.items():
        raise UsageError(
            f"{short.get(option, option)} {value}: a database has no topics and its own calibration"
            " (--odom-topic none and --scan-topic none leave its odometry and scans out)"
        )


def _check_alike(sessions: Sequence[StoredSession], log: RunLog) -> None:
    """Refuse databases whose cameras differ."""
    seeing = [session for session in sessions if session.images is not None]
    for first, other in pairwise(seeing):
        a, b = first.images, other.images
        if a is None or b is None:
            continue
        same = (a.depth is None) == (b.depth is None) and (a.right is None) == (b.right is None)
        same = same and bool(np.allclose(a.camera.array[:4], b.camera.array[:4], rtol=1e-3))
        same = same and bool(np.allclose(a.T_base_camera, b.T_base_camera, atol=1e-3))
        if not same:
            raise UsageError(f"{first.path} and {other.path}: their cameras differ; map them one after the other")
    if seeing and seeing[0].num_cameras > 1:
        log.warn(f"{seeing[0].path}: images of {seeing[0].num_cameras} cameras side by side: only the first is used")


def _offer(first: StoredSession, sessions: Sequence[StoredSession], asked: SensorRequest) -> SensorOffer:
    images = next((session.images for session in sessions if session.images is not None), None)
    modes = set() if images is None or asked.mode == "scan" else {"mono"}
    if images is not None and modes:
        modes |= ({"rgbd"} if images.depth is not None else set()) | ({"stereo"} if images.right is not None else set())
    scan = next((session.scan for session in sessions if session.scan is not None), None)
    ranges = scan is not None and asked.names.scans != (NONE,) and asked.names.points != (NONE,)
    return SensorOffer(
        num_laser_scans=int(ranges and scan is not None and scan.planar),
        num_point_clouds=int(ranges and scan is not None and not scan.planar),
        odometry=asked.names.odometry != NONE and first.has_odometry,
        imu=asked.names.imu != NONE and any(session.gravity for session in sessions),
        imu_placed=True,
        landmarks=asked.names.landmarks != NONE and any(session.landmarks for session in sessions),
        mode=asked.mode,
        cameras=frozenset(modes),
    )


def _with_stored(config: NativeConfig, database: Database, log: RunLog, *, own_odometry: bool) -> NativeConfig:
    """Return the configuration with the database's parameters where the user gave none.

    Every node is looked at, with the odometry that it had: nodes are too far apart to find it anew, unless that is asked for.
    """
    known = {entry.name: entry for entry in declarations(type(config.parameters))}
    stored: dict[str, Any] = {}
    unfit = []
    for old_name, text in database.parameters().items():
        setting = of_today(Setting(old_name, text, str(database.path), 0)).setting
        name = "" if setting is None else setting.name
        if setting is None or name not in known or name in _OF_THE_RUN or name in config.sources:
            continue
        try:
            stored[name] = convert(known[name], setting.value)
        except ConfigError:
            unfit.append(f"{name} {text}")
    values = as_dict(config.parameters)
    texts = database.parameters()
    changed = [f"{name} {texts[name]}" for name in stored if stored[name] != values[name]]
    told = f", of which {len(changed)} differ from the defaults: {', '.join(changed[:8])}{' …' if len(changed) > 8 else ''}"
    if stored:
        log.note(
            f"{database.path.name}: its {len(stored)} parameters are taken{told if changed else ''} (--set overrules)"
        )
    if unfit:
        log.warn(f"{database.path.name}: parameters with values that slamcli has not are left out: {', '.join(unfit)}")
    if _RATE in known and _RATE not in config.sources:
        stored[_RATE] = 0.0  # its nodes were chosen once
    if not own_odometry and _ODOMETRY in known and _ODOMETRY not in config.sources:
        stored[_ODOMETRY] = "recording"
    sources = {**dict.fromkeys(stored, database.path.name), **config.sources}
    return replace(config, parameters=resolve(type(config.parameters), values, stored), sources=sources)
