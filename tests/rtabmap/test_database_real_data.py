# SPDX-License-Identifier: MIT
"""Databases that RTAB-Map 0.23.8 wrote: read, written again, and compared field by field."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path

import database_worlds as worlds
import numpy as np
import pytest

from slamcli.rtabmap.database import Database
from slamcli.rtabmap.database.blobs import unpack_matrix

STATES = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).parents[2].parent / "shared" / "data")) / "states"
NAMES = ("redkitchen50", "kitti06")
pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not (STATES / "kitti06.db").exists(), reason=f"no {STATES}: set SLAMCLI_TEST_DATA"),
]


def copied(source: Path, path: Path) -> Path:
    """Read a database and write everything again."""
    with Database.read(source) as old:
        nodes, parameters = old.nodes(), ";".join(f"{name}:{value}" for name, value in old.parameters().items())
        statistics = {entry.node_id: entry for entry in old.read_statistics()}
        with Database.create(path, parameters, jobs=2) as new:
            for row, node_id in enumerate(nodes.ids.tolist()):
                truth = nodes.ground_truth[row]
                new.add_node(
                    old.read_signature(node_id), weight=int(nodes.weights[row]), label=nodes.labels[row], images=old.read_images(node_id),
                    ground_truth=truth if np.isfinite(truth).all() else None, local_grid=old.read_local_grid(node_id),
                )  # fmt: skip
                new.add_statistics(node_id, statistics[node_id].stamp_ns, statistics[node_id].values)
                new.commit()
            new.add_links(old.links())
            new.add_words(*old.words())
            optimised = old.optimised()
            assert optimised is not None
            new.set_optimised(optimised.ids, optimised.T_map_base, optimised.T_map_last)
    return path


@pytest.fixture(scope="module", params=NAMES)
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    source = STATES / f"{request.param}.db"
    return source, copied(source, tmp_path_factory.mktemp("databases") / "copy.db")


def both(pair: tuple[Path, Path], query: str) -> tuple[list[tuple], list[tuple]]:
    answers = []
    for path in pair:
        connection = sqlite3.connect(f"file:{path}?immutable=1", uri=True)
        answers.append(connection.execute(query).fetchall())
        connection.close()
    return answers[0], answers[1]


def poses(blobs: list[tuple]) -> np.ndarray:
    return np.array([np.frombuffer(blob, dtype="<f4") for (blob,) in blobs if blob])


def test_the_tables_are_the_same(pair: tuple[Path, Path]) -> None:
    for kind in ("table", "index", "trigger"):
        old, new = both(pair, f"SELECT name, tbl_name FROM sqlite_master WHERE type='{kind}' ORDER BY name")  # noqa: S608
        assert old == new
    for (table,) in both(pair, "SELECT name FROM sqlite_master WHERE type='table'")[0]:
        for pragma in ("table_info", "foreign_key_list", "index_list"):
            old, new = both(pair, f"PRAGMA {pragma}({table})")
            assert old == new, table
    triggers = [
        [" ".join(sql.split()) for (sql,) in side]
        for side in both(pair, "SELECT sql FROM sqlite_master WHERE type IN ('index', 'trigger') ORDER BY name")
    ]
    assert triggers[0] == triggers[1]
    assert both(pair, "SELECT version FROM Admin")[1] == [("0.23.8",)]


@pytest.mark.parametrize(
    "query",
    [
        "SELECT id, map_id, weight, stamp, label, gps, env_sensors FROM Node ORDER BY id",
        "SELECT id, depth_confidence, scan, scan_info, ground_cells, obstacle_cells, empty_cells, cell_size, view_point_x FROM Data ORDER BY id",
        "SELECT id, length(image) > 0, depth IS NULL FROM Data ORDER BY id",
        "SELECT from_id, to_id, type, information_matrix, user_data FROM Link ORDER BY from_id, to_id",
        "SELECT id, descriptor_size, descriptor FROM Word ORDER BY id",
        "SELECT node_id, max(word_id, 0), pos_x, pos_y, response, octave, depth_x, depth_y, depth_z, descriptor_size, descriptor FROM Feature ORDER BY rowid",
        "SELECT node_id, COUNT(DISTINCT word_id) FROM Feature WHERE word_id < 0 GROUP BY node_id",
        "SELECT parameters FROM Info ORDER BY rowid DESC LIMIT 1",
        "SELECT opt_ids FROM Admin",
        "SELECT id, stamp FROM Statistics ORDER BY id",
    ],
)  # fmt: skip
def test_fields_are_the_same_bytes(pair: tuple[Path, Path], query: str) -> None:
    old, new = both(pair, query)
    assert old == new
    assert old


def test_calibrations_are_the_same(pair: tuple[Path, Path]) -> None:
    """Byte for byte, but for K of pairs and, to the last bit, the offset of the right camera, which is fx times the baseline.

    RTAB-Map 0.23.8 wrote nine numbers of P in its order of rows, with four columns, where K belongs.
    """
    old, new = both(pair, "SELECT calibration FROM Data WHERE image IS NOT NULL ORDER BY id")
    for (a,), (b,) in zip(old, new, strict=True):
        assert len(a) == len(b)
        if len(a) == 164:
            assert a == b
            continue
        for begin in (40, 300):  # header, K, P, pose of the left and of the right camera
            assert a[begin : begin + 44] == b[begin : begin + 44]
            p_a, p_b = (np.frombuffer(blob, "<f8", 12, begin + 44 + 72) for blob in (a, b))
            np.testing.assert_allclose(p_a, p_b, rtol=1e-15)
            assert a[begin + 44 + 168 : begin + 260] == b[begin + 44 + 168 : begin + 260]
            assert np.frombuffer(a, "<f8", 9, begin + 44).tolist() == p_a[:9].tolist()
            assert np.frombuffer(b, "<f8", 9, begin + 44).reshape(3, 3).tolist() == p_a.reshape(3, 4)[:, :3].tolist()
    with Database.read(pair[0]) as database:
        (camera,) = database.read_cameras(1)
        assert camera.intrinsics is not None
        assert np.array_equal(camera.intrinsics, camera.pinhole.matrix)


def test_depth_is_the_same_bytes_and_jpeg_looks_the_same(pair: tuple[Path, Path]) -> None:
    old, new = both(pair, "SELECT depth FROM Data WHERE depth IS NOT NULL ORDER BY id")
    if old[0][0].startswith(b"DEPTHRVL"):
        assert old == new
    with Database.read(pair[0]) as first, Database.read(pair[1]) as second:
        ids = first.nodes().ids[first.nodes().weights >= 0].tolist()
        for node_id in ids[::5]:
            a, b = first.read_images(node_id), second.read_images(node_id)
            assert a is not None
            assert b is not None
            assert np.abs(a.colour.astype(int) - b.colour).mean() < 1.5
            assert (a.depth is None) == (b.depth is None)
            assert (a.right is None) == (b.right is None)


@pytest.mark.parametrize(
    "query",
    [
        "SELECT pose FROM Node",
        "SELECT ground_truth_pose FROM Node",
        "SELECT transform FROM Link ORDER BY from_id, to_id",
    ],
)
def test_poses_are_the_same_to_float32(pair: tuple[Path, Path], query: str) -> None:
    old, new = both(pair, query)
    np.testing.assert_allclose(poses(old), poses(new), rtol=1e-6, atol=2e-6)


def test_the_optimised_graph_is_the_same(pair: tuple[Path, Path]) -> None:
    (old,), (new,) = both(pair, "SELECT opt_poses FROM Admin")
    np.testing.assert_allclose(unpack_matrix(old[0]), unpack_matrix(new[0]), atol=2e-6)
    np.testing.assert_allclose(*map(poses, both(pair, "SELECT opt_last_localization FROM Admin")), atol=2e-6)


def test_what_is_in_them() -> None:
    with Database.read(STATES / "redkitchen50.db") as database:
        assert (database.version, len(database.nodes()), len(database.links()), len(database.words()[0])) == (
            "0.23.8",
            50,
            49,
            1131,
        )
        assert database.parameters()["Kp/MaxFeatures"] == "500"
        images = database.read_images(16)
        assert images is not None
        assert images.depth is not None
        assert (images.colour.shape, images.depth.shape, images.camera.fx) == ((480, 640, 3), (480, 640), 585.0)
        assert 0.5 < np.median(images.depth[images.depth > 0]) < 3.0
        signature = database.read_signature(16)
        assert (len(signature.features), np.count_nonzero(signature.word_ids)) == (835, 500)
        pixel = signature.features.pixels[0].astype(int)
        assert signature.features.depth[0] == pytest.approx(images.depth[pixel[1], pixel[0]], abs=0.02)
        assert len(database.last_working_ids()) == 50
    with Database.read(STATES / "kitti06.db") as database:
        stereo = database.read_images(6)
        assert stereo is not None
        assert stereo.right is not None
        assert (stereo.colour.shape, stereo.right.shape) == ((370, 1226), (370, 1226))
        assert stereo.camera.baseline_m == pytest.approx(0.53715, abs=1e-5)
        assert database.read_statistics()[20].values["Odometry/Features/"] > 500


def test_a_database_of_rtabmap_is_continued(tmp_path: Path) -> None:
    path = tmp_path / "redkitchen50.db"
    path.write_bytes((STATES / "redkitchen50.db").read_bytes())
    with Database.append(path, "Kp/MaxFeatures:300") as database:
        worlds.fill(database, 2, first=51)
        assert len(database.nodes()) == 52
    with Database.read(path) as database:
        assert database.read_signature(16).features.pixels.shape == (835, 2)
        assert database.read_signature(52).features.pixels.shape == (20, 2)
        assert database.parameters() == {"Kp/MaxFeatures": "300"}
