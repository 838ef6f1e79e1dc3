# SPDX-License-Identifier: MIT
"""``slamcli view``: pictures of results, maps, trajectories and recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.desktop import show
from slamcli.cli.options import json_option, verbosity_options
from slamcli.cli.recording_options import recording_options
from slamcli.cli.view_player import check_given, check_player, export_page, player_options, serve_page


@click.command(name="view")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="FILE",
    help="Where the picture goes (.png); of a result, a map or a trajectory also a figure for papers (.pdf, .svg), a film (.gif, .mp4), or a recording for Foxglove and RViz (.mcap, .bag, a folder). Default: view.png in a result folder, else NAME-view.png beside the source.",
)  # fmt: skip
@click.option(
    "--truth", "--ref", "truth", type=click.Path(path_type=Path), metavar="FILE",
    help="Ground truth (a TUM, KITTI or EuRoC file, or a data-set folder), drawn in green.",
)  # fmt: skip
@click.option(
    "--align", type=click.Choice(["auto", "fit", "start", "none"]), default="auto", show_default=True,
    help="How the others are laid over the first trajectory: fitted, from the same start, or as they are. auto fits files, and lays topics of another frame from the same start.",
)  # fmt: skip
@click.option("--title", help="Line above the picture. Default: the name of what is shown.")
@click.option(
    "--max-pixels", type=click.IntRange(64, 20000), default=2000, show_default=True,
    help="Most pixels of the drawing's longer side; larger maps are reduced so that walls stay.",
)  # fmt: skip
@click.option(
    "--width-cm", type=click.FloatRange(4.0, 60.0), show_default="8.8, a column", metavar="CM",
    help="Width of a .pdf or .svg, with the page's margins.",
)  # fmt: skip
@click.option(
    "--start", "start_s", type=float, metavar="SEC", help="Recordings: begin so many seconds after its start."
)
@click.option("--duration", "duration_s", type=float, metavar="SEC", help="Recordings: draw so many seconds.")
@click.option(
    "--scans", type=click.IntRange(0, 100_000), default=200, show_default=True,
    help="Recordings: draw so many scans, spread evenly, where odometry says the robot was.",
)  # fmt: skip
@click.option(
    "--open", "open_it", is_flag=True, help="Show the picture with the desktop's viewer, or the page with its browser."
)
@player_options
@click.option(
    "--recording", "recordings", type=click.Path(path_type=Path), metavar="BAG", multiple=True,
    help="Results: the recording that it was made of (once for each file). Default: found beside the result by name and size.",
)  # fmt: skip
@recording_options
@json_option
@verbosity_options
def command(
    sources: tuple[Path, ...],
    output: Path | None,
    truth: Path | None,
    align: Any,
    title: str | None,
    max_pixels: int,
    width_cm: float | None,
    start_s: float | None,
    duration_s: float | None,
    scans: int,
    mends: Any,
    open_it: bool,
    serve: bool,
    port: int,
    host: str,
    export: Path | None,
    recordings: tuple[Path, ...],
    as_json: bool,
    verbosity: int,
) -> int:
    """Draw a recording, a result or a map.

    SOURCE is a folder that `slamcli map` wrote, a map's .yaml, a saved state (.pbstream), a database of RTAB-Map (.db), one or more trajectory files,
    or a recording (several files that belong together count as one).

    \b
    slamcli view intel                          map and trajectory: intel/view.png
    slamcli view map.yaml -o map.png            any map that map_server reads
    slamcli view state.pbstream                 a state of Cartographer
    slamcli view a.tum b.tum --truth gt.tum     trajectories over each other
    slamcli view intel -o intel.mcap            the run, for Foxglove and RViz
    slamcli view intel -o intel.pdf             a figure; several results, too
    slamcli view intel -o intel.gif             a film of the map as it grew
    slamcli view intel --serve                  plays it in the browser
    slamcli view drive.bag                      topics over time, odometry, scans

    Exit codes: 0 drawn, 2 wrong usage or input.
    """  # noqa: D301
    from slamcli.pipelines.view import ViewOptions, view
    from slamcli.runtime import RunLog

    with Console(verbosity) as console:
        log = RunLog(console)
        check_given(click.get_current_context(), serve=serve, export=export)
        if serve or export is not None:
            source = check_player(sources, output, serve=serve, export=export)
            inputs = {"recording": recordings, "truth": truth, "mends": mends, "title": title}
            if export is None:
                return serve_page(
                    source, console, host=host, port=port, open_it=open_it, as_json=as_json, inputs=inputs
                )
            return export_page(source, export, console, open_it=open_it, as_json=as_json, inputs=inputs)
        options = ViewOptions(
            truth=truth,
            align=align,
            title=title,
            max_pixels=max_pixels,
            start_s=start_s,
            duration_s=duration_s,
            scans=scans,
            mends=mends,
            recording=recordings,
            width_cm=width_cm,
        )
        seen = view(list(sources), output, options, log)
        console.tell(log)
        if as_json:
            document = {"kind": seen.kind, "output": str(seen.output), **seen.facts}
            print_json({**document, "notes": log.notes, "warnings": log.warnings}, "view")
        else:
            click.echo(str(seen.output))
        if open_it and not show(str(seen.output)):
            console.warn(f"there is no desktop to show {seen.output} on")
    return 0
