# SPDX-License-Identifier: MIT
from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slamcli.errors import FormatError, UsageError
from slamcli.formats.map_images import read_image
from slamcli.formats.map_modes import PixelRule, table
from slamcli.formats.maps import read_map, write_map
from slamcli.grids import OccupancyGrid

DATA = Path(os.environ.get("SLAMCLI_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
needs_maps = pytest.mark.skipif(not (DATA / "maps").is_dir(), reason=f"no maps under {DATA}")

GRID = OccupancyGrid(
    np.array([[0, 100, -1, 25], [26, 64, 65, 99], [-1, 0, 50, 100]], dtype=np.int8), 0.05, (-25.0, 1.5, 0.25)
)


def naive_ros1(pixel: list[int], has_alpha: bool, rule: PixelRule) -> int:
    """One pixel as params.md section 12 words it."""
    colours = pixel[:-1] if has_alpha and rule.mode != "trinary" else pixel
    average = sum(colours) / len(colours)
    if rule.negate:
        average = 255 - average
    if rule.mode == "raw":
        return int(np.array(int(average), dtype=np.uint8).view(np.int8))
    occupancy = (255 - average) / 255.0
    if rule.mode == "scale" and has_alpha and pixel[-1] < 1:
        return -1
    if occupancy > rule.occupied_thresh:
        return 100
    if occupancy < rule.free_thresh:
        return 0
    if rule.mode == "trinary":
        return -1
    return int(1 + 98 * (occupancy - rule.free_thresh) / (rule.occupied_thresh - rule.free_thresh))


def write_yaml(path: Path, **keys: object) -> Path:
    values = dict(
        image="m.pgm", resolution=0.1, origin=[0.0, 0.0, 0.0], negate=0, occupied_thresh=0.65, free_thresh=0.196
    )
    values.update(keys)
    path.write_text("".join(f"{k}: {v}\n" for k, v in values.items() if v is not None))
    return path


def test_writes_what_map_saver_writes(tmp_path: Path) -> None:
    yaml_path, image = write_map(tmp_path / "map.yaml", GRID)
    assert yaml_path.read_text() == (
        "image: map.pgm\nresolution: 0.050000\norigin: [-25.000000, 1.500000, 0.250000]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n\n"
    )
    header = b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n4 3\n255\n"
    assert image.read_bytes() == header + bytes([205, 254, 205, 0, 205, 205, 0, 0, 254, 0, 205, 254])


@pytest.mark.parametrize("suffix", [".pgm", ".png", ".bmp"])
@pytest.mark.parametrize("negate", [False, True])
def test_trinary_round_trip(tmp_path: Path, suffix: str, negate: bool) -> None:
    write_map(tmp_path / "map.yaml", GRID, image=tmp_path / f"m{suffix}", negate=negate)
    read = read_map(tmp_path / "map.yaml")
    expected = np.array([[0, 100, -1, 0], [-1, -1, 100, 100], [-1, 0, -1, 100]], dtype=np.int8)
    np.testing.assert_array_equal(read.grid.cells, expected)
    assert read.grid.origin == GRID.origin
    assert read.grid.resolution_m == 0.05
    assert (read.mode, read.negate) == ("trinary", negate)


@pytest.mark.parametrize("mode", ["scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
def test_every_value_survives_scale_and_raw(tmp_path: Path, mode: str, negate: bool) -> None:
    cells = np.arange(-1, 101, dtype=np.int8).reshape(6, 17)
    write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05), mode=mode, negate=negate)
    read = read_map(tmp_path / "map.yaml")
    # Between the default thresholds lie 116 greys, but none that reads as 99: it becomes 100, the safe side.
    expected = np.where(cells == 99, 100, cells) if mode == "scale" else cells
    np.testing.assert_array_equal(read.grid.cells, expected)
    assert read.mode == mode


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_reads_pixels_as_map_server_does(tmp_path: Path, mode: str, negate: bool, channels: int) -> None:
    random = np.random.default_rng(7)
    pixels = random.integers(0, 256, (9, 8, channels), dtype=np.uint8)
    if channels == 4:
        pixels[::2, :, 3] = 0
        pixels[1::2, ::2, 3] = 255
    Image.fromarray(pixels.squeeze()).save(tmp_path / "m.png")
    path = write_yaml(tmp_path / "m.yaml", image="m.png", mode=mode, negate=int(negate))
    rule = PixelRule(mode=mode, negate=negate)
    expected = [[naive_ros1([int(v) for v in p], channels == 4, rule) for p in row] for row in pixels[::-1]]
    np.testing.assert_array_equal(read_map(path).grid.cells, np.array(expected, dtype=np.int8))


def test_nav2_reads_unknown_as_free_with_its_threshold(tmp_path: Path) -> None:
    write_map(tmp_path / "map.yaml", GRID)
    text = (tmp_path / "map.yaml").read_text().replace("0.196", "0.25")
    (tmp_path / "map.yaml").write_text(text)
    assert read_map(tmp_path / "map.yaml").grid.cells[2, 0] == 0
    assert read_map(tmp_path / "map.yaml", dialect="nav2").grid.cells[2, 0] == 0


def test_nav2_scale_and_raw_tables() -> None:
    scale = table(1, PixelRule(mode="scale", occupied_thresh=1.0, free_thresh=0.0), "nav2")
    assert [int(scale[v]) for v in (255, 128, 0)] == [0, 50, 100]
    raw = table(1, PixelRule(mode="raw"), "nav2")
    assert [int(raw[v]) for v in (0, 100, 101, 255)] == [0, 100, -1, -1]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"P2\n# a comment\n3 2 # another\n255\n0 205 254\n1 2 # end\n3\n", [[0, 205, 254], [1, 2, 3]]),
        (b"P2 3 1 15 0 7 15", [[0, 119, 255]]),
        (b"P5\n3 1\n15\n\x00\x07\x0f", [[0, 119, 255]]),
        (b"P5\n2 1\n65535\n\x00\x00\xff\xff", [[0, 255]]),
        (b"P5\n# CREATOR: GIMP\n2 2\n255\n #\n!", [[32, 35], [10, 33]]),
    ],
)
def test_reads_pgm_variants(tmp_path: Path, data: bytes, expected: list[list[int]]) -> None:
    (tmp_path / "m.pgm").write_bytes(data)
    np.testing.assert_array_equal(read_image(tmp_path / "m.pgm").channel_sum, expected)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"P5\n100 100\n255\nabc", "cut short"),
        (b"P2\n3 3\n255\n1 2 3", "cut short"),
        (b"P5\n99999999 99999999\n255\n", "no map has this size"),
        (b"P5\n0 5\n255\n", "no map has this size"),
        (b"P5\n-3 5\n255\n", "no width"),
        (b"P5\n3", "no height"),
        (b"P5\n3 3\n0\n123456789", "maxval"),
        (b"P2\n1 1\n10\n11", "more than the maxval"),
        (b"P2\n1 1\n10\nx", "not a number"),
        (b"", "not a picture"),
        (b"hello", "not a picture"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff\xff\xff\xff\xff\xff\xff\xff\x08\0\0\0\0", "not a picture|no map has"),
    ],
)
def test_damaged_picture_is_one_clear_line(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "m.pgm").write_bytes(data)
    with pytest.raises(FormatError, match=message) as error:
        read_map(write_yaml(tmp_path / "m.yaml"))
    assert "\n" not in str(error.value)
    assert "m.pgm" in str(error.value)


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "webp"])
def test_pictures_that_claim_an_absurd_size_are_not_decoded(tmp_path: Path, suffix: str) -> None:
    image = tmp_path / f"m.{suffix}"
    Image.fromarray(np.zeros((4, 4), dtype=np.uint8)).save(image, **({"lossless": True} if suffix == "webp" else {}))
    data = image.read_bytes()
    for cut in range(len(data)):
        image.write_bytes(data[:cut] + b"\xff\xff\xff\xff" + data[cut + 4 :])
        with contextlib.suppress(FormatError):
            assert read_image(image).channel_sum.size < 10_000


@pytest.mark.parametrize("cut", [0.2, 0.5, 0.9, 0.99])
def test_truncated_png(tmp_path: Path, cut: float) -> None:
    cells = np.random.default_rng(1).integers(-1, 101, (40, 40)).astype(np.int8)
    _, image = write_map(tmp_path / "map.yaml", OccupancyGrid(cells, 0.05), mode="scale")
    image.write_bytes(image.read_bytes()[: int(cut * image.stat().st_size)])
    with pytest.raises(FormatError, match=r"map\.png"):
        read_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": 0}, "positive"),
        ({"resolution": "nan"}, "positive"),
        ({"resolution": -0.05}, "positive"),
        ({"resolution": None}, "'resolution' is missing"),
        ({"image": None}, "'image' is missing"),
        ({"image": "none.pgm"}, "does not exist; pictures there: m.pgm"),
        ({"image": "."}, "not a file"),
        ({"image": "/dev/zero"}, "not a file"),
        ({"image": "/elsewhere/m.pgm"}, "lies beside the YAML"),
        ({"origin": "[0, 0]"}, "three numbers"),
        ({"origin": "[0, 0, .nan]"}, "three numbers"),
        ({"origin": "7"}, "three numbers"),
        ({"negate": "maybe"}, "0 or 1"),
        ({"mode": "grey"}, "trinary, scale, raw"),
        ({"occupied_thresh": 65}, "from 0 to 1"),
        ({"free_thresh": 0.7}, "above occupied_thresh"),
        ({"free_thresh": "{a: b}"}, "from 0 to 1"),
    ],
)
def test_bad_yaml_value_is_one_clear_line(tmp_path: Path, keys: dict[str, object], message: str) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 2\n255\n\x00\xfe\xcd\x00")
    with pytest.raises(FormatError, match=message) as error:
        read_map(write_yaml(tmp_path / "m.yaml", **keys))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["", "just text", "[1, 2]", "a: [", "\t: x", "P5\n2 2\n255\n", "[" * 5000, "\xff"])
def test_not_a_map_yaml(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.yaml").write_text(text, encoding="latin-1")
    with pytest.raises(FormatError, match=r"m\.yaml"):
        read_map(tmp_path / "m.yaml")


def test_missing_yaml_and_folder(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such map"):
        read_map(tmp_path / "m.yaml")
    with pytest.raises(FormatError, match="not a file"):
        read_map(tmp_path)


def test_bool_negate_absolute_path_and_exponents(tmp_path: Path) -> None:
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 1\n255\n\x00\xfe")
    path = write_yaml(tmp_path / "m.yaml", image=tmp_path / "m.pgm", negate="true", resolution="5e-2", extra=1)
    read = read_map(path)
    assert read.grid.cells.tolist() == [[0, 100]]
    assert read.grid.resolution_m == 0.05
    assert "extra" in read.warnings[0]


def test_refuses_what_would_not_read_back(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="unknown"):
        write_map(tmp_path / "map.yaml", GRID, free_thresh=0.25)
    with pytest.raises(UsageError, match="transparency"):
        write_map(tmp_path / "map.yaml", GRID, mode="scale", image=tmp_path / "map.pgm")
    with pytest.raises(UsageError, match="written as"):
        write_map(tmp_path / "map.yaml", GRID, image=tmp_path / "map.jpg")
    with pytest.raises(UsageError, match=r"\.yaml"):
        write_map(tmp_path / "map.pgm", GRID)
    assert list(tmp_path.iterdir()) == []


def test_resolution_that_six_decimals_would_change(tmp_path: Path) -> None:
    write_map(tmp_path / "map.yaml", OccupancyGrid(GRID.cells, 1 / 30))
    assert read_map(tmp_path / "map.yaml").grid.resolution_m == 1 / 30


def test_image_in_another_folder_and_odd_name(tmp_path: Path) -> None:
    write_map(tmp_path / "a" / "map.yaml", GRID, image=tmp_path / "b" / "my: map #1.pgm")
    assert read_map(tmp_path / "a" / "map.yaml").grid.cells.shape == (3, 4)


@needs_maps
@pytest.mark.real_data
def test_all_real_maps_read() -> None:
    known: dict[str, tuple[int, int, int]] = {}
    for path in sorted((DATA / "maps").rglob("*.yaml")):
        if path.name == "empty_room.yaml":
            with pytest.raises(FormatError, match=r"empty\.pgm"):
                read_map(path)
            continue
        cells = read_map(path).grid.cells
        known[path.parent.name + "/" + path.name] = tuple(int((cells == v).sum()) for v in (0, 100, -1))
    assert len(known) == 14
    assert known["navigation/testmap.yaml"] == known["nav2/testmap.yaml"]
    assert sum(known["nav2/depot.yaml"]) == 604 * 307
    assert known["nav2/depot.yaml"][2] == 0  # free_thresh 0.25: its unknown cells (205) are read as free
