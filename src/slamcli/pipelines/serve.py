# SPDX-License-Identifier: MIT
"""A result as a page that plays it: from a local server, or in one file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from slamcli.errors import SlamcliError, UsageError
from slamcli.outputs import atomic_file, check_file
from slamcli.pipelines.replay import load_replay
from slamcli.pipelines.serve_content import PlayerContent, player_content
from slamcli.pipelines.serve_http import PlayerServer, Resource, Site
from slamcli.recordings import Mends
from slamcli.reports.player import little_endian, player_page, player_script, player_style, standalone_page
from slamcli.runtime import RunLog

_IMAGE_WIDTH = 640
_EXPORT_IMAGE_WIDTH = 400
_EXPORT_IMAGES = 240
_EXPORT_SCAN_POINTS = 1_500_000
MOST_EXPORT_BYTES = 64 << 20
"""Of a page in one file; browsers and mail programs refuse much larger ones."""


def open_player(
    source: Path,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    recording: Sequence[Path] = (),
    truth: Path | None = None,
    mends: Mends | None = None,
    title: str | None = None,
    log: RunLog,
) -> PlayerServer:
    """Return a server that listens and has the player of a result; `PlayerServer.serve_forever` answers.

    Parameters
    ----------
    source
        The folder that ``slamcli map`` wrote.
    host, port
        Where to listen; port 0 is a free one.
    recording
        What the result was made of; left out, it is looked for.
    truth
        Ground truth to draw beside the trajectory.
    mends
        What is mended while the recording is read.
    title
        Line above the page; None for the name of the folder.
    log
        Takes notes and warnings; one if others than this machine can reach the server.

    Raises
    ------
    InputError
        If there is no such result, or nobody can listen there.
    """
    server = PlayerServer(Site(resources={}), host, port)  # an address that is taken is told before the result is read
    try:
        content = player_content(
            load_replay(source, recording=recording, truth=truth, mends=mends, log=log), title=title
        )
        server.site = _site(content)
        if not server.local:
            log.warn(f"{server.url} can be reached by others on the network, and nobody is asked for a password")
    except BaseException:
        server.server_close()
        raise
    return server


def export_player(
    source: Path,
    target: Path,
    *,
    recording: Sequence[Path] = (),
    truth: Path | None = None,
    mends: Mends | None = None,
    title: str | None = None,
    log: RunLog,
) -> int:
    """Write the player of a result with all its data into one HTML file, and return its size in bytes.

    Of a long recording every second, third ... scan and image is in it, and images are smaller than those of the server.

    Raises
    ------
    InputError
        If there is no such result, the file cannot be written, or would be larger than `MOST_EXPORT_BYTES`.
    """
    if target.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"{target}: the page is a file whose name ends with .html")
    check_file(target)
    replay = load_replay(source, recording=recording, truth=truth, mends=mends, log=log)
    content = player_content(replay, title=title, scan_points=_EXPORT_SCAN_POINTS, images=_EXPORT_IMAGES)
    page = standalone_page(content.facts, content.arrays, _pictures(content, log)).encode()
    if len(page) > MOST_EXPORT_BYTES:
        raise UsageError(
            f"{target} would be {len(page) / 1e6:.0f} MB; at most {MOST_EXPORT_BYTES / 1e6:.0f} MB go into one page: --serve plays results of any size"
        )
    with atomic_file(target, "wb") as stream:
        stream.write(page)
    return len(page)


def _pictures(content: PlayerContent, log: RunLog) -> list[bytes]:
    """Return the JPEGs that go into the page; one that cannot be read is empty, and said."""
    found = []
    for image in content.images:
        try:
            found.append(image(_EXPORT_IMAGE_WIDTH))
        except SlamcliError as error:
            log.warn(f"an image is left out: {error}")
            found.append(b"")
    return found


def _site(content: PlayerContent) -> Site:
    facts = json.dumps(content.facts, separators=(",", ":"), allow_nan=False)
    resources = {
        "/": Resource("text/html; charset=utf-8", player_page(str(content.facts["title"])).encode()),
        "/player.css": Resource("text/css; charset=utf-8", player_style().encode()),
        "/player.js": Resource("text/javascript; charset=utf-8", player_script().encode()),
        "/replay.json": Resource("application/json", facts.encode()),
    }
    for name, array in content.arrays.items():
        resources[f"/data/{name}.bin"] = Resource("application/octet-stream", little_endian(array))
    image: Callable[[int], bytes] | None = None
    if content.images:

        def image(number: int) -> bytes:
            return content.images[number](_IMAGE_WIDTH)

    return Site(resources=resources, num_images=len(content.images), image=image)
