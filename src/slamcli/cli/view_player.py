# SPDX-License-Identifier: MIT
"""``slamcli view RESULT --serve`` and ``--export``: the page that plays a result."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from slamcli.cli.console import Console, print_json
from slamcli.cli.desktop import show
from slamcli.errors import UsageError
from slamcli.runtime import RunLog

_LOOPBACK = "127.0.0.1"
_OF_PICTURES = ("align", "max_pixels", "width_cm", "start_s", "duration_s", "scans")
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def player_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the player."""
    options: Sequence[Decorator] = (
        click.option(
            "--serve", is_flag=True,
            help="Results: play them in the browser, from a local server whose address is printed. Ctrl-C ends it.",
        ),
        click.option("--port", type=click.IntRange(0, 65535), default=0, show_default="a free one", help="With --serve: where to listen."),
        click.option("--host", default=_LOOPBACK, show_default=True, metavar="NAME", help="With --serve: the address to listen on; 0.0.0.0 lets the network in."),
        click.option("--export", type=click.Path(path_type=Path), metavar="FILE.html", help="Results: write the same page with all its data into one file."),
    )  # fmt: skip
    for option in reversed(options):
        function = option(function)
    return function


def check_player(sources: Sequence[Path], output: Path | None, *, serve: bool, export: Path | None) -> Path:
    """Return the result that is to be played.

    Raises
    ------
    UsageError
        If the options or the source are about something else.
    """
    option = "--serve" if serve else "--export"
    if serve and export is not None:
        raise UsageError("--serve and --export are two ways to the same page: name one of them")
    if output is not None:
        raise UsageError(
            f"-o names a picture, and {option} makes none" + ("" if serve else ": --export names the page")
        )
    from slamcli.pipelines.view_source import find_kind

    kind = find_kind(sources)
    if kind != "result":
        raise UsageError(f"{option} plays the folder that slamcli map wrote; {sources[0]} is a {kind}")
    return sources[0]


def check_given(context: click.Context, *, serve: bool, export: Path | None) -> None:
    """Refuse options that would do nothing: the server's where nothing is served, those of pictures where none is drawn.

    Raises
    ------
    UsageError
        With the option.
    """
    page = "--serve" if serve else "--export"
    refused = {} if serve else {"port": "is for --serve", "host": "is for --serve"}
    if serve or export is not None:
        refused |= dict.fromkeys(_OF_PICTURES, f"is for pictures, and {page} makes none")
    for option in context.command.params:
        if option.name in refused and context.get_parameter_source(option.name) is ParameterSource.COMMANDLINE:
            raise UsageError(f"{max(option.opts, key=len)} {refused[option.name]}")


def serve_page(
    source: Path, console: Console, *, host: str, port: int, open_it: bool, as_json: bool, inputs: dict[str, Any]
) -> int:
    """Serve the player of a result until the user ends it; the first line of stdout is its address."""
    from slamcli.pipelines.serve import open_player

    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)  # a shell that starts it in the background has it ignored
    log = RunLog(console)
    try:
        with open_player(source, host=host, port=port, log=log, **inputs) as server:
            if as_json:
                print_json({"url": server.url, "notes": log.notes, "warnings": log.warnings}, "view-serve")
            else:
                click.echo(server.url)
            sys.stdout.flush()
            console.tell(log)
            console.say(f"playing {source} at {server.url}; Ctrl-C ends it")
            if open_it and not show(server.url):
                console.warn("there is no desktop to show it on")
            server.serve_forever(poll_interval=0.2)
    except KeyboardInterrupt:
        pass
    return 0


def export_page(
    source: Path, target: Path, console: Console, *, open_it: bool, as_json: bool, inputs: dict[str, Any]
) -> int:
    """Write the player of a result into one file, whose name is printed."""
    from slamcli.pipelines.serve import export_player

    log = RunLog(console)
    size = export_player(source, target, log=log, **inputs)
    console.tell(log)
    if as_json:
        document = {"kind": "player", "output": str(target), "size_bytes": size}
        print_json({**document, "notes": log.notes, "warnings": log.warnings}, "view")
    else:
        click.echo(str(target))
    if open_it and not show(target.resolve().as_uri()):
        console.warn(f"there is no desktop to show {target} on")
    return 0


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
