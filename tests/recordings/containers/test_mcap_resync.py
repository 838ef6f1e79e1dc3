# SPDX-License-Identifier: MIT
from __future__ import annotations

import random
import struct
import time
from pathlib import Path

import pytest

from slamcli.recordings.containers import create_raw, open_raw
from slamcli.recordings.containers import mcap_records as records
from slamcli.recordings.raw import RawMessage, Topic

NUM = 3000
START, STEP = 10**18, 10**7


def _write(path: Path, compression: str) -> bytearray:
    rng = random.Random(1)
    with create_raw(path, compression=compression) as writer:
        writer.add_topic(Topic(name="/a", msgtype="std_msgs/msg/String", count=None, definition="string data\n"))
        for i in range(NUM):
            text = b"%04d" % i + rng.randbytes(1100).replace(b"\0", b"x")
            data = b"\0\1\0\0" + struct.pack("<I", len(text) + 1) + text + b"\0"
            writer.write(RawMessage("/a", START + i * STEP, data, 0))
    return bytearray(path.read_bytes()[:-150])  # without a footer: its records must be read in sequence


def _chunks(data: bytes) -> list[int]:
    found, position = [], len(records.MAGIC)
    while position + 9 <= len(data):
        op, length = records.PREFIX.unpack_from(data, position)
        if op == records.CHUNK:
            found.append(position)
        position += 9 + length
    return found


def _read(path: Path) -> tuple[list[int], str]:
    with open_raw(path) as reader:
        numbers = []
        for message in reader.messages():
            number = int(bytes(message.data[8:12]))
            assert message.log_time_ns == START + number * STEP
            numbers.append(number)
        return numbers, "\n".join(reader.contents.damage)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("wrong", ["length", "type", "inserted"])
def test_reading_goes_on_behind_a_damaged_record(tmp_path: Path, compression: str, wrong: str) -> None:
    data = _write(tmp_path / "a.mcap", compression)
    chunks = _chunks(data)
    assert len(chunks) >= 4
    if wrong == "length":
        data[chunks[1] + 1 : chunks[1] + 9] = struct.pack("<Q", 2**50)
    elif wrong == "type":
        data[chunks[1]] = 0
    else:
        data[chunks[1] : chunks[1]] = bytes(range(16, 116)) * 10
    (tmp_path / "b.mcap").write_bytes(data)
    numbers, damage = _read(tmp_path / "b.mcap")
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == NUM - 1
    assert len(numbers) > NUM - 1000  # at most the damaged chunk
    if wrong == "inserted":
        assert len(numbers) == NUM
    assert "bytes are lost" in damage


def test_messages_outside_of_chunks(tmp_path: Path) -> None:
    def record(op: int, body: bytes) -> bytes:
        return records.PREFIX.pack(op, len(body)) + body

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    schema = struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data\n")
    channel = struct.pack("<HH", 1, 1) + text("/a") + text("cdr") + struct.pack("<I", 0)
    parts = [records.MAGIC, record(records.HEADER, text("ros2") + text("")), record(records.SCHEMA, schema), record(records.CHANNEL, channel)]  # fmt: skip
    for i in range(NUM):
        content = b"\0\1\0\0" + struct.pack("<I", 5) + b"%04d\0" % i
        stamp = START + i * STEP
        parts.append(record(records.MESSAGE, struct.pack("<HIQQ", 1, i, stamp, stamp) + content))
        if i == NUM // 2:
            parts.append(b"\x05" + b"\xff" * 8 + bytes(300))
    (tmp_path / "a.mcap").write_bytes(b"".join(parts))
    numbers, damage = _read(tmp_path / "a.mcap")
    assert numbers == list(range(NUM))
    assert "309 of" in damage


@pytest.mark.parametrize("byte", [0, 5, 6])
def test_garbage_takes_bounded_time(tmp_path: Path, byte: int) -> None:
    data = _write(tmp_path / "a.mcap", "none")
    first = _chunks(data)[1]
    body = records.PREFIX.pack(records.CHUNK, 40) + struct.pack("<QQQI", 0, 0, 0, 0) + struct.pack("<IQ", 0, 0)
    garbage = bytes([byte]) * 4_000_000 + (body + b"\0") * 20_000
    (tmp_path / "b.mcap").write_bytes(bytes(data[:first]) + garbage)
    began = time.perf_counter()
    numbers, damage = _read(tmp_path / "b.mcap")
    assert time.perf_counter() - began < 20
    assert numbers[0] == 0
    assert "bytes are lost" in damage
