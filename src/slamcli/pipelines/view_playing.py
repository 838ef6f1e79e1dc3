# SPDX-License-Identifier: MIT
"""Results that play: as recordings for Foxglove and RViz, and as films."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamcli.errors import UsageError
from slamcli.pipelines.replay import Replay, load_replay, replay_of
from slamcli.pipelines.view_content import Content, read_content
from slamcli.posegraph import MapState
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.pipelines.view import ViewOptions


def write_recording(
    sources: Sequence[Path], kind: str, output: Path, options: ViewOptions, log: RunLog
) -> dict[str, Any]:
    """Write a result, a map, a state, a database or a trajectory as a recording; return facts for ``--json``.

    Raises
    ------
    InputError
        If there are several sources, or one cannot be read.
    """
    from slamcli.reports.mcap import write_replay, write_result

    content = _content(sources, kind, output, options, log)
    if kind == "result" and content.trajectory is not None:
        replay = _loaded(sources[0], options, log)
        return content.facts | {"growth": replay.growth, "messages": write_replay(output, replay)}
    truth = content.truth[1] if content.truth is not None else None
    messages = write_result(
        output, grid=content.grid, trajectory=content.trajectory, truth=truth, state=_state(sources[0], kind, log)
    )
    return content.facts | {"messages": messages}


def write_film(sources: Sequence[Path], kind: str, output: Path, options: ViewOptions, log: RunLog) -> dict[str, Any]:
    """Write a film of a result, a state, a database or a trajectory; return facts for ``--json``.

    Raises
    ------
    InputError
        As `write_recording`; also if nothing moves in it.
    """
    from slamcli.reports.film import check_film
    from slamcli.reports.growth_film import write_growth_film

    check_film(output)
    content = _content(sources, kind, output, options, log)
    moving = content.trajectory
    if moving is None or not len(moving):
        raise UsageError(f"{output}: a film shows a trajectory, and {sources[0]} has none")
    if kind == "result":
        replay = _loaded(sources[0], options, log)
    else:
        truth = content.truth[1] if content.truth is not None else None
        state = _state(sources[0], kind, log)
        replay = replay_of(sources[0].stem, moving, grid=content.grid, truth=truth, state=state)
    return content.facts | {"film": write_growth_film(output, replay, title=options.title)}


def _content(sources: Sequence[Path], kind: str, output: Path, options: ViewOptions, log: RunLog) -> Content:
    if len(sources) > 1:
        raise UsageError(f"{output}: one result or trajectory can play at a time; {len(sources)} were given")
    return read_content(sources[0], kind, options, log)


def _loaded(source: Path, options: ViewOptions, log: RunLog) -> Replay:
    return load_replay(source, recording=options.recording, truth=options.truth, mends=options.mends, log=log)


def _state(source: Path, kind: str, log: RunLog) -> MapState | None:
    if kind != "state":
        return None
    from slamcli.formats.pbstream.reading import read_state

    return read_state(source, log=log)
