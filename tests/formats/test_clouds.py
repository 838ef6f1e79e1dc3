# SPDX-License-Identifier: MIT
"""PLY and PCD: what is written comes back bit by bit, every layout is read, garbage is one line of error."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from slamcli.errors import DataError, FormatError, InputError, UsageError
from slamcli.formats.cloud_colours import colours_in
from slamcli.formats.clouds import COLOURS, colours_of, read_cloud, write_cloud
from slamcli.measurements import PointCloud

RNG = np.random.default_rng(1)
POINTS = (RNG.standard_normal((200, 3)) * np.array([1e3, 1e-3, 10.0])).astype(np.float32)
INTENSITIES = RNG.uniform(0, 255, 200).astype(np.float32)
CLOUD = PointCloud(stamp_ns=5, frame_id="map", points_m=POINTS, intensities=INTENSITIES)


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".PLY"])
@pytest.mark.parametrize("colour", COLOURS)
def test_a_round_trip_is_exact(tmp_path, suffix, colour):
    path = tmp_path / f"cloud{suffix}"
    write_cloud(path, CLOUD, colour=colour)
    back = read_cloud(path)
    assert back.points_m.tobytes() == POINTS.tobytes()
    assert back.intensities is not None
    assert back.intensities.tobytes() == INTENSITIES.tobytes()
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_a_cloud_without_points_or_intensities(tmp_path, suffix):
    empty = PointCloud(stamp_ns=0, frame_id="", points_m=np.zeros((0, 3), np.float32))
    write_cloud(tmp_path / f"e{suffix}", empty, colour="intensity")
    back = read_cloud(tmp_path / f"e{suffix}")
    assert back.points_m.shape == (0, 3)
    assert back.intensities is None


def test_open3d_reads_what_is_written(tmp_path):
    o3d = pytest.importorskip("open3d")
    for suffix in (".ply", ".pcd"):
        write_cloud(tmp_path / f"c{suffix}", CLOUD)
        read = o3d.io.read_point_cloud(str(tmp_path / f"c{suffix}"))
        np.testing.assert_array_equal(np.asarray(read.points, dtype=np.float32), POINTS)
        np.testing.assert_allclose(np.asarray(read.colors) * 255, colours_of(POINTS[:, 2]), atol=1e-6)


@pytest.mark.parametrize("name", ["a.ply", "b.ply", "a.pcd", "b.pcd", "c.pcd"])
def test_what_open3d_writes_is_read(tmp_path, name):
    o3d = pytest.importorskip("open3d")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(POINTS.astype(np.float64)))
    cloud.colors = o3d.utility.Vector3dVector(np.zeros((200, 3)))
    o3d.io.write_point_cloud(str(tmp_path / name), cloud, write_ascii=name[0] == "a", compressed=name[0] == "c")
    tolerance = {"a": 1e-5, "b": 0, "c": 0}[name[0]]  # it writes six digits
    np.testing.assert_allclose(read_cloud(tmp_path / name).points_m, POINTS, rtol=tolerance, atol=tolerance)


def test_colours_run_from_dark_to_light_between_the_percentiles():
    colours = colours_of(np.arange(101, dtype=np.float32))
    assert colours[0].tolist() == colours[2].tolist() == [68, 1, 84]
    assert colours[100].tolist() == colours[98].tolist() == [253, 231, 37]
    assert (np.diff(colours.astype(int).sum(axis=1)[2:99]) >= -2).all()
    assert colours_of(np.full(3, 7, np.float32)).tolist() == [[68, 1, 84]] * 3


PLY_TEXT = b"""ply
format ascii 1.0
comment made by hand
element camera 1
property list uchar int ids
element vertex 2
property double x
property float y
property int z
property uchar Intensity
element face 1
property list uchar int vertex_indices
end_header
3 1 2 3
1.5 -2 3 10
4 5e-1 -6 20

3 0 1 0
"""


def test_ply_as_text_with_other_elements(tmp_path):
    (tmp_path / "t.ply").write_bytes(PLY_TEXT)
    cloud = read_cloud(tmp_path / "t.ply")
    np.testing.assert_array_equal(cloud.points_m, [[1.5, -2, 3], [4, 0.5, -6]])
    np.testing.assert_array_equal(cloud.intensities, [10, 20])


def test_ply_big_endian_after_another_element(tmp_path):
    header = b"ply\r\nformat binary_big_endian 1.0\r\nelement a 2\r\nproperty short s\r\nelement vertex 1\r\nproperty uchar c\r\n"
    header += b"property float z\r\nproperty float x\r\nproperty double y\r\nend_header\r\n"
    (tmp_path / "b.ply").write_bytes(header + struct.pack(">hhBffd", 1, 2, 3, 3.0, 1.0, 2.0))
    np.testing.assert_array_equal(read_cloud(tmp_path / "b.ply").points_m, [[1, 2, 3]])


PCD_TEXT = b"""# .PCD v.7 - Point Cloud Data file format
VERSION .7
FIELDS x y z fpfh _ intensity
SIZE 4 4 4 4 1 2
TYPE F F F F U U
COUNT 1 1 1 2 1 1
WIDTH 3
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 3
DATA ascii
1 2 3 9 9 0 7
nan nan nan 9 9 0 0
4 5 6 9 9 0 8
"""


def test_pcd_as_text_without_its_empty_cells(tmp_path):
    (tmp_path / "t.pcd").write_bytes(PCD_TEXT)
    cloud = read_cloud(tmp_path / "t.pcd")
    np.testing.assert_array_equal(cloud.points_m, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(cloud.intensities, [7, 8])


def test_pcd_binary_with_padding(tmp_path):
    head = PCD_TEXT.replace(b"DATA ascii\n", b"DATA binary\n").split(b"binary\n")[0] + b"binary\n"
    rows = b"".join(
        struct.pack("<fff2fBH", *row) for row in [(1, 2, 3, 9, 9, 0, 7), (4, 5, 6, 9, 9, 0, 8), (0, 0, 0, 0, 0, 0, 9)]
    )
    (tmp_path / "b.pcd").write_bytes(head + rows)
    cloud = read_cloud(tmp_path / "b.pcd")
    np.testing.assert_array_equal(cloud.points_m, [[1, 2, 3], [4, 5, 6], [0, 0, 0]])
    np.testing.assert_array_equal(cloud.intensities, [7, 8, 9])


def test_copies_of_lzf_may_reach_into_themselves(tmp_path):
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary_compressed\n"
    one = struct.pack("<f", 2.5)
    packed = bytes([3]) + one + bytes([(7 << 5), 20 - 9, 3])  # four literals, then 20 bytes from four back
    (tmp_path / "c.pcd").write_bytes(head + struct.pack("<II", len(packed), 24) + packed)
    np.testing.assert_array_equal(read_cloud(tmp_path / "c.pcd").points_m, np.full((2, 3), 2.5))


def bad_files():
    whole = PLY_TEXT.replace(b"ascii", b"binary_little_endian")
    yield "empty", b"", "neither a PLY nor a PCD"
    yield "garbage", bytes(RNG.integers(0, 256, 5000, np.uint8)), "neither a PLY nor a PCD"
    yield "no end", PLY_TEXT[:100], "no line end_header"
    yield "lists first", whole, "lists in or before the vertices"
    yield (
        "short",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\nend_header\nab",
        "99999999999 points",
    )
    yield "no size", b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nend_header\nab", "3 points of 0 bytes"
    yield "words", PLY_TEXT.replace(b"5e-1", b"many"), "no row of numbers"
    yield "no format", PLY_TEXT.replace(b"format ascii 1.0\n", b""), "does not say its format"
    yield "no z", PLY_TEXT.replace(b"int z", b"int w"), "no z"
    yield "no vertex", PLY_TEXT.replace(b"vertex 2", b"vortex 2"), "without vertices"
    yield "bad line", PLY_TEXT.replace(b"property double x", b"property quad x"), "no line of a PLY header"
    yield "rows", PCD_TEXT.replace(b"POINTS 3", b"POINTS 5"), "5 points are declared, 3 are there"
    yield "huge", PCD_TEXT.replace(b"POINTS 3", b"POINTS 999999999999"), "more than a file can hold"
    yield "counts", PCD_TEXT.replace(b"COUNT 1", b"COUNT x"), "COUNT of this PCD"
    yield "type", PCD_TEXT.replace(b"TYPE F", b"TYPE Q"), "do not declare points"
    yield "data", PCD_TEXT.replace(b"DATA ascii", b"DATA zip"), "DATA zip"
    yield "unpack", PCD_TEXT.replace(b"DATA ascii\n", b"DATA binary_compressed\n"), "compressed bytes"
    compressed = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nPOINTS 1\nDATA binary_compressed\n"
    yield "copy", compressed + struct.pack("<II", 2, 12) + b"\xff\xff", "damaged"
    yield "bomb", compressed + struct.pack("<II", 2, 4_000_000_000) + b"\xff\xff", "compressed bytes"


@pytest.mark.parametrize(("name", "content", "message"), list(bad_files()), ids=[name for name, _, _ in bad_files()])
def test_what_is_no_cloud_says_so_in_one_line(tmp_path, name, content, message):
    path = tmp_path / "cloud.bin"
    path.write_bytes(content)
    with pytest.raises(FormatError) as caught:
        read_cloud(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_damage_anywhere_is_an_input_error_or_a_cloud(tmp_path):
    rng = np.random.default_rng(3)
    wholes = []
    for name in ("c.ply", "c.pcd"):
        write_cloud(tmp_path / name, CLOUD)
        wholes.append((tmp_path / name).read_bytes())
    for whole in (*wholes, PLY_TEXT, PCD_TEXT):
        for _ in range(60):
            damaged = bytearray(whole[: rng.integers(1, len(whole))] if rng.random() < 0.3 else whole)
            for at in rng.integers(0, min(len(damaged), 300), 3):
                damaged[at] = rng.integers(0, 256)
            (tmp_path / "d").write_bytes(damaged)
            try:
                cloud = read_cloud(tmp_path / "d")
            except InputError as error:
                assert "\n" not in str(error)  # noqa: PT017
            else:
                assert np.isfinite(cloud.points_m).all()


def test_other_suffixes_and_missing_files(tmp_path):
    with pytest.raises(UsageError, match=r"written as \.ply or \.pcd"):
        write_cloud(tmp_path / "cloud.xyz", CLOUD)
    with pytest.raises(FormatError, match="No such file"):
        read_cloud(tmp_path / "none.ply")
    assert not list(tmp_path.iterdir())


COLOURED = PointCloud(
    stamp_ns=0, frame_id="map", points_m=POINTS, colours=RNG.integers(0, 256, (200, 3), dtype=np.uint8)
)


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_colours_come_back_as_they_were(tmp_path, suffix):
    path = tmp_path / f"c{suffix}"
    write_cloud(path, COLOURED)
    back = read_cloud(path)
    np.testing.assert_array_equal(back.colours, COLOURED.colours)
    write_cloud(path, COLOURED, colour="height")
    np.testing.assert_array_equal(read_cloud(path).colours, colours_of(POINTS[:, 2]))
    write_cloud(path, COLOURED, colour="none")
    assert read_cloud(path).colours is None


def test_open3d_agrees_on_colours(tmp_path):
    o3d = pytest.importorskip("open3d")
    for suffix in (".ply", ".pcd"):
        write_cloud(tmp_path / f"c{suffix}", COLOURED)
        read = o3d.io.read_point_cloud(str(tmp_path / f"c{suffix}"))
        np.testing.assert_allclose(np.asarray(read.colors) * 255, COLOURED.colours, atol=1e-6)
        for ascii_too in (True, False):
            o3d.io.write_point_cloud(str(tmp_path / f"o{suffix}"), read, write_ascii=ascii_too)
            np.testing.assert_array_equal(read_cloud(tmp_path / f"o{suffix}").colours, COLOURED.colours)


@pytest.mark.parametrize(
    "columns",
    [
        {name: np.array([v]) for name, v in zip("rgb", (0.2, 0.4, 1.0), strict=True)},
        {name: np.array([v]) for name, v in zip("rgb", (51.0, 102.0, 255.0), strict=True)},
        {"rgb": np.array([0x3366FF], dtype=np.uint32)},
        {"rgb": np.array([0xFF3366FF], dtype=np.uint32).view(np.float32).astype(np.float64)},
        {"rgb": np.array([0x003366FF], dtype=np.uint32).view(np.float32)},
        {"rgba": np.array([float(0xFF3366FF)])},
    ],
)
def test_colours_are_found_however_they_are_written(columns):
    np.testing.assert_array_equal(colours_in(columns), [[51, 102, 255]])


def test_colours_of_another_number_of_points_are_refused():
    with pytest.raises(DataError, match=r"colours have shape \(3, 3\) for 200 points"):
        PointCloud(stamp_ns=0, frame_id="", points_m=POINTS, colours=np.zeros((3, 3), np.uint8))
