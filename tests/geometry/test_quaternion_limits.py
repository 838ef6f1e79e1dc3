# SPDX-License-Identifier: MIT
from __future__ import annotations

import numpy as np

from slamcli.geometry import quaternion


def test_absurd_quaternions_are_normalised_without_overflow():
    found = quaternion.normalise([[1e308, 0.0, 0.0, 1e308], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 4.0]])
    np.testing.assert_allclose(found, [[0.5**0.5, 0, 0, 0.5**0.5], [0, 0, 0, 1], [0, 0, 0.6, 0.8]])
    assert quaternion.normalise(np.zeros((0, 4))).shape == (0, 4)
