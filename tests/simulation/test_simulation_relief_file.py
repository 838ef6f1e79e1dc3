# SPDX-License-Identifier: MIT
"""The key `relief` of world files and the heights of what stands on the plan."""

from __future__ import annotations

import re

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.simulation import load_world

BASE = """
rooms: [[0, 0, 10, 6]]
doors: [{at: [5, 0], width: 1.0, height: 2.1, open: 90}]
boxes:
  - {at: [2, 2], size: [1, 0.5], yaw: 90, height: 0.8, reflectivity: 0.9}
  - {at: [7, 2], size: [2, 1], above: 1.8, height: 2.2}
circles: [{at: [4, 4], radius: 0.2, above: 0.5, repeat: [2, 1], step: [3, 0]}]
"""


def load(tmp_path, text):
    path = tmp_path / "w.yaml"
    path.write_text(text)
    return load_world(path)


def test_heights_on_a_level_floor(tmp_path):
    world = load(tmp_path, BASE + "relief: {ceiling: 3.0, cell: 0.5, margin: 1}")
    made = world.relief
    assert made.ground.corners == ((-1.0, -1.0), (11.0, 7.0))
    assert (made.ceiling.heights == 3.0).all()
    lintel = made.panels[(made.panels[:, 4] > 0)]
    np.testing.assert_allclose(lintel, [[4.5, 0, 5.5, 0, 2.1, 3.0, 0.6]])
    leaf = made.panels[made.panels[:, 5] == 2.1]
    np.testing.assert_allclose(leaf[0, :4], [4.5, 0, 4.5, 1], atol=1e-12)
    np.testing.assert_allclose(made.boxes[:, [0, 4, 5, 7, 8]], [[2, 0.5, 0.25, 0.8, 0.9], [7, 1, 0.5, 2.2, 0.4]])
    assert made.boxes[1, 6] == pytest.approx(1.8)
    np.testing.assert_allclose(made.cylinders[:, [0, 2, 3, 4]], [[4, 0.2, 0.5, 3.0], [7, 0.2, 0.5, 3.0]])


def test_what_hangs_high_is_in_nobodys_way(tmp_path):
    world = load(tmp_path, BASE + "relief: {}")
    assert len(world.segments) == 4 + 1 + 1 + 4  # walls (one in two pieces), leaf, the low box
    assert len(world.circles) == 2


def test_things_stand_on_the_ground(tmp_path):
    world = load(
        tmp_path,
        BASE
        + "relief:\n  ramps: [{from: [0, 3], to: [5, 3], rise: 1.0}]\n  bumps: [{at: [7, 2], radius: 1, height: 0.2}]"
        "\n  hills: [{height: 0.0, wavelength: 3}]",
    )
    assert world.relief.ceiling is None
    assert world.relief.boxes[1, 6:8] == pytest.approx([3.0, 3.4], abs=0.02)
    assert world.relief.panels[:, 5].max() == pytest.approx(3.5, abs=1e-6)
    assert world.relief.ground.at(np.array([[0.0, 3.0], [8.9, 5.0]])) == pytest.approx([0.0, 1.0], abs=1e-3)


def test_a_world_of_ground_alone(tmp_path):
    assert load(tmp_path, "relief: {area: [0, 0, 20, 10], hills: [{height: 2, wavelength: 8}]}").bounds == (
        0,
        0,
        20,
        10,
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BASE, "doors[0]: unknown key 'height'"),
        ("rooms: [[0, 0, 5, 5]]\nboxes: [{at: [1, 1], size: [1, 1], above: 1}]", "boxes[0]: unknown key 'above'"),
        (
            "boxes: [{at: [1, 1], size: [1, 1], above: 1, height: 0.8}]\nrelief: {}",
            "boxes[0]: `above` 1 m is not below `height` 0.8 m",
        ),
        ("relief: {}", "`area: [x0, y0, x1, y1]` is needed"),
        ("relief: 5", "relief: is 5, not a table"),
        ("relief: {celling: 3}", "did you mean ceiling or cell?"),
        ("relief: {area: [0, 0, 0, 5]}", "relief.area: [0, 0, 0, 5] is not"),
        ("relief: {area: [0, 0, 1e4, 1e4], cell: 0.1}", "heights are more than"),
        ("relief: {area: [0, 0, 5, 5], ceiling: -1}", "relief.ceiling: -1 is not a number between 0.1 and 1000"),
        (
            "relief: {area: [0, 0, 5, 5], ramps: [{from: [1, 1], to: [1, 1], rise: 1}]}",
            "relief.ramps[0]: `from` and `to`",
        ),
        ("relief: {area: [0, 0, 5, 5], ramps: [{from: [1, 1], to: [2, 1]}]}", "relief.ramps[0]: `rise` is missing"),
        ("relief: {area: [0, 0, 5, 5], bumps: [{at: [1, 1], radius: 0, height: 1}]}", "relief.bumps[0].radius"),
        ("relief: {area: [0, 0, 5, 5], hills: [{height: 1, wavelength: no}]}", "relief.hills[0].wavelength"),
        ("relief: {area: [0, 0, 5, 5], hills: {height: 1}}", "hills: is"),
    ],
)
def test_errors_name_the_entry(tmp_path, text, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load(tmp_path, text)
