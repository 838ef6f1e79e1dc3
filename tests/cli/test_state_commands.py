# SPDX-License-Identifier: MIT
"""What the commands do with a saved state: small ones made here, and the one that Cartographer wrote."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map
from slamcli.formats.pbstream.reading import read_state
from slamcli.formats.pbstream.writing import write_state
from slamcli.formats.trajectories import read_tum
from slamcli.geometry import se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap, merge_states

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", ROOT.parent / "shared" / "data"))
REAL = DATA / "states" / "mit-csail.pbstream"
OFFICE = str(ROOT / "sample_data" / "office.bag")
START_NS = 1_600_000_000_000_000_000


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def a_room() -> MapState:
    """One submap of a room of 3 x 2 m, ten nodes along it, one loop closure."""
    cells = np.full((20, 30), 32767, np.uint16)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    nodes = tuple(
        Node(id=Id(0, i), stamp_ns=START_NS + i * 10**9, T_local_node=se3.from_se2([0.2 * i, 0.0, 0.0]),
             T_map_node=se3.from_se2([0.2 * i, 1.0, 0.0]), gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]),
             points_m=np.zeros((3, 3), np.float32))
        for i in range(10)
    )  # fmt: skip
    submap = Submap(id=Id(0, 0), T_local_submap=np.eye(4), T_map_submap=se3.from_se2([0.0, 1.0, 0.0]), num_range_data=10,
                    finished=True, grid=ProbabilityGrid(cells, 0.1, (-1.0, -1.0)))  # fmt: skip
    constraints = tuple(
        Constraint(submap=submap.id, node=node.id, T_submap_node=node.T_local_node, translation_weight=1.0,
                   rotation_weight=1.0, kind="inter" if node.id.number == 9 else "intra")
        for node in nodes
    )  # fmt: skip
    return MapState(nodes=nodes, submaps=(submap,), constraints=constraints, landmarks={"door": np.eye(4)})


def test_info(capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", merge_states([a_room(), a_room()]))
    assert run(["info", "room.pbstream", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["version"] == 2
    assert facts["kind"] == "2D probability grids"
    assert facts["resolutions_m"] == [0.1]
    assert facts["planar"] is True
    assert facts["landmarks"] == ["door"]
    assert (facts["constraints_intra"], facts["constraints_inter"]) == (18, 2)
    np.testing.assert_allclose(facts["extent_m"], [-1.0, 0.0, 2.0, 2.0], atol=1e-9)
    assert [entry["nodes"] for entry in facts["trajectories"]] == [10, 10]
    assert facts["trajectories"][1]["start_ns"] == START_NS
    assert facts["trajectories"][1]["length_m"] == pytest.approx(1.8)
    assert run(["info", "room.pbstream"]) == 0
    text = capsys.readouterr().out
    assert "Cartographer state (.pbstream version 2)" in text
    assert "3.0 x 2.0 m: x from -1.0 to 2.0" in text
    assert "constraints: 18 within submaps, 2 loop closures" in text
    assert "10 nodes with 30 points, 1 submaps" in text


def test_map_and_trajectory_come_out_of_a_state(capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", a_room())
    arguments = ["map", "--algo", "cartographer", "--load-state", "room.pbstream", "--save-state", "copy.pbstream"]
    assert run([*arguments, "--json", "--base-frame", "robot"]) == 0
    document = json.loads(capsys.readouterr().out)
    folder = Path("room-maps")
    assert document["outputs"] == sorted(path.name for path in folder.iterdir())
    assert {"state.pbstream", "map.yaml", "trajectory.tum", "keyframes.tum"} <= set(document["outputs"])
    assert document["frames"] == {"map": "map", "base": "robot"}
    assert document["summary"]["constraints_inter"] == 1
    assert [entry["name"] for entry in document["inputs"]] == ["room.pbstream"]
    assert document["command"].endswith("--load-state room.pbstream --base-frame robot")
    grid = read_map(folder / "map.yaml").grid
    assert grid.resolution_m == 0.1
    assert (grid.cells == 100).sum() == 96
    assert (grid.cells == 0).sum() == 20 * 30 - 96
    trajectory = read_tum(folder / "trajectory.tum")
    assert len(trajectory) == 10
    np.testing.assert_allclose(trajectory.poses_se2[-1], [1.8, 1.0, 0.0], atol=1e-12)
    assert Path("copy.pbstream").read_bytes() == (folder / "state.pbstream").read_bytes()
    assert read_state("copy.pbstream").trajectories == (0,)


def test_the_state_of_a_run_has_its_map_and_mapping_goes_on_from_it() -> None:
    common = ["map", "--algo", "cartographer", "-q", "--jobs", "1"]
    assert run([*common, OFFICE, "--duration", "25", "-o", "first"]) == 0
    assert run([*common, "--load-state", "first/state.pbstream", "-o", "drawn"]) == 0
    assert Path("first/map.pgm").read_bytes() == Path("drawn/map.pgm").read_bytes()
    keyframes, drawn = read_tum("first/keyframes.tum"), read_tum("drawn/trajectory.tum")
    np.testing.assert_array_equal(keyframes.stamps_ns, drawn.stamps_ns)
    np.testing.assert_allclose(keyframes.poses_se2, drawn.poses_se2, atol=1e-12)
    # A second visit of the same rooms is found in the frozen map, which stays as it is.
    visit = [OFFICE, "--start", "6", "--duration", "14"]
    assert run([*common, *visit, "--load-frozen-state", "first/state.pbstream", "-o", "frozen"]) == 0
    assert run([*common, *visit, "--load-state", "first/state.pbstream", "-o", "moved"]) == 0
    before = read_state("first/state.pbstream")
    for folder in ("frozen", "moved"):
        state = read_state(f"{folder}/state.pbstream")
        assert state.trajectories == (0, 1)
        assert sum(c.submap.trajectory != c.node.trajectory for c in state.constraints) >= 3
        assert distance_of("first/trajectory.tum", f"{folder}/trajectory.tum") < 0.05
        for old, new in zip(before.submaps, state.submaps, strict=False):
            np.testing.assert_array_equal(old.grid.cells, new.grid.cells)
            np.testing.assert_allclose(old.T_map_submap, new.T_map_submap, atol=1e-12 if folder == "frozen" else 0.02)


def distance_of(reference: str, path: str) -> float:
    """The greatest distance of poses at the same time, in the map."""
    first, second = read_tum(reference), read_tum(path)
    _, i, j = np.intersect1d(first.stamps_ns, second.stamps_ns, return_indices=True)
    assert len(i) > 100
    return float(np.abs(first.poses_se2[i, :2] - second.poses_se2[j, :2]).max())


def test_a_map_of_another_place_is_kept_beside(capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", a_room())
    arguments = [
        "map",
        "--algo",
        "cartographer",
        "--jobs",
        "1",
        OFFICE,
        "--duration",
        "6",
        "--load-state",
        "room.pbstream",
    ]
    assert run([*arguments, "-o", "both"]) == 0
    assert "trajectory 1 was not found in the loaded map: it is kept beside it" in capsys.readouterr().err
    assert read_state("both/state.pbstream").trajectories == (0, 1)


def test_several_states_are_joined_and_the_same_bytes_come_again() -> None:
    write_state("room.pbstream", a_room())
    arguments = [
        "map",
        "--algo",
        "cartographer",
        "--load-state",
        "room.pbstream",
        "--load-frozen-state",
        "room.pbstream",
        "-q",
    ]
    assert run([*arguments, "-o", "a"]) == 0
    assert run([*arguments, "-o", "b", "--jobs", "1"]) == 0
    assert read_state("a/state.pbstream").trajectories == (0, 1)
    assert len(read_tum("a/trajectory.tum")) == 20
    for name in ("state.pbstream", "map.pgm", "trajectory.tum", "constraints.csv"):
        assert Path("a", name).read_bytes() == Path("b", name).read_bytes()


def test_a_states_trajectory_is_read_where_trajectories_are(capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", a_room())
    write_state("two.pbstream", merge_states([a_room(), a_room()]))
    assert run(["convert", "room.pbstream", "path.tum", "-q"]) == 0
    assert run(["evaluate", "two.pbstream:1", "path.tum", "--align-origin", "--json"]) == 0
    capsys.readouterr()
    assert run(["convert", "two.pbstream:1", "path.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["poses"] == 10
    assert run(["convert", "two.pbstream", "again.pbstream", "-q"]) == 0
    assert Path("again.pbstream").read_bytes() == Path("two.pbstream").read_bytes()
    assert run(["evaluate", "two.pbstream", "path.tum"]) == 2
    assert "2 trajectories, say which: two.pbstream:0, two.pbstream:1" in capsys.readouterr().err


def test_view(capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", a_room())
    assert run(["view", "room.pbstream", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["kind"], facts["output"], facts["poses"]) == ("state", "room-view.png", 10)
    assert facts["occupied_area_m2"] == pytest.approx(0.96)
    assert Path("room-view.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["map"], "nothing to map"),
        (["map", "--load-state", "room.pbstream"], "gmapping has no state"),
        (["map", OFFICE, "--save-state", "x.pbstream"], "--save-state: gmapping has no state"),
        (["map", "--algo", "cartographer", "--load-state", "none.pbstream"], "none.pbstream: No such file"),
        (["map", "--algo", "cartographer", "--load-frozen-state", "text.pbstream"], "not a Cartographer state"),
        (
            ["map", "--algo", "cartographer", "--load-state", "room.pbstream", "--start", "3"],
            "--start is for a recording",
        ),
        (
            ["map", "--algo", "cartographer", "--load-state", "room.pbstream", "--scan-topic", "/scan"],
            "--scan-topic is for a recording",
        ),
        (["map", "--algo", "cartographer", "--load-state", "cut.pbstream"], "the file ends in the middle"),
        (["info", "cut.pbstream"], "the file ends in the middle"),
        (["info", "room.pbstream", OFFICE], "one at a time"),
        (["view", "cut.pbstream"], "the file ends in the middle"),
        (["convert", "room.pbstream", "x.bag"], "becomes a trajectory"),
        (["convert", "room.pbstream", "room.pbstream"], "are the same"),
        (["convert", "room.pbstream:7", "x.tum"], "no trajectory '7'"),
        (["convert", "room.pbstream:0", "x.pbstream"], "with all its trajectories"),
        (["convert", "room.pbstream", "room.pbstream", "x.tum"], "one at a time"),
        (["convert", "empty.pbstream", "x.tum"], "no nodes in this state"),
    ],
)
def test_what_is_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    write_state("room.pbstream", a_room())
    write_state("empty.pbstream", MapState(nodes=(), submaps=(), constraints=()))
    data = Path("room.pbstream").read_bytes()
    Path("cut.pbstream").write_bytes(data[: len(data) * 2 // 3])
    Path("text.pbstream").write_text("1 2 3\n")
    before = sorted(Path().iterdir())
    assert run(arguments) == 2
    told = [line for line in capsys.readouterr().err.splitlines() if "compiling" not in line]
    assert len(told) == 1
    assert message in told[0]
    assert sorted(Path().iterdir()) == before


@pytest.mark.real_data
@pytest.mark.skipif(not REAL.exists(), reason=f"no {REAL}: set SLAMCLI_TEST_DATA")
def test_what_cartographer_wrote(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(REAL)]) == 0
    text = capsys.readouterr().out
    assert "58.2 x 89.3 m" in text
    assert "constraints: 3416 within submaps, 91 loop closures" in text
    assert "1753 nodes with 358966 points, 20 submaps (2 unfinished)" in text
    assert run(["map", "--algo", "cartographer", "--load-state", str(REAL), "-o", "out", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)["summary"]
    assert summary["path_length_m"] == pytest.approx(373.46, abs=0.01)
    assert summary["free_m2"] == pytest.approx(1803, rel=0.002)
