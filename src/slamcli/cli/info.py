# SPDX-License-Identifier: MIT
"""``slamcli info``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.info_database import tell_database
from slamcli.cli.info_state import tell_state
from slamcli.cli.options import json_option, verbosity_options
from slamcli.cli.quantities import duration_text, size_text, time_text
from slamcli.cli.recording_options import recording_options

if TYPE_CHECKING:
    from slamcli.geometry.frame_tree import FrameTree
    from slamcli.measurements import CameraModel
    from slamcli.recordings.mends import Mends
    from slamcli.recordings.summary import RecordingSummary, TopicSummary
    from slamcli.runtime import RunLog


@click.command()
@click.argument("bags", metavar="BAG...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--full", is_flag=True, help="Read a big recording to its end for gaps, frames and traits.")
@json_option
@recording_options
@verbosity_options
def command(bags: tuple[Path, ...], full: bool, as_json: bool, mends: Mends, verbosity: int) -> int:
    """Say what a recording or a saved state holds, and which SLAM systems can run on it.

    BAG is a ROS 1 bag, a ROS 2 folder or file, an MCAP file, a data-set folder (TUM RGB-D, EuRoC, TUM-VI, KITTI odometry, 7-Scenes,
    ICL-NUIM), or a CARMEN or exp*.dat log; several files are read as one recording. Of recordings over 64 MB only the index and the first seconds are read, unless --full is given. BAG may also be one state that Cartographer or
    `slamcli map --algo cartographer` saved (.pbstream), or one database of RTAB-Map or of `slamcli map --algo rtabmap` (.db).
    """
    from slamcli.recordings import open_recording
    from slamcli.recordings.summary import summarise
    from slamcli.runtime import RunLog

    with Console(verbosity) as console:
        if _is_state(bags):
            tell_state(bags[0], console, as_json=as_json)
            return 0
        if _is_database(bags):
            tell_database(bags[0], as_json=as_json)
            return 0
        log = RunLog(console)
        with (
            open_recording(bags, mends=mends, log=log) as recording,
            log.stage("reading", (recording.end_ns - recording.start_ns) / 1e9),
        ):
            summary = summarise(recording, full=full)
        # Damage and contradicting frames are part of the answer: they are not said twice.
        answered = {*summary.contents.damage, *(f"tf: {problem}" for problem in summary.frames.problems)}
        for note in log.notes:
            console.say(note)
        for warning in log.warnings:
            if warning not in answered:
                console.warn(warning)
    if as_json:
        print_json(_document(summary, log), "info")
    else:
        click.echo(_text(summary))
    return 0


def _is_state(bags: tuple[Path, ...]) -> bool:
    """Return whether a state is meant.

    Raises
    ------
    UsageError
        If a state is one of several files.
    """
    from slamcli.errors import UsageError
    from slamcli.formats.pbstream.container import is_pbstream

    found = [bag for bag in bags if is_pbstream(bag)]
    if found and len(bags) > 1:
        raise UsageError(f"{found[0]} is a saved state: one at a time")
    return bool(found)


def _is_database(bags: tuple[Path, ...]) -> bool:
    """Return whether a database of RTAB-Map is meant.

    Raises
    ------
    UsageError
        If one is one of several files.
    """
    from slamcli.errors import UsageError
    from slamcli.rtabmap.database import is_database

    found = [bag for bag in bags if is_database(bag)]
    if found and len(bags) > 1:
        raise UsageError(f"{found[0]} is a database of RTAB-Map: one at a time")
    return bool(found)


def _document(summary: RecordingSummary, log: RunLog) -> dict[str, Any]:
    contents = summary.contents
    installed = _installed()
    return {
        "files": [str(path) for path in contents.paths],
        "format": contents.format,
        "compression": contents.compression,
        "size_bytes": contents.size_bytes,
        "messages": contents.num_messages,
        "start_ns": contents.start_ns,
        "end_ns": contents.end_ns,
        "duration_s": summary.duration_s,
        "sampled_s": summary.sampled_s,
        "damage": list(contents.damage),
        "topics": [_topic_document(topic) for topic in summary.topics],
        "frames": _frames_document(summary.frames),
        "calibration": [_camera_document(camera) for camera in summary.cameras],
        "tiers": [
            {
                "tier": fit.tier,
                "runs": fit.runs,
                "installed": fit.tier in installed,
                "mode": fit.mode,
                "topics": dict(fit.topics),
            }
            for fit in summary.tiers
        ],
        "notes": log.notes,
        "warnings": log.warnings,
    }


def _installed() -> set[str]:
    """Return the names of the tiers that are installed."""
    from importlib.metadata import entry_points

    return {point.name for point in entry_points(group="slamcli.mappers")}


def _topic_document(topic: TopicSummary) -> dict[str, Any]:
    return {
        "name": topic.topic.name,
        "type": topic.topic.msgtype,
        "count": topic.count,
        "rate_hz": topic.rate_hz,
        "largest_gap_s": topic.largest_gap_s,
        "gap_at_ns": topic.gap_at_ns,
        "frame_id": topic.frame_id,
        "traits": topic.traits,
    }


def _frames_document(frames: FrameTree) -> dict[str, Any]:
    return {
        "roots": list(frames.roots),
        "edges": [
            {"parent": edge.parent, "child": edge.child, "static": edge.static, "samples": edge.num_samples}
            for edge in frames.edges
        ],
        "problems": list(frames.problems),
    }


def _camera_document(camera: CameraModel) -> dict[str, Any]:
    return {
        "topic": camera.topic,
        "frame_id": camera.frame_id,
        "width": camera.width,
        "height": camera.height,
        "distortion_model": camera.distortion_model,
        "distortion": camera.distortion.tolist(),
        "K": camera.intrinsics.tolist(),
        "P": camera.projection.tolist(),
    }


def _text(summary: RecordingSummary) -> str:
    contents = summary.contents
    size = size_text(contents.size_bytes)
    names = ", ".join(str(path) for path in contents.paths[:4]) + (", …" if len(contents.paths) > 4 else "")
    lines = [
        f"{names}",
        f"  {contents.format}, {size}, compression {contents.compression}",
        f"  {_messages(contents.num_messages)} in {duration_text(summary.duration_s)}, from {time_text(contents.start_ns)}",
    ]
    lines += [f"  damaged: {damage}" for damage in contents.damage]
    if summary.sampled_s is not None:
        lines.append(
            f"  gaps, frames and traits are those of the first {summary.sampled_s:.1f} s (--full reads everything)"
        )
    lines += ["", *_topic_lines(summary.topics), "", *_frame_lines(summary.frames)]
    lines += ["", "runs on it"]
    installed = _installed()
    for fit in summary.tiers:
        topics = ", ".join(f"{role} {topic}" for role, topic in fit.topics.items())
        line = f"  {fit.tier:13} {'yes' if fit.runs else 'no'}: {fit.mode}" + f" ({topics})" * bool(topics)
        lines.append(line + "; not installed" * (fit.runs and fit.tier not in installed))
    return "\n".join(lines)


def _topic_lines(topics: tuple[TopicSummary, ...]) -> list[str]:
    if not topics:
        return ["no topics"]
    rows = [("topic", "type", "count", "Hz", "longest gap", "frame", "")]
    rows += [
        (
            topic.topic.name,
            topic.topic.msgtype.replace("/msg/", "/"),
            "?" if topic.count is None else str(topic.count),
            "" if topic.rate_hz is None else f"{topic.rate_hz:.4g}",
            "" if topic.largest_gap_s is None else f"{topic.largest_gap_s:.3g} s",
            topic.frame_id or "",
            topic.traits,
        )
        for topic in topics
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    right = {2, 3, 4}
    return [
        "  ".join(cell.rjust(width) if i in right else cell.ljust(width) for i, (cell, width) in enumerate(zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]  # fmt: skip


def _frame_lines(frames: FrameTree) -> list[str]:
    if not frames.frames:
        return ["no frames (neither /tf nor /tf_static)"]
    lines = ["frames (* moves)"]
    children: dict[str, list[str]] = {}
    for edge in frames.edges:
        children.setdefault(edge.parent, []).append(edge.child)
    pending = [(root, 1) for root in reversed(frames.roots)]
    while pending:
        frame, depth = pending.pop()
        edge_to = frames.edge(frame)
        lines.append("  " * depth + frame + (" *" if edge_to is not None and not edge_to.static else ""))
        pending += [(child, depth + 1) for child in reversed(children.get(frame, []))]
    return lines + [f"  problem: {problem}" for problem in frames.problems]


def _messages(count: int | None) -> str:
    return "an unknown number of messages" if count is None else f"{count} messages"
