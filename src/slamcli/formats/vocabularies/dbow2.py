# SPDX-License-Identifier: MIT
"""The text format of DBoW2 as ORB-SLAM has it (``ORBvoc.txt``).

The first line is ``branching levels scoring weighting``; every other line is a node below the root: number of the parent, 1
for a word, 32 bytes, weight. Nodes are numbered as their lines follow each other, from 1; the root, 0, has no line.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import DataError, FormatError
from slamcli.vision.vocabulary import WEIGHTINGS, Vocabulary, breadth_first, vocabulary

_COLUMNS = 35
_CHUNK = 1 << 22


def is_text_vocabulary(data: bytes) -> bool:
    """Whether the first line is such a file's: four whole numbers."""
    words = data[:200].partition(b"\n")[0].split()
    return len(words) == 4 and all(word.isdigit() and len(word) < 4 for word in words)


def parse_text_vocabulary(data: bytes, path: Path) -> Vocabulary:
    """Return the vocabulary in a text file.

    Raises
    ------
    FormatError
        If a line is wrong, or the file is cut.
    """
    header, _, _ = data.partition(b"\n")
    branching, depth, scoring, weighting = (int(word) for word in header.split())
    check_header(branching, depth, scoring, weighting, path)
    root = (np.zeros(1, np.int64), np.zeros(1, np.bool_), np.zeros((1, 32), np.uint8), np.zeros(1))
    columns = zip(root, *_columns(data, len(header) + 1, path), strict=True)
    parents, is_word, descriptors, weights = (np.concatenate(parts) for parts in columns)
    return assembled(path, branching, depth, weighting, parents, descriptors, weights, is_word)


def check_header(branching: int, depth: int, scoring: int, weighting: int, path: Path) -> None:
    """Raise if the numbers that a vocabulary begins with are out of range, or ask for a score other than L1.

    Raises
    ------
    FormatError
        With the number that is wrong.
    """
    if not (2 <= branching <= 256 and 1 <= depth <= 10 and weighting < len(WEIGHTINGS)):
        raise FormatError(
            f"{path}: a vocabulary of {branching} branches, {depth} levels and weighting {weighting} (2 to 256, 1 to 10, 0 to 3)"
        )
    if scoring != 0:
        raise FormatError(f"{path}: scoring {scoring} is not read; ORB-SLAM's vocabularies have 0 (L1)")


def assembled(
    path: Path, branching: int, depth: int, weighting: int, parents: NDArray[np.int64], descriptors: NDArray[np.uint8],
    weights: NDArray[np.float64], is_word: NDArray[np.bool_] | None,
) -> Vocabulary:  # fmt: skip
    """Return the vocabulary of nodes in any order, the root first: parents (M,), descriptors (M, 32), weights (M,).

    Raises
    ------
    FormatError
        If they are no tree, or `is_word` (M,), where it is given, says otherwise of some node.
    """
    try:
        nodes, num_children = breadth_first(parents)
        if is_word is not None and not np.array_equal(num_children == 0, is_word[nodes]):
            wrong = int(nodes[(num_children == 0) != is_word[nodes]].min())
            raise FormatError(
                f"{path}: node {wrong} is {'a word with' if is_word[wrong] else 'no word, yet without'} nodes below it: the file is cut or damaged"
            )
        return vocabulary(
            branching=branching, depth=depth, weighting=WEIGHTINGS[weighting], descriptors=descriptors[nodes],
            num_children=num_children, weights=weights[nodes],
        )  # fmt: skip
    except DataError as error:
        raise FormatError(f"{path}: {error}") from error


def _columns(data: bytes, begin: int, path: Path) -> list[tuple[NDArray[Any], ...]]:
    """Return parents, whether a node is a word, bytes (N, 32) and weights of piece after piece of the lines."""
    if not data.endswith(b"\n"):
        raise FormatError(f"{path}: the last line does not end: the file is cut")
    pieces: list[tuple[NDArray[Any], ...]] = []
    line = 2
    while begin < len(data):
        end = data.find(b"\n", min(begin + _CHUNK, len(data) - 1)) + 1
        table = _rows(data[begin:end], line, path)
        pieces.append(
            (table[:, 0].astype(np.int64), table[:, 1] == 1.0, table[:, 2:34].astype(np.uint8), table[:, 34].copy())
        )
        line += data.count(b"\n", begin, end)
        begin = end
    if not any(len(parents) for parents, *_ in pieces):
        raise FormatError(f"{path}: there is no node in it: the file is cut")
    return pieces


def _rows(chunk: bytes, line: int, path: Path) -> NDArray[np.float64]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # numpy stops at what is no number, and says so in a warning
        try:
            values = np.fromstring(chunk.decode("ascii"), sep=" ")
        except (ValueError, Warning):
            values = np.zeros(0)
    lines = chunk.count(b"\n")
    if len(values) == lines * _COLUMNS:
        table = values.reshape(lines, _COLUMNS)
        good = (table[:, :34] == np.floor(table[:, :34])).all(axis=1) & (table[:, :34] >= 0).all(axis=1)
        good &= (table[:, 1] <= 1) & (table[:, 2:34] <= 255).all(axis=1) & np.isfinite(table[:, 34])
        if good.all():
            return table
        raise FormatError(
            f"{path}: line {line + int(np.argmin(good))} is no node: a parent, 0 or 1, 32 bytes and a weight"
        )
    rows = chunk.rstrip().split(b"\n")
    wrong = next((i for i, row in enumerate(rows) if not _is_numbers(row)), None)
    if wrong is None:  # empty lines between or after the nodes
        return _rows(b"".join(row + b"\n" for row in rows if row.strip()), line, path)
    raise FormatError(f"{path}: line {line + wrong} is no node: a parent, 0 or 1, 32 bytes and a weight")


def _is_numbers(row: bytes) -> bool:
    """Whether a line has the numbers of a node, or none."""
    words = row.split()
    try:
        return len([float(word) for word in words]) in (0, _COLUMNS)
    except ValueError:
        return False
