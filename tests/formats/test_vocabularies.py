# SPDX-License-Identifier: MIT
"""Vocabularies: three kinds of files give the same tree, the cache spares parsing, damage is one line."""

from __future__ import annotations

import gzip
import io
import os
import tarfile
import time
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.formats.vocabularies import load_vocabulary, read_vocabulary, write_vocabulary
from slamcli.formats.vocabularies import reading as module
from slamcli.vision.vocabulary import vocabulary

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
DBOW3 = DATA / "visual" / "dbow3_small_vocabulary.yml.gz"


def small_tree():
    generator = np.random.default_rng(0)
    num_children = np.array([3, 2, 0, 3, 0, 0, 0, 0, 0])
    return vocabulary(
        branching=3, depth=2, weighting="tf-idf", descriptors=generator.integers(0, 256, (9, 32), np.uint8),
        num_children=num_children, weights=np.round(generator.random(9) * 5, 3),
    )  # fmt: skip


# As DBoW2 numbers nodes: the children of the root, then those of each child in turn.
PARENTS = (0, 0, 0, 1, 1, 3, 3, 3)


def as_text(tree):
    lines = ["3 2 0 0"]
    for node, parent in enumerate(PARENTS, 1):
        bytes_ = " ".join(str(value) for value in tree.descriptors[node])
        lines.append(f"{parent} {int(tree.num_children[node] == 0)} {bytes_}  {tree.weights[node]:g}")
    return ("\n".join(lines) + "\n").encode()


def as_yaml(tree, prefix="0 32 "):
    lines = ["%YAML:1.0", "vocabulary:", "   k: 3", "   L: 2", "   scoringType: 0", "   weightingType: 0", "   nodes:"]
    for node, parent in enumerate(PARENTS, 1):
        bytes_ = " ".join(str(value) for value in tree.descriptors[node])
        lines.append(f"      - {{ nodeId:{node}, parentId:{parent}, weight:{tree.weights[node]:g},")
        lines.append(f'          descriptor:"{prefix}{bytes_} " }}')
    lines.append("   words:")
    leaves = [node for node in range(1, 9) if tree.num_children[node] == 0]
    lines += [f"      - {{ wordId:{word}, nodeId:{node} }}" for word, node in enumerate(leaves)]
    return ("\n".join(lines) + "\n").encode()


def as_archive(data, name="Vocabulary/ORBvoc.txt"):
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w:gz") as archive:
        for member, content in (("Vocabulary/._ORBvoc.txt", b"resource fork"), ("Vocabulary/README", b"hello"), (name, data)):  # fmt: skip
            entry = tarfile.TarInfo(member)
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return stream.getvalue()


def assert_same(one, other):
    assert (one.branching, one.depth, one.weighting) == (other.branching, other.depth, other.weighting)
    assert np.array_equal(one.num_children, other.num_children)
    assert np.array_equal(one.descriptors[1:], other.descriptors[1:])
    assert np.array_equal(one.weights, other.weights)


@pytest.mark.parametrize(
    ("name", "pack"),
    [
        ("ORBvoc.txt", as_text),
        ("ORBvoc.txt.gz", lambda tree: gzip.compress(as_text(tree))),
        ("ORBvoc.txt.tar.gz", lambda tree: as_archive(as_text(tree))),
        ("blank-lines.txt", lambda tree: as_text(tree) + b"\n\n"),
        ("dbow3.yml", as_yaml),
        ("dbow3.yml.gz", lambda tree: gzip.compress(as_yaml(tree))),
        ("dbow3-new.yml", lambda tree: as_yaml(tree, "dbw3 0 32 ")),
        ("dbow2.yml", lambda tree: as_yaml(tree, "").replace(b"nodeId:", b"nodeId: ")),
    ],
)
def test_every_kind_of_file_gives_the_tree(tmp_path, name, pack):
    tree = small_tree()
    (tmp_path / name).write_bytes(pack(tree))
    assert_same(read_vocabulary(tmp_path / name), tree)


def test_own_files_come_back_and_have_the_same_bytes(tmp_path):
    tree = small_tree()
    for name, compress in (("a.npz", True), ("b.npz", True), ("c.npz", False)):
        write_vocabulary(tree, tmp_path / name, compress=compress)
        assert_same(read_vocabulary(tmp_path / name), tree)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text[:-1], "the last line does not end: the file is cut"),
        (lambda text: text[:700], "the last line does not end"),
        (lambda text: b"\n".join(text.split(b"\n")[:5]) + b"\n", "node 3 is no word, yet without nodes below it"),
        (lambda text: b"\n".join(text.split(b"\n")[:1]) + b"\n", "there is no node in it"),
        (lambda text: text.replace(b"0 1 ", b"0 0 ", 1), "node 2 is no word"),
        (lambda text: text.replace(b"\n1 1 ", b"\n2 1 ", 1), "node 2 is a word with nodes below it"),
        (lambda text: text.replace(b"\n3 1 ", b"\n3 2 ", 1), "line 7 is no node"),
        (lambda text: text.replace(b"\n3 1 ", b"\n3 1 7 ", 1), "line 7 is no node"),
        (lambda text: text.replace(b"\n3 1 ", b"\n3 x ", 1), "line 7 is no node"),
        (lambda text: text.replace(b"\n3 1 ", b"\n99 1 ", 1), "parent does not exist"),
        (lambda text: text.replace(b"\n3 1 ", b"\n6 1 ", 1), "do not hang together"),
        (lambda text: text.replace(b"3 2 0 0", b"3 2 4 0"), "scoring 4 is not read"),
        (lambda text: text.replace(b"3 2 0 0", b"3 0 0 0"), "3 branches, 0 levels"),
        (lambda text: text.replace(b"3 2 0 0", b"2 2 0 0"), "3 children and 2 levels where 2 and 2"),
        (lambda text: b"three 2 0 0" + text[7:], "no vocabulary: expected DBoW2's text"),
        (lambda text: b"", "no vocabulary"),
        (lambda text: gzip.compress(text)[:-20], "cut or damaged"),
        (lambda text: gzip.compress(as_archive(text)[:40]), "cut or damaged|no vocabulary"),
        (lambda text: gzip.compress(gzip.decompress(as_archive(text))[:3000]), "cut or damaged"),
    ],
)
def test_damaged_text_is_one_line(tmp_path, damage, message):
    path = tmp_path / "ORBvoc.txt"
    path.write_bytes(damage(as_text(small_tree())))
    with pytest.raises(FormatError, match=message) as caught:
        read_vocabulary(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text[:900], "of 5 nodes are not written|nodes are not written"),
        (lambda text: text[: text.index(b"   words:")], "but 0 words are listed: the file is cut"),
        (lambda text: text[:-10], "but 5 words are listed"),
        (lambda text: text.replace(b"k: 3", b"q: 3"), "k is missing"),
        (lambda text: text.replace(b"nodeId:4,", b"nodeId:44,", 1), "not numbered from 1 to 8"),
        (lambda text: text.replace(b'"0 32 ', b'"0 31 ', 1), "the descriptor of node 1 is not 32 bytes"),
        (lambda text: text.replace(b'"0 32 ', b'"5 64 ', 1), "only vocabularies of ORB"),
        (lambda text: text.replace(b"weight:0,", b"weight:-,", 1), "weight of a node is not a number"),
    ],
)
def test_damaged_yaml_is_one_line(tmp_path, damage, message):
    path = tmp_path / "voc.yml"
    path.write_bytes(damage(as_yaml(small_tree())))
    with pytest.raises(FormatError, match=message):
        read_vocabulary(path)


def test_own_files_that_are_damaged_are_one_line(tmp_path):
    write_vocabulary(small_tree(), tmp_path / "good.npz")
    good = (tmp_path / "good.npz").read_bytes()
    generator = np.random.default_rng(1)
    path = tmp_path / "bad.npz"
    for cut in generator.integers(2, len(good), 30):
        path.write_bytes(good[:cut])
        with pytest.raises(FormatError, match=r"bad\.npz: "):
            read_vocabulary(path)
    np.savez(path, kind=np.array("slamcli vocabulary 9"))
    with pytest.raises(FormatError, match="'slamcli vocabulary 9' is not read"):
        read_vocabulary(path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(FormatError, match="no vocabulary"):
        read_vocabulary(path)
    with pytest.raises(FormatError, match="cannot be read"):
        read_vocabulary(tmp_path / "nowhere.txt")
    with pytest.raises(FormatError, match="cannot be read"):
        read_vocabulary(tmp_path)


def test_what_took_long_is_kept_by_content(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_CACHED_FROM", 0)
    path, cache, tree = tmp_path / "voc.txt", tmp_path / "cache", small_tree()
    path.write_bytes(as_text(tree))
    assert_same(read_vocabulary(path, cache=cache), tree)
    (kept,) = cache.iterdir()
    monkeypatch.setattr(module, "parse_text_vocabulary", None)  # parsing again would fail
    assert_same(read_vocabulary(path, cache=cache), tree)
    monkeypatch.undo()
    monkeypatch.setattr(module, "_CACHED_FROM", 0)
    kept.write_bytes(kept.read_bytes()[:100])
    assert_same(read_vocabulary(path, cache=cache), tree)  # made anew
    assert kept.stat().st_size > 100
    path.write_bytes(as_text(tree).replace(b"3 2 0 0", b"3 3 0 0"))
    assert read_vocabulary(path, cache=cache).depth == 3
    assert len(list(cache.iterdir())) == 2


def test_a_cache_that_cannot_be_written_is_none(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_CACHED_FROM", 0)
    (tmp_path / "voc.txt").write_bytes(as_text(small_tree()))
    (tmp_path / "file").write_text("not a folder")
    assert_same(read_vocabulary(tmp_path / "voc.txt", cache=tmp_path / "file"), small_tree())


def full_size(path, levels):
    """Write a text of 10 branches and return the number of its words."""
    generator = np.random.default_rng(0)
    counts = 10 ** np.arange(levels + 1)
    parents = np.concatenate([(counts[level - 1] - 1) // 9 + np.arange(counts[level]) // 10 for level in range(1, levels + 1)])  # fmt: skip
    leaf = np.arange(len(parents)) >= len(parents) - counts[levels]
    table = np.column_stack([parents, leaf, generator.integers(0, 256, (len(parents), 32)), np.where(leaf, 1.5, 0)])
    with path.open("wb") as stream:
        stream.write(f"10 {levels} 0 0\n".encode())
        np.savetxt(stream, table, fmt="%d " * 34 + "%g")
    return int(counts[levels])


def test_a_large_vocabulary_loads_from_the_cache_in_a_fraction_of_the_time(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_CACHED_FROM", 1 << 20)
    words = full_size(tmp_path / "large.txt", 4)  # benchmarks/vocabularies.py does this at the size of ORBvoc.txt
    start = time.perf_counter()
    parsed = read_vocabulary(tmp_path / "large.txt", cache=tmp_path / "cache")
    between = time.perf_counter()
    loaded = read_vocabulary(tmp_path / "large.txt", cache=tmp_path / "cache")
    end = time.perf_counter()
    assert parsed.num_words == loaded.num_words == words
    assert np.array_equal(parsed.descriptors, loaded.descriptors)
    assert end - between < between - start


def test_without_a_file_there_is_one():
    assert load_vocabulary().num_words > 5000


@pytest.mark.real_data
@pytest.mark.skipif(not DBOW3.exists(), reason=f"no {DBOW3}: set SLAMCLI_TEST_DATA")
def test_the_small_vocabulary_of_dbow3_is_read():
    tree = read_vocabulary(DBOW3)
    assert (tree.branching, tree.depth, tree.num_words, len(tree.levels)) == (10, 5, 4983, 6163)
    assert tree.descriptors[1, :5].tolist() == [27, 159, 99, 205, 118]
    assert tree.weights.max() == pytest.approx(np.log(10))
