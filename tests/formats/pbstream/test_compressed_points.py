# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from slamcli.errors import DataError, FormatError
from slamcli.formats.pbstream import packed, points

CLOUDS = arrays.arrays(np.int64, st.tuples(st.integers(0, 40), st.just(3)), elements=st.integers(-8_388_000, 8_388_000))


def naive(numbers: list[int]) -> list[tuple[np.float32, ...]]:
    """The decoder as a loop over the numbers."""
    out, at = [], 0
    while at < len(numbers):
        count, bx, by, bz = numbers[at : at + 4]
        for code in numbers[at + 4 : at + 4 + count]:
            whole = (bx * 1024 + code % 1024, by * 1024 + code // 1024 % 1024, bz * 1024 + code // 1048576)
            out.append(tuple(np.float32(w) * np.float32(0.001) for w in whole))
        at += 4 + count
    return out


@given(CLOUDS)
def test_millimetres_come_back(steps: np.ndarray) -> None:
    cloud = steps.astype(np.float32) * np.float32(0.001)
    ((count, data),) = points.encode([cloud])
    assert count == len(cloud)
    decoded = points.decode(count, data, "x")
    assert decoded.dtype == np.float32
    assert [tuple(p) for p in decoded] == naive(packed.unpack(data, "x").tolist())
    assert sorted(map(tuple, decoded.tolist())) == sorted(map(tuple, cloud.tolist()))
    assert points.encode([decoded]) == [(count, data)]  # what was read is written as it was, order and all


@given(arrays.arrays(np.float32, (5, 3), elements=st.floats(-100, 100, width=32)))
def test_rounding_is_half_a_millimetre(cloud: np.ndarray) -> None:
    decoded = points.decode(*points.encode([cloud])[0], "x")
    distances = np.abs(decoded[:, None] - cloud[None]).max(axis=2)
    assert (distances.min(axis=0) < 0.000_51).all()


@given(st.lists(CLOUDS, max_size=5))
def test_many_clouds_at_once_are_the_clouds_one_by_one(steps: list[np.ndarray]) -> None:
    clouds = [whole.astype(np.float32) * np.float32(0.001) for whole in steps]
    assert points.encode(clouds) == [points.encode([cloud])[0] for cloud in clouds]


def test_a_known_cloud() -> None:
    cloud = np.array([[0.001, 0.002, 0.003], [-0.001, 0.0, 0.0], [1.025, 0.0, 2.048]], np.float32)
    ((_, data),) = points.encode([cloud])
    first, second, third = (3 << 20) + (2 << 10) + 1, 1023, 1
    assert packed.unpack(data, "x").tolist() == [1, 0, 0, 0, first, 1, -1, 0, 0, second, 1, 1, 0, 2, third]


def test_what_is_no_cloud() -> None:
    with pytest.raises(FormatError, match="cut off"):
        points.decode(2, packed.pack(np.array([2, 0, 0, 0, 5])), "x")
    with pytest.raises(FormatError, match="cut off"):
        points.decode(1, packed.pack(np.array([-1, 0, 0, 0])), "x")
    with pytest.raises(FormatError, match="1 points in its blocks, but it says 3"):
        points.decode(3, packed.pack(np.array([1, 0, 0, 0, 5])), "x")
    with pytest.raises(FormatError, match="farther away"):
        points.decode(1, packed.pack(np.array([1, 2**20, 0, 0, 5])), "x")
    for value in (np.nan, np.inf, 8388.7):
        with pytest.raises(DataError, match="cannot be saved"):
            points.encode([np.array([[0.0, value, 0.0]], np.float32)])
