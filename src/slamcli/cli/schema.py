# SPDX-License-Identifier: MIT
"""``slamcli schema``: the JSON Schemas of what slamcli writes, and a check against them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from slamcli.errors import FormatError, UsageError


@click.command()
@click.argument("name", required=False)
@click.option(
    "--validate", "documents", multiple=True, type=click.Path(path_type=Path), metavar="FILE",
    help="Check a document against the schema that it names, or against NAME; `-` is stdin; repeatable.",
)  # fmt: skip
def command(name: str | None, documents: tuple[Path, ...]) -> int:
    """List the schemas of run.json and of every --json document, print the one called NAME, or check documents.

    \b
    slamcli schema
    slamcli schema run > run.schema.json
    slamcli schema --validate intel/run.json
    slamcli info intel.mcap --json | slamcli schema --validate -

    NAME is run, run.1 or slamcli.run.1; without a version it is the newest. Exit codes: 0 done, 1 a document leaves its schema, 2 wrong
    usage, or not a JSON document.
    """  # noqa: D301 - click needs the backspace itself
    from slamcli.pipelines.schemas import find_schema, load_schema, schema_names, schema_text

    wanted = None if name is None else find_schema(name)
    if documents:
        wrong = sum(not _is_valid(document, name) for document in documents)
        return 1 if wrong else 0
    if wanted is not None:
        click.echo(schema_text(wanted), nl=False)
        return 0
    rows = [(schema.stamp, load_schema(schema)["title"]) for schema in schema_names()]
    width = max(len(stamp) for stamp, _ in rows)
    click.echo("\n".join(f"{stamp:{width}}  {title}" for stamp, title in rows))
    return 0


def _is_valid(path: Path, name: str | None) -> bool:
    """Say in one line whether a document keeps to its schema."""
    from slamcli.pipelines.schemas import find_schema, first_deviation, schema_of

    document = _read(path)
    try:
        schema = schema_of(document) if name is None else find_schema(name)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    deviation = first_deviation(document, schema)
    click.echo(f"{path}: {schema.stamp}" if deviation is None else f"{path}: not {schema.stamp}: {deviation}")
    return deviation is None


def _read(path: Path) -> Any:
    """Return a JSON document.

    Raises
    ------
    FormatError
        If it cannot be read, or is not JSON: NaN and Infinity are not.
    """
    import json
    import sys

    def refuse(word: str) -> None:
        raise ValueError(f"{word} is not JSON")

    try:
        data = sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
        return json.loads(data, parse_constant=refuse)
    except OSError as error:
        raise FormatError(f"{path}: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: not a JSON document: {error or 'nested too deep'}") from error
