# SPDX-License-Identifier: MIT
"""Closures that were tried, as CSV: one line each, accepted or not, with why not."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from pathlib import Path

from slamcli.errors import FormatError
from slamcli.formats.text_tables import format_stamp_s, parse_stamps_ns
from slamcli.posegraph.place_closure import PlaceClosure

COLUMNS = (
    "stamp_s", "older_stamp_s", "node", "older_node", "kind", "accepted", "posterior", "matches", "inliers", "strain", "reason",
)  # fmt: skip


def write_closures(path: str | os.PathLike[str], closures: Sequence[PlaceClosure]) -> None:
    """Write closures in their order; stamps of landmarks, which have none, are empty."""
    with Path(path).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for one in closures:
            older = "" if one.older_stamp_ns is None else format_stamp_s(one.older_stamp_ns)
            writer.writerow((
                format_stamp_s(one.stamp_ns), older, one.node, one.older_node, one.kind, int(one.accepted),
                f"{one.posterior:.9g}", one.num_matches, one.num_inliers, f"{one.strain:.9g}", one.reason,
            ))  # fmt: skip


def read_closures(path: str | os.PathLike[str]) -> tuple[PlaceClosure, ...]:
    """Return the closures of a file that `write_closures` wrote; other columns are passed over.

    Raises
    ------
    FormatError
        If a column is missing, or a line does not hold what it should.
    """
    try:
        with Path(path).open(encoding="utf-8", newline="") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise FormatError(f"{path}: no table of closures: the column {missing[0]!r} is missing")
            return tuple(_closure(row, path, reader.line_num) for row in reader)
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise FormatError(f"{path}: cannot be read as a table of closures: {problem}") from problem


def _closure(row: dict[str, str], path: str | os.PathLike[str], line: int) -> PlaceClosure:
    try:
        written = [text for text in (row["stamp_s"], row["older_stamp_s"] or None) if text is not None]
        stamps = parse_stamps_ns(written, [line] * len(written), path, "s")
        return PlaceClosure(
            stamp_ns=stamps[0], older_stamp_ns=stamps[1] if len(stamps) > 1 else None,
            node=int(row["node"]), older_node=int(row["older_node"]), kind=row["kind"], accepted=bool(int(row["accepted"])),
            reason=row["reason"], posterior=float(row["posterior"]), num_matches=int(row["matches"]),
            num_inliers=int(row["inliers"]), strain=float(row["strain"]),
        )  # fmt: skip
    except (TypeError, ValueError) as problem:
        raise FormatError(f"{path}, line {line}: no closure: {problem}") from problem
