# SPDX-License-Identifier: MIT
"""Pictures of whatever slamcli reads or writes: results, maps, trajectories and recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamcli.errors import UsageError
from slamcli.formats.clouds import read_cloud
from slamcli.formats.octomap import read_octomap
from slamcli.formats.trajectories import read_trajectory
from slamcli.outputs import atomic_file
from slamcli.pipelines.trajectories import load_trajectory
from slamcli.pipelines.view_alignment import Alignment, laid_over
from slamcli.pipelines.view_content import read_content, read_truth, trajectory_facts
from slamcli.pipelines.view_source import OCTREES, default_output, find_kind
from slamcli.reports.figures import map_png, raster, track
from slamcli.reports.figures.cloud import cloud_view
from slamcli.runtime import RunLog

if TYPE_CHECKING:
    from slamcli.recordings.mends import Mends

RECORDINGS = (".mcap", ".bag", "")
"""As what results are written besides pictures; without a suffix a ROS 2 folder."""
FILMS = (".gif", ".mp4")
PAPER = (".pdf", ".svg")
_NUM_SCANS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewed:
    """What was drawn, and where it lies."""

    kind: str
    """result, map, cloud, state, database, trajectory or recording."""
    output: Path
    facts: Mapping[str, Any]
    """Figures of what is shown, for ``--json``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """How to draw."""

    truth: Path | None = None
    """Ground truth to draw beside the trajectory: whatever `load_trajectory` takes, a data-set folder too."""
    align: Alignment = "auto"
    """How what is drawn beside the first trajectory is laid over it; auto is fit for files, and start for those topics
    of a recording that are in another frame."""
    title: str | None = None
    """None for the name of what is shown."""
    max_pixels: int = 2000
    start_s: float | None = None
    duration_s: float | None = None
    scans: int = _NUM_SCANS
    """Number of scans that are drawn of a recording, spread over it."""
    mends: Mends | None = None
    """What is mended while a recording is read."""
    recording: Sequence[Path] = ()
    """What a result was made of; empty: looked for by its record."""
    width_cm: float | None = None
    """Of a figure for a paper; None for 8.8."""


def view(
    sources: Sequence[Path], output: Path | None = None, options: ViewOptions | None = None, log: RunLog | None = None
) -> Viewed:
    """Draw a result folder, a map, trajectories or a recording to a PNG and return where it lies.

    Parameters
    ----------
    sources
        One result folder (several for a .pdf or .svg), map.yaml, point cloud, saved state or database of RTAB-Map, one or more
        trajectory files, or the files of one recording.
    output
        The PNG; of results, maps and trajectories also a figure for papers (.pdf, .svg), a film (.gif, .mp4) or a recording (.mcap,
        .bag, a folder). None for `slamcli.pipelines.view_source.default_output`.
    options
        How to draw.
    log
        Takes notes and warnings.

    Raises
    ------
    InputError
        If a source is missing or is none of these, or the output cannot be written.
    """
    options, log = options or ViewOptions(), log if log is not None else RunLog()
    kind = find_kind(sources, several=output is not None and output.suffix.lower() in PAPER)
    output = output or default_output(sources[0], kind)
    suffix = output.suffix.lower()
    check_options(kind, suffix, options)
    if kind not in ("recording", "cloud") and suffix in (*RECORDINGS, *FILMS, *PAPER):
        if suffix in PAPER:
            from slamcli.pipelines.view_paper import write_paper

            return Viewed(kind=kind, output=output, facts=write_paper(sources, kind, output, options, log))
        from slamcli.pipelines.view_playing import write_film, write_recording

        write = write_recording if suffix in RECORDINGS else write_film
        return Viewed(kind=kind, output=output, facts=write(sources, kind, output, options, log))
    if suffix != ".png":
        raise UsageError(
            f"{output}: pictures are written as .png; results, maps and trajectories also as .pdf and .svg, as films (.gif, .mp4) "
            "and as recordings (.mcap, .bag)"
        )
    if kind == "recording":
        from slamcli.pipelines.view_recording import draw_recording

        image, facts = draw_recording(sources, options, log)
    elif kind == "cloud":
        image, facts = _draw_cloud(sources[0], options, log)
    elif kind == "trajectory":
        image, facts = _draw_trajectories(sources, options, log)
    else:
        image, facts = _draw_map(sources[0], kind, options, log)
    with atomic_file(output, "wb") as stream:
        stream.write(image)
    return Viewed(kind=kind, output=output, facts=facts)


def check_options(kind: str, suffix: str, options: ViewOptions) -> None:
    """Refuse options that are about another kind of source than `kind`, or of output than `suffix` names.

    Raises
    ------
    UsageError
        With the option.
    """
    part = {
        "--start": options.start_s,
        "--duration": options.duration_s,
        "--scans": options.scans != _NUM_SCANS or None,
    }
    given = next((option for option, value in part.items() if value is not None), None)
    if given is not None and kind != "recording":
        raise UsageError(f"{given} is for recordings, and this is a {kind}")
    if options.recording and suffix not in (*RECORDINGS, *FILMS):
        raise UsageError(
            "--recording is for what plays: --serve, --export, and -o FILE.mcap, .bag, .gif or .mp4 of a result"
        )
    if options.width_cm is not None and suffix not in PAPER:
        raise UsageError("--width-cm is for figures: -o FILE.pdf or .svg; --max-pixels sizes pictures")


def _draw_map(source: Path, kind: str, options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    """Draw a map, or a result: its map with its trajectory, or the trajectory alone where there is no map."""
    content = read_content(source, kind, options, log)
    title = source.resolve().name if options.title is None else options.title
    if content.grid is None and content.trajectory is not None:
        image = track.track_image(content.trajectory, truth=content.truth, title=title, max_pixels=options.max_pixels)
        return raster.png(image), content.facts
    if content.grid is None:
        raise UsageError(f"{source}: no map in it")
    picture = map_png(
        content.grid,
        trajectory=content.trajectory,
        truth=content.truth[1] if content.truth is not None else None,
        truth_label=content.truth[0] if content.truth is not None else "",
        title=title,
        max_pixels=options.max_pixels,
    )
    return picture, content.facts


def _draw_trajectories(sources: Sequence[Path], options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    read = [read_trajectory(source, log=log) for source in sources]
    if len(read) > 6:
        raise UsageError(f"{len(read)} trajectories: six can be told apart")
    others = [
        laid_over(read[0], source.name, trajectory, options.align, log)
        for source, trajectory in zip(sources[1:], read[1:], strict=True)
    ]
    truth = read_truth(options, read[0], log)
    image = track.track_image(
        read[0],
        others,
        truth=truth,
        label=sources[0].name,
        title=options.title or "",
        max_pixels=options.max_pixels,
    )
    facts = trajectory_facts(read[0])
    if len(read) > 1:
        facts["others"] = [{"file": str(s), **trajectory_facts(t)} for s, t in zip(sources[1:], read[1:], strict=True)]
    return raster.png(image), facts


def _draw_cloud(source: Path, options: ViewOptions, log: RunLog) -> tuple[bytes, dict[str, Any]]:
    """Draw a point cloud, or what is occupied in an octree, from above, with the trajectory that is given as truth."""
    if source.suffix.lower() in OCTREES:
        octree = read_octomap(source)
        points = octree.select(octree.occupied).centres_m.astype(np.float32)
    else:
        points = read_cloud(source).points_m
    if not len(points):
        raise UsageError(f"{source}: a point cloud without points")
    truth = None if options.truth is None else load_trajectory(options.truth, log=log)
    image = cloud_view(points, (0, 1), trajectory=truth, max_pixels=options.max_pixels)
    low, high = points.min(axis=0), points.max(axis=0)
    return raster.png(image), {"points": len(points), "low_m": low.tolist(), "high_m": high.tolist()}
