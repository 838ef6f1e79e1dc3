# SPDX-License-Identifier: MIT
"""``slamcli info`` on a database of RTAB-Map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from slamcli.cli.console import print_json
from slamcli.cli.quantities import duration_text, size_text, time_text

if TYPE_CHECKING:
    from slamcli.pipelines.database_facts import DatabaseFacts, SessionFacts

_SHOWN = 20
_LINKS = {
    "neighbor": "neighbours", "global_closure": "loop closures by looks", "local_space_closure": "closures by nearness",
    "local_time_closure": "closures within short-term memory", "user_closure": "closures by hand", "virtual_closure": "virtual",
    "neighbor_merged": "merged neighbours", "pose_prior": "pose priors", "landmark": "sightings of landmarks", "gravity": "gravity",
}  # fmt: skip


def tell_database(path: Path, *, as_json: bool) -> None:
    """Say what a ``.db`` holds."""
    from slamcli.pipelines.database_facts import database_facts, document

    facts = database_facts(path)
    if as_json:
        print_json({**document(facts), "notes": [], "warnings": []}, "info-database")
    else:
        click.echo(_text(facts))


def _text(facts: DatabaseFacts) -> str:
    counts = facts.counts
    lines = [
        str(facts.path),
        f"  database of RTAB-Map (version {facts.version}), {size_text(facts.size_bytes)}",
        f"  {facts.nodes} nodes{_of_them(facts)}",
    ]
    held = (
        f"{counts.with_images} with images, {counts.with_scans} with scans, {counts.with_local_grids} with local grids"
    )
    lines.append(f"  {held}; {counts.key_points} key points, {counts.words} words")
    lines += [f"  sensors: {', '.join(facts.sensors)}"] if facts.sensors else []
    lines += [f"  {line}" for line in _camera_lines(facts)]
    lines.append("  links: " + (", ".join(f"{count} {_LINKS[kind]}" for kind, count in facts.links.items()) or "none"))
    if facts.closures_between_sessions:
        lines.append(f"  {facts.closures_between_sessions} of them between sessions")
    if facts.landmarks:
        shown = ", ".join(map(str, facts.landmarks[:_SHOWN])) + (" …" if len(facts.landmarks) > _SHOWN else "")
        lines.append(f"  {len(facts.landmarks)} landmarks: {shown}")
    grid = "" if facts.grid is None else f", a map of {facts.grid[0]} x {facts.grid[1]} cells of {facts.grid[2]:g} m"
    lines.append(f"  optimised: {facts.optimised or 'no'} poses{grid}; figures of {counts.statistics} updates")
    for session in facts.sessions:
        lines += ["", *_session_lines(session)]
    lines += ["", f"parameters: {facts.parameters}, of which {len(facts.changed)} differ from the defaults"]
    lines += [f"  {name} {value}" for name, value in facts.changed.items()]
    lines += [
        "",
        f"mapped once more: slamcli map --algo rtabmap {facts.path.name}",
        f"gone on from with a recording: slamcli map --algo rtabmap BAG --database {facts.path.name}",
    ]
    return "\n".join(lines)


def _of_them(facts: DatabaseFacts) -> str:
    parts = {
        "intermediate": facts.intermediate, "not to be used": facts.unused,
        "in working memory when the last session ended": facts.working,
    }  # fmt: skip
    told = [f"{count} {what}" for what, count in parts.items() if count]
    return f", of them {', '.join(told)}" if told else ""


def _camera_lines(facts: DatabaseFacts) -> list[str]:
    lines = []
    for camera in facts.cameras:
        pinhole = camera.pinhole
        x, y, z = camera.T_base_camera[:3, 3]
        baseline = f", baseline {pinhole.baseline_m:.3f} m" if pinhole.baseline_m > 0 else ""
        lines.append(
            f"camera: {pinhole.width} x {pinhole.height}, fx {pinhole.fx:.1f} fy {pinhole.fy:.1f} cx {pinhole.cx:.1f} "
            f"cy {pinhole.cy:.1f}{baseline}, at {x:.3f}, {y:.3f}, {z:.3f} m of the base"
        )
    return lines


def _session_lines(session: SessionFacts) -> list[str]:
    span = duration_text((session.end_ns - session.start_ns) / 1e9)
    return [
        f"session {session.map_id}: nodes {session.first_id} to {session.last_id} ({session.nodes})",
        f"  {span}, from {time_text(session.start_ns)}, path of {session.length_m:.1f} m by odometry",
    ]
