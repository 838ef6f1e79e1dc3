# SPDX-License-Identifier: MIT
"""docs/generate.md and sample_data/ keep up with the code."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slamcli.formats.maps import read_map
from slamcli.formats.trajectories import read_tum
from slamcli.measurements import Image, LaserScan
from slamcli.parameters import declarations
from slamcli.recordings import open_recording
from slamcli.simulation import SimulationParameters, load_world
from slamcli.simulation.builtin import world_names

ROOT = Path(__file__).resolve().parents[2]


def test_the_table_of_settings_is_complete_and_has_the_defaults():
    text = "\n".join((ROOT / "docs" / name).read_text() for name in ("generate.md", "simulator.md"))
    rows = dict(re.findall(r"^\| `([a-z0-9_.]+)` \| ([^|]*)\|", text, re.MULTILINE))
    for d in declarations(SimulationParameters):
        default = "auto" if d.default is None else str(d.default).lower() if d.kind is bool else d.default
        shown = rows[d.name].strip()
        assert float(shown) == default if d.kind in (int, float) and d.default is not None else shown == default
    assert {name for name in rows if "." in name} == {d.name for d in declarations(SimulationParameters)}


def test_built_in_worlds_are_described():
    text = (ROOT / "docs" / "generate.md").read_text()
    for name in world_names():
        assert f"`{name}`" in text


def test_the_example_world_of_the_page_loads(tmp_path):
    text = (ROOT / "docs" / "generate.md").read_text()
    block = re.search(r"(    name: two rooms\n(?:    .*\n)+)", text).group(1)
    (tmp_path / "w.yaml").write_text("\n".join(line[4:] for line in block.splitlines()))
    world = load_world(tmp_path / "w.yaml")
    assert len(world.waypoints) == 5
    assert len(world.circles) == 3


@pytest.mark.parametrize("name", ["office.bag", "loop_corridor.mcap", "warehouse.mcap", "cluttered_room"])
def test_samples_fit_their_truth_and_map(name):
    stem = ROOT / "sample_data" / name.split(".")[0]
    truth, grid = read_tum(f"{stem}.truth.tum"), read_map(f"{stem}.map.yaml").grid
    with open_recording(ROOT / "sample_data" / name) as recording:
        assert [t.name for t in recording.topics(LaserScan)] == ["/scan"]
        stamps = [scan.stamp_ns for scan in recording.measurements(["/scan"])]
    assert truth.stamps_ns.tolist() == stamps
    rc = grid.map_to_cell(truth.poses_se2[:, :2])
    np.testing.assert_array_equal(grid.cells[rc[:, 0], rc[:, 1]], 0)


def test_the_sample_of_a_camera_fits_its_truth():
    truth = read_tum(ROOT / "sample_data" / "desk_rgbd.truth.tum")
    with open_recording(ROOT / "sample_data" / "desk_rgbd.mcap") as recording:
        topics = sorted(t.name for t in recording.topics(Image))
        assert topics == [
            "/camera/aligned_depth_to_color/image_raw/compressedDepth",
            "/camera/color/image_raw/compressed",
        ]
        images = {topic: list(recording.measurements([topic])) for topic in topics}
    for found in images.values():
        assert [image.stamp_ns for image in found] == truth.stamps_ns.tolist()
        assert {image.pixels.shape[:2] for image in found} == {(240, 320)}
    depth = images[topics[0]][0].pixels
    assert 0.5 < np.median(depth[depth > 0]) < 2.5
    assert (ROOT / "sample_data" / "desk_rgbd.mcap").stat().st_size < 3e6
