# SPDX-License-Identifier: MIT
"""The YAML that DBoW3 and DBoW2 write through OpenCV (``vocabulary.yml``).

It is OpenCV's dialect of YAML and may be hundreds of megabytes long: read by patterns, not by a YAML parser.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.formats.vocabularies.dbow2 import assembled, check_header
from slamcli.vision.vocabulary import Vocabulary

_NODE = re.compile(
    rb"nodeId:\s*(\d{1,9}),\s*parentId:\s*(\d{1,9}),\s*weight:\s*([-+.\deE]{1,30}),\s*descriptor:\s*\"([^\"]{0,400})\""
)
_WORD = re.compile(rb"wordId:\s*\d{1,9},\s*nodeId:\s*\d{1,9}\s*}")


def is_yaml_vocabulary(data: bytes) -> bool:
    """Whether a file begins as OpenCV begins YAML, and then names a vocabulary."""
    return data.startswith(b"%YAML") and b"vocabulary:" in data[:1000]


def parse_yaml_vocabulary(data: bytes, path: Path) -> Vocabulary:
    """Return the vocabulary in a YAML file of OpenCV.

    Raises
    ------
    FormatError
        If something is missing or wrong, or the file is cut.
    """
    branching, depth, scoring, weighting = (
        _header(data, key, path) for key in (b"k", b"L", b"scoringType", b"weightingType")
    )
    check_header(branching, depth, scoring, weighting, path)
    found = _NODE.findall(data)
    declared, words = data.count(b"parentId:"), len(_WORD.findall(data))
    if len(found) != declared or not found:
        raise FormatError(f"{path}: {declared - len(found)} of {declared} nodes are not written as DBoW3 writes them")
    numbers = np.array([int(node) for node, *_ in found])
    parents = np.array([int(parent) for _, parent, *_ in found])
    count = len(found) + 1
    if not np.array_equal(np.sort(numbers), np.arange(1, count)):
        raise FormatError(f"{path}: the nodes are not numbered from 1 to {count - 1}: the file is damaged")
    try:
        weights = np.array([float(weight) for _, _, weight, _ in found])
    except ValueError as error:
        raise FormatError(f"{path}: the weight of a node is not a number") from error
    descriptors = _descriptors([text for *_, text in found], numbers, path)
    all_parents, all_weights = np.zeros(count, np.int64), np.zeros(count)
    all_descriptors = np.zeros((count, 32), np.uint8)
    all_parents[numbers], all_weights[numbers], all_descriptors[numbers] = parents, weights, descriptors
    tree = assembled(path, branching, depth, weighting, all_parents, all_descriptors, all_weights, None)
    if words != tree.num_words:
        raise FormatError(
            f"{path}: {tree.num_words} nodes have none below them, but {words} words are listed: the file is cut"
        )
    return tree


def _header(data: bytes, key: bytes, path: Path) -> int:
    found = re.search(rb"^\s+" + key + rb":\s*(\d{1,9})\s*$", data[:2000], re.MULTILINE)
    if found is None:
        raise FormatError(f"{path}: {key.decode()} is missing in this vocabulary")
    return int(found.group(1))


def _descriptors(texts: list[bytes], numbers: NDArray[np.int64], path: Path) -> NDArray[np.uint8]:
    """Return uint8 (N, 32): 32 numbers each, after OpenCV's type (0) and length where DBoW3 wrote them."""
    rows = np.zeros((len(texts), 32), np.uint8)
    for i, text in enumerate(texts):
        words = text.split()
        if words[:1] == [b"dbw3"]:
            words = words[1:]
        if len(words) == 34 and words[:2] == [b"0", b"32"]:
            words = words[2:]
        if len(words) != 32 or not all(word.isdigit() and len(word) < 4 and int(word) < 256 for word in words):
            raise FormatError(
                f"{path}: the descriptor of node {numbers[i]} is not 32 bytes: only vocabularies of ORB are read"
            )
        rows[i] = [int(word) for word in words]
    return rows
