# SPDX-License-Identifier: MIT
"""A link seen from its other end says the same."""

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.geometry import se3
from slamcli.rtabmap.links import Link, LinkKind


def _error(measured: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Translation, then rotation vector, along the axes of the first end, as `Link.information` weighs them."""
    turn = Rotation.from_matrix(true[:3, :3] @ measured[:3, :3].T).as_rotvec()
    return np.concatenate([true[:3, 3] - measured[:3, 3], turn])


def test_inverse_weighs_small_errors_the_same() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.4, -0.8, 1.9]).as_matrix(), [1.0, -2.0, 0.5]
    link = Link(from_id=3, to_id=8, kind=LinkKind.GLOBAL_CLOSURE, T_from_to=T, information=root @ root.T)
    other = link.inverse()
    assert (other.from_id, other.to_id) == (8, 3)
    np.testing.assert_allclose(other.T_from_to @ T, np.eye(4), atol=1e-12)
    for _ in range(5):
        step = 1e-5 * rng.normal(size=6)
        true = T.copy()
        true[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
        true[:3, 3] += step[:3]
        there = _error(T, true)
        back = _error(other.T_from_to, se3.inverse(true))
        np.testing.assert_allclose(back @ other.information @ back, there @ link.information @ there, rtol=1e-3)
    twice = other.inverse()
    np.testing.assert_allclose(twice.information, link.information, rtol=1e-9)
