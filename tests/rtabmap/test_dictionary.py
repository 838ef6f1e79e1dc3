# SPDX-License-Identifier: MIT
"""The visual dictionary against a naive twin, and words that come and go."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from slamcli.errors import ConfigError, DataError
from slamcli.rtabmap import _dictionary_kernels as kernels  # noqa: F401  (its twin is `naive_quantise`)
from slamcli.rtabmap.dictionary import Dictionary, DictionarySettings

pytestmark = pytest.mark.kernels


def word(bits: int) -> NDArray[np.uint8]:
    """A descriptor whose first `bits` bits are set: words differ by the difference of their bits."""
    return np.packbits((np.arange(256) < bits).astype(np.uint8))


def words(*bits: int) -> NDArray[np.uint8]:
    return np.array([word(b) for b in bits], np.uint8).reshape(-1, 32)


def naive_quantise(descriptors: NDArray[np.uint8], known: dict[int, NDArray[np.uint8]], ratio: float, together: bool):
    """As the paper says it; `known` grows."""
    old, result = dict(known), []
    for descriptor in descriptors:
        pool = known if together else old
        ranked = sorted(int(np.unpackbits(descriptor ^ other).sum()) for other in pool.values())
        if len(ranked) < 2 or ranked[0] > ratio * ranked[1]:
            number = len(known) + 1
            known[number] = descriptor
        else:
            near = [n for n, other in pool.items() if np.unpackbits(descriptor ^ other).sum() == ranked[0]]
            number = near[0]
        result.append(number)
    return result


def test_words_by_hand():
    dictionary = Dictionary()
    assert dictionary.quantise(words(0, 100)).tolist() == [1, 2]
    # 4 of 96 bits away: the first word. 40 and 60: between two, a new one. 41: near that one, which is compared with at once.
    assert dictionary.quantise(words(4, 45, 46)).tolist() == [1, 3, 3]
    assert dictionary.quantise(words(46, 100)).tolist() == [3, 2]
    assert len(dictionary) == 3


def test_new_words_may_be_kept_apart():
    dictionary = Dictionary(DictionarySettings(new_words_compared_together=False))
    dictionary.quantise(words(0, 100))
    assert dictionary.quantise(words(45, 46)).tolist() == [3, 4]


def test_the_ratio_is_inclusive():
    dictionary = Dictionary(DictionarySettings(nndr_ratio=0.8))
    dictionary.quantise(words(0, 18))
    assert dictionary.nearest(words(8)).tolist() == [1]  # 8 = 0.8 * 10
    assert dictionary.nearest(words(9)).tolist() == [0]


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), together=st.booleans(), ratio=st.sampled_from([0.5, 0.8, 0.95]))
def test_quantise_is_the_naive_one(seed: int, together: bool, ratio: float):
    rng = np.random.default_rng(seed)
    patterns = rng.integers(0, 256, (6, 32), dtype=np.uint8)
    dictionary = Dictionary(DictionarySettings(new_words_compared_together=together, nndr_ratio=ratio, exact=True))
    known: dict[int, NDArray[np.uint8]] = {}
    for _ in range(3):
        noise = np.packbits(rng.random((12, 256)) < 0.04, axis=1)
        image = patterns[rng.integers(0, 6, 12)] ^ noise
        assert dictionary.quantise(image).tolist() == naive_quantise(image, known, ratio, together)
    made, descriptors = dictionary.take_made()
    assert made.tolist() == list(known)
    assert descriptors.tolist() == [d.tolist() for d in known.values()]
    assert len(dictionary.take_made()[0]) == 0


def test_words_without_references_go():
    dictionary = Dictionary()
    first = dictionary.quantise(words(0, 100))
    dictionary.refer(np.array([0, *first, *first]))
    second = dictionary.quantise(words(50))
    dictionary.refer(second)
    assert dictionary.drop_unused() == 0
    dictionary.release(first)
    assert dictionary.drop_unused() == 0  # each is referred to once more
    dictionary.release(first)
    assert dictionary.drop_unused() == 2
    assert len(dictionary) == 1
    assert 1 not in dictionary
    assert dictionary.quantise(words(0)).tolist() == [4]  # a number is never given twice
    dictionary.add_words(np.array([1]), words(0))
    assert dictionary.descriptors(np.array([1, 3])).tolist() == words(0, 50).tolist()
    assert dictionary.drop_unused() == 2


def test_a_fixed_dictionary_gives_the_nearest_and_keeps_all():
    dictionary = Dictionary(DictionarySettings(incremental=False))
    with pytest.raises(ConfigError, match="Kp/DictionaryPath"):
        dictionary.quantise(words(0))
    assert dictionary.quantise(words()).tolist() == []
    dictionary.add_words(np.array([7, 5]), words(0, 100))
    assert dictionary.quantise(words(45, 60)).tolist() == [7, 5]
    assert dictionary.drop_unused() == 0
    assert len(dictionary) == 2


def test_numbers_of_words_are_checked():
    dictionary = Dictionary()
    dictionary.add_words(np.array([3]), words(0))
    for wrong in ([3], [0], [4, 4]):
        with pytest.raises(DataError, match="each is there once"):
            dictionary.add_words(np.array(wrong), words(*([1] * len(wrong))))
    assert dictionary.last_id == 3
