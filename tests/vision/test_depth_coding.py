# SPDX-License-Identifier: MIT
"""RVL: the compiled codec against a naive twin, and damaged bytes."""

from __future__ import annotations

import struct
from contextlib import suppress

import numpy as np
import pytest
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.vision.depth_coding import decode_rvl, encode_rvl, in_millimetres

pytestmark = pytest.mark.kernels


def naive_rvl(image: NDArray[np.uint16]) -> bytes:
    """Wilson's algorithm with a list of nibbles."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while True:
            low, number = number & 7, number >> 3
            nibbles.append(low | (8 if number else 0))
            if not number:
                return

    values = [int(value) for value in image.ravel()]
    previous, i = 0, 0
    while i < len(values):
        for wanted in (False, True):
            begin = i
            while i < len(values) and bool(values[i]) == wanted:
                i += 1
            put(i - begin)
        for value in values[begin:i]:
            delta, previous = value - previous, value
            put(delta * 2 if delta >= 0 else -delta * 2 - 1)
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[k : k + 8]), 16) for k in range(0, len(nibbles), 8)]
    return struct.pack("<8sii", b"DEPTHRVL", image.shape[1], image.shape[0]) + struct.pack(f"<{len(words)}I", *words)


def images() -> list[NDArray[np.uint16]]:
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 65536, (7, 9), dtype=np.uint16)
    holes = np.where(rng.random((12, 10)) < 0.5, 0, rng.integers(900, 1100, (12, 10))).astype(np.uint16)
    extremes = np.array([[65535, 0, 1, 65535], [0, 0, 65535, 1]], dtype=np.uint16)
    ramp = np.arange(400, 520, dtype=np.uint16).reshape(10, 12)
    return [noise, holes, extremes, ramp, np.zeros((3, 5), np.uint16), np.full((1, 1), 7, np.uint16)]


@pytest.mark.parametrize("image", images(), ids=["noise", "holes", "extremes", "ramp", "zeros", "one"])
def test_rvl_equals_its_naive_twin_and_comes_back(image: NDArray[np.uint16]) -> None:
    data = encode_rvl(image)
    assert data == naive_rvl(image)
    assert np.array_equal(decode_rvl(data), image)


def test_a_ramp_takes_a_nibble_for_a_pixel() -> None:
    ramp = np.arange(1, 8001, dtype=np.uint16).reshape(80, 100)
    assert len(encode_rvl(ramp)) - 16 <= 8000 // 2 + 8


@pytest.mark.parametrize("cut", [0, 8, 15, 16, 20, 40])
def test_bytes_that_end_early_are_refused(cut: int) -> None:
    data = encode_rvl(images()[0])
    with pytest.raises(FormatError, match="RVL"):
        decode_rvl(data[:cut])


def test_no_damage_is_read_beyond_the_image() -> None:
    rng = np.random.default_rng(4)
    data = encode_rvl(images()[1])
    for _ in range(200):
        damaged = bytearray(data)
        damaged[int(rng.integers(16, len(data)))] = int(rng.integers(0, 256))
        with suppress(FormatError):  # or another image of the same size
            assert decode_rvl(bytes(damaged)).shape == (12, 10)


@pytest.mark.parametrize("size", [(-1, 4), (0, 4), (1 << 20, 1 << 20)])
def test_sizes_that_no_camera_has_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(FormatError, match="damaged"):
        decode_rvl(struct.pack("<8sii", b"DEPTHRVL", *size) + bytes(40))


def naive_millimetres(depth: NDArray[np.float32], rounding: bool) -> NDArray[np.uint16] | None:
    scaled = np.where(np.isfinite(depth) & (depth > 0.0), depth, 0.0).astype(np.float64) * 1000.0
    whole = np.rint(scaled)
    if rounding:
        return np.where(whole > 65535, 0, whole).astype(np.uint16)
    return whole.astype(np.uint16) if whole.max() <= 65535 and np.abs(whole - scaled).max() <= 0.01 else None


@pytest.mark.parametrize("rounding", [False, True])
def test_millimetres_equal_their_naive_twin(rounding: bool) -> None:
    rng = np.random.default_rng(6)
    whole = (rng.integers(0, 65536, (9, 11)) / 1000.0).astype(np.float32)
    whole[0, :5] = [0.0, -1.0, np.nan, np.inf, 65.535]
    fine = rng.uniform(0.0, 80.0, (9, 11)).astype(np.float32)
    far = np.full((2, 2), 65.536, dtype=np.float32)
    for depth, kept in ((whole, True), (fine, rounding), (far, rounding)):
        values, naive = in_millimetres(depth, rounding=rounding), naive_millimetres(depth, rounding)
        assert (values is not None) == (naive is not None) == kept
        if kept:
            assert np.array_equal(values, naive)
