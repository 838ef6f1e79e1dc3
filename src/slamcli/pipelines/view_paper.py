# SPDX-License-Identifier: MIT
"""Figures for papers of results, maps, states and trajectories, one or several over each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from slamcli.errors import UsageError
from slamcli.outputs import atomic_file
from slamcli.pipelines.view_alignment import laid_over
from slamcli.pipelines.view_content import read_content, trajectory_facts
from slamcli.reports.paper_figure import MOST_LINES, PaperOptions, paper_figure
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

if TYPE_CHECKING:
    from slamcli.pipelines.view import ViewOptions


def write_paper(sources: Sequence[Path], kind: str, output: Path, options: ViewOptions, log: RunLog) -> dict[str, Any]:
    """Write a figure as the suffix of `output` says; return facts of the first source, and ``others``, for ``--json``.

    The first source's map lies below, and the others' trajectories are laid over its trajectory.

    Raises
    ------
    InputError
        If there are more sources than colours, or one cannot be read.
    """
    if len(sources) > MOST_LINES:
        raise UsageError(f"{output}: {len(sources)} trajectories; {MOST_LINES} can be told apart")
    contents = [read_content(source, kind, options, log) for source in sources]
    first, base = contents[0], contents[0].trajectory
    lines: list[tuple[str, Trajectory]] = []
    for label, content in zip(labels(sources), contents, strict=True):
        if content.trajectory is None:
            continue
        if base is None or content is first:
            lines.append((label, content.trajectory))
        else:
            moved = laid_over(base, label, content.trajectory, "fit" if options.align == "auto" else options.align, log)
            lines.append((label, moved[1]))
    layout = (
        PaperOptions(title=options.title or "")
        if options.width_cm is None
        else PaperOptions(title=options.title or "", width_cm=options.width_cm)
    )
    truth = None if first.truth is None else ("ground truth", first.truth[1])
    data = paper_figure(output.suffix.lower(), lines, grid=first.grid, truth=truth, options=layout)
    with atomic_file(output, "wb") as stream:
        stream.write(data)
    others = [
        {"file": str(s), **trajectory_facts(c.trajectory)}
        for s, c in zip(sources[1:], contents[1:], strict=True)
        if c.trajectory
    ]
    return first.facts | ({"others": others} if others else {})


def labels(sources: Sequence[Path]) -> list[str]:
    """Return what each source is called beside the others: its name without suffix, or with its folder where names repeat."""
    names = [source.resolve().name if source.is_dir() else source.stem for source in sources]
    return [
        f"{source.resolve().parent.name}/{name}" if names.count(name) > 1 else name
        for source, name in zip(sources, names, strict=True)
    ]
