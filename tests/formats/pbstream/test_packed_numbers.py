# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slamcli.errors import FormatError
from slamcli.formats.pbstream import packed


def naive(value: int) -> bytes:
    """One varint as the protobuf documentation has it."""
    value &= (1 << 64) - 1
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


@given(st.lists(st.integers(-(2**31), 2**31 - 1)))
def test_numbers_are_packed_as_protobuf_does(numbers: list[int]) -> None:
    data = packed.pack(np.array(numbers, np.int64))
    assert data == b"".join(map(naive, numbers))
    assert packed.unpack(data, "x").tolist() == numbers


@given(st.lists(st.integers(-(2**31), 2**31 - 1)))
def test_zigzag(numbers: list[int]) -> None:
    data = packed.pack_zigzag(np.array(numbers, np.int64))
    assert data == b"".join(naive(2 * n if n >= 0 else -2 * n - 1) for n in numbers)
    assert packed.unpack_zigzag(data, "x").tolist() == numbers


@given(st.binary(max_size=60))
def test_any_bytes_are_numbers_or_refused(data: bytes) -> None:
    ends = [i for i, byte in enumerate(data) if byte < 0x80]
    longest = max(np.diff([-1, *ends]), default=0)
    if (data and ends[-1:] != [len(data) - 1]) or longest > 10:
        with pytest.raises(FormatError, match=r"^x: "):
            packed.unpack(data, "x")
    else:
        assert len(packed.unpack(data, "x")) == len(ends)


def test_values_out_of_range() -> None:
    with pytest.raises(FormatError, match="cells: values from 0 to 32768, not within 0 to 32767"):
        packed.unpack_uint16(packed.pack(np.array([0, 32768])), "cells", 32767)
    with pytest.raises(FormatError, match="values from -1"):
        packed.unpack_uint16(packed.pack(np.array([-1])), "cells", 32767)
    with pytest.raises(FormatError, match="out of the range"):
        packed.check_int32(np.array([2**31]), "x")
