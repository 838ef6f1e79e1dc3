# SPDX-License-Identifier: MIT
"""slamcli's own file of a vocabulary: NumPy's ``.npz`` with the nodes in breadth-first order."""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from pathlib import Path

import numpy as np

from slamcli.errors import DataError, FormatError
from slamcli.outputs import atomic_file
from slamcli.vision.vocabulary import WEIGHTINGS, Vocabulary, vocabulary

VERSION = 1
_KIND = "slamcli vocabulary"


def write_vocabulary(tree: Vocabulary, target: str | os.PathLike[str], *, compress: bool = True) -> None:
    """Write a vocabulary; the same one gives the same bytes. Not compressed it loads faster.

    Raises
    ------
    UsageError
        If `target` cannot be written to.
    """
    save = np.savez_compressed if compress else np.savez
    with atomic_file(target, "wb") as stream:
        save(
            stream, kind=np.array(f"{_KIND} {VERSION}"),
            shape=np.array([tree.branching, tree.depth, WEIGHTINGS.index(tree.weighting)]),
            num_children=tree.num_children.astype(np.uint16), weights=tree.weights, descriptors=tree.descriptors,
        )  # fmt: skip


def is_own_vocabulary(data: bytes) -> bool:
    """Whether a file begins as ``.npz`` files do."""
    return data.startswith(b"PK")


def parse_own_vocabulary(data: bytes, path: Path) -> Vocabulary:
    """Return the vocabulary in slamcli's own file.

    Raises
    ------
    FormatError
        If the file is damaged, or of another kind or version.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as columns:
            kind = str(columns["kind"])
            if kind == f"{_KIND} {VERSION}":
                branching, depth, weighting = (int(value) for value in columns["shape"])
                return vocabulary(
                    branching=branching, depth=depth, weighting=WEIGHTINGS[weighting], weights=columns["weights"],
                    descriptors=columns["descriptors"], num_children=columns["num_children"],
                )  # fmt: skip
    except KeyError as error:
        raise FormatError(f"{path}: no vocabulary: {error.args[0]}") from error
    except (zipfile.BadZipFile, zlib.error, ValueError, IndexError, TypeError, EOFError, OSError, MemoryError, RuntimeError, DataError) as error:  # fmt: skip
        raise FormatError(f"{path}: this vocabulary is damaged: {error}") from error
    raise FormatError(f"{path}: {kind[:60]!r} is not read; this slamcli reads '{_KIND} {VERSION}'")
