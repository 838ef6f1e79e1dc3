# SPDX-License-Identifier: MIT
"""``slamcli map --algo rtabmap`` end to end: the maps that it writes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.clouds import read_cloud
from slamcli.formats.maps import read_map
from slamcli.formats.octomap import read_octomap
from slamcli.rtabmap.node_views import NodeViews

DESK = Path(__file__).parents[2] / "sample_data" / "desk_rgbd.mcap"
WORDS = ["map", "--algo", "rtabmap", str(DESK), "--duration", "1.2", "--dense-voxel", "0.05"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result with everything."""
    out = tmp_path_factory.mktemp("maps") / "desk"
    assert run([*WORDS, "--octomap", "--dense", "texture", "-o", str(out)]) == 0
    return out


def test_everything_is_there(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert {"cloud.ply", "map.yaml", "octomap.bt", "octomap.ot", "octomap.ply", "octomap.yaml", "octomap.pgm"} <= names
    assert {"dense.obj", "dense.mtl", "dense.jpg"} <= names
    assert set(json.loads((folder / "run.json").read_text())["outputs"]) == names


def test_the_maps_are_of_one_place(folder: Path) -> None:
    tree, cloud = read_octomap(folder / "octomap.ot"), read_cloud(folder / "cloud.ply")
    assert cloud.colours is not None
    size = tree.resolution_m
    fine = tree.select(tree.edges == 1)
    occupied = {tuple(cell) for cell in fine.indices[fine.occupied].tolist()}
    seen = {tuple(cell) for cell in np.floor(cloud.points_m / size).astype(int).tolist()}
    # Segmentation takes noise away, and thinned points lie a cell beside what they are of now and then.
    assert len(occupied & seen) > 0.6 * len(occupied)
    assert len(read_cloud(folder / "octomap.ply").points_m) == len(occupied) + (tree.edges[tree.occupied] > 1).sum()
    grid, plane = read_map(folder / "map.yaml").grid, read_map(folder / "octomap.yaml").grid
    assert (grid.cells == 100).any()
    assert (plane.cells == 0).sum() > (grid.cells == 0).sum()  # rays clear more than ground alone


def test_the_octree_is_drawn(folder: Path, tmp_path: Path) -> None:
    assert run(["view", str(folder / "octomap.bt"), "-o", str(tmp_path / "tree.png")]) == 0
    assert (tmp_path / "tree.png").read_bytes()[:4] == b"\x89PNG"


def test_the_nodes_images_come_back_from_the_database(folder: Path) -> None:
    views = list(NodeViews(database=folder / "rtabmap.db", ids=np.array([1]), T_map_base=np.eye(4)[None]))
    assert len(views) == 1
    assert views[0].colour.shape == (*views[0].depth.shape, 3)
    assert 0.3 < np.median(views[0].depth[views[0].depth > 0]) < 5.0


def test_scanners_have_no_octree_and_no_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    laser = DESK.with_name("warehouse.mcap")
    out = tmp_path / "out"
    assert (
        run(
            ["map", "--algo", "rtabmap", str(laser), "--duration", "10", "--octomap", "--dense", "mesh", "-o", str(out)]
        )
        == 0
    )
    said = capsys.readouterr().err
    assert "--octomap: nothing was seen that has a height" in said
    assert "--dense mesh: the nodes have no depth images" in said
    assert (out / "map.yaml").exists()
    assert not list(out.glob("octomap*"))
