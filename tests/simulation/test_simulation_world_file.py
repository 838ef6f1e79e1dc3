# SPDX-License-Identifier: MIT
"""World files: what each key means, and one clear line for each mistake."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.grids import OccupancyGrid
from slamcli.simulation import is_world_file, load_world
from slamcli.simulation.builtin import find_world, world_names

LAYERS = "bcdefghij"
BOMB = "walkers:\n- &a [0, 0]\n" + "".join(
    f"- &{new} [{', '.join(['*' + old] * 9)}]\n" for old, new in zip("a" + LAYERS, LAYERS, strict=False)
)
"""A few hundred bytes that would print as 9^9 points."""


def load(tmp_path, text, read_grid=None):
    path = tmp_path / "w.yaml"
    path.write_text(text)
    return load_world(path, read_grid)


def length(segments):
    return np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]).sum()


def test_walls_rooms_boxes_and_circles(tmp_path):
    world = load(
        tmp_path,
        """
        walls: [[[0, 0], [1, 0], [1, 2]]]
        rooms: [[0, 0, 4, 3]]
        boxes: [{at: [2, 1], size: [1, 0.5], yaw: 90}]
        circles: [{at: [3, 2], radius: 0.2, repeat: [2, 3], step: [1, 2]}]
        start: [1, 2, 9e1]
        """,
    )
    assert world.segments.shape == (2 + 4 + 4, 4)
    np.testing.assert_allclose(world.segments[:2], [[0, 0, 1, 0], [1, 0, 1, 2]])
    box = world.segments[6:].reshape(-1, 2)
    np.testing.assert_allclose([box.min(axis=0), box.max(axis=0)], [[1.75, 0.5], [2.25, 1.5]])
    assert sorted(map(tuple, world.circles[:, :2].tolist())) == [(3, 2), (3, 4), (3, 6), (4, 2), (4, 4), (4, 6)]
    assert world.start == (1, 2, math.pi / 2)
    assert world.bounds == (0.0, 0.0, 4.2, 6.2)
    assert world.name == "w"


def test_a_door_opens_the_common_wall_of_two_rooms(tmp_path):
    closed = load(tmp_path, "rooms: [[0, 0, 4, 3], [4, 0, 8, 3]]").segments
    world = load(tmp_path, "rooms: [[0, 0, 4, 3], [4, 0, 8, 3]]\ndoors: [{at: [4, 1], width: 1.0, open: 90}]")
    assert length(world.segments) == pytest.approx(length(closed) - 2 * 1.0 + 1.0)
    np.testing.assert_allclose(world.segments[-1], [4, 0.5, 3, 0.5], atol=1e-12)  # hinge below, turned left
    on_line = (world.segments[:-1, 0] == 4) & (world.segments[:-1, 2] == 4)
    spans = np.sort(world.segments[:-1][on_line][:, [1, 3]], axis=1)
    assert not ((spans[:, 0] < 1.49) & (spans[:, 1] > 0.51)).any()


def test_a_door_at_the_end_of_a_wall_leaves_no_stub(tmp_path):
    world = load(tmp_path, "walls: [[[0, 0], [4, 0]]]\ndoors: [{at: [0.3, 0], width: 1}]")
    np.testing.assert_allclose(world.segments, [[0.8, 0, 4, 0]])


def test_route_walkers_and_settings(tmp_path):
    world = load(
        tmp_path,
        """
        rooms: [[0, 0, 4, 3]]
        route: {waypoints: [[1, 1], [2, 1]], rounds: 3}
        walkers: [{points: [[1, 2], [3, 2]], speed: 0.5}]
        laser: {beams: 361, upside_down: true}
        odometry: {srr: 0.5}
        """,
    )
    assert world.waypoints.tolist() == [[1, 1], [2, 1]]
    assert world.rounds == 3
    assert world.walkers[0].speed_m_s == 0.5
    assert dict(world.settings) == {"laser.beams": 361, "laser.upside_down": True, "odometry.srr": 0.5}


def test_grid_is_read_beside_the_file(tmp_path):
    seen = []

    def read(path):
        seen.append(path)
        return OccupancyGrid(np.full((3, 4), 100, np.int8), 0.5, (1.0, 2.0, 0.0))

    world = load(tmp_path, "grid: sub/map.yaml", read)
    assert seen == [tmp_path / "sub" / "map.yaml"]
    assert world.bounds == (1.0, 2.0, 3.0, 3.5)
    assert world.occupied_cells.sum() == 12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("boxs: []", ["boxs", "boxes"]),
        ("rooms: [[0,0,1,1]]\nlaser: {beam: 3}", ["laser.beam", "laser.beams"]),
        ("rooms: [[0,0,1,1]]\nlaser: {beams: 0}", ["laser.beams", "between 1"]),
        ("rooms: [[0,0,1,1]]\nlaser: {beams: many}", ["laser.beams", "whole number"]),
        ("rooms: [[0,0,1,1]]\nlaser: 7", ["laser", "table"]),
        ("rooms: [[0,0,1]]", ["rooms[0]", "x0, y0, x1, y1"]),
        ("rooms: 5", ["rooms", "list"]),
        ("walls: [[[0, 0]]]", ["walls[0]", "2 points"]),
        ("walls: [[[0, 0], [1, .nan]]]", ["walls[0][1]", "nan"]),
        ("walls: [[[0, 0], [1, x]]]", ["walls[0][1]", "'x'"]),
        ("rooms: [[0,0,1,1]]\nboxes: [{at: [0, 0]}]", ["boxes[0]", "size"]),
        ("rooms: [[0,0,1,1]]\nboxes: [{at: [0, 0], size: [0, 1]}]", ["boxes[0].size"]),
        ("rooms: [[0,0,1,1]]\nboxes: [{at: [0, 0], size: [1, 1], jaw: 3}]", ["jaw", "yaw"]),
        ("rooms: [[0,0,1,1]]\nboxes: [{at: [0, 0], size: [1, 1], repeat: [2, 1]}]", ["step"]),
        ("rooms: [[0,0,1,1]]\nboxes: [{at: [0, 0], size: [1, 1], repeat: [9e5, 9e5], step: [1, 1]}]", ["repeat"]),
        ("rooms: [[0,0,1,1]]\ndoors: [{at: [0.5, 0.5]}]", ["doors[0]", "no wall"]),
        ("circles: [{at: [0, 0], radius: -1}]", ["circles[0].radius"]),
        ("rooms: [[0,0,1,1]]\nroute: {waypoints: [[1, 1]]}", ["route.waypoints"]),
        ("rooms: [[0,0,1,1]]\nstart: [1]", ["start", "yaw"]),
        ("rooms: [[0,0,1,1]]\n3: 4", ["3", "not text"]),
        ("grid: m.yaml", ["grid"]),
        ("grid: 5", ["grid", "map.yaml"]),
        ("name: nothing", ["nothing in this world"]),
        ("rooms: [[0,0,1,1]]\nname: [1, 2]", ["name", "not text"]),
        ("rooms: [[0,0,1,1]]\nlaser: {beams: [1, 2]}", ["laser.beams", "not one value"]),
        ("rooms: [[0,0,1,1]]\nlaser: {beams: .inf}", ["laser.beams", "whole number"]),
        ("rooms: [[0,0,1,1]]\nlaser: {noise: .inf}", ["laser.noise", "between"]),
        ("rooms: [[0,0,1,1]]\nlaser: {noise: 0x" + "f" * 9000 + "}", ["laser.noise", "hundreds of digits"]),
        ("rooms: [[0,0,1,0x" + "f" * 9000 + "]]", ["rooms[0]", "hundreds of digits"]),
        ("rooms: [[0,0,[0x" + "f" * 9000 + "],1]]", ["rooms[0]"]),
        (BOMB + "rooms: [[0,0,1,1]]\nname: *j", ["name"]),
        (BOMB + "walls: *j", ["walls[0]"]),
        (BOMB + "rooms: [[0,0,1,1]]\nlaser: {beams: *j}", ["walkers[0]"]),
        (BOMB + "rooms: [[0,0,1,1]]\nstart: *j", ["start"]),
        ("", ["table"]),
        ("[1, 2]", ["table"]),
        ("a: [", ["line", "YAML"]),
        ("a: !!python/object:os.system x", ["YAML"]),
    ],
)
def test_a_mistake_is_one_line_with_file_and_place(tmp_path, text, words):
    with pytest.raises(ConfigError) as error:
        load(tmp_path, text)
    message = str(error.value)
    assert "w.yaml" in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_files_that_are_no_text(tmp_path):
    (tmp_path / "b.yaml").write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match="not a YAML text"):
        load_world(tmp_path / "b.yaml")
    with pytest.raises(ConfigError, match="cannot read"):
        load_world(tmp_path / "none.yaml")
    (tmp_path / "deep.yaml").write_text("[" * 20000)
    with pytest.raises(ConfigError, match=r"deep\.yaml"):
        load_world(tmp_path / "deep.yaml")


def test_a_map_yaml_is_no_world(tmp_path):
    (tmp_path / "map.yaml").write_text("image: map.pgm\nresolution: 0.05\n")
    assert not is_world_file(tmp_path / "map.yaml")
    assert is_world_file(find_world("office"))


def test_built_in_worlds_load_and_a_wrong_name_names_the_nearest():
    assert set(world_names()) >= {"office", "loop_corridor", "warehouse", "cluttered_room", "long_loop"}
    for name in world_names():
        world = load_world(find_world(name))
        assert world.name == name
        assert world.description
    with pytest.raises(UsageError, match="'office'"):
        find_world("ofice")


def test_a_folder_does_not_hide_a_built_in_world(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "office").mkdir()
    (tmp_path / "result").mkdir()
    assert find_world("office").name == "office.yaml"
    with pytest.raises(UsageError, match="result is a folder: name a world file"):
        find_world("result")
