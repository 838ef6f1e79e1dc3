# SPDX-License-Identifier: MIT
"""Relations files."""

import numpy as np
import pytest

from slamcli.errors import DataError, FormatError
from slamcli.evaluation import Relations
from slamcli.formats.relations import looks_like_relations, read_relations, write_relations


def relations(k=20):
    rng = np.random.default_rng(1)
    first = 976_052_905_167_303_000 + rng.integers(0, 10**11, k)
    return Relations(first, first + rng.integers(1, 10**10, k), rng.normal(size=(k, 3)), rng.normal(size=(k, 3)))


def test_round_trip_is_exact(tmp_path):
    before = relations()
    write_relations(tmp_path / "r.relations", before)
    after = read_relations(tmp_path / "r.relations")
    for name in ("first_ns", "second_ns", "translations_m", "angles_rad"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert looks_like_relations(tmp_path / "r.relations")


def test_a_tum_file_is_not_taken_for_relations(tmp_path):
    (tmp_path / "t.tum").write_text("1 2 0 0 0 0 0 1\n2 1 0 0 0 0 0.6 0.8\n")
    assert not looks_like_relations(tmp_path / "t.tum")
    (tmp_path / "k.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    assert not looks_like_relations(tmp_path / "k.txt")
    (tmp_path / "empty").write_text("")
    assert not looks_like_relations(tmp_path / "empty")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no relations in it"),
        ("1 2 3\n", "line 1: 3 columns, not the 8 of a relation"),
        ("1 2 0 0 0 0 0 inf\n", "line 1: 'inf' is not a finite number"),
        ("1 x 0 0 0 0 0 0\n", "line 1: stamp 'x' is not a number"),
    ],
)
def test_damage_is_one_line(tmp_path, text, message):
    (tmp_path / "r").write_text(text)
    with pytest.raises(FormatError, match=message):
        read_relations(tmp_path / "r")


def test_arrays_that_do_not_fit():
    ok = relations(2)
    with pytest.raises(DataError, match="2 and"):
        Relations(ok.first_ns, ok.second_ns[:1], ok.translations_m, ok.angles_rad)
    with pytest.raises(DataError, match="not finite"):
        Relations(ok.first_ns, ok.second_ns, ok.translations_m * np.nan, ok.angles_rad)
