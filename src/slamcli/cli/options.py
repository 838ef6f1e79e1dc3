# SPDX-License-Identifier: MIT
"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
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
