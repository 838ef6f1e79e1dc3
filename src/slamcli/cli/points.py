# SPDX-License-Identifier: MIT
"""Points on the command line: ``-1.5,2.0`` is a place, not an option."""

from __future__ import annotations

import math
import re

import click

from slamcli.errors import UsageError

_POINT = re.compile(r"[-+]?[\d.][^,\s]*(,[-+]?[\d.][^,\s]*){1,2}")


class PointsCommand(click.Command):
    """A command whose arguments may begin with a minus sign; options stand before, between or after them."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Move points behind ``--``, in their order."""
        cut = args.index("--") if "--" in args else len(args)
        head, tail = args[:cut], args[cut + 1 :]
        points = [a for a in head if _POINT.fullmatch(a)]
        rest = [a for a in head if not _POINT.fullmatch(a)]
        return super().parse_args(ctx, [*rest, "--", *points, *tail] if points or tail else rest)


def parse_point(role: str, text: str) -> tuple[float, ...]:
    """Return x, y or x, y, yaw, in metres and radians; a yaw may be written in degrees, ``90deg``.

    Raises
    ------
    UsageError
        If `text` is anything else, or a yaw of more than a turn that was surely meant in degrees.
    """
    x_y, yaw = text.split(",")[:2], text.split(",")[2:]
    try:
        values = (*map(float, x_y), *(_angle(part) for part in yaw))
    except ValueError as error:
        raise UsageError(f"{role} {text}: write it as X,Y or X,Y,YAW (metres, radians)") from error
    if len(values) not in (2, 3):
        raise UsageError(f"{role} {text}: write it as X,Y or X,Y,YAW (metres, radians)")
    if len(values) == 3 and 2 * math.pi < abs(values[2]) < math.inf:
        raise UsageError(f"{role} {text}: a yaw of {yaw[0]} rad is more than a turn; write {yaw[0]}deg for degrees")
    return values


def _angle(text: str) -> float:
    """Return radians; ``deg`` behind the number says degrees."""
    return math.radians(float(text[:-3])) if text.endswith("deg") else float(text)
