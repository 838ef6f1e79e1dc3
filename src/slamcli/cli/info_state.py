# SPDX-License-Identifier: MIT
"""``slamcli info`` on a saved state."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.quantities import duration_text, size_text, time_text

if TYPE_CHECKING:
    from slamcli.pipelines.state_facts import StateFacts, TrajectoryFacts


def tell_state(path: Path, console: Console, *, as_json: bool) -> None:
    """Say what a ``.pbstream`` holds."""
    from slamcli.pipelines.state_facts import document, state_facts
    from slamcli.runtime import RunLog

    log = RunLog(console)
    facts = state_facts(path, log)
    console.tell(log)
    if as_json:
        print_json({**document(facts), "notes": log.notes, "warnings": log.warnings}, "info-state")
    else:
        click.echo(_text(facts))


def _text(facts: StateFacts) -> str:
    resolutions = " and ".join(f"{resolution:g} m" for resolution in facts.resolutions_m)
    lines = [
        str(facts.path),
        f"  Cartographer state (.pbstream version {facts.version}), {size_text(facts.size_bytes)}",
        f"  {facts.kind}" + (f" of {resolutions}" if resolutions else ""),
    ]
    if facts.extent_m is not None:
        x0, y0, x1, y1 = facts.extent_m
        lines.append(f"  {x1 - x0:.1f} x {y1 - y0:.1f} m: x from {x0:.1f} to {x1:.1f}, y from {y0:.1f} to {y1:.1f}")
    between = facts.constraints_between_trajectories
    lines.append(
        f"  constraints: {facts.constraints_intra} within submaps, {facts.constraints_inter} loop closures"
        + (f", {between} of them between trajectories" if between else "")
    )
    if facts.landmarks:
        more = f" and {len(facts.landmarks) - 8} more" if len(facts.landmarks) > 8 else ""
        lines.append(f"  {len(facts.landmarks)} landmarks: {', '.join(facts.landmarks[:8])}{more}")
    for trajectory in facts.trajectories:
        lines += ["", *_trajectory_lines(trajectory)]
    lines += [
        "",
        "its map and trajectory: slamcli map --algo cartographer --load-state " + facts.path.name,
        "the trajectories are not frozen by the file: --load-state goes on mapping, --load-frozen-state localises",
    ]
    return "\n".join(lines)


def _trajectory_lines(facts: TrajectoryFacts) -> list[str]:
    lines = [f"trajectory {facts.number}"]
    if facts.start_ns is not None and facts.end_ns is not None:
        span = duration_text((facts.end_ns - facts.start_ns) / 1e9)
        lines.append(f"  {span}, from {time_text(facts.start_ns)}, path of {facts.length_m:.1f} m")
    unfinished = f" ({facts.unfinished} unfinished)" if facts.unfinished else ""
    lines.append(f"  {facts.nodes} nodes with {facts.points} points, {facts.submaps} submaps{unfinished}")
    sensors: dict[str, Any] = {
        "IMU readings": facts.imu,
        "odometry poses": facts.odometry,
        "fixed-frame poses": facts.fixed_frame_poses,
        "landmark observations": facts.landmark_observations,
    }
    found = [f"{count} {name}" for name, count in sensors.items() if count]
    return [*lines, f"  {', '.join(found)}"] if found else lines
