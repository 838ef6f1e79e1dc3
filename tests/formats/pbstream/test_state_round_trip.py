# SPDX-License-Identifier: MIT
from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_states import assert_same, make_state, transforms

from slamcli.errors import DataError
from slamcli.formats.pbstream import schema
from slamcli.formats.pbstream.container import is_pbstream
from slamcli.formats.pbstream.reading import read_state, read_state_file
from slamcli.formats.pbstream.writing import write_state
from slamcli.geometry import se3
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.posegraph import Id, MapState, Node, Submap
from slamcli.runtime import RunLog

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[4] / "shared" / "data"))
REAL = DATA / "states" / "mit-csail.pbstream"
real_data = pytest.mark.skipif(not REAL.exists(), reason=f"no {REAL}: set SLAMCLI_TEST_DATA")


@pytest.mark.parametrize("kind", ["probability", "tsdf", "3d"])
def test_what_is_written_is_read(tmp_path: Path, kind: str) -> None:
    state = make_state(kind)
    write_state(tmp_path / "state.pbstream", state)
    read = read_state_file(tmp_path / "state.pbstream")
    assert (read.version, read.trajectories) == (2, (0, 2))
    assert_same(state, read.state, rotations=5e-16)


@pytest.mark.parametrize("kind", ["probability", "tsdf", "3d"])
def test_a_second_round_changes_nothing_but_rounding(tmp_path: Path, kind: str) -> None:
    first, second = tmp_path / "a.pbstream", tmp_path / "b.pbstream"
    write_state(first, make_state(kind, seed=3))
    state = read_state(first)
    write_state(second, state)
    assert_same(state, read_state(second), rotations=3e-16)
    again = tmp_path / "c.pbstream"
    write_state(again, state)
    assert again.read_bytes() == second.read_bytes()


def test_planar_states_keep_every_bit(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    poses = se3.from_se2(random.uniform(-3, 3, size=(500, 3)))
    nodes = tuple(
        Node(id=Id(0, i), stamp_ns=0, T_local_node=poses[i], T_map_node=poses[-i], points_m=np.zeros((0, 3), np.float32),
             gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]))
        for i in range(500)
    )  # fmt: skip
    write_state(tmp_path / "a.pbstream", MapState(nodes=nodes, submaps=(), constraints=()))
    for before, after in zip(nodes, read_state(tmp_path / "a.pbstream").nodes, strict=True):
        np.testing.assert_array_equal(before.T_local_node, after.T_local_node)
        np.testing.assert_array_equal(before.T_map_node, after.T_map_node)


def test_a_grid_lies_in_the_file_as_cartographer_has_it(tmp_path: Path) -> None:
    cells = np.array([[1, 2, 3], [4, 5, 0]], np.uint16)  # rows from the least y, columns from the least x
    T = np.eye(4)
    submap = Submap(id=Id(0, 0), T_local_submap=T, T_map_submap=T, num_range_data=1, finished=True,
                    grid=ProbabilityGrid(cells, 0.5, (10.0, 20.0)))  # fmt: skip
    write_state(tmp_path / "a.pbstream", MapState(nodes=(), submaps=(submap,), constraints=()))
    grid = messages(tmp_path / "a.pbstream")[3].submap.submap_2d.grid
    assert (grid.limits.max.x, grid.limits.max.y) == (11.5, 21.0)
    assert (grid.limits.cell_limits.num_x_cells, grid.limits.cell_limits.num_y_cells) == (2, 3)
    # The first cell is at the greatest x and y, the next one at less y.
    assert list(grid.cells) == [0, 3, 5, 2, 4, 1]
    box = grid.known_cells_box
    assert (box.min_x, box.max_x, box.min_y, box.max_y) == (0, 1, 0, 2)


def messages(path: Path) -> list:
    data, at, found = path.read_bytes(), 8, []
    while at < len(data):
        (size,) = struct.unpack_from("<Q", data, at)
        text = zlib.decompress(data[at + 8 : at + 8 + size], 31)
        found.append((schema.Data if found else schema.Header).FromString(text))
        at += 8 + size
    return found


def test_the_first_messages_are_those_that_cartographer_wants(tmp_path: Path) -> None:
    write_state(tmp_path / "a.pbstream", make_state("probability"))
    header, graph, options, *rest = messages(tmp_path / "a.pbstream")
    assert header.format_version == 2
    assert len(graph.pose_graph.trajectory) == 2
    assert list(options.all_trajectory_builder_options.options_with_sensor_ids) == [b"\n\0", b"\n\2"]
    order = [message.ListFields()[0][0].number for message in rest]
    assert order == sorted(order)


def test_an_empty_state(tmp_path: Path) -> None:
    write_state(tmp_path / "a.pbstream", MapState(nodes=(), submaps=(), constraints=()))
    assert_same(MapState(nodes=(), submaps=(), constraints=()), read_state(tmp_path / "a.pbstream"))


def test_constraints_of_what_was_not_saved_are_left_out(tmp_path: Path) -> None:
    state = make_state("probability", trajectories=(0, 1))
    partial = MapState(nodes=state.nodes, submaps=state.submaps[:-1], constraints=state.constraints)
    write_state(tmp_path / "a.pbstream", partial)
    log = RunLog()
    read = read_state(tmp_path / "a.pbstream", log=log)
    assert len(read.constraints) == len(state.constraints) - 2
    assert log.notes == [f"{tmp_path}/a.pbstream: 2 constraints of nodes or submaps without data are left out"]


def test_what_cannot_be_saved_is_refused_and_nothing_written(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    T = transforms(random, 1)[0]
    node = Node(id=Id(0, 0), stamp_ns=0, T_local_node=T, T_map_node=T, gravity_alignment_xyzw=np.array([0.0, 0, 0, 1]),
                points_m=np.array([[9000.0, 0, 0]], np.float32))  # fmt: skip
    with pytest.raises(DataError, match="farther away than 8389 m"):
        write_state(tmp_path / "a.pbstream", MapState(nodes=(node,), submaps=(), constraints=()))
    with pytest.raises(DataError, match="landmark 0 has a pose that is not finite"):
        write_state(
            tmp_path / "a.pbstream", MapState(nodes=(), submaps=(), constraints=(), landmarks={"a": T * np.nan})
        )
    assert list(tmp_path.iterdir()) == []


def test_a_state_is_known_by_name_or_by_its_first_bytes(tmp_path: Path) -> None:
    write_state(tmp_path / "state", make_state("tsdf"))
    (tmp_path / "named.pbstream").write_text("x")
    (tmp_path / "other").write_text("x")
    assert is_pbstream(tmp_path / "state")
    assert is_pbstream(tmp_path / "named.pbstream")
    assert not is_pbstream(tmp_path / "other")
    assert not is_pbstream(tmp_path)


@real_data
@pytest.mark.real_data
def test_what_cartographer_wrote_is_kept_to_the_last_bit(tmp_path: Path) -> None:
    read = read_state_file(REAL)
    state = read.state
    assert read.version == 2
    assert (len(state.nodes), len(state.submaps), len(state.constraints)) == (1753, 20, 3507)
    assert len(state.odometry[0]) == 1988
    assert state.nodes[0].stamp_ns == 1_134_864_629_895_181_800
    assert state.submaps[0].grid is not None
    assert state.submaps[0].grid.cells.shape == (450, 328)
    write_state(tmp_path / "a.pbstream", state)
    assert_same(state, read_state(tmp_path / "a.pbstream"))
    # More than what is kept of it: message by message the files are the same but for the last digits of quaternions.
    before, after = messages(REAL), messages(tmp_path / "a.pbstream")
    assert len(before) == len(after)
    for one, other in zip(before, after, strict=True):
        assert without_rotations(one) == without_rotations(other)


def without_rotations(message: Any) -> bytes:
    """The bytes of a message, its rotations left out."""
    pending = [message]
    while pending:
        for field, value in pending.pop().ListFields():
            if field.message_type is None:
                continue
            for part in [value] if hasattr(value, "ListFields") else value:
                if field.name == "rotation":
                    part.Clear()
                else:
                    pending.append(part)
    return message.SerializeToString(deterministic=True)
