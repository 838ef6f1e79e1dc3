# SPDX-License-Identifier: MIT
"""Mutations of files: of their bytes, their numbers and their lines."""

from __future__ import annotations

import gzip
import random
import re
import shutil
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORDS = [b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"1e-320", b"99999999999999999999", b"-0.0", b"", b"x", b"\xff", b"''",
          b"[]", b"{}", b"null", b"true", b"0x10", b"1e9", b"2147483648", b"-9223372036854775809", b"\x00", b"1,5", b"~", b"*a", b"&a"]  # fmt: skip
_INTEGERS = [
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFFFFFF,
    0x80000000,
    0xFFFFFFFF,
    0x7FFFFFFFFFFFFFFF,
    0xFFFFFFFFFFFFFFFF,
]


def mutate(seed: Any, folder: Path, rng: random.Random, corpus: Sequence[Any]) -> Path:
    """Copy an input of the corpus into `folder` with something changed; return the path to give to a command."""
    target = folder / seed.path.name
    if seed.path.is_dir():
        shutil.copytree(seed.path, target)
        files = sorted(path for path in target.rglob("*") if path.is_file())
    else:
        shutil.copy(seed.path, target)
        files = [target]
        for companion in seed.companions:
            shutil.copy(companion, folder / companion.name)
            files.append(folder / companion.name)
    victim = rng.choice(files)
    if rng.random() < 0.02:
        victim.unlink()
        return target
    others = [other.path for other in corpus if other.kind == seed.kind and other.path.is_file()]
    victim.write_bytes(mutate_file(victim.name, victim.read_bytes(), rng, others))
    return target


def mutate_file(name: str, data: bytes, rng: random.Random, others: Sequence[Path]) -> bytes:
    """Return changed content; within gzip half of the time."""
    if name.endswith(".gz") and rng.random() < 0.5:
        return gzip.compress(mutate_file(name[:-3], gzip.decompress(data), rng, []), mtime=0)
    is_text = b"\x00" not in data[:1000] and name.rpartition(".")[2] not in (
        "pgm",
        "png",
        "bmp",
        "gz",
        "bag",
        "mcap",
        "db3",
    )
    for _ in range(rng.choice([1, 1, 1, 2, 3, 8])):
        kinds = [*_TEXT, *_BYTES] if is_text else _BYTES
        data = rng.choice(kinds)(data, rng)
    if others and rng.random() < 0.05:
        data = splice(data, rng.choice(others).read_bytes(), rng)
    return data


def flip_bits(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 4, 32])):
        if changed:
            changed[_position(changed, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def set_integer(data: bytes, rng: random.Random) -> bytes:
    size, code = rng.choice([(1, "B"), (2, "<H"), (4, "<I"), (4, ">I"), (8, "<Q")])
    if len(data) < size:
        return data
    at = min(_position(data, rng), len(data) - size)
    return data[:at] + struct.pack(code, rng.choice(_INTEGERS) & ((1 << 8 * size) - 1)) + data[at + size :]


def set_double(data: bytes, rng: random.Random) -> bytes:
    if len(data) < 8:
        return data
    at = min(_position(data, rng), len(data) - 8)
    value = rng.choice([float("nan"), float("inf"), -float("inf"), 1e308, -1.0, 0.0, 1e-320, 1e20])
    return data[:at] + struct.pack("<d", value) + data[at + 8 :]


def truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def remove(data: bytes, rng: random.Random) -> bytes:
    at, size = _span(data, rng)
    return data[:at] + data[at + size :]


def repeat(data: bytes, rng: random.Random) -> bytes:
    at, size = _span(data, rng)
    return data[: at + size] + data[at : at + size] * rng.choice([1, 1, 3]) + data[at + size :]


def insert(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice([1, 4, 64])) + data[at:]


def zero(data: bytes, rng: random.Random) -> bytes:
    at, size = _span(data, rng)
    return data[:at] + bytes([rng.choice([0, 0xFF])]) * size + data[at + size :]


def splice(data: bytes, other: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def change_number(data: bytes, rng: random.Random) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return data
    number = rng.choice(found[:50] if rng.random() < 0.5 else found)
    return data[: number.start()] + rng.choice(_WORDS) + data[number.end() :]


def change_word(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"[A-Za-z_]+", data))
    if not found:
        return data
    word = rng.choice(found)
    new = rng.choice([*_WORDS, rng.choice(found).group(), word.group()[::-1], word.group() * 50])
    return data[: word.start()] + new + data[word.end() :]


def change_line(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    other = rng.randrange(len(lines))
    action = rng.randrange(4)
    if action == 0:
        del lines[at]
    elif action == 1:
        lines[at], lines[other] = lines[other], lines[at]
    elif action == 2:
        lines[at:at] = [lines[other]] * rng.choice([1, 5])
    else:
        lines[at] = b" ".join([lines[at]] * rng.choice([2, 30]))
    return b"\n".join(lines)


def change_separator(data: bytes, rng: random.Random) -> bytes:
    old, new = rng.sample([b" ", b",", b"\n", b"\t", b":", b"\r\n", b"  ", b">", b'"'], 2)
    return data.replace(old, new, rng.choice([1, 1, 10_000]))


def _position(data: bytes | bytearray, rng: random.Random) -> int:
    """Half of the time near the head, where the structure is."""
    return rng.randrange(min(len(data), 512)) if rng.random() < 0.4 else rng.randrange(len(data))


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    return rng.randrange(len(data) + 1), rng.choice([1, 2, 8, 100, 5000])


_BYTES = [flip_bits, flip_bits, set_integer, set_integer, set_double, truncate, remove, repeat, insert, zero]
_TEXT = [change_number, change_number, change_word, change_line, change_separator]
