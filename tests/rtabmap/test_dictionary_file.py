# SPDX-License-Identifier: MIT
"""Dictionaries made beforehand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.dictionary import Dictionary, DictionarySettings
from slamcli.rtabmap.dictionary_file import read_dictionary

WORDS = np.random.default_rng(0).integers(0, 256, (5, 32), dtype=np.uint8)
IDS = np.array([3, 4, 7, 8, 20])


def written(path: Path, header: str, rows: list[list[float]]) -> Path:
    path.write_text("\n".join([header, *(" ".join(f"{v:g}" for v in row) + " " for row in rows)]) + "\n")
    return path


def test_bytes_and_bits(tmp_path: Path):
    by_bytes = written(
        tmp_path / "a.txt", "WordID Descriptors...32", [[i, *w] for i, w in zip(IDS, WORDS, strict=True)]
    )
    bits = np.unpackbits(WORDS, axis=1, bitorder="little")
    by_bits = written(tmp_path / "b.txt", "WordID Descriptors...256", [[i, *w] for i, w in zip(IDS, bits, strict=True)])
    for path in (by_bytes, by_bits):
        ids, words = read_dictionary(path)
        assert ids.tolist() == IDS.tolist()
        assert words.tolist() == WORDS.tolist()
    dictionary = Dictionary(DictionarySettings(incremental=False))
    dictionary.add_words(ids, words)
    assert dictionary.quantise(WORDS[::-1].copy()).tolist() == IDS[::-1].tolist()


def test_of_a_database(tmp_path: Path):
    with Database.create(tmp_path / "words.db", "") as database:
        database.add_words(IDS, WORDS)
    ids, words = read_dictionary(tmp_path / "words.db")
    assert ids.tolist() == IDS.tolist()
    assert words.tolist() == WORDS.tolist()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1 says 0 numbers"),
        ("WordID Descriptors...64\n1 0.5", "line 1 says 64 numbers"),
        ("WordID Descriptors...32\n", "no words with descriptors of 256 bits"),
        ("WordID Descriptors...32\n1 2 3\n", "line 2 is not a word's number and 32 whole numbers from 0 to 255"),
        ("WordID Descriptors...32\n1" + " 7" * 31 + " 300\n", "line 2 is not"),
        ("WordID Descriptors...32\n1" + " 0.5" * 32 + "\n", "line 2 is not"),
        ("WordID Descriptors...32\n1" + " x" * 32 + "\n", "line 2 is not"),
        ("WordID Descriptors...32\n0" + " 1" * 32 + "\n", "line 2 is not"),
        ("WordID Descriptors...32\n" + ("1" + " 1" * 32 + "\n") * 2, "there twice"),
        ("\xff", "neither a .db nor text"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, message: str):
    path = tmp_path / "words.txt"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError, match=message):
        read_dictionary(path)


def test_no_file(tmp_path: Path):
    with pytest.raises(ConfigError, match="there is no file"):
        read_dictionary(tmp_path / "none.txt")
