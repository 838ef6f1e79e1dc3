# SPDX-License-Identifier: MIT
"""When no map could be begun, the cause that most frames share is told."""

from collections import Counter

import numpy as np

from slamcli.orbslam3.frame import Frame
from slamcli.orbslam3.initialisation import MonocularStart, start_with_depth
from slamcli.orbslam3.sparse_map import SparseMap
from slamcli.orbslam3.start_refusals import FEW_KEY_POINTS, FEW_MATCHES, LITTLE_DEPTH, NO_PARALLAX, why_none_began
from slamcli.vision.features import Features
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=500.0, fy=500.0, cx=320.0, cy=240.0, width=640, height=480)


def frame(number, pixels, seed=0):
    rng, n = np.random.default_rng(seed), len(pixels)
    features = Features(
        pixels=pixels, raw_pixels=pixels, octaves=np.zeros(n, dtype=np.int64), angles=np.zeros(n), responses=np.ones(n),
        descriptors=rng.integers(0, 256, (n, 32)).astype(np.uint8), sigmas=np.ones(n), right=np.full(n, np.nan), depth=np.full(n, np.nan),
    )  # fmt: skip
    return Frame(number=number, stamp_ns=number, features=features, grid=None, points=np.full(n, -1), T_camera_map=None)


def test_every_cause_is_counted():
    rng = np.random.default_rng(1)
    pixels = rng.uniform((0, 0), (640, 480), (300, 2))
    sparse_map, refused = SparseMap(CAMERA, 1.2 ** np.arange(8.0)), Counter()
    start = MonocularStart(0, lambda _: None, refused)
    assert not start.take(sparse_map, frame(0, pixels))
    assert not refused
    for number in (1, 2):  # at rest
        assert not start.take(sparse_map, frame(number, pixels + rng.normal(0, 0.3, pixels.shape)))
    assert not start.take(sparse_map, frame(3, pixels, seed=9))  # nothing in common
    assert not start.take(sparse_map, frame(4, pixels[:60]))
    assert not start_with_depth(sparse_map, frame(5, pixels), 3.0, 200, None, refused)
    assert not start_with_depth(sparse_map, frame(6, pixels), 3.0, 400, None, refused)
    assert refused == {NO_PARALLAX: 2, FEW_MATCHES: 1, FEW_KEY_POINTS: 2, LITTLE_DEPTH: 1}


def test_the_most_common_cause_is_told():
    told = why_none_began({NO_PARALLAX: 59, FEW_MATCHES: 3, "keyframes": 100}, 62)
    assert told.startswith("in 59 of 62 frames the motion shows no parallax: the camera stands still, only turns")
    assert "--depth-scale" in why_none_began({LITTLE_DEPTH: 2}, 2)
    assert why_none_began({FEW_KEY_POINTS: 30}, 30).startswith("30 of 30 frames have too few key points")
    assert "too different" in why_none_began({FEW_MATCHES: 1}, 9)
    assert why_none_began({}, 0) == "the recording has no frames"
    assert why_none_began({}, 7) == "none of 7 frames was found in a map"
