# SPDX-License-Identifier: MIT
"""Dictionaries that were made beforehand (`Kp/DictionaryPath`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.rtabmap.database import Database

Words = tuple[NDArray[np.int64], NDArray[np.uint8]]

_BYTES, _BITS = 32, 256


def read_dictionary(path: Path | str) -> Words:
    """Return the numbers int64 (W,) and descriptors uint8 (W, 32) of a dictionary's words.

    Parameters
    ----------
    path
        A database (``.db``), or a text file as RTAB-Map's: a line with the length of a descriptor, ``WordID Descriptors...32``, then
        for each word its number and its descriptor, as 32 bytes 0 to 255, or as 256 bits with the lowest of each byte first.

    Raises
    ------
    ConfigError
        If there is no such file, or it holds something else: SURF and SIFT descriptors are not binary.
    FormatError
        If it is a database that cannot be read.
    """
    file = Path(path)
    if not file.is_file():
        raise ConfigError(f"Kp/DictionaryPath: there is no file {file}")
    if file.suffix == ".db":
        with Database.read(file) as database:
            words = database.words()
    else:
        words = _read_text(file)
    if not len(words[0]) or words[1].shape[1] != _BYTES:
        raise ConfigError(f"Kp/DictionaryPath: no words with descriptors of 256 bits in {file}")
    return words


def _read_text(file: Path) -> Words:
    try:
        lines = file.read_text(encoding="ascii").splitlines()
    except UnicodeDecodeError as error:
        raise ConfigError(f"Kp/DictionaryPath: neither a .db nor text: {file}") from error
    digits = "".join(mark if mark.isdigit() else " " for mark in (lines[0] if lines else "")).split()
    length = int(digits[0]) if digits else 0
    if length not in (_BYTES, _BITS):
        raise ConfigError(
            f"Kp/DictionaryPath: line 1 says {length} numbers a descriptor; binary ones have 32 bytes or 256 bits: {file}"
        )
    most = 255 if length == _BYTES else 1
    ids, rows = [], []
    for number, line in enumerate(lines[1:], 2):
        if not line.strip():
            continue
        try:
            values = [float(word) for word in line.split()]
        except ValueError:
            values = []
        if len(values) != length + 1 or values[0] < 1 or not all(v.is_integer() and 0 <= v <= most for v in values[1:]):
            raise ConfigError(
                f"Kp/DictionaryPath: line {number} is not a word's number and {length} whole numbers from 0 to {most}: {file}"
            )
        ids.append(int(values[0]))
        rows.append(values[1:])
    if len(set(ids)) < len(ids):
        raise ConfigError(f"Kp/DictionaryPath: a word's number is there twice: {file}")
    table = np.array(rows, np.uint8).reshape(-1, length)
    if length == _BITS:
        table = np.packbits(table, axis=1, bitorder="little")
    return np.array(ids, np.int64), table
