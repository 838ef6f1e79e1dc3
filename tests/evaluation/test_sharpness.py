# SPDX-License-Identifier: MIT
"""Figures of points without ground truth: kernels against naive twins, and worlds whose figures are known."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import EstimationError
from slamcli.evaluation.neighbourhoods import SAME_SIDE, covariances, neighbourhoods
from slamcli.evaluation.redrawn_map import redraw
from slamcli.evaluation.seen_points import PlacedPoints, SeenPoints, has_pose, place
from slamcli.evaluation.sharpness import Scales, scales_of, sharpness
from slamcli.trajectory import Trajectory

SECOND = 1_000_000_000
FAR = np.array([0.0, 50.0, 0.0])
"""Where everything is seen from unless a test says otherwise: the same side."""
SCALES = Scales(radius_m=0.6, visit_gap_s=5.0, cell_m=0.05)


def placed(
    points: np.ndarray, seconds: np.ndarray, origins: np.ndarray | None = None, planar: bool = True
) -> PlacedPoints:
    return PlacedPoints(
        points_m=points, origins_m=points + FAR if origins is None else origins,
        stamps_ns=(seconds * SECOND).astype(np.int64), planar=planar, num_views=1,
    )  # fmt: skip


def two_visits(offset_m: float, noise_m: float = 0.0, seed: int = 0) -> PlacedPoints:
    """A wall of 6 m along x seen twice, a minute apart, the second time `offset_m` beside."""
    rng = np.random.default_rng(seed)
    x = np.tile(np.linspace(0.0, 6.0, 401), 2)
    y = np.repeat([0.0, offset_m], 401) + rng.normal(0.0, noise_m, 802) if noise_m else np.repeat([0.0, offset_m], 401)
    return placed(np.column_stack([x, y, np.zeros_like(x)]), np.repeat([0.0, 60.0], 401))


def naive_moments(found: PlacedPoints, own: int, radius: float, gap_s: float) -> tuple[np.ndarray, ...]:
    apart = found.points_m - found.points_m[own]
    near = (apart**2).sum(axis=1) <= radius**2
    looks = found.origins_m - found.points_m
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    near &= looks @ looks[own] >= SAME_SIDE
    other = np.abs(found.stamps_ns - found.stamps_ns[own]) > gap_s * SECOND
    sums = []
    for rows in (near & ~other, near & other):
        p = apart[rows]
        products = [(p[:, a] * p[:, b]).sum() for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
        sums.append(np.array([len(p), *p.sum(axis=0), *products]))
    distances = np.linalg.norm(apart[near & other], axis=1)
    return sums[0], sums[1], distances.min(initial=np.inf)


def test_neighbours_as_a_naive_twin_finds_them() -> None:
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-2.0, 2.0, (150, 3)), np.zeros((3, 3)), [[50.0, -40.0, 0.0]]])
    world = placed(points, rng.uniform(0.0, 60.0, 154), rng.uniform(-9.0, 9.0, (154, 3)), planar=False)
    found = neighbourhoods(world, radius_m=0.8, visit_gap_s=5.0, num_queries=1000)
    assert len(found.stamps_ns) == 154
    for i in range(154):
        own, others, nearest = naive_moments(world, i, 0.8, 5.0)
        np.testing.assert_allclose(found.own[i], own, atol=1e-9)
        np.testing.assert_allclose(found.others[i], others, atol=1e-9)
        assert found.nearest_m[i] == pytest.approx(nearest)


def test_covariances_are_those_of_numpy() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(50, 3))
    found = neighbourhoods(placed(points, np.zeros(50), planar=False), radius_m=100.0, visit_gap_s=1.0, num_queries=50)
    mean, covariance = covariances(found.own)
    np.testing.assert_allclose(mean[7], points.mean(axis=0) - points[7], atol=1e-12)
    np.testing.assert_allclose(covariance[7], np.cov(points.T, bias=True), atol=1e-12)


@pytest.mark.parametrize("offset_m", [0.0, 0.05, 0.2, 0.4])
def test_a_double_wall_is_as_far_apart_as_it_is(offset_m: float) -> None:
    found = sharpness(two_visits(offset_m), SCALES)
    assert np.median(found.revisit_offset_m) == pytest.approx(offset_m, abs=1e-9)
    assert found.revisited == 1.0


def test_the_two_sides_of_a_thin_wall_are_no_double_wall() -> None:
    world = two_visits(0.2)
    origins = world.points_m + np.where(world.points_m[:, 1:2] > 0.1, FAR, -FAR)
    found = sharpness(placed(world.points_m, world.stamps_ns / SECOND, origins), SCALES)
    assert found.revisited == 0.0
    assert found.wall_thickness_m.max() < 1e-6


def test_thickness_is_the_distance_of_two_thin_walls_and_twice_the_noise_of_one() -> None:
    thick = sharpness(two_visits(0.1), SCALES).wall_thickness_m
    assert np.median(thick) == pytest.approx(0.1, abs=0.002)
    noisy = sharpness(two_visits(0.0, noise_m=0.02), SCALES).wall_thickness_m
    assert np.median(noisy) == pytest.approx(0.04, abs=0.004)


def test_mean_entropy_of_a_wall_is_that_of_its_normal_distribution() -> None:
    found = sharpness(two_visits(0.0, noise_m=0.01), SCALES)
    # In a circle of radius r = 0.6 about a point on a line the points spread by r / sqrt(3) along it.
    expected = 0.5 * np.log((2 * np.pi * np.e) ** 2 * (0.6**2 / 3) * 0.01**2)
    assert found.mean_entropy == pytest.approx(expected, abs=0.12)  # less at the ends of the wall
    blurred = sharpness(two_visits(0.0, noise_m=0.03), SCALES)
    assert blurred.mean_entropy - found.mean_entropy == pytest.approx(np.log(3.0), abs=0.06)


def test_without_another_visit_there_is_no_offset() -> None:
    once = placed(two_visits(0.0).points_m, np.zeros(802))
    found = sharpness(once, SCALES)
    assert len(found.revisit_offset_m) == 0
    assert found.revisited == 0.0
    assert np.isfinite(found.mean_entropy)


def test_moving_all_points_moves_no_figure() -> None:
    world = two_visits(0.1, noise_m=0.02)
    turn = 0.7
    R = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    moved = placed(
        world.points_m @ R.T + [300.0, -200.0, 0.0],
        world.stamps_ns / SECOND,
        world.origins_m @ R.T + [300.0, -200.0, 0.0],
    )
    first, second = sharpness(world, SCALES), sharpness(moved, SCALES)
    assert second.mean_entropy == pytest.approx(first.mean_entropy, abs=1e-6)
    np.testing.assert_allclose(np.sort(second.wall_thickness_m), np.sort(first.wall_thickness_m), atol=1e-6)


def test_scales_grow_with_the_range_and_shrink_with_the_time() -> None:
    def seen(range_m: float, seconds: float) -> SeenPoints:
        points = np.full((10, 3), [range_m, 0.0, 0.0], dtype=np.float32)
        return SeenPoints(
            stamps_ns=np.array([0, seconds * SECOND], dtype=np.int64), view=np.repeat([0, 1], 5), points_m=points,
            offset_ns=np.zeros(10, dtype=np.int64), frame_id="laser", topic="/scan", planar=True,
        )  # fmt: skip

    assert scales_of(seen(3.0, 100.0)) == Scales(radius_m=0.6, visit_gap_s=10.0, cell_m=0.6 / 12.0)
    assert scales_of(seen(20.0, 30.0)) == Scales(radius_m=2.0, visit_gap_s=3.0, cell_m=2.0 / 12.0)
    assert scales_of(seen(500.0, 2.0)).radius_m == 3.0
    assert scales_of(seen(1.0, 2.0)).visit_gap_s == 1.0


def naive_counts(
    world: PlacedPoints, cell_m: float, low: tuple[float, float], shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Sample each ray densely: which cells it passes, without that of its end."""
    hits, passes = np.zeros(shape, dtype=np.int64), np.zeros(shape, dtype=np.int64)
    for end, origin in zip(world.points_m, world.origins_m, strict=True):
        a, b = (origin[:2] - low) / cell_m, (end[:2] - low) / cell_m
        last = tuple(np.floor(b).astype(int)[::-1])
        along = np.linspace(0.0, 1.0, 20_001)[:, None]
        cells = {tuple(c) for c in np.floor(a + along * (b - a)).astype(int)[:, ::-1].tolist()}
        for cell in cells - {last}:
            passes[cell] += 1
        hits[last] += 1
    return hits, passes


def test_redrawing_counts_as_a_naive_twin() -> None:
    rng = np.random.default_rng(3)
    ends = np.column_stack([rng.uniform(-2.0, 2.0, (60, 2)), np.zeros(60)])
    ends[:4, :2] = [[-2.0, 0.3], [0.3, 2.0], [2.0, 0.3], [0.3, -2.0]]
    world = placed(ends, np.zeros(60), np.tile([0.31, 0.32, 0.0], (60, 1)))
    found = redraw(world, 0.25)
    hits, passes = naive_counts(world, 0.25, found.origin_m, found.hits.shape)
    np.testing.assert_array_equal(found.hits, hits)
    assert (found.passes != passes).mean() < 0.002  # a corner that is cut by less than a 20,000th of a ray


def test_entropy_is_nought_where_rays_agree_and_one_where_they_do_not() -> None:
    wall = np.column_stack([np.full(600, 2.02), np.repeat(np.linspace(0.02, 0.97, 20), 30), np.zeros(600)])
    origins = wall * (0.0, 1.0, 0.0) + (0.02, 0.0, 0.0)
    agreed = redraw(placed(wall, np.zeros(600), origins), 0.05)
    few = 0.5 / 31  # of 30 rays, all of which say the same
    assert agreed.entropy_bits == pytest.approx(-few * np.log2(few) - (1 - few) * np.log2(1 - few), abs=1e-9)
    behind = wall.copy()
    behind[1::2, 0] += 1.0  # every second ray goes through the wall
    doubted = redraw(placed(behind, np.zeros(600), origins), 0.05)
    # The cells of the wall, 1 of 61 that each row's rays reach, say both as often: 1 bit each.
    assert doubted.entropy_bits > agreed.entropy_bits * 40 / 61 + 0.9 / 61


def test_points_are_put_where_the_pose_was_at_their_own_time() -> None:
    stamps = np.array([0, 1, 2], dtype=np.int64) * SECOND
    path = Trajectory.from_se2(
        stamps, np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, np.pi / 2]]), "map", "base"
    )
    seen = SeenPoints(
        stamps_ns=stamps, view=np.array([0, 0, 2]), points_m=np.array([[1, 0, 0], [1, 0, 0], [1, 0, 0]], dtype=np.float32),
        offset_ns=np.array([0, SECOND // 2, 0]), frame_id="laser", topic="/scan", planar=True,
    )  # fmt: skip
    mount = np.eye(4)
    mount[:3, 3] = [0.2, 0.0, 0.5]
    found = place(seen, path, mount)
    np.testing.assert_allclose(found.points_m, [[1.2, 0, 0], [1.7, 0, 0], [2.0, 1.2, 0]], atol=1e-6)
    np.testing.assert_allclose(found.origins_m, [[0.2, 0, 0], [0.7, 0, 0], [2.0, 0.2, 0]], atol=1e-6)


def test_what_was_seen_while_there_was_no_pose_is_left_out() -> None:
    path = Trajectory.from_se2(np.arange(0, 10, dtype=np.int64) * SECOND // 10, np.zeros((10, 3)), "map", "base")
    stamps = np.array([0, 1, 2, 3], dtype=np.int64) * SECOND
    assert has_pose(stamps, path).tolist() == [True, True, False, False]
    seen = SeenPoints(
        stamps_ns=stamps + 10 * SECOND, view=np.arange(4), points_m=np.ones((4, 3), dtype=np.float32),
        offset_ns=np.zeros(4, dtype=np.int64), frame_id="laser", topic="/scan", planar=True,
    )  # fmt: skip
    with pytest.raises(EstimationError, match="no pose at the time of anything on /scan"):
        place(seen, path, np.eye(4))
