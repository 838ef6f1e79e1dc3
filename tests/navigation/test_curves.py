# SPDX-License-Identifier: MIT
"""Dubins and Reeds-Shepp against brute force: no drive of arcs and lines that ends there is shorter, and the end is exact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.navigation.curves import CURVE_FAMILIES, shortest_curve

pytestmark = pytest.mark.kernels


def brute_drive(pose: np.ndarray, turn: int, length: float, radius: float, steps: int = 400) -> np.ndarray:
    """Midpoint integration of the motion, independent of the closed form."""
    x, y, yaw = pose
    step = length / steps
    for _ in range(steps):
        middle = yaw + 0.5 * step * turn / radius
        x, y, yaw = x + step * math.cos(middle), y + step * math.sin(middle), yaw + step * turn / radius
    return np.array([x, y, yaw])


def closed_drive(pose: np.ndarray, turn: int, length: float, radius: float) -> np.ndarray:
    x, y, yaw = pose
    if turn == 0:
        return np.array([x + length * math.cos(yaw), y + length * math.sin(yaw), yaw])
    end = yaw + turn * length / radius
    x += turn * radius * (math.sin(end) - math.sin(yaw))
    y -= turn * radius * (math.cos(end) - math.cos(yaw))
    return np.array([x, y, end])


def assert_same_pose(a: np.ndarray, b: np.ndarray, tolerance: float) -> None:
    assert math.dist(a[:2], b[:2]) < tolerance
    assert abs(math.remainder(a[2] - b[2], 2 * math.pi)) < tolerance


@pytest.mark.parametrize("family", CURVE_FAMILIES)
def test_the_end_is_exact(family: str) -> None:
    random = np.random.default_rng(0)
    for scale in (0.5, 2.0, 8.0):
        for _ in range(300):
            start, goal = random.uniform([-scale, -scale, -4], [scale, scale, 4], (2, 3))
            radius = float(random.uniform(0.3, 2.0))
            curve = shortest_curve(start, goal, radius, family)
            pose = start
            for length, turn in zip(curve.lengths_m, curve.turns, strict=True):
                pose = closed_drive(pose, int(turn), float(length), radius)
            assert_same_pose(pose, goal, 1e-7)
            assert curve.length_m >= math.dist(start[:2], goal[:2]) - 1e-9
            assert family == "reeds_shepp" or (curve.lengths_m > 0).all()
    pose = start
    for length, turn in zip(curve.lengths_m, curve.turns, strict=True):
        pose = brute_drive(pose, int(turn), float(length), radius)
    assert_same_pose(pose, goal, 1e-3)


@pytest.mark.parametrize("family", CURVE_FAMILIES)
def test_no_random_drive_is_shorter(family: str) -> None:
    """The strongest rivals are drives like the optimal words themselves, so lengths are drawn from all scales."""
    random = np.random.default_rng(1)
    tight = 0
    for _ in range(12000):
        count = int(random.integers(1, 6 if family == "reeds_shepp" else 4))
        turns = random.integers(-1, 2, count)
        lengths = random.uniform(0.0, random.choice([0.5, 1.6, 3.2, 6.0]), count)
        if family == "reeds_shepp":
            lengths *= random.choice([-1, 1], count)
        pose = np.zeros(3)
        for turn, length in zip(turns, lengths, strict=True):
            pose = closed_drive(pose, int(turn), float(length), 1.0)
        curve = shortest_curve((0, 0, 0), pose, 1.0, family)
        rival = float(np.abs(lengths).sum())
        assert curve.length_m <= rival + 1e-7, (turns, lengths)
        tight += rival - curve.length_m < 1e-7
    assert tight > 300


def test_triangles_and_symmetry() -> None:
    random = np.random.default_rng(2)
    for _ in range(3000):
        a, b, c = random.uniform([-2, -2, -4], [2, 2, 4], (3, 3))
        direct = shortest_curve(a, c, 1.0, "reeds_shepp").length_m
        assert direct <= sum(shortest_curve(p, q, 1.0, "reeds_shepp").length_m for p, q in ((a, b), (b, c))) + 1e-7
        assert direct == pytest.approx(shortest_curve(c, a, 1.0, "reeds_shepp").length_m, abs=1e-7)
        forward = shortest_curve(a, c, 1.0, "dubins").length_m
        assert direct <= forward + 1e-7
        assert forward <= sum(shortest_curve(p, q, 1.0, "dubins").length_m for p, q in ((a, b), (b, c))) + 1e-7


@pytest.mark.parametrize(
    ("family", "goal", "length"),
    [
        ("dubins", (5.0, 0.0, 0.0), 5.0),
        ("dubins", (0.0, 2.0, math.pi), math.pi),
        ("reeds_shepp", (-1.0, 0.0, 0.0), 1.0),
        ("reeds_shepp", (0.0, 0.0, math.pi), math.pi),
        ("reeds_shepp", (0.0, 0.0, 0.0), 0.0),
    ],
)
def test_known_lengths(family: str, goal: tuple[float, float, float], length: float) -> None:
    curve = shortest_curve((0, 0, 0), goal, 1.0, family)
    assert curve.length_m == pytest.approx(length, abs=1e-9)


@pytest.mark.parametrize("family", CURVE_FAMILIES)
def test_samples_lie_close_and_on_the_curve(family: str) -> None:
    goal = np.array([-0.7, 1.3, 2.0])
    curve = shortest_curve((0.2, 0.1, -0.4), goal, 0.6, family)
    poses, directions = curve.sample(0.05)
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    assert steps.max() <= 0.05 + 1e-9
    assert steps.sum() == pytest.approx(curve.length_m, rel=1e-3)
    assert_same_pose(poses[-1], goal, 1e-7)
    assert set(directions.tolist()) <= ({1} if family == "dubins" else {1, -1})
    middle = poses[:-1, 2] + 0.5 * np.arctan2(np.sin(np.diff(poses[:, 2])), np.cos(np.diff(poses[:, 2])))
    ahead = directions[1:, None] * np.column_stack([np.cos(middle), np.sin(middle)]) * steps[:, None]
    np.testing.assert_allclose(np.diff(poses[:, :2], axis=0), ahead, atol=1e-3)


def test_wrong_input() -> None:
    with pytest.raises(DataError, match="finite"):
        shortest_curve((0, 0, math.nan), (1, 1, 1), 1.0, "dubins")
    with pytest.raises(DataError, match="not positive"):
        shortest_curve((0, 0, 0), (1, 1, 1), 0.0, "dubins")
