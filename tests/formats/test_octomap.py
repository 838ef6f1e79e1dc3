# SPDX-License-Identifier: MIT
"""Octrees in OctoMap's files, read by a naive reader, by our own, and by OctoMap itself where it is installed."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from slamcli.errors import FormatError, UsageError
from slamcli.formats.octomap import read_octomap, write_octomap
from slamcli.grids.octree import Octree


def tree_of(cells, log_odds, resolution=0.05):
    cells = np.asarray(cells, dtype=np.int64).reshape(-1, 3)
    order = np.lexsort(cells.T[::-1])
    return Octree(
        resolution_m=resolution, indices=cells[order], edges=np.ones(len(cells), np.int64),
        log_odds=np.asarray(log_odds, dtype=np.float32)[order], ground=np.zeros(len(cells), bool),
    )  # fmt: skip


def some_tree(seed=0):
    rng = np.random.default_rng(seed)
    block = np.argwhere(np.ones((4, 4, 4))) + np.array([8, -16, 4])
    cells = np.unique(np.concatenate([rng.integers(-40, 40, (300, 3)), rng.integers(-3, 3, (80, 3)), block]), axis=0)
    odds = rng.choice([-2.0, -0.4, 0.85, 3.5], len(cells))
    odds[(cells >= [8, -16, 4]).all(axis=1) & (cells < [12, -12, 8]).all(axis=1)] = -2.0
    return tree_of(cells, odds)


def naive_full(data):
    """Read .ot by recursion: smallest cells with their log odds, and the number of nodes."""
    body = data[data.index(b"data\n") + 5 :]
    cells, count = {}, 0

    def node(at, x, y, z, edge):
        nonlocal count
        count += 1
        (value,), mask = struct.unpack_from("<f", body, at), body[at + 4]
        at += 5
        if mask == 0:
            for i in range(edge):
                for j in range(edge):
                    for k in range(edge):
                        cells[x + i - 32768, y + j - 32768, z + k - 32768] = value
        highest = []
        for child in range(8):
            if mask >> child & 1:
                h = edge // 2
                highest.append(struct.unpack_from("<f", body, at)[0])
                at = node(at, x + h * (child & 1), y + h * (child >> 1 & 1), z + h * (child >> 2 & 1), h)
        assert not highest or max(highest) == value
        return at

    assert node(0, 0, 0, 0, 65536) == len(body)
    return cells, count


def cells_of(tree):
    found = {}
    for index, edge, value in zip(tree.indices.tolist(), tree.edges.tolist(), tree.log_odds.tolist(), strict=True):
        for i in range(edge):
            for j in range(edge):
                for k in range(edge):
                    found[index[0] + i, index[1] + j, index[2] + k] = value
    return found


def test_one_cell_by_hand(tmp_path):
    write_octomap(tmp_path / "one.bt", tree_of([[0, 0, 0]], [1.0], resolution=0.1))
    data = (tmp_path / "one.bt").read_bytes()
    header, body = data.split(b"data\n")
    assert header.decode().splitlines() == [
        "# Octomap OcTree binary file",
        "# (feel free to add / change comments, but leave the first line as it is!)", "#", "id OcTree", "size 17", "res 0.1",
    ]  # fmt: skip
    # The root's child 7 has children; then child 0 fifteen times, occupied at last.
    assert body == bytes([0, 0b11000000]) + bytes([0b11, 0]) * 14 + bytes([0b10, 0])


def test_eight_equal_cells_become_one(tmp_path):
    cells = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    write_octomap(tmp_path / "a.ot", tree_of(cells, [0.5] * 8))
    _, count = naive_full((tmp_path / "a.ot").read_bytes())
    assert count == 16
    assert b"\nsize 16\n" in (tmp_path / "a.ot").read_bytes()
    tree = read_octomap(tmp_path / "a.ot")
    assert (tree.indices.tolist(), tree.edges.tolist(), tree.log_odds.tolist()) == ([[0, 0, 0]], [2], [0.5])


@pytest.mark.parametrize("seed", range(3))
def test_all_cells_come_back(tmp_path, seed):
    tree = some_tree(seed)
    write_octomap(tmp_path / "a.ot", tree)
    write_octomap(tmp_path / "a.bt", tree)
    expected = cells_of(tree)
    cells, count = naive_full((tmp_path / "a.ot").read_bytes())
    assert cells == expected
    assert f"\nsize {count}\n".encode() in (tmp_path / "a.ot").read_bytes()
    full, binary = read_octomap(tmp_path / "a.ot"), read_octomap(tmp_path / "a.bt")
    assert cells_of(full) == expected
    assert full.edges.max() >= 4
    assert {cell: value >= 0 for cell, value in cells_of(binary).items()} == {
        cell: v >= 0 for cell, v in expected.items()
    }
    assert binary.resolution_m == 0.05
    # What was read can be written again: the same bytes.
    for suffix, read in ((".ot", full), (".bt", binary)):
        write_octomap(tmp_path / f"b{suffix}", read)
        assert (tmp_path / f"b{suffix}").read_bytes() == (tmp_path / f"a{suffix}").read_bytes()


def test_octomap_itself_reads_them(tmp_path):
    pyoctomap = pytest.importorskip("pyoctomap", reason="pyoctomap is not installed: OctoMap's own reader is not asked")
    tree = some_tree()
    for name in ("a.bt", "a.ot"):
        write_octomap(tmp_path / name, tree)
    binary = pyoctomap.OcTree(0.05)
    assert binary.readBinary(str(tmp_path / "a.bt"))
    for read in (binary, pyoctomap.OcTree(0.1).read(str(tmp_path / "a.ot"))):
        for cell, value in cells_of(tree).items():
            found = read.search([(c + 0.5) * 0.05 for c in cell])
            assert found is not None
            assert read.isNodeOccupied(found) == (value >= 0)


def test_an_empty_tree_and_one_out_of_reach(tmp_path):
    write_octomap(tmp_path / "a.bt", tree_of([], []))
    assert (tmp_path / "a.bt").read_bytes().endswith(b"size 0\nres 0.05\ndata\n")
    assert len(read_octomap(tmp_path / "a.bt")) == 0
    write_octomap(tmp_path / "b.bt", tree_of([[0, 0, 0], [32767, 0, 0], [32768, 0, 0], [0, 0, -40000]], [1.0] * 4))
    assert read_octomap(tmp_path / "b.bt").indices.tolist() == [[0, 0, 0], [32767, 0, 0]]


def test_wrong_files_are_refused(tmp_path):
    with pytest.raises(UsageError, match=r"as \.bt or \.ot"):
        write_octomap(tmp_path / "a.ply", some_tree())
    with pytest.raises(FormatError, match="cannot be read as an octree"):
        read_octomap(tmp_path / "none.bt")
    (tmp_path / "x.bt").write_bytes(b"ply\n")
    with pytest.raises(FormatError, match=r"neither a \.bt nor a \.ot"):
        read_octomap(tmp_path / "x.bt")
    head = b"# Octomap OcTree file\nid %s\nsize 1\n%sdata\n"
    (tmp_path / "x.ot").write_bytes(head % (b"ColorOcTree", b"res 0.1\n"))
    with pytest.raises(FormatError, match="of type ColorOcTree"):
        read_octomap(tmp_path / "x.ot")
    (tmp_path / "x.ot").write_bytes(head % (b"OcTree", b""))
    with pytest.raises(FormatError, match="no resolution"):
        read_octomap(tmp_path / "x.ot")
    write_octomap(tmp_path / "cut.ot", some_tree())
    whole = (tmp_path / "cut.ot").read_bytes()
    for end in (len(whole) - 3, len(whole) - 500, whole.index(b"data\n") + 7):
        (tmp_path / "cut.ot").write_bytes(whole[:end])
        with pytest.raises(FormatError, match="end early"):
            read_octomap(tmp_path / "cut.ot")
