# SPDX-License-Identifier: MIT
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.maps import read_map, write_map
from slamcli.grids import OccupancyGrid


@pytest.fixture
def cells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    cells = np.full((30, 40), -1, dtype=np.int8)
    cells[5:20, 10:35] = 0
    cells[5, 10:35] = 100
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.1, (-1.0, -2.0, 0.0)))
    monkeypatch.chdir(tmp_path)
    return cells


def document(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> dict:
    assert run(["map-tools", *arguments, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def test_info(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    found = document(capsys, "info", "map.yaml")
    assert (found["width"], found["height"], found["resolution_m"]) == (40, 30, 0.1)
    assert found["cells"]["ros1"] == {"free": 350, "occupied": 25, "between": 0, "unknown": 825}
    assert found["cells"]["nav2"] == found["cells"]["ros1"]
    assert found["area_m2"]["ros1"]["free"] == pytest.approx(3.5)
    assert found["known_bounds_m"] == pytest.approx([0.0, -1.5, 2.5, 0.0])
    assert found["warnings"] == []
    assert run(["map-tools", "info", "map.yaml"]) == 0
    assert "350 (3.5 m²)" in capsys.readouterr().out


def test_info_warns_of_unknown_that_is_read_as_free(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    Path("map.yaml").write_text(Path("map.yaml").read_text().replace("0.196", "0.25"))
    found = document(capsys, "info", "map.yaml")
    assert found["cells"]["ros1"]["unknown"] == 0
    assert "825 pixels have the value 205" in found["warnings"][0]


def test_info_says_where_the_readers_differ(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    raw = OccupancyGrid(np.arange(-128, 128, dtype=np.int64).astype(np.int8).reshape(16, 16), 0.1)
    write_map("raw.yaml", raw, mode="raw")
    pixels = bytes(range(256))
    Path("raw.pgm").write_bytes(b"P5\n16 16\n255\n" + pixels)
    found = document(capsys, "info", "raw.yaml")
    # ROS 1 keeps 101..127 and makes 128..254 negative; nav2 makes all of them unknown.
    assert found["differing_cells"] == 254 - 100
    assert any("differently" in warning for warning in found["warnings"])


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("suffix", ["png", "bmp", "pgm"])
def test_convert(cells: np.ndarray, capsys: pytest.CaptureFixture[str], mode: str, suffix: str) -> None:
    arguments = ["convert", "map.yaml", "out.yaml", "--mode", mode, "--image-format", suffix, "--negate"]
    if mode == "scale" and suffix != "png":
        assert run(["map-tools", *arguments]) == 2
        assert not Path("out.yaml").exists()
        return
    assert document(capsys, *arguments)["outputs"] == ["out.yaml", f"out.{suffix}", "out.yaml.run.json"]
    read = read_map("out.yaml")
    np.testing.assert_array_equal(read.grid.cells, cells)
    assert (read.mode, read.negate) == (mode, True)


def test_crop_to_known_and_to_bounds(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    document(capsys, "crop", "map.yaml", "small.yaml")
    small = read_map("small.yaml").grid
    np.testing.assert_array_equal(small.cells, cells[5:20, 10:35])
    assert small.origin == pytest.approx((0.0, -1.5, 0.0))
    document(capsys, "crop", "map.yaml", "small.yaml", "--bounds", "-1,-2,0.2,-1.4", "--margin", "0.1")
    np.testing.assert_array_equal(read_map("small.yaml").grid.cells, cells[0:7, 0:13])
    for bounds in ("5,5,6,6", "1,1,0,0", "1,2,3", "a,b,c,d", "nan,0,1,1"):
        assert run(["map-tools", "crop", "map.yaml", "other.yaml", "--bounds", bounds]) == 2
    assert not Path("other.yaml").exists()


def test_diff(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    other = cells.copy()
    other[10, 12:15], other[0, 0] = 100, 0
    write_map("other.yaml", OccupancyGrid(other, 0.1, (-1.0, -2.0, 0.0)), mode="raw")
    found = document(capsys, "diff", "map.yaml", "other.yaml", "-o", "diff.png")
    assert (found["changed_cells"], found["appeared_cells"], found["vanished_cells"]) == (3, 1, 0)
    assert found["changed"] == pytest.approx(3 / 375)
    assert Path("diff.png").read_bytes()[:4] == b"\x89PNG"
    assert run(["map-tools", "diff", "map.yaml", "other.yaml", "--max", "changed=0.01"]) == 0
    capsys.readouterr()
    assert run(["map-tools", "diff", "map.yaml", "other.yaml", "--max", "changed_cells=2"]) == 1
    shown = capsys.readouterr()
    assert "changed_cells is 3, 1 above 2" in shown.err
    assert "changed 3 of 375" in shown.out
    for limit in ("changed", "changd=1"):
        assert run(["map-tools", "diff", "map.yaml", "other.yaml", "--max", limit]) == 2
    assert run(["map-tools", "diff", "map.yaml", "other.yaml", "-o", "diff.txt"]) == 2


def test_a_broken_map_is_one_line_and_exit_2(cells: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    Path("map.pgm").write_bytes(b"P5\n40 30\n255\n123")
    for arguments in (["info", "map.yaml"], ["convert", "map.yaml", "o.yaml"], ["diff", "map.yaml", "map.yaml"]):
        assert run(["map-tools", *arguments]) == 2
        shown = capsys.readouterr()
        assert "cut short" in shown.err
        assert len(shown.err.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [["convert", "map.yaml", "map.yaml"], ["crop", "map.yaml", "./map.yaml"], ["crop", "map.yaml", "o.yaml", "--margin", "nan"]],
)  # fmt: skip
def test_a_map_is_not_written_over_itself(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.chdir(tmp_path)
    write_map("map.yaml", OccupancyGrid(np.zeros((20, 20), dtype=np.int8), 0.05))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run(["map-tools", *arguments]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
