# SPDX-License-Identifier: MIT
"""Databases of other versions: older ones are read, newer and unknown ones are refused, those that lack columns are not continued."""

from __future__ import annotations

import zlib
from pathlib import Path

import database_worlds as worlds
import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.rtabmap.database import Database
from slamcli.rtabmap.database.calibration_blobs import pack_camera, unpack_cameras
from slamcli.rtabmap.database.scan_blobs import unpack_scan
from slamcli.vision.image_coding import encode_depth, encode_image

POSE = np.hstack([worlds.OPTICAL[:3]]).astype("<f4")


def matrix(values: np.ndarray, code: int) -> bytes:
    return zlib.compress(values.tobytes()) + np.array([*values.shape[:2], code], dtype="<i4").tobytes()


def old_0_8(path: Path) -> Path:
    """Write a database as 0.8.11 made them."""
    with worlds.raw(path) as connection:
        connection.executescript(
            """
            CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER NOT NULL, weight INTEGER, stamp FLOAT, pose BLOB, label TEXT, user_data BLOB, time_enter DATE, PRIMARY KEY (id));
            CREATE TABLE Image (id INTEGER NOT NULL, data BLOB, time_enter DATE, PRIMARY KEY (id));
            CREATE TABLE Depth (id INTEGER NOT NULL, data BLOB, fx FLOAT, fy FLOAT, cx FLOAT, cy FLOAT, local_transform BLOB, data2d BLOB, data2d_max_pts INTEGER, time_enter DATE, PRIMARY KEY (id));
            CREATE TABLE Link (from_id INTEGER NOT NULL, to_id INTEGER NOT NULL, type INTEGER NOT NULL, rot_variance FLOAT NOT NULL, trans_variance FLOAT NOT NULL, transform BLOB);
            CREATE TABLE Word (id INTEGER NOT NULL, descriptor_size INTEGER NOT NULL, descriptor BLOB NOT NULL, time_enter DATE, PRIMARY KEY (id));
            CREATE TABLE Map_Node_Word (node_id INTEGER NOT NULL, word_id INTEGER NOT NULL, pos_x FLOAT NOT NULL, pos_y FLOAT NOT NULL, size INTEGER NOT NULL, dir FLOAT NOT NULL, response FLOAT NOT NULL, depth_x FLOAT, depth_y FLOAT, depth_z FLOAT);
            CREATE TABLE Statistics (STM_size INTEGER, time_enter DATE);
            CREATE TABLE Admin (version TEXT);
            INSERT INTO Admin VALUES ('0.8.11');
            INSERT INTO Word VALUES (5, 32, x'0101010101010101010101010101010101010101010101010101010101010101', NULL);
            INSERT INTO Map_Node_Word VALUES (1, 5, 10.5, 20.0, 31, 90.0, 0.5, 2.0, 0.5, 0.3);
            INSERT INTO Map_Node_Word VALUES (1, 6, 11.5, 21.0, 31, -1.0, 0.4, NULL, NULL, NULL);
            """
        )
        given = worlds.images(1)
        for node_id in (1, 2):
            T = worlds.pose(node_id)[:3].astype("<f4").tobytes()
            connection.execute(
                "INSERT INTO Node VALUES (?, 0, 1, ?, ?, ?, NULL, NULL)",
                (node_id, 100.5 + node_id, T, f"place {node_id}"),
            )
        connection.execute("INSERT INTO Image VALUES (1, ?, NULL)", (encode_image(given.colour, ".png"),))
        scan = matrix(np.array([[[1.0, 2.0], [3.0, 4.0]]], dtype="<f4"), 13)
        row = (encode_depth(given.depth, ".png"), 50.0, 51.0, 32.5, 24.0, POSE.tobytes(), scan)
        connection.execute("INSERT INTO Depth VALUES (1, ?, ?, ?, ?, ?, ?, ?, 360, NULL)", row)
        T = worlds.pose(1.0)[:3].astype("<f4").tobytes()
        connection.execute("INSERT INTO Link VALUES (1, 2, 0, 0.01, 0.25, ?)", (T,))
    return path


def test_a_database_of_2015_is_read(tmp_path: Path) -> None:
    path = old_0_8(tmp_path / "old.db")
    with Database.read(path) as database:
        assert database.version == "0.8.11"
        nodes = database.nodes()
        assert (nodes.ids.tolist(), nodes.stamps_ns.tolist()) == ([1, 2], [101_500_000_000, 102_500_000_000])
        assert nodes.labels == ("place 1", "place 2")
        assert np.isnan(nodes.ground_truth).all()
        (link,) = database.links()
        np.testing.assert_allclose(np.diag(link.information), [4.0] * 3 + [100.0] * 3)
        images = database.read_images(1)
        assert images is not None
        assert (images.camera.fx, images.camera.fy, images.camera.width, images.camera.height) == (50.0, 51.0, 64, 48)
        assert np.array_equal(images.colour, worlds.images(1).colour)
        assert np.array_equal(images.depth, worlds.images(1).depth)
        np.testing.assert_allclose(images.T_base_camera, worlds.OPTICAL, atol=1e-7)
        assert database.read_images(2) is None
        signature = database.read_signature(1)
        assert signature.word_ids.tolist() == [5, 6]
        assert signature.features.descriptors[:, 0].tolist() == [1, 0]
        assert signature.features.angles.tolist() == pytest.approx([np.pi / 2, 0.0])
        assert signature.points[0].tolist() == [2.0, 0.5, 0.3]
        assert signature.scan is not None
        assert signature.scan.planar
        assert signature.scan.points.tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
        assert (database.counts().with_images, database.counts().key_points, database.counts().infos) == (1, 2, 0)
        assert database.read_local_grid(1) is None
        assert database.optimised() is None
        assert database.grid() is None
        assert database.read_statistics() == []
        assert database.parameters() == {}
        assert database.last_working_ids().tolist() == []
    with pytest.raises(
        FormatError, match=r"written by RTAB-Map 0\.8\.11, without .* it can be read, but not continued"
    ):
        Database.append(path)


def test_a_database_of_0_16_is_read(tmp_path: Path) -> None:
    """Another record of the calibration and of the scan, columns that came later missing."""
    path = worlds.written(tmp_path / "a.db")
    numbers = np.concatenate([[50.0, 51.0, 32.5, 24.0, 64.0, 48.0], POSE.ravel()]).astype("<f4")
    info = np.concatenate([[360.0, 9.0, 1.0], np.eye(3, 4).ravel()]).astype("<f4")
    with worlds.raw(path) as connection:
        connection.execute("UPDATE Data SET calibration=?, scan_info=?", (numbers.tobytes(), info.tobytes()))
        for table, column in (("Node", "env_sensors"), ("Data", "depth_confidence"), ("Admin", "dictionary_index")):
            connection.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        connection.execute("DROP TABLE GlobalDescriptor")
        connection.execute("UPDATE Admin SET version='0.16.3'")
    with Database.read(path) as database:
        (camera,) = database.read_cameras(1)
        assert (camera.pinhole.fx, camera.pinhole.width, camera.pinhole.baseline_m) == (50.0, 64, 0.0)
        scan = database.read_scan(1)
        assert scan is not None
        assert (scan.range_max_m, len(scan.points), scan.planar) == (9.0, 80, True)
        assert len(database.read_signature(2).features) == 20


@pytest.mark.parametrize(
    ("version", "message"),
    [("0.24.0", "0.8.0 to 0.23 are read"), ("1.0.0", "0.8.0 to 0.23"), ("0.7.9", "0.8.0 to 0.23"), ("next", "none of RTAB-Map's"), (None, "none of")],
)  # fmt: skip
def test_other_versions_are_refused(tmp_path: Path, version: str | None, message: str) -> None:
    path = worlds.written(tmp_path / "a.db", 1)
    with worlds.raw(path) as connection:
        connection.execute("UPDATE Admin SET version=?", (version,))
    for opening in (Database.read, Database.append):
        with pytest.raises(FormatError, match=message):
            opening(path)


def test_a_database_of_0_21_is_continued_and_its_search_tree_forgotten(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with worlds.raw(path) as connection:
        connection.execute("ALTER TABLE Data DROP COLUMN depth_confidence")
        connection.execute("UPDATE Admin SET version='0.21.4', dictionary_index=x'00'")
    with Database.append(path) as database:
        worlds.fill(database, 1, first=5)
    with worlds.raw(path) as connection:
        assert connection.execute("SELECT version, dictionary_index FROM Admin").fetchone() == ("0.21.4", None)


def test_calibrations_of_all_versions() -> None:
    head = [400.0, 410.0, 320.0, 240.0]

    def blob(*numbers: float) -> bytes:
        return np.concatenate([numbers, POSE.ravel()]).astype("<f4").tobytes()

    for version, data, sizes, baseline in (
        ((0, 10, 0), blob(*head), [(0, 0)], 0.0), ((0, 10, 0), blob(*head) * 3, [(0, 0)] * 3, 0.0),
        ((0, 10, 0), blob(*head, 0.25), [(0, 0)], 0.25), ((0, 11, 2), blob(*head, 640, 480) * 2, [(640, 480)] * 2, 0.0),
        ((0, 17, 6), blob(*head, 0.25, 640, 480), [(640, 480)], 0.25),
    ):  # fmt: skip
        cameras = unpack_cameras(data, version)
        assert [(camera.pinhole.width, camera.pinhole.height) for camera in cameras] == sizes
        assert all(
            (camera.pinhole.fx, camera.pinhole.cy, camera.pinhole.baseline_m) == (400.0, 240.0, baseline)
            for camera in cameras
        )
        np.testing.assert_allclose(cameras[-1].T_base_camera, worlds.OPTICAL, atol=1e-7)
    several = b"".join(pack_camera(worlds.images(1).camera, worlds.OPTICAL, pair=False) for _ in range(3))
    assert len(unpack_cameras(several, (0, 18, 0))) == 3
    assert unpack_cameras(None, (0, 23, 8)) == ()


def test_a_calibration_with_distortion_and_extrinsics() -> None:
    """A raw stereo camera as rtabmap-ros keeps it: K, D, R, P of both and the pose of the right one."""

    def one(baseline_m: float) -> bytes:
        numbers = [*np.diag([400.0, 410.0, 1.0]).ravel(), 0.1, 0.2, 0.3, 0.4, 0.5, *np.eye(3).ravel()]
        numbers += [380.0, 0, 300, -380 * baseline_m, 0, 380, 200, 0, 0, 0, 1, 0]
        header = np.array([0, 21, 0, 0, 640, 480, 9, 5, 9, 12, 12], dtype="<i4").tobytes()
        return header + np.array(numbers, dtype="<f8").tobytes() + POSE.tobytes()

    left, right = one(0.0), one(0.25)
    header = np.array([0, 21, 0, 1, 9, 3, 9, 9, len(left), len(right)], dtype="<i4").tobytes()
    (camera,) = unpack_cameras(header + np.zeros(30, "<f8").tobytes() + left + right, (0, 21, 0))
    assert (camera.pinhole.fx, camera.pinhole.cx, camera.pinhole.baseline_m) == (380.0, 300.0, 0.25)
    assert camera.distortion is not None
    assert camera.distortion.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert camera.intrinsics is not None
    assert camera.intrinsics[1, 1] == 410.0


@pytest.mark.parametrize(
    ("form", "channels", "planar"),
    [(1, 2, True), (2, 3, True), (3, 5, True), (4, 6, True), (5, 3, False), (6, 4, False), (7, 4, False), (8, 6, False), (9, 7, False), (10, 7, False), (11, 5, False)],
)  # fmt: skip
def test_scans_of_all_formats(form: int, channels: int, planar: bool) -> None:
    values = np.arange(1.0, 1.0 + 3 * channels, dtype="<f4").reshape(1, 3, channels)
    values[0, 1, 0] = np.nan
    info = np.concatenate([[form, 0.1, 30.0, 0, 0, 0, 3], worlds.pose(1.0)[:3].ravel()]).astype("<f4").tobytes()
    scan = unpack_scan(matrix(values, 5 + ((channels - 1) << 3)), info, None, (0, 23, 8))
    assert scan is not None
    assert (scan.planar, scan.range_max_m, len(scan.points)) == (planar, 30.0, 2)
    assert scan.points[1].tolist() == [*(values[0, 2, :2] + [1.0, 0.0]), 0.0 if planar else values[0, 2, 2]]


def test_scans_of_old_versions_are_told_by_their_channels() -> None:
    values = np.arange(1.0, 7.0, dtype="<f4").reshape(1, 2, 3)
    assert unpack_scan(matrix(values, 21), None, None, (0, 10, 0)).planar is False
    info = np.concatenate([[2.0, 5.0], np.eye(3, 4).ravel()]).astype("<f4").tobytes()
    assert unpack_scan(matrix(values[:, :, :2], 13), info, None, (0, 13, 0)).range_max_m == 5.0
    with pytest.raises(FormatError, match="scan_info of 56 bytes"):
        unpack_scan(matrix(values, 21), info, None, (0, 23, 8))
    with pytest.raises(FormatError, match="format 12"):
        unpack_scan(
            matrix(values, 21),
            np.concatenate([[12.0], np.zeros(6), np.eye(3, 4).ravel()]).astype("<f4").tobytes(),
            None,
            (0, 23, 8),
        )
