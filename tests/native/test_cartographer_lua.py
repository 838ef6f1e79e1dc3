# SPDX-License-Identifier: MIT
"""Cartographer's Lua files and the launch files that name them."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import pytest

from slamcli.cartographer import CartographerParameters
from slamcli.errors import ConfigError
from slamcli.native import is_preset, read_cartographer_lua, read_launch
from slamcli.native.cartographer_launch import find_configuration
from slamcli.native.settings import find_native, shipped_folders
from slamcli.parameters import declarations, resolve

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = ROOT / "configs"
BUILT = 'include "map_builder.lua"\ninclude "trajectory_builder.lua"\n'
OPTIONS = (
    "options = {\n  map_builder = MAP_BUILDER,\n  trajectory_builder = TRAJECTORY_BUILDER,\n  map_frame = 'm',\n}\n"
)


def read(path: Path, text: str):
    path.write_text(text)
    return read_cartographer_lua(path, [CONFIGS])


def named(found) -> dict[str, object]:
    return {setting.name: setting.value for setting in found.settings}


def lines(found) -> dict[str, str]:
    return {s.name: f"{Path(s.file).name}:{s.line}" for s in found.settings}


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("cartographer_presets", ROOT / ".ci" / "cartographer_presets.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", sorted(generator().FILES))
def test_the_presets_are_what_the_declarations_say(name):
    assert generator().render(name) == (CONFIGS / name).read_text(), "run: python .ci/parameter_tables.py"


def test_the_missions_file_has_its_values_and_their_lines():
    found = read_cartographer_lua(CONFIGS / "backpack_2d.lua", [CONFIGS])
    values, where = named(found), lines(found)
    assert found.is_node
    assert found.misfits == ()
    assert [Path(file).name for file in found.files] == [
        "backpack_2d.lua", "map_builder.lua", "pose_graph.lua", "trajectory_builder.lua", "trajectory_builder_2d.lua",
        "trajectory_builder_3d.lua",
    ]  # fmt: skip
    expected = {
        "tracking_frame": ("base_link", 9),
        "num_laser_scans": (1, 17),
        "use_odometry": (True, 14),
        "MAP_BUILDER.use_trajectory_builder_2d": (True, 23),
        "TRAJECTORY_BUILDER_2D.min_range": (0.1, 25),
        "TRAJECTORY_BUILDER_2D.use_imu_data": (False, 28),
        "TRAJECTORY_BUILDER_2D.motion_filter.max_angle_radians": (math.radians(1.0), 31),
        "POSE_GRAPH.optimization_problem.huber_scale": (10.0, 33),
        "POSE_GRAPH.constraint_builder.min_score": (0.65, 35),
    }
    assert {name: (values[name], where[name]) for name in expected} == {
        name: (value, f"backpack_2d.lua:{line}") for name, (value, line) in expected.items()
    }
    assert where["POSE_GRAPH.constraint_builder.sampling_ratio"].startswith("pose_graph.lua:")
    assert "map_builder.use_trajectory_builder_2d" not in values
    resolved = resolve(CartographerParameters, values)
    assert resolved.trajectory_builder_2d.max_range == 30.0
    assert resolved.pose_graph.optimize_every_n_nodes == 90


def test_every_shipped_file_resolves_and_has_every_key():
    known = {entry.name for entry in declarations(CartographerParameters) if not entry.extension}
    for path in sorted(CONFIGS.glob("*.lua")):
        found = read_cartographer_lua(path, [CONFIGS])
        values = named(found)
        assert set(values) <= known, path.name
        resolve(CartographerParameters, values)
        assert found.misfits == (), path.name
        assert all(setting.line > 0 for setting in found.settings), path.name
        if found.is_node and not path.name.startswith("backpack_2d"):  # the mission's lacks what ROS wants
            assert {name for name in known - set(values) if "trimmer" not in name} == {
                "publish_to_tf", "publish_tracked_pose", "ignore_out_of_order",
            } | ({"use_pose_extrapolator"} - set(values)), path.name  # fmt: skip
    three = resolve(CartographerParameters, named(read_cartographer_lua(CONFIGS / "backpack_3d_localization.lua")))
    assert three.map_builder.dimensions == 3
    assert three.trajectory_builder.pure_localization_trimmer.max_submaps_to_keep == 3
    assert three.trajectory_builder_3d.num_accumulated_range_data == 160
    assert three.pose_graph.optimize_every_n_nodes == 100
    assert three.pose_graph.constraint_builder.global_localization_min_score == 0.66


def test_tables_alone_are_a_file_too(tmp_path):
    found = read(tmp_path / "x.lua", "POSE_GRAPH = {\n  constraint_builder = {\n    min_score = 0.5,\n  },\n}\n")
    assert not found.is_node
    assert [(s.name, s.value, s.line) for s in found.settings] == [("POSE_GRAPH.constraint_builder.min_score", 0.5, 3)]
    assert named(read(tmp_path / "x.lua", "POSE_GRAPH = {a = 1}\nreturn POSE_GRAPH")) == {"POSE_GRAPH.a": 1}
    nested = "MAP_BUILDER = {pose_graph = {a = 1}}\nTRAJECTORY_BUILDER = {trajectory_builder_2d = {b = 2}, c = 3}"
    assert named(read(tmp_path / "x.lua", nested)) == {
        "POSE_GRAPH.a": 1,
        "TRAJECTORY_BUILDER.c": 3,
        "TRAJECTORY_BUILDER_2D.b": 2,
    }


def test_values_may_be_set_through_options_and_other_names(tmp_path):
    text = (
        BUILT + OPTIONS + "options.map_builder.pose_graph.optimize_every_n_nodes = 7\n"
        "TRAJECTORY_BUILDER.trajectory_builder_2d.max_range = 8\nlocal tb = TRAJECTORY_BUILDER_2D\ntb.min_range = 1\n"
        "options.use_odometry = true\nfor _, key in ipairs({'min_z'}) do tb[key] = -2 end\nreturn options"
    )
    found = read(tmp_path / "x.lua", text)
    values, where = named(found), lines(found)
    assert values["POSE_GRAPH.optimize_every_n_nodes"] == 7
    assert where["POSE_GRAPH.optimize_every_n_nodes"] == "x.lua:8"
    assert (values["TRAJECTORY_BUILDER_2D.max_range"], where["TRAJECTORY_BUILDER_2D.max_range"]) == (8, "x.lua:9")
    assert (values["TRAJECTORY_BUILDER_2D.min_range"], where["TRAJECTORY_BUILDER_2D.min_range"]) == (1, "x.lua:11")
    assert (values["use_odometry"], where["use_odometry"]) == (True, "x.lua:12")
    assert (values["map_frame"], where["map_frame"]) == ("m", "x.lua:6")
    assert values["TRAJECTORY_BUILDER_2D.min_z"] == -2


def test_what_a_file_seems_to_do_and_does_not_is_told(tmp_path):
    replaced = BUILT + OPTIONS + "TRAJECTORY_BUILDER_2D = {max_range = 5}\nreturn options"
    found = read(tmp_path / "x.lua", replaced)
    assert [(m.fatal, m.message.partition(" was replaced")[0]) for m in found.misfits] == [
        (False, "TRAJECTORY_BUILDER_2D")
    ]
    assert named(found)["TRAJECTORY_BUILDER_2D.max_range"] == 30.0
    found = read(tmp_path / "x.lua", BUILT + OPTIONS)
    assert [(m.fatal, m.message) for m in found.misfits] == [(True, "it returns nothing: end it with 'return options'")]
    assert named(found)["map_frame"] == "m"
    without = BUILT + "options = {map_builder = MAP_BUILDER}\nTRAJECTORY_BUILDER_2D.max_range = 5\nreturn options"
    found = read(tmp_path / "x.lua", without)
    assert found.misfits[0].message == (
        "options.trajectory_builder is missing: write trajectory_builder = TRAJECTORY_BUILDER"
    )
    assert named(found)["TRAJECTORY_BUILDER_2D.max_range"] == 5


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "sets nothing of Cartographer's"),
        ("return 5", "returns 5, not a table"),
        ("return 'x'", "returns 'x', not a table"),
        ("local t = {} for i = 1, 13 do t = {a = t, b = t, c = t} end return {x = t}", "sets nothing|settings|$"),
    ],
)
def test_what_is_no_configuration_is_refused(tmp_path, text, expected):
    if "for i" in text:
        assert read(tmp_path / "x.lua", text).settings == ()  # empty tables hold nothing
        text = text.replace("local t = {}", "local t = {x = 1}")
        expected = "sets more than 20000 values"
    with pytest.raises(ConfigError, match=expected):
        read(tmp_path / "x.lua", text)


def test_a_value_where_a_table_belongs_is_an_unknown_name(tmp_path):
    text = "options = {map_builder = 5, trajectory_builder = 'x', map_frame = 'm'}\nreturn options"
    assert named(read(tmp_path / "x.lua", text)) == {"map_builder": 5, "map_frame": "m", "trajectory_builder": "x"}


def launch(folder: Path, arguments: str, kind: str = "cartographer_node"):
    path = folder / "a.launch"
    path.write_text(f'<launch><node pkg="cartographer_ros" type="{kind}" name="n" args="{arguments}"/></launch>')
    return find_configuration(read_launch(path).nodes[0], shipped_folders())


def test_a_launch_file_names_the_lua_file(tmp_path):
    folder = tmp_path / "conf"
    folder.mkdir()
    (folder / "mine.lua").write_text("")
    (tmp_path / "near.lua").write_text("")
    found = launch(tmp_path, f"-configuration_directory {folder} -configuration_basename mine.lua")
    assert (found.path, found.folders, found.notes) == (folder / "mine.lua", (folder,), ())
    found = launch(
        tmp_path, f"--configuration_directory={folder} --configuration_basename=mine.lua -load_state_filename x"
    )
    assert found.path == folder / "mine.lua"
    assert "-load_state_filename is not followed: give the state by --load-state" in found.notes[0]
    found = launch(tmp_path, "-configuration_directory $(find no_such_pkg)/x -configuration_basename near.lua")
    assert found.path == tmp_path / "near.lua"
    assert "no_such_pkg/x/near.lua is not here" in found.notes[0]
    found = launch(
        tmp_path,
        "-configuration_directory conf -configuration_basenames mine.lua,near.lua",
        "cartographer_offline_node",
    )
    assert found.path == tmp_path / "conf" / "mine.lua"
    assert "the first is taken: mine.lua" in found.notes[0]
    assert launch(tmp_path, "-configuration_basename backpack_3d.lua").path == CONFIGS / "backpack_3d.lua"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("", "has no argument -configuration_basename"),
        ("-configuration_basename", "has no argument -configuration_basename"),
        ("-configuration_basename nowhere.lua", "nowhere.lua is not here"),
        ("-configuration_directory /etc -configuration_basename nowhere.lua", "/etc/nowhere.lua is not here"),
    ],
)
def test_a_launch_file_without_a_lua_file_is_one_error(tmp_path, arguments, expected):
    with pytest.raises(ConfigError, match=expected):
        launch(tmp_path, arguments)


def test_a_bare_name_means_the_shipped_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_native(Path("pr2.lua")) == CONFIGS / "pr2.lua"
    (tmp_path / "pr2.lua").write_text("")
    assert find_native(Path("pr2.lua")) == Path("pr2.lua")
    assert find_native(Path("nowhere.lua")) == Path("nowhere.lua")
    assert is_preset(str(CONFIGS / "pose_graph.lua"))
    assert not is_preset(str(tmp_path / "pose_graph.lua"))
    assert not is_preset(str(CONFIGS / "pr2.lua"))
