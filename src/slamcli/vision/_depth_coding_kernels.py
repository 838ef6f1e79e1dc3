# SPDX-License-Identifier: MIT
"""Compiled loops over depth images of `slamcli.vision.depth_coding`."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def put_number(number, words, position, word, nibbles):
    """Append a number, three bits at a time, lowest first; return (position, word, nibbles)."""
    while True:
        nibble = number & 7
        number >>= 3
        if number:
            nibble |= 8
        word = (word << 4) | nibble
        nibbles += 1
        if nibbles == 8:
            words[position] = word
            position += 1
            word = 0
            nibbles = 0
        if not number:
            return position, word, nibbles


@njit(cache=True, nogil=True)
def take_number(words, position, word, nibbles):
    """Read a number; return (number, position, word, nibbles), number -1 where the words end or it is longer than 32 bits."""
    number = 0
    shift = 0
    while True:
        if nibbles == 0:
            if position >= len(words) or shift > 30:
                return -1, position, word, nibbles
            word = int(words[position])
            position += 1
            nibbles = 8
        nibble = (word >> 28) & 15
        word = (word << 4) & 0xFFFFFFFF
        nibbles -= 1
        number |= (nibble & 7) << shift
        shift += 3
        if not nibble & 8:
            return number, position, word, nibbles


@njit(cache=True, nogil=True)
def compress(values, words):
    """Write runs of zeros and of differences to `words`; return how many words."""
    position, word, nibbles = 0, 0, 0
    previous = 0
    count = len(values)
    i = 0
    while i < count:
        start = i
        while i < count and values[i] == 0:
            i += 1
        position, word, nibbles = put_number(i - start, words, position, word, nibbles)
        start = i
        while i < count and values[i] != 0:
            i += 1
        position, word, nibbles = put_number(i - start, words, position, word, nibbles)
        for j in range(start, i):
            value = int(values[j])
            delta = value - previous
            previous = value
            folded = 2 * delta if delta >= 0 else -2 * delta - 1
            position, word, nibbles = put_number(folded, words, position, word, nibbles)
    if nibbles:
        words[position] = word << (4 * (8 - nibbles))
        position += 1
    return position


@njit(cache=True, nogil=True)
def expand(words, values):
    """Fill `values` (zeros at first); return whether the words describe exactly that many."""
    position, word, nibbles = 0, 0, 0
    previous = 0
    i = 0
    count = len(values)
    while i < count:
        zeros, position, word, nibbles = take_number(words, position, word, nibbles)
        if zeros < 0 or i + zeros > count:
            return False
        i += zeros
        others, position, word, nibbles = take_number(words, position, word, nibbles)
        if others < 0 or i + others > count or (zeros == 0 and others == 0):
            return False
        for _ in range(others):
            folded, position, word, nibbles = take_number(words, position, word, nibbles)
            if folded < 0:
                return False
            previous += (folded >> 1) if folded & 1 == 0 else -((folded + 1) >> 1)
            values[i] = previous & 0xFFFF
            i += 1
    return True


@njit(cache=True, nogil=True)
def to_millimetres(depth, values, tolerance, rounding):
    """Fill `values` with depth in whole millimetres, 0 where unknown; return False, unless `rounding`, where one is not whole or too far."""
    for i in range(len(depth)):
        metres = float(depth[i])
        values[i] = 0
        if 0.0 < metres < math.inf:
            scaled = metres * 1000.0
            whole = np.rint(scaled)
            if whole <= 65535.0 and (rounding or abs(whole - scaled) <= tolerance):
                values[i] = int(whole)
            elif not rounding:
                return False
    return True
