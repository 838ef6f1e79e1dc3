# SPDX-License-Identifier: MIT
"""Options of what tiers that see know of places: atlas and vocabulary."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_OPTIONS = (
    click.option(
        "--vocabulary", metavar="FILE",
        help="Visual words by which places are known again (orbslam3): a file (see `slamcli vocabulary`), own, or recording, learnt from it beforehand.  [default: own]",
    ),
    click.option(
        "--load-atlas", metavar="FILE", type=click.Path(path_type=Path),
        help="Go on from the maps of an earlier run (orbslam3; its atlas.npz).",
    ),
    click.option(
        "--save-atlas", metavar="FILE", type=click.Path(path_type=Path),
        help="Where the maps go besides atlas.npz in the folder.",
    ),
    click.option(
        "--localise-only", is_flag=True, help="Find the frames in the maps of --load-atlas or --database and leave those as they are."
    ),
)  # fmt: skip
_NAMES = ("vocabulary", "load_atlas", "save_atlas", "localise_only")


def atlas_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it gets `atlas` (`slamcli.pipelines.visual_places.AtlasChoices`)."""

    @functools.wraps(function)
    def with_atlas(**arguments: Any) -> Any:
        from slamcli.pipelines.visual_places import AtlasChoices

        vocabulary, load, save, localise_only = (arguments.pop(name) for name in _NAMES)
        atlas = AtlasChoices(vocabulary=vocabulary, load=load, save=save, localise_only=localise_only)
        return function(atlas=atlas, **arguments)

    decorated: Callable[..., Any] = with_atlas
    for option in reversed(_OPTIONS):
        decorated = option(decorated)
    return decorated


def atlas_words(atlas: Any) -> list[str]:
    """Return the options as words of the command that makes the same result again: files without their folders."""
    words: list[str] = []
    if atlas.vocabulary is not None:
        words += ["--vocabulary", Path(atlas.vocabulary).name]
    if atlas.load is not None:
        words += ["--load-atlas", atlas.load.name]
    return [*words, "--localise-only"] if atlas.localise_only else words
