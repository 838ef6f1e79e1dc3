# SPDX-License-Identifier: MIT
"""``slamcli map --algo orbslam3`` end to end: everything it writes, and the dense models."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.clouds import read_cloud
from slamcli.formats.g2o import read_g2o

DESK = Path(__file__).parents[2] / "sample_data" / "desk_rgbd.mcap"
WORDS = ["map", "--algo", "orbslam3", str(DESK), "--duration", "0.6"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Results with a dense cloud, a mesh, and a mesh with pictures."""
    base = tmp_path_factory.mktemp("dense")
    for kind in ("cloud", "mesh", "texture"):
        assert run([*WORDS, "--dense", kind, "--dense-voxel", "0.04", "-o", str(base / kind)]) == 0
    return {kind: base / kind for kind in ("cloud", "mesh", "texture")}


def test_everything_is_there(folders: dict[str, Path]) -> None:
    out = folders["mesh"]
    names = {path.name for path in out.iterdir()}
    assert {
        "atlas.npz",
        "cloud.ply",
        "covisibility.csv",
        "dense.ply",
        "graph.g2o",
        "keyframes.tum",
        "map.yaml",
    } <= names
    document = json.loads((out / "run.json").read_text())
    assert set(document["outputs"]) == names
    assert "--dense mesh --dense-voxel 0.04" in document["command"]
    assert document["summary"]["tracked"] == document["summary"]["frames"] == len(document["steps"]["stamp_ns"])
    assert len(read_g2o(out / "graph.g2o").ids) == document["summary"]["keyframes"]
    points = read_cloud(out / "cloud.ply")
    assert points.colours is not None
    assert np.ptp(points.colours, axis=0).min() > 50
    assert "What the camera saw" in (out / "report.html").read_text()


def test_the_mesh_and_the_cloud_are_of_the_same_place(folders: dict[str, Path]) -> None:
    cloud, mesh = (read_cloud(folders[kind] / "dense.ply") for kind in ("cloud", "mesh"))
    assert len(cloud.points_m) > 3000
    assert len(mesh.points_m) > 3000
    assert cloud.colours is not None
    assert mesh.colours is not None
    cells = [
        {tuple(cell) for cell in np.floor(points / 0.2).astype(int).tolist()}
        for points in (cloud.points_m, mesh.points_m)
    ]
    assert len(cells[0] & cells[1]) > 0.75 * len(cells[0] | cells[1])
    np.testing.assert_allclose(np.median(cloud.colours, axis=0), np.median(mesh.colours, axis=0), atol=12)


def test_open3d_reads_the_triangles(folders: dict[str, Path]) -> None:
    o3d = pytest.importorskip("open3d")
    read = o3d.io.read_triangle_mesh(str(folders["mesh"] / "dense.ply"))
    mesh = read_cloud(folders["mesh"] / "dense.ply")
    np.testing.assert_array_equal(np.asarray(read.vertices, dtype=np.float32), mesh.points_m)
    assert len(read.triangles) > len(mesh.points_m)
    assert np.asarray(read.triangles).max() < len(mesh.points_m)


def test_open3d_reads_the_pictures(folders: dict[str, Path]) -> None:
    o3d = pytest.importorskip("open3d")
    read = o3d.io.read_triangle_mesh(str(folders["texture"] / "dense.obj"))
    mesh = read_cloud(folders["mesh"] / "dense.ply")
    assert len(read.triangles) > 3000
    picture = np.asarray(read.textures[int(np.asarray(read.triangle_material_ids)[0])])
    places = np.asarray(read.triangle_uvs)
    assert places.min() >= 0.0
    assert places.max() <= 1.0
    # Seen at its corners, the picture has the colours of the mesh. open3d turns pictures upside down as it reads them.
    row, column = (places[:, 1] * picture.shape[0]).astype(int), (places[:, 0] * picture.shape[1]).astype(int)
    seen = picture[np.minimum(row, picture.shape[0] - 1), np.minimum(column, picture.shape[1] - 1)]
    assert mesh.colours is not None
    np.testing.assert_allclose(np.median(seen, axis=0), np.median(mesh.colours, axis=0), atol=15)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--mode", "mono"), "--dense cloud: needs depth images (--mode rgbd), and this is mono"),
        (("--dense", "none", "--dense-range", "2"), "--dense-voxel and --dense-range go with --dense cloud"),
        (("--octomap",), "--octomap: octrees are made by systems that keep what their sensors saw"),
        (("--dense-voxel", "0"), "Invalid value for '--dense-voxel'"),
    ],
)
def test_wrong_use_is_one_line(
    tmp_path: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run([*WORDS, "--dense", "cloud", "-o", str(out), *words]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not out.exists()


def test_scanners_have_no_dense_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corridor = DESK.with_name("loop_corridor.mcap")
    assert run(["map", str(corridor), "--dense", "mesh", "-o", str(tmp_path / "out")]) == 2
    assert "--dense mesh: is made from depth images" in capsys.readouterr().err
