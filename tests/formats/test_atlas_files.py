# SPDX-License-Identifier: MIT
"""Atlases in files come back as they were; damage and other systems' files are one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.formats.atlas_files import read_atlas, write_atlas
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.visual_atlas import COLUMNS, VisualAtlas, VisualMap

CAMERA = Pinhole(fx=300.0, fy=301.0, cx=160.0, cy=120.0, width=320, height=240, baseline_m=0.1)


def saved_map(seed, keyframes=3, points=7, T_world_map=None):
    rng = np.random.default_rng(seed)
    counts = rng.integers(2, 6, keyframes)
    rows = {"keyframes": keyframes, "features": int(counts.sum()), "points": points, "edges": 1}
    columns = {
        name: (rng.random((rows[kind], *shape)) if dtype == "float64" else np.zeros((rows[kind], *shape))).astype(dtype)
        for name, (kind, shape, dtype) in COLUMNS.items()
    }
    columns |= {
        "counts": counts,
        "parent": np.arange(keyframes) - 1,
        "seen": rng.integers(-1, points, int(counts.sum())),
    }
    columns["depth"][0] = np.nan
    return VisualMap(columns=columns, T_world_map=T_world_map)


def atlas(bounds=None, maps=2):
    T = np.eye(4)
    T[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    return VisualAtlas(
        camera=replace(CAMERA, bounds=bounds), scales=1.2 ** np.arange(8.0),
        maps=tuple(saved_map(seed, T_world_map=T if seed else None) for seed in range(maps)),
    )  # fmt: skip


@pytest.mark.parametrize("bounds", [None, (-3.5, -2.0, 330.0, 250.25)])
def test_an_atlas_comes_back_and_has_the_same_bytes(tmp_path, bounds):
    made = atlas(bounds)
    write_atlas(made, tmp_path / "a.atlas")
    write_atlas(made, tmp_path / "b.atlas")
    assert (tmp_path / "a.atlas").read_bytes() == (tmp_path / "b.atlas").read_bytes()
    again = read_atlas(tmp_path / "a.atlas")
    assert again.camera == made.camera
    assert np.array_equal(again.scales, made.scales)
    assert again.maps[0].T_world_map is None
    assert np.array_equal(again.maps[1].T_world_map, made.maps[1].T_world_map)
    assert len(again.maps) == 2
    for one, other in zip(made.maps, again.maps, strict=True):
        for name in COLUMNS:
            assert one.columns[name].tobytes() == other.columns[name].tobytes()


def test_an_atlas_without_maps_is_one(tmp_path):
    write_atlas(atlas(maps=0), tmp_path / "empty.npz")
    assert read_atlas(tmp_path / "empty.npz").maps == ()


def test_damage_is_one_line(tmp_path):
    write_atlas(atlas(), tmp_path / "good.npz")
    good, path = (tmp_path / "good.npz").read_bytes(), tmp_path / "bad.npz"
    rng = np.random.default_rng(0)
    for cut in rng.integers(2, len(good), 25):
        path.write_bytes(good[:cut])
        with pytest.raises(FormatError, match=r"bad\.npz: ") as caught:
            read_atlas(path)
        assert "\n" not in str(caught.value).strip()
    middle = good.index(b"map0.positions.npy") + 150  # inside a column: its checksum tells
    path.write_bytes(good[:middle] + bytes([good[middle] ^ 0xFF]) + good[middle + 1 :])
    with pytest.raises(FormatError, match="damaged"):
        read_atlas(path)


def test_columns_that_do_not_fit_are_damage(tmp_path):
    write_atlas(atlas(), tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as stored:
        columns = dict(stored)
    columns["map1.seen"] = columns["map1.seen"] + 99
    np.savez(tmp_path / "wrong.npz", **columns)
    with pytest.raises(FormatError, match="this atlas is damaged: visual map: seen refers to points"):
        read_atlas(tmp_path / "wrong.npz")
    columns["num_maps"] = np.array(3)
    np.savez(tmp_path / "wrong.npz", **columns)
    with pytest.raises(FormatError, match="damaged"):
        read_atlas(tmp_path / "wrong.npz")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("map.osa", b"anything", "an atlas of ORB-SLAM3"),
        ("renamed.bin", b"\x16\x00\x00\x00\x00\x00\x00\x00serialization::archive\x12\x00", "an atlas of ORB-SLAM3"),
        ("notes.txt", b"hello", "no atlas of slamcli"),
        ("empty.npz", b"", "no atlas of slamcli"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=message):
        read_atlas(tmp_path / name)


def test_other_kinds_of_npz_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", kind=np.array("slamcli vocabulary 1"))
    with pytest.raises(FormatError, match="'slamcli vocabulary 1' is not read"):
        read_atlas(tmp_path / "other.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(1))
    with pytest.raises(FormatError, match="no atlas of slamcli"):
        read_atlas(tmp_path / "other.npz")
    with pytest.raises(FormatError, match="cannot be read"):
        read_atlas(tmp_path / "nowhere.npz")
