# SPDX-License-Identifier: MIT
import contextlib
import random
import struct
import time
from pathlib import Path

import pytest
import zstandard
from sample_bags import START_NS, SUFFIXES, core, write_plain_mcap, write_sample

from slamcli.errors import RecordingError, SlamcliError
from slamcli.recordings.containers import open_raw
from slamcli.recordings.containers.compression import DecompressionError, decompress
from slamcli.runtime import RunLog

FILES = [
    ("rosbag1", "none"),
    ("rosbag1", "bz2"),
    ("rosbag1", "lz4"),
    ("mcap", "none"),
    ("mcap", "lz4"),
    ("mcap", "zstd"),
    ("mcap", "unchunked"),
    ("sqlite3", "none"),
]


def _write(path: Path, format: str, compression: str) -> list[tuple[str, int, bytes]]:
    if compression == "unchunked":
        return core(write_plain_mcap(path))
    return core(write_sample(path, format, compression))


def _read(path: Path) -> tuple[list[tuple[str, int, bytes]], tuple[str, ...], RunLog]:
    log = RunLog()
    with open_raw(path, log) as reader:
        read = core(reader.messages())
        return read, reader.contents.damage, log


def _refusal(path: Path) -> str:
    """What is said where a file cannot be opened at all; one line."""
    try:
        with open_raw(path):
            return ""
    except SlamcliError as error:
        return str(error).replace("\n", "two lines")


@pytest.mark.parametrize(("format", "compression"), FILES)
def test_cut_off_files_are_read_up_to_the_cut(tmp_path: Path, format: str, compression: str) -> None:
    path = tmp_path / f"bag{SUFFIXES[format]}"
    written = _write(path, format, compression)
    data = path.read_bytes()
    counts = []
    for cut in range(0, len(data), max(len(data) // 40, 1)):
        path.write_bytes(data[:cut])
        message = _refusal(path)
        if message:
            assert str(path) in message
            counts.append(0)
            continue
        read, damage, log = _read(path)
        assert read == written[: len(read)]
        assert damage, cut
        assert log.warnings == list(damage)
        counts.append(len(read))
    if format != "sqlite3":  # a page that leads to others may be cut off
        assert counts == sorted(counts)
        # Nothing but the last chunk (some 8 messages) is lost; 4 kB are the head of a ROS 1 bag, the end is an index.
        step = max(len(data) // 40, 1)
        assert all(count >= 60 * (cut * step - 4200) / len(data) - 12 for cut, count in enumerate(counts))
    assert max(counts) > 50


def test_an_unclosed_bag_says_how_much_was_lost_and_which_stamp_was_last(tmp_path: Path) -> None:
    path = tmp_path / "x.bag"
    write_sample(path, "rosbag1", "none")
    data = bytearray(path.read_bytes())
    index = data.index(b"index_pos=")
    data[index + 10 : index + 18] = bytes(8)
    path.write_bytes(data[:9000])
    read, damage, _ = _read(path)
    assert 10 < len(read) < 60
    text = " ".join(damage)
    assert "the recording was not closed" in text
    assert "bytes" in text
    assert f"{read[-1][1] // 10**9}.{read[-1][1] % 10**9:09d}" in text


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_a_damaged_chunk_costs_only_itself(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "x.bag"
    written = core(write_sample(path, "rosbag1", compression))
    data = bytearray(path.read_bytes())
    third = [i for i in range(len(data)) if data.startswith(b"compression=", i)][2]
    data[third + 80 : third + 100] = bytes(20)
    path.write_bytes(data)
    read, damage, _ = _read(path)
    assert 40 < len(read) < 60
    assert set(read) < set(written)
    assert read[-1] == written[-1]
    assert "chunk at byte" in damage[0]


def test_wrong_lengths_in_index_records(tmp_path: Path) -> None:
    """As an early writer made them: 20 bytes declared for each entry of 12; with the file's own index cut off."""
    path = tmp_path / "x.bag"
    written = core(write_sample(path, "rosbag1", "none"))
    data = bytearray(path.read_bytes())
    position = 13
    while position < len(data):
        (head,) = struct.unpack_from("<I", data, position)
        (size,) = struct.unpack_from("<I", data, position + 4 + head)
        if b"op=\x04" in data[position : position + 4 + head]:
            struct.pack_into("<I", data, position + 4 + head, size // 12 * 20)
        position += 8 + head + size
    path.write_bytes(data)
    assert _read(path)[:2] == (written, ())
    index = data.index(b"index_pos=")
    data[index + 10 : index + 18] = bytes(8)
    path.write_bytes(data)
    read, damage, _ = _read(path)
    assert read == written
    assert "read in sequence instead" in damage[0]


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_reading_goes_on_behind_damage_without_an_index(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "x.bag"
    written = core(write_sample(path, "rosbag1", compression, number=120))
    data = bytearray(path.read_bytes())
    index = data.index(b"index_pos=")
    data[index + 10 : index + 18] = bytes(8)
    chunks = [i for i in range(len(data)) if data.startswith(b"compression=", i)]
    assert len(chunks) > 6
    del data[chunks[2] + 60 : chunks[2] + 100]  # the records behind are shifted
    path.write_bytes(data)
    read, damage, _ = _read(path)
    assert set(read) < set(written)
    assert read[-1] == written[-1]
    assert len(read) > 90
    assert any("bytes are lost" in line for line in damage)


def test_wrong_checksums_are_told(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    written = core(write_sample(path, "mcap", "none"))
    data = bytearray(path.read_bytes())
    place = data.index(written[20][2]) + 20
    data[place] ^= 1
    path.write_bytes(data)
    read, damage, _ = _read(path)
    assert len(read) == 60
    assert "wrong checksum" in damage[0]


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("x.bag", b"", "is empty"),
        ("x.bag", b"hello, this is no bag", "not a recording"),
        ("x.bag", b"#ROSBAG V1.2\n" + bytes(200), "V1.2"),
        ("x.bag", b"#ROSRECORD V1.2\n" + bytes(200), "V1.2"),
        ("x.mcap", b"\x1f\x8b" + bytes(50), "gunzip"),
        ("x.db3", b"SQLite format 3\x00" + bytes(200), "damaged at its beginning"),
        ("x.db3", b"SQLite format 3\x00", "damaged at its beginning"),
    ],
)
def test_what_is_no_bag_gets_one_line(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(RecordingError, match=words) as caught:
        open_raw(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_missing_files_folders_and_mixed_formats(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        open_raw(tmp_path / "none.bag")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"neither \.db3 nor \.mcap"):
        open_raw(tmp_path / "empty")
    write_sample(tmp_path / "empty" / "x.bag", "rosbag1", "none")
    with pytest.raises(RecordingError, match=r"name one of its files: x\.bag"):
        open_raw(tmp_path / "empty")
    write_sample(tmp_path / "x.mcap", "mcap", "none")
    with pytest.raises(RecordingError, match="different formats"):
        open_raw([tmp_path / "empty" / "x.bag", tmp_path / "x.mcap"])


def test_a_database_that_is_no_bag(tmp_path: Path) -> None:
    import sqlite3

    connection = sqlite3.connect(tmp_path / "x.db3")
    connection.execute("CREATE TABLE songs(id)")
    connection.commit()
    connection.close()
    with pytest.raises(RecordingError, match="tables: songs"):
        open_raw(tmp_path / "x.db3")


def test_a_damaged_schema_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "x.db3"
    write_sample(path, "sqlite3", "none")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"CREATE TABLE topics", b"CRE\xff\xff TABLE topics"))
    assert "two lines" not in _refusal(path)
    assert "nothing can be read" in _refusal(path)


@pytest.mark.parametrize("compression", ["bz2", "zstd", "lz4"])
def test_bombs_stop_at_the_declared_size(compression: str) -> None:
    import bz2

    import lz4.frame

    pack = {"bz2": bz2.compress, "zstd": zstandard.compress, "lz4": lz4.frame.compress}[compression]
    bomb = pack(bytes(50_000_000))
    with pytest.raises(DecompressionError) as caught:
        decompress(bomb, compression, 1000)
    assert len(caught.value.partial) <= 1001
    with pytest.raises(DecompressionError, match="more than any writer"):
        decompress(bomb, compression, 1 << 40)
    assert len(decompress(bomb, compression, 50_000_000)) == 50_000_000


def _mutated(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    kind = rng.randrange(4)
    place = rng.randrange(len(out) - 8)
    if kind == 0:
        out[place] ^= 1 << rng.randrange(8)
    elif kind == 1:
        out[place : place + 4] = rng.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\x80"))
    elif kind == 2:
        del out[place : place + rng.choice((1, 8, 200))]
    else:
        out[place:place] = out[: rng.choice((1, 40))]
    return bytes(out)


@pytest.mark.parametrize(("format", "compression"), FILES)
def test_mutated_files_end_well(tmp_path: Path, format: str, compression: str) -> None:
    path = tmp_path / f"bag{SUFFIXES[format]}"
    _write(path, format, compression)
    data = path.read_bytes()
    rng = random.Random(f"{format} {compression}")
    for _ in range(40):
        path.write_bytes(_mutated(data, rng))
        began = time.monotonic()
        message = _refusal(path)
        assert "two lines" not in message
        if not message:
            _read_all(path)
        assert time.monotonic() - began < 5


def _read_all(path: Path) -> None:
    with open_raw(path, RunLog()) as reader:
        for message in reader.messages():
            with contextlib.suppress(RecordingError):
                reader.decode(message)
        list(reader.messages(["/a"], START_NS + 10**9, START_NS + 2 * 10**9))
