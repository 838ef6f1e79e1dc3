# SPDX-License-Identifier: MIT
"""Options of the database in which a tier keeps its long-term memory."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

_OPTIONS = (
    click.option(
        "--database", metavar="FILE", type=click.Path(path_type=Path),
        help="Long-term memory (rtabmap): gone on from as a new session if it is there.  [default: rtabmap.db in the folder, anew]",
    ),
    click.option("--delete-db-on-start", is_flag=True, help="Begin the database of --database anew."),
)  # fmt: skip


def database_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a command; it gets `database` (`slamcli.pipelines.databases.DatabaseRequest`)."""

    @functools.wraps(function)
    def with_database(**arguments: Any) -> Any:
        from slamcli.pipelines.databases import DatabaseRequest

        database = DatabaseRequest(file=arguments.pop("database"), anew=arguments.pop("delete_db_on_start"))
        return function(database=database, **arguments)

    decorated: Callable[..., Any] = with_database
    for option in reversed(_OPTIONS):
        decorated = option(decorated)
    return decorated


def database_words(database: Any) -> list[str]:
    """Return the options as words of the command that makes the same result again: the file without its folder."""
    words = [] if database.file is None else ["--database", database.file.name]
    return [*words, "--delete-db-on-start"] if database.anew else words
