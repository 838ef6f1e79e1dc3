# SPDX-License-Identifier: MIT
"""Replays: the growing map, scans in the map, where the recording is found, and what is damaged."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import small_result as small

from slamcli.errors import FormatError, InputError, UsageError
from slamcli.grids import OccupancyGrid
from slamcli.pipelines.replay import load_replay
from slamcli.runtime import RunLog


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Return a folder with a recording and a result of it."""
    folder = tmp_path_factory.mktemp("replay")
    small.write_recording(folder / "room.mcap")
    small.write_result(folder / "result", folder / "room.mcap")
    return folder


def test_the_map_grows_as_the_scans_reach_it(place):
    replay = load_replay(place / "result")
    assert (replay.name, replay.algo, replay.growth) == ("result", "gmapping", "scans")
    assert replay.recording == ((place / "room.mcap").resolve(),)
    column_at = [(replay.grid.map_to_cell([[x, 1.5]])[0, 1]) for x in (1.25, 3.05, 7.95)]
    middle = replay.first_seen[replay.grid.map_to_cell([[0.0, 1.5]])[0, 0]]
    # The scanner sits at 1.2 m: 1.25 is seen at once. Only beams that hit a wall clear: ahead that is the one to the far wall.
    assert middle[column_at[0]] == 0
    far = small.LENGTH_M - small.REACH_M - small.MOUNT_M
    first = int(np.argmax(small.poses_se2()[:, 0] >= far))
    assert 0 < middle[column_at[1]] < middle[column_at[2]] == first
    assert np.array_equal(replay.first_seen >= 0, replay.grid.cells >= 0)
    known = [np.count_nonzero(replay.map_at(i).cells >= 0) for i in range(small.STEPS)]
    assert known == sorted(known)
    assert np.array_equal(replay.map_at(small.STEPS - 1).cells, replay.grid.cells)
    assert known[0] < 0.55 * known[-1]


def test_scans_lie_on_the_walls_of_the_map(place):
    scans = load_replay(place / "result").scans
    assert scans.stamps_ns.tolist() == small.stamps_ns().tolist()
    assert scans.pose_index.tolist() == list(range(small.STEPS))
    x, y = scans.points_m.T.astype(np.float64)
    away = np.min(np.abs([x, small.LENGTH_M - x, y, small.WIDTH_M - y]), axis=0)
    assert away.max() < 1e-5
    assert scans.offsets[-1] == len(scans.points_m)
    assert scans.points_m.dtype == np.float32


def test_reach_of_the_tier_shortens_rays(place, tmp_path):
    small.write_result(tmp_path / "near", place / "room.mcap", parameters={"maxUrange": 1.0})
    near = load_replay(tmp_path / "near", recording=[place / "room.mcap"])
    whole = load_replay(place / "result")
    at_first = [np.count_nonzero(replay.first_seen == 0) for replay in (near, whole)]
    assert at_first[0] < 0.8 * at_first[1]


def test_without_the_recording_the_finished_map_says_what_can_be_seen(place, tmp_path):
    log = RunLog()
    small.write_result(tmp_path / "alone", place / "room.mcap")
    replay = load_replay(tmp_path / "alone", log=log)
    assert (replay.growth, replay.scans, replay.images, replay.recording) == ("visibility", None, (), ())
    assert "room.mcap) is neither beside it nor here; --recording names it" in log.notes[0]
    assert replay.first_seen[replay.grid.map_to_cell([[7.9, 1.5]])[0, 0]].max() <= small.STEPS - 1
    assert np.count_nonzero(replay.first_seen == 0) < np.count_nonzero(replay.grid.cells >= 0)


def test_a_named_recording_is_taken_and_one_of_another_size_is_not_found(place, tmp_path):
    small.write_result(tmp_path / "result", place / "room.mcap")
    (tmp_path / "room.mcap").write_bytes(b"another")
    assert load_replay(tmp_path / "result").growth == "visibility"
    assert load_replay(tmp_path / "result", recording=[place / "room.mcap"]).growth == "scans"
    with pytest.raises(InputError):
        load_replay(tmp_path / "result", recording=[tmp_path / "room.mcap"])


def test_the_same_files_give_the_same_replay(place):
    first, second = (load_replay(place / "result") for _ in range(2))
    assert first.first_seen.tobytes() == second.first_seen.tobytes()
    assert first.scans.points_m.tobytes() == second.scans.points_m.tobytes()


def test_ground_truth_is_laid_over_the_trajectory(place):
    replay = load_replay(place / "result", truth=place / "result" / "trajectory.tum")
    assert np.abs(replay.truth.positions_m - replay.trajectory.positions_m).max() < 1e-9


def test_a_map_that_the_robot_knew_is_there_from_the_beginning(place, tmp_path):
    folder = small.write_result(
        tmp_path / "localised", place / "room.mcap", algo="amcl", command="slamcli localize room.mcap --map map.yaml"
    )
    (tmp_path / "known").mkdir()
    for name in ("map.yaml", "map.pgm"):
        (folder / name).rename(tmp_path / "known" / name)
    content = (tmp_path / "known" / "map.yaml").read_bytes()
    (tmp_path / "another").mkdir()  # of one name and size, and first in the order of folders
    (tmp_path / "another" / "map.yaml").write_bytes(content[:-2] + b"9" + content[-1:])
    run = json.loads((folder / "run.json").read_text())
    entry = {"name": "map.yaml", "size_bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    (folder / "run.json").write_text(json.dumps({**run, "inputs": [*run["inputs"], entry]}))
    log = RunLog()
    replay = load_replay(folder, recording=[place / "room.mcap"], log=log)
    assert (replay.growth, replay.first_seen) == ("none", None)
    np.testing.assert_array_equal(replay.grid.cells, small.room().cells)
    assert len(replay.scans.stamps_ns) == small.STEPS
    assert log.warnings == []
    (tmp_path / "known" / "map.yaml").unlink()
    assert load_replay(folder).grid is None


def test_a_drive_of_the_simulator_has_no_recording_to_look_for(place, tmp_path):
    folder = small.write_result(tmp_path / "drive", place / "room.mcap", command="slamcli navigate 1,2 --map map.yaml")
    log = RunLog()
    assert load_replay(folder, log=log).recording == ()
    assert log.notes == []


def test_particles_are_read_and_checked(place, tmp_path):
    folder = small.write_result(tmp_path / "result", place / "room.mcap")
    poses = np.zeros((2, 5, 3), np.float32)
    stamps = small.stamps_ns()[:2]
    np.savez(folder / "particles.npz", stamps_ns=stamps, poses=poses, weights=np.full((2, 5), 0.2, np.float32))
    particles = load_replay(folder).particles
    assert particles.poses.shape == (2, 5, 3)
    assert particles.weights.sum() == pytest.approx(2.0)
    log = RunLog()
    np.savez(folder / "particles.npz", stamps_ns=stamps, poses=poses, weights=np.zeros((2, 4)))
    assert load_replay(folder, log=log).particles is None
    assert "weights (2, 4) do not fit" in log.warnings[0]
    (folder / "particles.npz").write_bytes(b"no archive")
    assert load_replay(folder, log=log).particles is None
    assert "cannot be read as a track of particles" in log.warnings[1]


def test_edges_of_keyframes_come_with_their_later_end(place, tmp_path):
    folder = small.write_result(tmp_path / "result", place / "room.mcap")
    lines = [f"{i}.500000000 {i} 0 0 0 0 0 1" for i in range(3)]
    (folder / "keyframes.tum").write_text("\n".join(lines) + "\n", encoding="utf-8")
    head = "node_a,node_b,stamp_a_s,stamp_b_s,kind,translation_residual_m"
    rows = ["1,2,0.500000000,1.500000000,odometry,0.25", "3,1,2.500000000,0.500000000,loop,", "9,1,9.0,0.5,loop,1"]
    (folder / "links.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    graph = load_replay(folder).graph
    assert graph.edges.tolist() == [[0, 1], [2, 0]]
    assert [graph.KINDS[kind] for kind in graph.kinds.tolist()] == ["sequence", "loop"]
    assert graph.edge_stamps_ns.tolist() == [1_500_000_000, 2_500_000_000]
    assert graph.residual_m[0] == 0.25
    assert np.isnan(graph.residual_m[1])
    (folder / "links.csv").write_text(f"{head}\n1,2,x,1.5,odometry,\n", encoding="utf-8")
    with pytest.raises(FormatError, match=r"links\.csv: line 2: no edge of a graph"):
        load_replay(folder)


def test_a_folder_without_a_trajectory_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"no trajectory\.tum in it"):
        load_replay(tmp_path)


@pytest.mark.parametrize("damage", ["{", "[]", "{}", '{"inputs": 5, "topics": 3, "frames": []}'])
def test_a_damaged_record_of_the_run_is_no_obstacle(place, tmp_path, damage):
    folder = small.write_result(tmp_path / "result", place / "room.mcap")
    (folder / "run.json").write_text(damage, encoding="utf-8")
    replay = load_replay(folder)
    assert replay.growth == "visibility"
    assert replay.trajectory.child_frame_id == "base_link"


def test_an_input_that_names_a_path_is_not_followed(place, tmp_path):
    folder = small.write_result(tmp_path / "result", place / "room.mcap")
    run = json.loads((folder / "run.json").read_text())
    run["inputs"][0]["name"] = str(place / "room.mcap")
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    assert load_replay(folder).recording == ()


def test_a_map_that_no_pose_can_see_does_not_grow(place, tmp_path):
    folder = small.write_result(tmp_path / "result", place / "room.mcap")
    far = small.poses_se2() + np.array([900.0, 0.0, 0.0])
    small.write_tum(folder / "trajectory.tum", small.Trajectory.from_se2(small.stamps_ns(), far, "map", "base_link"))
    replay = load_replay(folder)
    assert (replay.growth, replay.first_seen) == ("none", None)
    assert isinstance(replay.map_at(0), OccupancyGrid)


def test_a_map_grows_by_depth_images_where_there_are_no_scans(tmp_path):
    recording = Path(__file__).resolve().parents[2] / "sample_data/desk_rgbd.mcap"
    folder = small.write_images_result(tmp_path / "desk", {})
    run = json.loads((folder / "run.json").read_text())
    run["topics"]["depth"] = "/camera/aligned_depth_to_color/image_raw/compressedDepth"
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    small.write_map(folder / "map.yaml", OccupancyGrid(np.zeros((200, 200), np.int8), 0.05, (-5.0, -5.0, 0.0)))
    replay = load_replay(folder, recording=[recording])
    assert replay.growth == "scans"
    # The camera looks along its z axis, tilted: what is ahead of it is seen at once, what is beside it later or by its neighbour.
    ahead = replay.images[0].T_base_camera[:2, 2]
    at = replay.grid.map_to_cell([0.6 * ahead / np.hypot(*ahead)])[0]
    assert replay.first_seen[tuple(at)] == 0
    assert 20 < replay.first_seen.max() <= 30
    run["topics"]["depth"] = "/nowhere"
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")
    assert load_replay(folder, recording=[recording]).growth == "visibility"
