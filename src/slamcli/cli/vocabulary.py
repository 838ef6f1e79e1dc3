# SPDX-License-Identifier: MIT
"""``slamcli vocabulary``: train and inspect vocabularies of visual words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, seed_option, verbosity_options


@click.group()
def command() -> None:
    """Train and inspect vocabularies of visual words, by which --algo orbslam3 knows places again.

    \b
    slamcli vocabulary info ORBvoc.txt.tar.gz
    slamcli vocabulary train office.mcap -o office.npz
    """  # noqa: D301 - click needs the backspace itself


@command.command(short_help="Learn a vocabulary from pictures or recordings.")
@click.argument("sources", metavar="IMAGES|RECORDING...", nargs=-1, required=True, type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), metavar="FILE", help="Where to write it (.npz).")
@click.option("--branching", type=click.IntRange(2, 256), default=10, show_default=True, help="Branches of a node.")
@click.option("--levels", type=click.IntRange(1, 10), default=4, show_default=True, help="Levels of the tree: at most BRANCHING ** LEVELS words.")  # fmt: skip
@click.option("--features", type=click.IntRange(1), default=1000, show_default=True, help="ORB features of an image.")
@click.option("--max-images", type=click.IntRange(1), default=400, show_default=True, help="Images of each source, evenly spread over it.")  # fmt: skip
@click.option("--topic", help="Topic of the images, in recordings (default: the first that is not depth).")
@seed_option
@json_option
@verbosity_options
def train(
    sources: tuple[str, ...], output: str, branching: int, levels: int, features: int, max_images: int,
    topic: str | None, seed: int, as_json: bool, verbosity: int,
) -> int:  # fmt: skip
    """Learn a vocabulary from pictures, folders of pictures or recordings, and write it to FILE.

    The same sources and seed give the same bytes. Words are weighted by how few images they occur in (tf-idf).
    """
    from slamcli.pipelines.vocabulary import TrainingRequest
    from slamcli.pipelines.vocabulary import train as run
    from slamcli.runtime import RunLog
    from slamcli.vision.vocabulary_training import TrainingSettings

    request = TrainingRequest(
        sources=tuple(Path(source) for source in sources), num_features=features, max_images=max_images, topic=topic,
        settings=TrainingSettings(branching=branching, depth=levels, seed=seed),
    )  # fmt: skip
    with Console(verbosity) as console:
        log = RunLog(console)
        document = run(request, Path(output), log=log)
        console.tell(log)
        if not as_json:
            console.say(
                f"{document['words']} words from {document['features']} features of {document['images']} images -> "
                f"{output} ({document['size_bytes'] / 1e6:.2f} MB)"
            )
    if as_json:
        print_json(document, "vocabulary-train")
    return 0


@command.command(short_help="What is in a vocabulary's file.")
@click.argument("source", metavar="FILE", type=click.Path())
@json_option
def info(source: str, as_json: bool) -> int:
    """What is in FILE: ORB-SLAM's ORBvoc.txt (also .tar.gz), DBoW3's .yml(.gz), or slamcli's own.

    A large text is parsed once and then kept in the user's cache folder.
    """
    from slamcli.pipelines.vocabulary import inspect

    document = inspect(Path(source))
    if as_json:
        print_json(document, "vocabulary-info")
    else:
        _print(document)
    return 0


def _print(document: dict[str, Any]) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    low, high = document["weights"]
    for name, value in (
        ("file", f"{document['file']} ({document['size_bytes'] / 1e6:.2f} MB)"),
        ("tree", f"{document['branching']} branches, {document['levels']} levels, {document['nodes']} nodes"),
        ("words", f"{document['words']}, {document['words_without_weight']} of them without weight"),
        ("weights", f"{document['weighting']}, {low:.3g} to {high:.3g}"),
        ("matching", f"{document['matching_nodes']} nodes"),
    ):
        table.add_row(name, value)
    RichConsole(soft_wrap=True).print(table)
