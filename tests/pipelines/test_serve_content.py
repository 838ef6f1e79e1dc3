# SPDX-License-Identifier: MIT
"""What the player is given of a result: arrays in the order of time, small enough, in types that a browser reads."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import hashlib
import json
import re

import numpy as np
import player_result
import pytest
import small_result as small

from slamcli.errors import UsageError
from slamcli.measurements import PointCloud
from slamcli.pipelines import serve
from slamcli.pipelines.replay import load_replay
from slamcli.pipelines.replay_tracks import GraphTrack, SubmapTrack
from slamcli.pipelines.serve import export_player
from slamcli.pipelines.serve_content import player_content
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return player_result.write(tmp_path_factory.mktemp("content"))


@pytest.fixture(scope="module")
def replay(result):
    return load_replay(result, truth=result.parent / "truth.tum")


@pytest.fixture(scope="module")
def content(replay):
    return player_content(replay)


def test_poses_map_and_truth(content, replay):
    arrays = content.arrays
    np.testing.assert_allclose(arrays["time"], np.arange(small.STEPS) * 0.5)
    np.testing.assert_allclose(arrays["pose"], small.poses_se2(), atol=1e-6)
    np.testing.assert_array_equal(arrays["cells"], replay.grid.cells)
    np.testing.assert_array_equal(arrays["first_seen"], replay.first_seen)
    assert content.facts["map"] == {"width": 82, "height": 32, "resolution_m": 0.1, "origin": [-0.1, -0.1, 0.0]}
    assert (content.facts["poses"], content.facts["duration_s"], content.facts["axes"]) == (20, 9.5, ["x", "y"])
    np.testing.assert_allclose(content.facts["bounds_m"], [-0.1, -0.1, 8.1, 3.1])
    assert arrays["truth"].shape == (small.STEPS, 2)
    assert content.facts["notes"] == []


def test_every_array_is_declared_and_of_a_type_that_the_page_knows(content):
    declared = content.facts["arrays"]
    assert declared.keys() == content.arrays.keys()
    script = serve.player_script()
    for name, array in content.arrays.items():
        assert declared[name]["dtype"] == str(array.dtype)
        assert f"{array.dtype}:" in script
    json.dumps(content.facts, allow_nan=False)


def test_scans_come_back_within_half_a_unit(content, replay):
    facts, arrays = content.facts, content.arrays
    points = arrays["scan_point"] * facts["scan_unit_m"] + np.array(facts["scan_origin_m"])
    assert np.abs(points - replay.scans.points_m).max() <= facts["scan_unit_m"] / 2 + 1e-6
    assert facts["scan_unit_m"] == 0.002
    np.testing.assert_array_equal(arrays["scan_offset"], replay.scans.offsets)


def test_fewer_scans_and_images_where_asked(replay):
    thinned = player_content(replay, scan_points=len(replay.scans.points_m) // 2, images=2).arrays
    assert thinned["scan_time"].tolist() == np.arange(0, 10, 1.0).tolist()
    offsets = replay.scans.offsets
    assert thinned["scan_offset"][2] == offsets[1] + offsets[3] - offsets[2]
    assert len(thinned["image_time"]) == 2


def test_particles_graph_and_marks(content):
    facts, arrays = content.facts, content.arrays
    assert (facts["particles"], arrays["particle"].shape) == (8, (small.STEPS, 8, 3))
    np.testing.assert_allclose(arrays["node_time"], [0.0, 2.5, 7.5])
    assert arrays["edge"].tolist() == [[0, 1], [1, 2], [0, 2]]
    assert arrays["edge_kind"].tolist() == [0, 0, 1]
    assert arrays["edge_class"].tolist() == [9, 9, 1]  # 0.07 m; the way from node to node has no residual
    assert facts["marks"] == {"closure": [7.5], "resampling": [6.0]}
    assert [chart["title"] for chart in facts["charts"]] == [
        "Points of each scan",
        "Effective number of particles",
    ]
    np.testing.assert_allclose(arrays[facts["charts"][1]["values"]], np.linspace(8, 3, small.STEPS), rtol=1e-6)
    assert arrays[facts["charts"][1]["marks"]].tolist() == [6.0]


def test_images_are_those_of_the_nodes(content):
    assert content.facts["images"] == [{"topic": "/camera/image", "first": 0, "count": 3}]
    np.testing.assert_allclose(content.arrays["image_time"], [0.0, 2.5, 7.5])
    assert content.images[0](16)[:2] == b"\xff\xd8"


def test_a_clock_that_runs_backwards_waits_and_a_graph_is_sorted(replay):
    stamps = small.stamps_ns()
    back = stamps.copy()
    back[5] = back[3]
    trajectory = dataclasses.replace(replay.trajectory, stamps_ns=back)
    graph = GraphTrack(
        stamps_ns=stamps[[4, 2]], positions_m=np.array([[4.0, 0, 0], [2.0, 0, 0]]), edges=np.array([[0, 1], [1, 0]]),
        kinds=np.array([1, 0], dtype=np.uint8), edge_stamps_ns=stamps[[9, 4]], residual_m=np.array([0.1, np.nan]), residual_rad=np.array([0.5, np.nan]),
    )  # fmt: skip
    arrays = player_content(dataclasses.replace(replay, trajectory=trajectory, graph=graph)).arrays
    assert arrays["time"][4:7].tolist() == [2.0, 2.0, 3.0]
    assert arrays["node"][:, 0].tolist() == [2.0, 4.0]
    assert arrays["edge"].tolist() == [[0, 1], [1, 0]]
    assert arrays["edge_time"].tolist() == [2.0, 4.5]
    assert arrays["edge_class"].tolist() == [9, 3]  # the worse of both residuals counts


def test_far_coordinates_keep_their_millimetres(replay):
    far = np.array([600_000.0, 5_000_000.0, 0.0])
    trajectory = dataclasses.replace(replay.trajectory, positions_m=replay.trajectory.positions_m + far)
    content = player_content(dataclasses.replace(replay, trajectory=trajectory, grid=None, scans=None, particles=None))
    shift = np.array(content.facts["shift_m"])
    np.testing.assert_allclose(content.arrays["pose"][:, :2] + shift, trajectory.positions_m[:, :2], atol=1e-3)


def test_what_is_seen_from_the_side_without_a_map(replay):
    positions = np.column_stack([np.zeros(small.STEPS), np.zeros(small.STEPS), np.linspace(0, 9, small.STEPS)])
    trajectory = Trajectory(small.stamps_ns(), positions, np.tile([0.0, 0.0, 0.0, 1.0], (small.STEPS, 1)), "map", "cam")
    cloud = PointCloud(
        stamp_ns=0, frame_id="map",
        points_m=np.array([[0, 3, 1], [1, 1, 2], [0, np.nan, 0], [2, 2, 3]], dtype=np.float32),
    )  # fmt: skip
    bare = dataclasses.replace(replay, trajectory=trajectory, grid=None, first_seen=None, cloud=cloud, scans=None)
    content = player_content(bare)
    assert content.facts["axes"] == ["x", "z"]
    np.testing.assert_allclose(content.arrays["pose"][-1], [0.0, 9.0, np.pi / 2])
    assert content.arrays["cloud"].tolist() == [[1, 2], [2, 3], [0, 1]]  # by y, which nobody sees
    assert np.all(np.diff(content.arrays["cloud_height"].astype(int)) >= 0)


@pytest.mark.parametrize(
    ("quat_xyzw", "front"),
    [((0.0, 0.0, 0.0, 1.0), 0.0), ((-0.5, 0.5, -0.5, 0.5), 0.0), ((0.5, 0.5, 0.5, 0.5), 0.0), ((-0.7071068, 0.0, 0.0, 0.7071068), np.pi / 2)],
    ids=["a robot along x", "a camera that looks along x", "the same upside down", "a camera that looks along y"],
)  # fmt: skip
def test_where_robots_and_cameras_point_to(replay, quat_xyzw, front):
    trajectory = dataclasses.replace(replay.trajectory, quats_xyzw=np.tile(quat_xyzw, (small.STEPS, 1)))
    pose = player_content(dataclasses.replace(replay, trajectory=trajectory)).arrays["pose"]
    np.testing.assert_allclose(pose[:, 2], front, atol=1e-6)


def test_submaps_in_the_order_in_which_they_were_begun(replay):
    stamps = small.stamps_ns()
    outlines = np.arange(16.0).reshape(2, 4, 2)
    submaps = SubmapTrack(
        names=("a", "b"), begun_ns=stamps[[4, 0]], finished_ns=stamps[[9, 5]], outlines_m=outlines,
        heights_m=np.zeros(2), grids=(None, None),
    )  # fmt: skip
    arrays = player_content(dataclasses.replace(replay, submaps=submaps)).arrays
    assert arrays["submap_begun"].tolist() == [0.0, 2.0]
    assert arrays["submap_finished"].tolist() == [2.5, 4.5]
    assert arrays["submap"][0, 0].tolist() == [8.0, 9.0]


def test_a_record_without_statistics_or_with_odd_ones(replay):
    for steps in (
        None,
        [],
        {"stamp_ns": [1.5]},
        {"neff": [1]},
        {"stamp_ns": [1, 2], "neff": [1.0, None], "x": ["a", "b"]},
    ):
        facts = player_content(dataclasses.replace(replay, run={"steps": steps})).facts
        assert facts["charts"] == []


def test_one_file_holds_everything_and_allows_nothing_else(result, tmp_path, content):
    target = tmp_path / "page.html"
    size = export_player(result, target, truth=result.parent / "truth.tum", log=RunLog())
    text = target.read_text()
    assert size == target.stat().st_size
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)[1]
    for kind, mark in (("style", "<style>"), ("script", "<script>")):
        inner = text.partition(mark)[2].partition(f"</{kind}>")[0]
        assert f"{kind}-src 'sha256-{base64.b64encode(hashlib.sha256(inner.encode()).digest()).decode()}'" in policy
    assert policy.startswith("default-src 'none';img-src data:;")
    assert player_result.facts_of(text)["arrays"] == content.facts["arrays"]
    pose = re.search('id="data-pose">([^<]*)<', text)[1]
    np.testing.assert_array_equal(
        np.frombuffer(gzip.decompress(base64.b64decode(pose)), "<f4").reshape(-1, 3), content.arrays["pose"]
    )
    assert len(re.findall('id="data-image-', text)) == 3
    assert "http://" not in text.replace("http://www.w3.org", "")
    again = tmp_path / "again.html"
    export_player(result, again, truth=result.parent / "truth.tum", log=RunLog())
    assert again.read_bytes() == target.read_bytes()
    export_player(result, again, title="A <room>", log=RunLog())
    assert player_result.facts_of(again.read_text())["title"] == "A <room>"
    assert "<title>A &lt;room&gt;</title>" in again.read_text()


def test_a_page_that_would_be_too_large_is_refused(result, tmp_path, monkeypatch):
    monkeypatch.setattr(serve, "MOST_EXPORT_BYTES", 1000)
    with pytest.raises(UsageError, match="--serve plays results of any size"):
        export_player(result, tmp_path / "page.html", log=RunLog())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError, match=r"name ends with \.html"):
        export_player(result, tmp_path / "page.txt", log=RunLog())


def test_a_title_cannot_become_markup(replay):
    bad = dataclasses.replace(replay, name="</script><script>alert(1)</script>")
    page = serve.standalone_page(player_content(bad).facts, {}, [])
    assert "<script>alert" not in page
    assert player_result.facts_of(page)["title"] == bad.name
