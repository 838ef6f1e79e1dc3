# SPDX-License-Identifier: MIT
from __future__ import annotations

import math

import naive_layers as naive
import numpy as np
import pytest

from slamcli.measurements.laser import LaserScan
from slamcli.navigation.cell_bounds import Extent
from slamcli.navigation.layered_parameters import LayerParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_layer import ObstacleLayer
from slamcli.navigation.obstacle_parameters import ObservationSource, ObstacleParameters
from slamcli.navigation.scan_observation import observe_scan

pytestmark = pytest.mark.kernels

CORNER = np.array([-1.0, 0.5])
EXTENT = Extent(CORNER, 0.2, 23, 31)
HIGH = 9.0


def layer(default: int = 255, **values: object) -> ObstacleLayer:
    source = ObservationSource(name="scan", clearing=True)
    parameters = ObstacleParameters(**values)
    return ObstacleLayer(
        LayerParameters(name="obstacles", kind="obstacle", obstacle=parameters, sources=(source,)), EXTENT, default
    )


def observation(origin: np.ndarray, points: np.ndarray, nothing: np.ndarray) -> Observation:
    return Observation(source="scan", time_s=0.0, origin=origin, points=points, clear_points=nothing)


@pytest.mark.parametrize("seed", range(8))
def test_beams_points_and_outlines_equal_the_naive_twin(seed: int) -> None:
    random = np.random.default_rng(seed)
    most, least = float(random.uniform(0.5, 5.0)), float(random.choice([0.0, 0.3, 0.9]))
    obstacles = layer(
        raytrace_range=most,
        raytrace_min_range=least,
        obstacle_range=3.0,
        obstacle_min_range=least,
        min_obstacle_height=0.1,
        max_obstacle_height=1.5,
    )
    expected = np.full(EXTENT.shape, 255, dtype=np.uint8)
    for _ in range(12):
        # Some sensors stand outside, most beams leave the map, some begin and end in one cell.
        origin = np.append(random.uniform([-1.6, 0.0], [5.6, 5.5]), 0.4)
        points = np.column_stack([random.uniform(-3.0, 9.0, (20, 2)), random.uniform(0.0, 2.0, 20)])
        points[0] = origin
        nothing = np.column_stack([random.uniform(-3.0, 9.0, (9, 2)), np.full(9, 0.4)])
        turn = random.uniform(-3.0, 3.0)
        polygon = random.uniform(0.05, 0.6, (5, 1)) * np.array(
            [[math.cos(a), math.sin(a)] for a in np.arange(5) * 2 * math.pi / 5]
        )
        pose = np.append(random.uniform([-1.0, 0.5], [5.2, 5.1]), turn)
        obstacles.observe(observation(origin, points, nothing))
        touched, before = EXTENT.nothing(), expected.copy()
        obstacles.update(polygon, pose, touched)
        for ends in (points, nothing):
            naive.clear(expected, origin, ends, CORNER, 0.2, most, least)
        naive.mark(expected, origin, points, CORNER, 0.2, 3.0, least, 0.1, 1.5)
        naive.outline(expected, polygon.tolist(), pose, CORNER, 0.2)
        np.testing.assert_array_equal(obstacles.costs, expected)
        outside = np.ones(EXTENT.shape, dtype=np.bool_)
        outside[max(0, touched[0]) : touched[1], max(0, touched[2]) : touched[3]] = False
        assert (before[outside] == expected[outside]).all()
    assert set(np.unique(expected).tolist()) == {0, 254, 255}


def test_a_layer_that_is_off_neither_senses_nor_counts() -> None:
    obstacles = layer(enabled=False)
    obstacles.observe(observation(np.array([0.0, 1.0, 0.5]), np.array([[1.0, 1.0, 0.5]]), np.zeros((0, 3))))
    touched = EXTENT.nothing()
    obstacles.update(np.zeros((3, 2)), np.zeros(3), touched)
    out = np.full(EXTENT.shape, 7, dtype=np.uint8)
    obstacles.put(EXTENT.everything(), out)
    assert (obstacles.costs == 255).all()
    assert (out == 7).all()
    assert touched[0] >= touched[1]


def test_another_resolution_forgets_and_another_corner_keeps() -> None:
    obstacles = layer(default=0)
    obstacles.costs[3, 4] = 254
    obstacles.place(Extent(CORNER - 0.39, 0.2, 30, 40))
    assert np.argwhere(obstacles.costs == 254).tolist() == [[5, 6]]
    obstacles.place(Extent(CORNER, 0.1, 30, 40))
    assert not obstacles.costs.any()


def test_unknown_of_the_layer_alone() -> None:
    assert layer(default=0, track_unknown_space=True).costs.min() == 255
    assert layer(default=255, track_unknown_space=False).costs.max() == 0


@pytest.mark.parametrize("limit", [3.0, math.inf, math.nan, -1.0])
def test_scans_equal_the_naive_twin(limit: float) -> None:
    random = np.random.default_rng(8)
    ranges = random.uniform(-0.5, 4.0, 200).astype(np.float32)
    ranges[::17], ranges[5::23], ranges[9::41] = math.inf, math.nan, -math.inf
    scan = LaserScan(
        stamp_ns=0,
        frame_id="laser",
        angle_min_rad=-2.0,
        angle_increment_rad=0.02,
        range_min_m=0.2,
        range_max_m=limit,
        ranges_m=ranges,
    )
    for valid in (None, True, False):
        found = observe_scan(scan, np.array([1.0, -2.0, 0.7]), ObservationSource(inf_is_valid=valid), 1.0, 0.3)
        points, nothing = [], []
        far = limit if limit > 0 else math.inf
        for k, reading in enumerate(ranges.astype(float)):
            angle = -2.0 + 0.02 * k + 0.7
            if 0.2 <= reading < far:
                points.append([1.0 + reading * math.cos(angle), -2.0 + reading * math.sin(angle), 0.3])
            elif reading >= far and far < math.inf and valid is not False:
                reach = far - 1e-4
                nothing.append([1.0 + reach * math.cos(angle), -2.0 + reach * math.sin(angle), 0.3])
        np.testing.assert_allclose(found.points, np.reshape(points, (-1, 3)), atol=1e-12)
        np.testing.assert_allclose(found.clear_points, np.reshape(nothing, (-1, 3)), atol=1e-12)
