# SPDX-License-Identifier: MIT
"""A small database that RTAB-Map 0.21.12 itself wrote (its library within the depthai wheel), from made-up images and scans.

Three nodes, 0.2 m and 0.05 rad apart: a textured wall 2 m away (3 mm farther with each row), and a scan of 180 rays, whose ends lie on
r = 3 + sin(5 a), from a sensor at (0.2, 0, 0.4) that looks 0.3 rad to the left.
"""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from slamcli.rtabmap.database import Database

STORED = Path(__file__).with_name("rtabmap_0_21_12.db.gz")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    unpacked = tmp_path / "made.db"
    unpacked.write_bytes(gzip.decompress(STORED.read_bytes()))
    return unpacked


def test_nodes_links_and_summaries(path: Path) -> None:
    with Database.read(path) as database:
        assert database.version == "0.21.12"
        nodes = database.nodes()
        assert (nodes.ids.tolist(), nodes.stamps_ns.tolist()) == (
            [1, 2, 3],
            [100_000_000_000, 101_000_000_000, 102_000_000_000],
        )
        np.testing.assert_allclose(nodes.T_odom_base[:, 0, 3], [0.0, 0.2, 0.4], atol=1e-6)
        np.testing.assert_allclose(
            np.arctan2(nodes.T_odom_base[:, 1, 0], nodes.T_odom_base[:, 0, 0]), [0.0, 0.05, 0.1], atol=1e-6
        )
        links = database.links()
        assert [(link.from_id, link.to_id) for link in links] == [(1, 2), (2, 3)]
        np.testing.assert_allclose(np.diag(links[0].information), 1000.0, rtol=1e-6)
        optimised = database.optimised()
        assert optimised is not None
        np.testing.assert_allclose(optimised.T_map_base, nodes.T_odom_base, atol=1e-6)
        assert database.last_working_ids().tolist() == [1, 2, 3]
        assert database.parameters()["Kp/MaxFeatures"] == "500"
        assert [entry.node_id for entry in database.read_statistics()] == [1, 2, 3]
        assert len(database.words()[0]) == 3


@pytest.mark.parametrize("node_id", [1, 2])
def test_its_scans_with_and_without_angles(path: Path, node_id: int) -> None:
    with Database.read(path) as database:
        scan = database.read_scan(node_id)
    assert scan is not None
    angles = -1.57 + 0.0174 * np.arange(180)
    ranges = 3.0 + np.sin(5.0 * angles)
    cos, sin = np.cos(0.3), np.sin(0.3)
    x, y = ranges * np.cos(angles), ranges * np.sin(angles)
    expected = np.column_stack([cos * x - sin * y + 0.2, sin * x + cos * y, np.full(180, 0.4)])
    np.testing.assert_allclose(scan.points, expected, atol=2e-6)
    assert (scan.planar, scan.range_max_m) == (True, 9.0)


def test_its_images_and_camera(path: Path) -> None:
    with Database.read(path) as database:
        images = database.read_images(2)
    assert images is not None
    assert images.depth is not None
    assert (images.colour.shape, images.camera.fx, images.camera.cx) == ((48, 64, 3), 40.0, 32.0)
    np.testing.assert_allclose(images.depth, np.repeat((2.0 + 0.003 * np.arange(48))[:, None], 64, axis=1), atol=1e-6)
    red, green, blue = images.colour.reshape(-1, 3).T.astype(int)
    assert (red >= green).all()  # made as t, 2 t / 3 and t / 3
    assert (np.abs(green - 2 * blue) <= 1).all()
    np.testing.assert_allclose(images.T_base_camera[:3, 3], [0.1, 0.0, 0.5], atol=1e-6)


def test_its_local_grids(path: Path) -> None:
    with Database.read(path) as database:
        cells, scan = database.read_local_grid(1), database.read_scan(1)
    assert cells is not None
    assert scan is not None
    assert (len(cells.ground), len(cells.obstacles), cells.cell_size_m) == (0, 180, pytest.approx(0.05))
    np.testing.assert_allclose(cells.view_point, [0.2, 0.0, 0.4], atol=1e-6)
    apart = np.abs(cells.obstacles[:, None] - scan.points[None, :, :2]).max(axis=2).min(axis=1)
    assert apart.max() < 0.05
    assert len(cells.empty) > 1000
    assert np.hypot(*(cells.empty - [0.2, 0.0]).T).max() < 4.1


def test_it_is_continued(path: Path) -> None:
    with Database.append(path) as database:
        signature = database.read_signature(2)
        assert len(signature.features) == 3
        database.add_node(
            type(signature)(**{**{name: getattr(signature, name) for name in signature.__slots__}, "id": 4}), weight=0
        )
    with Database.read(path) as database:
        assert database.nodes().ids.tolist() == [1, 2, 3, 4]
        assert np.array_equal(database.read_signature(4).features.descriptors, signature.features.descriptors)
        assert database.version == "0.21.12"
