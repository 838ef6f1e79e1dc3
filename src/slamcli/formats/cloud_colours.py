# SPDX-License-Identifier: MIT
"""The colours that the columns of a point file hold, however they are written there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TRIPLES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_PACKED = ("rgb", "rgba")


def colours_in(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8] | None:
    """Return red, green, blue uint8 (N, 3) of a file's columns (N,) by name; None if it has no colours.

    Three columns hold bytes, or shares from 0 to 1; one column (PCL's ``rgb``) holds all three in the bits of an integer or a float.
    """
    for names in _TRIPLES:
        if all(name in columns for name in names):
            return _bytes(np.column_stack([columns[name] for name in names]))
    name = next((name for name in _PACKED if name in columns), None)
    return None if name is None else _unpacked(columns[name])


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return np.ascontiguousarray(values)
    numbers = np.nan_to_num(values.astype(np.float64))
    if values.dtype.kind == "f" and numbers.size and numbers.max() <= 1.0 and (numbers % 1 != 0).any():
        numbers = 255.0 * numbers
    return np.rint(np.clip(numbers, 0, 255)).astype(np.uint8)


def _unpacked(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the colours of packed ones: the lowest byte is blue."""
    if values.dtype.itemsize == 4:
        bits = (
            np.ascontiguousarray(values)
            .view(np.dtype(np.uint32).newbyteorder(values.dtype.byteorder))
            .astype(np.uint32)
        )
    else:
        bits = _bits_of_numbers(values.astype(np.float64))
    return np.column_stack([(bits >> shift) & 0xFF for shift in (16, 8, 0)]).astype(np.uint8)


def _bits_of_numbers(values: NDArray[np.float64]) -> NDArray[np.uint32]:
    """Return the bits of columns of text, where PCL writes the integer or the float with the same bits.

    Those floats are smaller than 1 (no fourth byte) or negative or not finite (a fourth byte of 255).
    """
    if ((np.abs(values) < 1) & (values != 0)).any() or (values < 0).any() or not np.isfinite(values).all():
        with np.errstate(over="ignore", under="ignore"):
            return values.astype(np.float32).view(np.uint32)
    return np.clip(values, 0, 2**32 - 1).astype(np.uint64).astype(np.uint32)
