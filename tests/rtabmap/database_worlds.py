# SPDX-License-Identifier: MIT
"""Small nodes to write into databases."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.rtabmap.database import Database, GeoFix
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.local_grid import LocalGrid
from slamcli.rtabmap.signature import NodeImages, NodeScan, Signature, no_features
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

OPTICAL = np.array([[0.0, 0.0, 1.0, 0.1], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
BEGIN_NS = 1_700_000_000_123_456_789
PARAMETERS = "Kp/MaxFeatures:500;Mem/STMSize:10;Rtabmap/DetectionRate:1"


@contextmanager
def raw(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a database as it is, and commit and close it."""
    with closing(sqlite3.connect(path)) as connection, connection:
        yield connection


def pose(x: float, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    T[:3, 3] = [x, y, 0.0]
    return T


def features(count: int, rng: np.random.Generator) -> Features:
    pixels = rng.uniform(0.0, 60.0, (count, 2))
    octaves = rng.integers(0, 4, count)
    return Features(
        pixels=pixels, octaves=octaves, angles=rng.uniform(0.0, 6.28, count), responses=rng.uniform(0.0, 1.0, count),
        descriptors=rng.integers(0, 256, (count, 32), dtype=np.uint8), sigmas=1.2**octaves, right=np.full(count, np.nan),
        depth=np.full(count, np.nan), raw_pixels=pixels,
    )  # fmt: skip


def signature(node_id: int, *, count: int = 20, scan: NodeScan | None = None, map_id: int = 0) -> Signature:
    rng = np.random.default_rng(node_id)
    points = rng.uniform(1.0, 4.0, (count, 3))
    points[count // 2 :: 3] = np.nan
    words = np.arange(1, count + 1) + 100 * node_id
    words[-count // 4 :] = 0
    return Signature(
        id=node_id, map_id=map_id, stamp_ns=BEGIN_NS + node_id * 1_000_000_001, T_odom_base=pose(0.5 * node_id, 0.1, 0.05 * node_id),
        features=features(count, rng) if count else no_features(), points=points, word_ids=words.astype(np.int64), scan=scan,
    )  # fmt: skip


def images(node_id: int, *, stereo: bool = False) -> NodeImages:
    rows, columns = np.mgrid[:48, :64]
    colour = np.dstack([rows * 5, columns * 3, np.full_like(rows, node_id)]).astype(np.uint8)
    camera = Pinhole(fx=50.0, fy=51.0, cx=32.5, cy=24.0, width=64, height=48, baseline_m=0.12 if stereo else 0.0)
    depth = np.where(columns > 5, 1000 + rows * 10 + node_id, 0) / 1000.0
    return NodeImages(
        colour=colour, camera=camera, T_base_camera=OPTICAL, depth=None if stereo else depth.astype(np.float32),
        right=colour[:, :, 0] if stereo else None,
    )  # fmt: skip


def planar_scan() -> NodeScan:
    angles = np.linspace(-2.0, 2.0, 90)
    T_base_sensor = pose(0.2, -0.05, 0.3)
    T_base_sensor[2, 3] = 0.4
    local = np.column_stack([3.0 * np.cos(angles), 3.0 * np.sin(angles), np.zeros(90)])
    points = (local @ T_base_sensor[:3, :3].T + T_base_sensor[:3, 3]).astype(np.float32)
    return NodeScan(
        points=points[:80], planar=True, T_base_sensor=T_base_sensor, range_max_m=12.0, open_ends=points[80:] * 4
    )


def link(from_id: int, to_id: int, kind: LinkKind = LinkKind.NEIGHBOR) -> Link:
    return Link(
        from_id=from_id,
        to_id=to_id,
        kind=kind,
        T_from_to=pose(0.5, 0.0, 0.05),
        information=np.diag([100.0, 90, 80, 700, 600, 500]),
    )


def local_grid() -> LocalGrid:
    rng = np.random.default_rng(5)
    ground, obstacles = rng.normal(size=(40, 2)).astype(np.float32), rng.normal(size=(10, 2)).astype(np.float32)
    return LocalGrid(
        ground=ground,
        obstacles=obstacles,
        empty=np.zeros((0, 2), np.float32),
        cell_size_m=0.05,
        view_point=np.array([0.1, 0.0, 0.4]),
    )


def fix() -> GeoFix:
    return GeoFix(
        stamp_ns=BEGIN_NS, longitude_deg=-71.9, latitude_deg=45.4, altitude_m=200.0, accuracy_m=2.0, bearing_deg=90.0
    )


def fill(database: Database, count: int = 4, *, first: int = 1) -> None:
    """Write a small session."""
    for node_id in range(first, first + count):
        database.add_node(
            signature(node_id, scan=planar_scan() if node_id % 2 else None), weight=node_id % 3, label="map0" if node_id == 1 else None,
            images=images(node_id, stereo=node_id % 4 == 3), local_grid=local_grid() if node_id % 2 else None,
            ground_truth=pose(node_id), gps=fix(), velocity=np.arange(6.0),
        )  # fmt: skip
        if node_id > 1:
            database.add_links([link(node_id - 1, node_id)])
        words = np.arange(1, 16) + 100 * node_id
        database.add_words(words, np.random.default_rng(node_id).integers(0, 256, (15, 32), dtype=np.uint8))
        database.add_statistics(
            node_id, BEGIN_NS, {"Loop/Id/": 0.0, "Timing/Total/ms": 12.5 + np.random.default_rng().random()}
        )
        database.commit()


def written(path: Path, count: int = 4, *, jobs: int = 1) -> Path:
    """Return a database with a small session."""
    with Database.create(path, PARAMETERS, jobs=jobs) as database:
        fill(database, count)
        ids = np.arange(1, count + 1)
        database.set_optimised(ids, np.array([pose(0.5 * i) for i in ids]), pose(9.0))
        database.set_info(PARAMETERS, stm_size=2, last_id=count, num_words=15 * count, working_ids=ids[1:].tolist())
    return path
