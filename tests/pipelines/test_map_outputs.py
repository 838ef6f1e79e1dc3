# SPDX-License-Identifier: MIT
"""One file for each thing that a result has, and none for what it has not."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slamcli.formats.clouds import read_cloud
from slamcli.formats.g2o import read_g2o
from slamcli.formats.maps import read_map
from slamcli.formats.particles import read_particles
from slamcli.formats.trajectories import read_tum
from slamcli.geometry import se3
from slamcli.grids import OccupancyGrid
from slamcli.mapper import MappingResult
from slamcli.measurements import PointCloud
from slamcli.pipelines.map_outputs import RECORDS, OutputChoices, summarise, write_records, write_result
from slamcli.posegraph import Constraint, Id, LoopSearch, MapState, Node, Submap
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory
from slamcli.trajectory.particle_track import particle_track

STAMPS = np.arange(3) * 100_000_000
TRAJECTORY = Trajectory.from_se2(STAMPS, np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0.1]]))


def state():
    nodes = tuple(
        Node(
            id=Id(0, k), stamp_ns=int(STAMPS[k]), T_local_node=np.eye(4), T_map_node=se3.from_se2(TRAJECTORY.poses_se2[k]),
            gravity_alignment_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), points_m=np.zeros((0, 3), dtype=np.float32),
        )
        for k in range(3)
    )  # fmt: skip
    submap = Submap(id=Id(0, 0), T_local_submap=np.eye(4), T_map_submap=np.eye(4), num_range_data=3, finished=True)
    constraints = tuple(
        Constraint(
            submap=submap.id,
            node=node.id,
            T_submap_node=node.T_map_node,
            translation_weight=1.0,
            rotation_weight=1.0,
            kind="intra",
        )
        for node in nodes
    )
    return MapState(nodes=nodes, submaps=(submap,), constraints=constraints)


def written(tmp_path, result, choices=None):
    tmp_path.mkdir(exist_ok=True)
    files = write_result(tmp_path, result, score=None, choices=choices or OutputChoices(), log=RunLog())
    run = {"summary": summarise(result, None), "outputs": sorted([*files.names, *RECORDS])}
    document = write_records(tmp_path, run, result, files, score=None, declared=())
    saved = json.loads((tmp_path / "run.json").read_text())
    assert {"steps": {}} | saved == json.loads(json.dumps(document))
    assert document["outputs"] == sorted(p.name for p in tmp_path.iterdir())
    return set(document["outputs"]), document


def test_a_trajectory_alone(tmp_path):
    names, document = written(tmp_path, MappingResult(trajectory=TRAJECTORY))
    assert names == {"trajectory.tum", *RECORDS}
    assert document["summary"] == {"path_length_m": TRAJECTORY.length_m, "poses": 3}


def test_everything_that_a_graph_has(tmp_path):
    grid = OccupancyGrid(np.zeros((4, 5), dtype=np.int8), 0.5, (0.0, 0.0, 0.0))
    search = LoopSearch(submap=Id(0, 0), node=Id(0, 2), score=0.3, accepted=False, reason="score")
    result = MappingResult(
        trajectory=TRAJECTORY,
        grid=grid,
        keyframes=TRAJECTORY,
        state=state(),
        loop_searches=(search,),
        steps={"stamp_ns": STAMPS},
    )
    names, document = written(tmp_path / "a", result)
    assert {
        "map.yaml",
        "map.pgm",
        "map.png",
        "trajectory.tum",
        "keyframes.tum",
        "constraints.csv",
        "loop_closures.csv",
        *RECORDS,
    } <= names
    np.testing.assert_array_equal(read_tum(tmp_path / "a" / "keyframes.tum").stamps_ns, STAMPS)
    assert document["summary"]["free_m2"] == pytest.approx(5.0)
    assert document["steps"] == {"stamp_ns": STAMPS.tolist()}
    graph = read_g2o(tmp_path / "a" / "graph.g2o")
    assert (len(graph.ids), len(graph.information)) == (4, 3)
    page = (tmp_path / "a" / "report.html").read_text()
    assert "Pose graph" in page
    written(tmp_path / "b", result)
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_particles_of_a_filter(tmp_path):
    track = particle_track(STAMPS.tolist(), [np.zeros((2, 3))] * 3, [np.full(2, 0.5)] * 3)
    names, _ = written(tmp_path, MappingResult(trajectory=TRAJECTORY, particles=track))
    assert names == {"trajectory.tum", "particles.npz", *RECORDS}
    assert read_particles(tmp_path / "particles.npz").poses.shape == (3, 2, 3)


def test_a_graph_without_searches_has_no_table_of_them(tmp_path):
    names, _ = written(tmp_path, MappingResult(trajectory=TRAJECTORY, state=state()))
    assert "constraints.csv" in names
    assert "loop_closures.csv" not in names


@pytest.mark.parametrize(("form", "colour"), [("ply", "height"), ("pcd", "intensity"), ("none", "height")])
def test_a_cloud_in_the_form_that_is_asked_for(tmp_path, form, colour):
    points = np.random.default_rng(0).uniform(0, 5, (50, 3)).astype(np.float32)
    cloud = PointCloud(stamp_ns=0, frame_id="map", points_m=points, intensities=points[:, 0].copy())
    names, _ = written(
        tmp_path,
        MappingResult(trajectory=TRAJECTORY, cloud=cloud),
        OutputChoices(cloud_format=form, cloud_colour=colour),
    )
    assert {name for name in names if name.startswith("cloud")} == ({f"cloud.{form}"} if form != "none" else set())
    if form != "none":
        np.testing.assert_array_equal(read_cloud(tmp_path / f"cloud.{form}").points_m, points)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_the_map_reads_back_in_every_mode(tmp_path, mode):
    cells = np.array([[-1, 0, 100], [0, 0, -1]], dtype=np.int8)
    result = MappingResult(trajectory=TRAJECTORY, grid=OccupancyGrid(cells, 0.5, (0.0, 0.0, 0.0)))
    names, _ = written(tmp_path, result, OutputChoices(map_mode=mode))
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml").grid.cells, cells)
    assert {"map.png", "map-scale.png" if mode == "scale" else "map.pgm"} <= names
