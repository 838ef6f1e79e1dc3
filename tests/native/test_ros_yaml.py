# SPDX-License-Identifier: MIT
from __future__ import annotations

import math

import pytest

from slamcli.errors import ConfigError
from slamcli.native import Setting, merge, read_ros_yaml
from slamcli.native.expressions import evaluate
from slamcli.native.ros_yaml import parse_ros_yaml


def test_nested_maps_become_names_with_lines(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(
        "# a comment\nrobot_radius: 0.18\nlayer:\n  radius: 0.5   # m\n  sources: [a, {t: 1}]\n  empty: {}\n"
    )
    settings = read_ros_yaml(path, "global_costmap")
    assert [(s.name, s.value, s.line) for s in settings] == [
        ("global_costmap/robot_radius", 0.18, 2),
        ("global_costmap/layer/radius", 0.5, 4),
        ("global_costmap/layer/sources", ["a", {"t": 1}], 5),
        ("global_costmap/layer/empty", {}, 6),
    ]
    assert settings[1].source == f"{path}:4"


def test_angles_and_scalars():
    text = "a: !degrees 90\nb: deg(180)\nc: rad(pi/2)\nd: !radians 2*pi\ne: yes\nf: 0x10\ng: ~\nh: 1.0e-3\ni: 2020-01-01\nj: '5'\n"
    values = {s.name: s.value for s in parse_ros_yaml(text, "t.yaml")}
    assert values == {
        "a": math.pi / 2,
        "b": math.pi,
        "c": math.pi / 2,
        "d": 2 * math.pi,
        "e": True,
        "f": 16,
        "g": None,
        "h": 0.001,
        "i": "2020-01-01",
        "j": "5",
    }


def test_anchors_and_merge_keys():
    settings = parse_ros_yaml("base: &b {x: 1, y: 2}\nmine:\n  <<: *b\n  y: 3\n", "t.yaml")
    assert {name: s.value for name, s in merge(settings).items()} == {
        "base/x": 1,
        "base/y": 2,
        "mine/x": 1,
        "mine/y": 3,
    }


def test_later_wins_and_moves_to_the_end():
    settings = [Setting("a", 1, "f", 1), Setting("b", 2, "f", 2), Setting("a", 3, "g", 1)]
    merged = merge(settings)
    assert list(merged) == ["b", "a"]
    assert merged["a"].source == "g:1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1\nb: 2\n", "t.yaml:2: not YAML"),
        ("- 1\n- 2\n", "t.yaml:1: expected `name: value` pairs"),
        ("a: !!python/object/apply:os.system [ls]\n", None),
        ("a: !!python/name:os.system x\n", "t.yaml:1: tag .* is not allowed"),
        ("? [1, 2]\n: 3\n", "t.yaml:1: a parameter's name must be plain text"),
        ("a: deg(import)\n", "t.yaml:1: .* is not an angle"),
        ("a: &a [*a]\n", "nested too deeply"),
        ("a: " + "[" * 3000, "nested too deeply"),
        (
            "a: &a [1,1]\n"
            + "".join(f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(8)),
            "too large",
        ),
        ("a: *x\n", "t.yaml:1: not YAML"),
        ("<<: 5\n", "t.yaml:1: << needs a map"),
        ("a: \x01\n", "not YAML"),
    ],
)
def test_errors_and_bombs(text, message):
    if message is None:  # a tag on a list constructs nothing: it is a list
        assert [s.value for s in parse_ros_yaml(text, "t.yaml")] == [["ls"]]
        return
    with pytest.raises(ConfigError, match=message):
        parse_ros_yaml(text, "t.yaml")


def test_expressions_allow_arithmetic_and_nothing_else():
    assert evaluate("2 * pi / 4") == math.pi / 2
    assert evaluate("'a' if arg('x') == 1 and not false else 'b'", calls={"arg": lambda _: 1}) == "a"
    assert evaluate("1 <= x < 3", {"x": 2}) is True
    for bad in (
        "x.y",
        "().__class__",
        "'a' * 10**9",
        "2 ** 99999",
        "open('f')",
        "[1]*9",
        "1 / 0",
        "f'{1}'",
        "(" * 300,
        "lambda: 1",
        "",
    ):
        with pytest.raises(ConfigError):
            evaluate(bad)
