# SPDX-License-Identifier: MIT
"""Compiled loops over the inverted file of `slamcli.vision.keyframe_database`."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def insert(words, weights, key, size, heads, following, terms, keys, values):
    """Put the words of a keyframe in front of their lists, as entries `size` and on; return the new number of entries."""
    for i in range(len(words)):
        following[size] = heads[words[i]]
        terms[size] = words[i]
        keys[size] = key
        values[size] = weights[i]
        heads[words[i]] = size
        size += 1
    return size


@njit(cache=True, nogil=True)
def compare(words, weights, heads, following, keys, values, alive, common, scores):
    """Add up, for each keyframe that is alive, the words it has in common with a bag and the smaller weight of each."""
    common[:] = 0
    scores[:] = 0.0
    for i in range(len(words)):
        entry = heads[words[i]]
        while entry >= 0:
            key = keys[entry]
            if alive[key]:
                common[key] += 1
                scores[key] += min(weights[i], values[entry])
            entry = following[entry]


@njit(cache=True, nogil=True)
def drop(alive, size, heads, following, terms, keys, values):
    """Keep only the entries of keyframes that are alive, in their order, and link them anew; return how many there are."""
    heads[:] = -1
    left = 0
    for entry in range(size):
        if alive[keys[entry]]:
            terms[left], keys[left], values[left] = terms[entry], keys[entry], values[entry]
            following[left] = heads[terms[left]]
            heads[terms[left]] = left
            left += 1
    return left
