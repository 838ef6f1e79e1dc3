# SPDX-License-Identifier: MIT
"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def verbosity_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``-v`` and ``-q``; the command gets `verbosity` (-1 quiet, 0, 1 verbose)."""
    function = click.option("-v", "--verbose", "verbosity", flag_value=1, type=int, help="Say more.")(function)
    return click.option(
        "-q", "--quiet", "verbosity", flag_value=-1, type=int, default=0, help="Say only warnings and errors."
    )(function)


json_option: Decorator = click.option("--json", "as_json", is_flag=True, help="Print one JSON document to stdout.")
seed_option: Decorator = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of every random draw."
)
jobs_option: Decorator = click.option(
    "--jobs",
    type=click.IntRange(min=0),
    default=0,
    show_default="all cores",
    help="Threads; results do not depend on it.",
)


def threshold_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--max`` and ``--min``; the command gets `upper` and `lower`, for `slamcli.cli.verdicts.Verdicts`."""
    function = click.option(
        "--min", "lower", multiple=True, metavar="KEY=VALUE",
        help="Fail (exit 1) if a figure is smaller; repeatable. A wrong KEY lists the figures.",
    )(function)  # fmt: skip
    return click.option(
        "--max", "upper", multiple=True, metavar="KEY=VALUE",
        help="Fail (exit 1) if a figure is larger; repeatable. A wrong KEY lists the figures.",
    )(function)  # fmt: skip


junit_option: Decorator = click.option(
    "--junit",
    type=click.Path(path_type=Path),
    metavar="FILE.xml",
    help="Write the verdicts as JUnit XML: a test case per threshold, an error where the command fails.",
)
