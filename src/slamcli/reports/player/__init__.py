# SPDX-License-Identifier: MIT
"""The page that plays a result in a browser: its parts, as a server sends them and in one file."""

from __future__ import annotations

import base64
import functools
import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SCRIPTS = ("data.js", "growth.js", "camera.js", "layers.js", "charts.js", "player.js", "page.js")
"""In the order in which they build on each other."""
_HEAD = (
    '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
    '<meta name="viewport" content="width=device-width,initial-scale=1"><link rel="icon" href="data:,">'
)

__all__ = ["little_endian", "player_page", "player_script", "player_style", "standalone_page"]


@functools.cache
def player_style() -> str:
    """Return the style sheet."""
    return _part("player.css")


@functools.cache
def player_script() -> str:
    """Return the script: all parts in one scope of their own."""
    return '"use strict";\n(() => {\n' + "\n".join(_part(name) for name in _SCRIPTS) + "})();\n"


def player_page(title: str) -> str:
    """Return the page as a server sends it: style, script and data are at ``player.css``, ``player.js`` and ``replay.json``."""
    return (
        f'{_HEAD}<title>{escape(title)}</title><link rel="stylesheet" href="player.css"></head>\n<body>\n'
        f'{_part("player.html")}<script src="player.js"></script>\n</body></html>\n'
    )


def standalone_page(facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], images: Sequence[bytes]) -> str:
    """Return the page with everything in it; it loads nothing, and its own policy forbids it to.

    Parameters
    ----------
    facts
        What ``replay.json`` holds.
    arrays
        Those that the facts name.
    images
        JPEG, in the order of the array ``image_time``.
    """
    style, script = player_style(), player_script()
    policy = f"default-src 'none';img-src data:;style-src '{_digest(style)}';script-src '{_digest(script)}'"
    blocks = [_block("replay", "application/json", json.dumps(facts, separators=(",", ":")).replace("<", "\\u003c"))]
    blocks += [_block(name, "text/plain", base64.b64encode(_packed(array)).decode()) for name, array in arrays.items()]
    blocks += [
        _block(f"image-{number}", "text/plain", base64.b64encode(image).decode()) for number, image in enumerate(images)
    ]
    return (
        f'{_HEAD}<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{escape(str(facts['title']))}</title><style>{style}</style></head>\n<body>\n"
        f"{_part('player.html')}{''.join(blocks)}<script>{script}</script>\n</body></html>\n"
    )


def _packed(array: NDArray[Any]) -> bytes:
    """Return the little-endian bytes of an array, compressed; the same array gives the same bytes."""
    return gzip.compress(little_endian(array), compresslevel=6, mtime=0)


def little_endian(array: NDArray[Any]) -> bytes:
    """Return the bytes of an array, as the page reads them."""
    return np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False).tobytes()


def _block(name: str, kind: str, text: str) -> str:
    """Return a block of data, which a browser does not run."""
    return f'<script type="{kind}" id="data-{name}">{text}</script>\n'


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


@functools.cache
def _part(name: str) -> str:
    return resources.files(__name__).joinpath(name).read_text(encoding="utf-8")
