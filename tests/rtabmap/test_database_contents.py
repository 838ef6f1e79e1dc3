# SPDX-License-Identifier: MIT
"""What is written to a database is read from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import database_worlds as worlds
import numpy as np
import pytest

from slamcli.errors import FormatError
from slamcli.rtabmap.database import Database, StorageSettings
from slamcli.rtabmap.links import LinkKind
from slamcli.rtabmap.signature import NodeScan, Signature


def rows(path: Path, query: str) -> list[tuple]:
    with worlds.raw(path) as connection:
        return connection.execute(query).fetchall()


def assert_same(read: Signature, given: Signature) -> None:
    assert (read.id, read.map_id) == (given.id, given.map_id)
    assert abs(read.stamp_ns - given.stamp_ns) <= 1000
    np.testing.assert_allclose(read.T_odom_base, given.T_odom_base, atol=1e-6)
    assert np.array_equal(read.word_ids, given.word_ids)
    known = np.isfinite(given.points).all(axis=1)
    assert np.array_equal(read.points[known], given.points[known])
    assert np.isnan(read.points[~known]).all()
    for name in ("pixels", "octaves", "responses", "descriptors"):
        assert np.array_equal(getattr(read.features, name), getattr(given.features, name)), name
    np.testing.assert_allclose(read.features.angles, given.features.angles, atol=1e-12)
    np.testing.assert_allclose(read.features.sigmas, given.features.sigmas, rtol=1e-12)


def test_a_signature_comes_back(tmp_path: Path) -> None:
    with Database.read(worlds.written(tmp_path / "a.db")) as database:
        for node_id in (1, 2, 3, 4):
            assert_same(database.read_signature(node_id), worlds.signature(node_id))
        read = database.read_signature(1)
        T_camera_base = np.linalg.inv(worlds.OPTICAL)
        known = np.isfinite(read.points).all(axis=1)
        z = (read.points[known] @ T_camera_base[:3, :3].T + T_camera_base[:3, 3])[:, 2]
        np.testing.assert_allclose(read.features.depth[known], z, atol=1e-6)
        stereo = database.read_signature(3)
        shift = stereo.features.pixels[:, 0] - stereo.features.right
        np.testing.assert_allclose(shift[known], 50.0 * 0.12 / stereo.features.depth[known], rtol=1e-6)
        assert [found.id for found in database.read_signatures([3, 1])] == [3, 1]


def test_a_stamp_is_exact_while_the_database_that_wrote_it_is_open(tmp_path: Path) -> None:
    with Database.create(tmp_path / "a.db", "") as database:
        database.add_node(worlds.signature(1), weight=0)
        assert database.read_signature(1).stamp_ns == worlds.signature(1).stamp_ns


def test_nodes_and_what_is_told_of_them(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with Database.read(path) as database:
        nodes = database.nodes()
        assert nodes.ids.tolist() == [1, 2, 3, 4]
        assert nodes.weights.tolist() == [1, 2, 0, 1]
        assert nodes.labels == ("map0", None, None, None)
        np.testing.assert_allclose(nodes.ground_truth[2], worlds.pose(3), atol=1e-6)
        np.testing.assert_allclose(nodes.T_odom_base[3], worlds.signature(4).T_odom_base, atol=1e-6)
        assert np.abs(nodes.stamps_ns - [worlds.signature(i).stamp_ns for i in nodes.ids]).max() <= 1000
        assert len(nodes) == 4
    gps, velocity = rows(path, "SELECT gps, velocity FROM Node WHERE id=1")[0]
    assert np.frombuffer(gps, "<f8").tolist() == pytest.approx([worlds.BEGIN_NS / 1e9, -71.9, 45.4, 200.0, 2.0, 90.0])
    assert np.frombuffer(velocity, "<f4").tolist() == [0, 1, 2, 3, 4, 5]


def test_images_come_back(tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    with Database.create(path, "", settings=StorageSettings(image_encoding=".png", depth_encoding=".png")) as database:
        database.add_node(worlds.signature(1), weight=0, images=worlds.images(1))
        database.add_node(worlds.signature(2), weight=0, images=worlds.images(2, stereo=True))
        database.add_node(worlds.signature(3), weight=0)
    with Database.read(path) as database:
        depth, stereo = database.read_images(1), database.read_images(2)
        assert depth is not None
        assert stereo is not None
        assert np.array_equal(depth.colour, worlds.images(1).colour)
        assert np.array_equal(depth.depth, worlds.images(1).depth)
        assert depth.right is None
        assert np.array_equal(stereo.right, worlds.images(2, stereo=True).right)
        assert stereo.depth is None
        assert replace(stereo.camera, baseline_m=0.0) == depth.camera == worlds.images(1).camera
        assert stereo.camera.baseline_m == pytest.approx(0.12)
        np.testing.assert_allclose(depth.T_base_camera, worlds.OPTICAL, atol=1e-7)
        assert database.read_images(3) is None
        assert database.read_images(99) is None
        assert [len(database.read_cameras(i)) for i in (1, 2, 3, 99)] == [1, 1, 0, 0]
        with pytest.raises(FormatError, match="camera 1 is none of them"):
            database.read_images(1, camera=1)


def test_a_planar_scan_is_kept_flat_and_comes_back(tmp_path: Path) -> None:
    given = worlds.planar_scan()
    path = worlds.written(tmp_path / "a.db")
    with Database.read(path) as database:
        read = database.read_scan(1)
        assert database.read_scan(2) is None
        signature = database.read_signature(1)
    assert read is not None
    assert signature.scan is not None
    for scan in (read, signature.scan):
        assert scan.planar
        np.testing.assert_allclose(scan.points, given.points, atol=1e-5)
        np.testing.assert_allclose(scan.T_base_sensor, given.T_base_sensor, atol=1e-6)
        assert scan.range_max_m == 12.0
        assert np.array_equal(scan.open_ends, given.open_ends)
    info = np.frombuffer(rows(path, "SELECT scan_info FROM Data WHERE id=1")[0][0], "<f4")
    assert info[:7].tolist() == [1.0, 0.0, 12.0, 0.0, 0.0, 0.0, 80.0]


def test_a_cloud_is_kept_in_space(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (500, 3)).astype(np.float32)
    scan = NodeScan(points=points, planar=False, T_base_sensor=worlds.pose(0.3), range_max_m=80.0)
    with Database.create(tmp_path / "a.db", "") as database:
        database.add_node(worlds.signature(1, count=0, scan=scan), weight=0)
        read = database.read_signature(1)
    assert read.scan is not None
    assert not read.scan.planar
    np.testing.assert_allclose(read.scan.points, points, atol=2e-6)
    assert read.scan.open_ends is None
    assert len(read.features) == 0


def test_local_grids_come_back_and_can_be_replaced(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with Database.append(path) as database:
        read = database.read_local_grid(1)
        assert read is not None
        assert np.array_equal(read.ground, worlds.local_grid().ground)
        assert np.array_equal(read.obstacles, worlds.local_grid().obstacles)
        assert read.empty.shape == (0, 2)
        assert (read.cell_size_m, read.view_point.tolist()) == (0.05, [0.1, 0.0, 0.4])
        assert database.read_local_grid(2) is None
        spatial = replace(read, ground=np.zeros((0, 2), np.float32), obstacles=np.ones((2, 3), np.float32))
        database.set_local_grid(2, spatial)
        second = database.read_local_grid(2)
        assert second is not None
        assert second.spatial
        assert second.ground.shape == (0, 3)


def test_links_are_kept_from_both_ends_and_read_once(tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    given = [
        worlds.link(1, 2), worlds.link(2, 3), worlds.link(3, 1, LinkKind.GLOBAL_CLOSURE), worlds.link(2, 2, LinkKind.GRAVITY),
        worlds.link(3, -7, LinkKind.LANDMARK), worlds.link(1, 3, LinkKind.VIRTUAL_CLOSURE),
    ]  # fmt: skip
    with Database.create(path, "") as database:
        for node_id in (1, 2, 3):
            database.add_node(worlds.signature(node_id), weight=0)
        database.add_links(given)
        read = database.links()
        assert [(link.from_id, link.to_id, link.kind) for link in read] == [
            (link.from_id, link.to_id, link.kind) for link in given[:-1]
        ]
        for link, other in zip(read, given[:-1], strict=True):
            np.testing.assert_allclose(link.T_from_to, other.T_from_to, atol=1e-7)
            assert np.array_equal(link.information, other.information)
        assert [(link.from_id, link.to_id) for link in database.links(3)] == [(2, 3), (3, 1), (3, -7)]
        database.remove_links([(1, 3), (3, -7)])
        assert len(database.links()) == 3
    assert rows(path, "SELECT from_id, to_id, type FROM Link") == [
        (1, 2, 0),
        (2, 1, 0),
        (2, 3, 0),
        (3, 2, 0),
        (2, 2, 9),
    ]


def test_words_come_go_and_change(tmp_path: Path) -> None:
    with Database.append(worlds.written(tmp_path / "a.db")) as database:
        ids, descriptors = database.words()
        assert (ids.tolist(), descriptors.shape) == (
            [k + 100 * i for i in (1, 2, 3, 4) for k in range(1, 16)],
            (60, 32),
        )
        assert np.array_equal(descriptors[:15], np.random.default_rng(1).integers(0, 256, (15, 32), dtype=np.uint8))
        database.remove_words([101, 102])
        database.add_words(np.array([103]), np.zeros((1, 32), np.uint8))
        ids, descriptors = database.words()
        assert ids[0] == 103
        assert not descriptors[0].any()
        words = database.read_signature(1).word_ids
        changed = np.where(words == 105, 900, words)
        database.update_word_ids(1, changed)
        assert np.array_equal(database.read_signature(1).word_ids, changed)
        with pytest.raises(FormatError, match="has 20 key points"):
            database.update_word_ids(1, changed[:-1])


def test_summaries_come_back(tmp_path: Path) -> None:
    with Database.append(worlds.written(tmp_path / "a.db")) as database:
        optimised = database.optimised()
        assert optimised is not None
        assert optimised.ids.tolist() == [1, 2, 3, 4]
        np.testing.assert_allclose(optimised.T_map_base[3], worlds.pose(2.0), atol=1e-6)
        assert optimised.T_map_last is not None
        assert optimised.T_map_last[0, 3] == 9.0
        assert database.parameters() == {"Kp/MaxFeatures": "500", "Mem/STMSize": "10", "Rtabmap/DetectionRate": "1"}
        statistics = database.read_statistics()
        assert [entry.node_id for entry in statistics] == [1, 2, 3, 4]
        assert statistics[0].values == {"Loop/Id/": 0.0}  # times are not kept
        assert database.grid() is None
        cells = np.array([[-1, 0, 100], [0, 0, -1]], dtype=np.int8)
        database.set_grid(cells, x_min_m=-1.5, y_min_m=2.0, resolution_m=0.05)
        grid = database.grid()
        assert grid is not None
        assert np.array_equal(grid.cells, cells)
        assert (grid.x_min_m, grid.y_min_m, grid.resolution_m) == (-1.5, 2.0, 0.05)
        database.set_weight(2, 7)
        database.set_label(2, "kitchen")
        assert database.nodes().weights[1] == 7
        assert database.nodes().labels[1] == "kitchen"


def test_the_next_session_knows_who_was_in_working_memory(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with Database.read(path) as database:
        assert database.last_working_ids().tolist() == [2, 3, 4]
    with Database.append(path, "Kp/MaxFeatures:7") as database:
        worlds.fill(database, 2, first=5)
        assert database.parameters() == {"Kp/MaxFeatures": "7"}
    with Database.read(path) as database:  # the second session did not say: all since it began, and those it began with
        assert database.last_working_ids().tolist() == [2, 3, 4, 5, 6]
        assert database.nodes().ids.tolist() == [1, 2, 3, 4, 5, 6]


def test_descriptors_that_are_not_binary_are_refused(tmp_path: Path) -> None:
    path = worlds.written(tmp_path / "a.db")
    with worlds.raw(path) as connection:
        connection.execute("UPDATE Feature SET descriptor_size=8")
    with Database.read(path) as database, pytest.raises(FormatError, match="not binary"):
        database.read_signature(1)


def test_there_is_no_such_node(tmp_path: Path) -> None:
    with (
        Database.read(worlds.written(tmp_path / "a.db")) as database,
        pytest.raises(FormatError, match=r"a\.db: node 77: there is no such node"),
    ):
        database.read_signature(77)


def test_several_cameras_are_read_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    left, wide = worlds.images(1), worlds.images(1)
    both = replace(
        wide,
        colour=np.hstack([left.colour, left.colour[::-1]]),
        depth=np.hstack([left.depth, left.depth + np.float32(1.0)]),
    )
    with Database.create(path, "", settings=StorageSettings(image_encoding=".png")) as database:
        database.add_node(worlds.signature(1), weight=0, images=both)
    with worlds.raw(path) as connection:
        connection.execute("UPDATE Data SET calibration = CAST(calibration || calibration AS BLOB)")
    with Database.read(path) as database:
        first, second = database.read_images(1), database.read_images(1, camera=1)
        assert first is not None
        assert second is not None
        assert np.array_equal(first.colour, left.colour)
        assert np.array_equal(second.colour, left.colour[::-1])
        assert np.array_equal(first.depth, left.depth)
        assert second.camera == left.camera
        assert len(database.read_cameras(1)) == 2


def test_depth_that_was_kept_smaller_is_enlarged(tmp_path: Path) -> None:
    path = tmp_path / "a.db"
    with Database.create(path, "") as database:
        database.add_node(
            worlds.signature(1), weight=0, images=replace(worlds.images(1), depth=worlds.images(1).depth[::2, ::2])
        )
        database.add_node(
            worlds.signature(2), weight=0, images=replace(worlds.images(1), depth=worlds.images(1).depth[:30])
        )
        images = database.read_images(1)
        assert images is not None
        assert np.array_equal(images.depth, np.kron(worlds.images(1).depth[::2, ::2], np.ones((2, 2), np.float32)))
        with pytest.raises(FormatError, match="64 x 30 beside one of 64 x 48"):
            database.read_images(2)
