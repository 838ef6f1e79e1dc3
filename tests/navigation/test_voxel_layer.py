# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from slamcli.grids import OccupancyGrid
from slamcli.measurements.points import PointCloud
from slamcli.navigation.cell_bounds import Extent
from slamcli.navigation.layered_costmap import LayeredCostmap
from slamcli.navigation.layered_parameters import LayeredParameters, LayerParameters
from slamcli.navigation.observation import Observation
from slamcli.navigation.obstacle_parameters import ObservationSource, ObstacleParameters
from slamcli.navigation.scan_observation import observe_cloud
from slamcli.navigation.voxel_layer import VoxelLayer

pytestmark = pytest.mark.kernels

SOURCE = ObservationSource(name="cloud", clearing=True, max_obstacle_height=10.0)
FLAT = np.array([[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]])


def layer(shape: tuple[int, int] = (8, 10), *, default: int = 0, **values: object) -> VoxelLayer:
    facts = {"footprint_clearing_enabled": False, "obstacle_range": 100.0, "raytrace_range": 100.0} | values
    parameters = LayerParameters(
        name="voxel_layer", kind="voxel", obstacle=ObstacleParameters(**facts), sources=(SOURCE,)
    )
    return VoxelLayer(parameters, Extent(np.zeros(2), 1.0, *shape), default)


def seen(points, origin=(0.5, 0.5, 0.5)) -> Observation:
    points = np.array(points, dtype=np.float64).reshape(-1, 3)
    return Observation(
        source="cloud",
        time_s=0.0,
        origin=np.array(origin, dtype=np.float64),
        points=points,
        clear_points=np.zeros((0, 3)),
    )


def apply(voxels: VoxelLayer, observation: Observation) -> np.ndarray:
    voxels.observe(observation)
    touched = voxels.extent.nothing()
    voxels.update(FLAT, np.array([0.5, 0.5, 0.0]), touched)
    return touched


def test_a_beam_below_clears_only_at_its_height() -> None:
    voxels = layer(z_resolution=0.5, z_voxels=4, max_obstacle_height=2.0)
    apply(voxels, seen([(5.5, 0.5, 0.3), (5.5, 0.5, 1.2)]))
    assert voxels.costs[0, 5] == 254
    assert voxels.voxels[0, 5] == 0xFFFF | 1 << 16 | 1 << 18
    apply(voxels, seen([(9.5, 0.5, 0.3)], origin=(0.5, 0.5, 0.3)))
    assert voxels.costs[0].tolist() == [0, 0, 0, 0, 0, 254, 0, 0, 0, 254]  # what was seen at 1.2 m is still there
    assert voxels.voxels[0, 5] == 0xFFFE | 1 << 18
    apply(voxels, seen([(9.5, 0.5, 1.2)], origin=(0.5, 0.5, 1.2)))
    assert voxels.costs[0, 5] == 0


def test_the_beam_ends_two_cells_before_its_point() -> None:
    voxels = layer(default=255, unknown_threshold=15)
    touched = apply(voxels, seen([(6.5, 0.5, 0.5)]))
    assert voxels.costs[0].tolist() == [0, 0, 0, 0, 0, 255, 254, 255, 255, 255]
    assert touched.tolist() == [0, 1, 0, 7]


def test_thresholds_and_heights() -> None:
    voxels = layer(mark_threshold=1)
    apply(voxels, seen([(3.5, 0.5, 0.5)]))
    assert voxels.costs[0, 3] == 0
    apply(voxels, seen([(3.5, 0.5, 0.9)]))
    assert voxels.costs[0, 3] == 254
    strict = layer(unknown_threshold=5, z_voxels=10)
    apply(strict, seen([(6.5, 0.5, 0.5)]))
    assert strict.costs[0, :5].tolist() == [255] * 5  # nine of ten voxels are unknown yet
    for z in (0.1, 0.3, 0.7, 0.9):
        apply(strict, seen([(6.5, 0.5, z)], origin=(0.5, 0.5, z)))
    assert strict.costs[0, :5].tolist() == [0] * 5
    cut = layer(origin_z=0.2, z_resolution=0.1, z_voxels=4, max_obstacle_height=2.0, obstacle_range=6.0)
    apply(cut, seen([(2.5, 0.5, 0.0), (3.5, 0.5, 0.65), (4.5, 0.5, 2.1), (7.5, 0.5, 0.5)], origin=(0.5, 0.5, 0.3)))
    # below the lowest voxel: taken there; above the highest voxel, above max_obstacle_height, too far: not
    assert np.flatnonzero(cut.costs[0] == 254).tolist() == [2]
    outside = layer()
    before = outside.voxels.copy()
    outside.observe(seen([(3.5, 0.5, 0.5)], origin=(0.5, 0.5, 5.0)))
    outside.parameters = dataclasses.replace(outside.parameters, obstacle_range=1.0)
    outside.update(FLAT, np.array([0.5, 0.5, 0.0]), outside.extent.nothing())
    np.testing.assert_array_equal(outside.voxels, before)


def naive_update(columns, costs, observation, parameters, extent) -> None:
    """Twin of clearing and marking: sets of voxels instead of bits, lines in closed form."""
    height, width = costs.shape
    side, z_side, bottom = extent.resolution_m, parameters.z_resolution, parameters.origin_z
    origin = observation.origin
    low = np.array([*extent.corner, bottom])
    sizes = np.array([side, side, z_side])
    start = (origin - low) / sizes
    limits = np.array([width, height, parameters.z_voxels])
    unknown_threshold = parameters.unknown_threshold + 16 - parameters.z_voxels
    if (start >= 0).all() and (start < limits).all():
        for point in observation.points:
            beam = point - origin
            distance = float(np.linalg.norm(beam))
            beam = beam * max(0.0, (distance - 2 * side) / distance)
            share = 1.0
            if origin[2] + beam[2] > parameters.max_obstacle_height:
                share = max(0.0, min(share, (parameters.max_obstacle_height - 0.01 - origin[2]) / beam[2]))
            elif origin[2] + beam[2] < bottom:
                share = min(share, (bottom - origin[2]) / beam[2])
            for k, size in ((0, width), (1, height)):
                if origin[k] + beam[k] < low[k]:
                    share = min(share, (low[k] - origin[k]) / beam[k])
                end = low[k] + (size - 0.5) * side
                if origin[k] + beam[k] > end:
                    share = min(share, max(0.0, (end - origin[k]) / beam[k]))
            end = start + beam * share / sizes
            end[:2] = np.clip(end[:2], 0.0, np.array([width, height]) - 0.5)
            end[2] = max(end[2], 0.0)
            if end[2] >= parameters.z_voxels:
                continue
            a, b = start.astype(int), end.astype(int)
            length = float(np.linalg.norm(end - start))
            along = int(np.abs(b - a).max())
            most = math.ceil(parameters.raytrace_range / side)
            for step in range(int(min(1.0, most / length if length else 1.0) * along) + 1):
                move = [(along // 2 + step * abs(d)) // max(along, 1) * (1 if d > 0 else -1) for d in (b - a)]
                x, y, z = a + (move if along else 0)
                known, marked = columns[y, x]
                known.add(int(z))
                marked.discard(int(z))
                if len(marked) <= parameters.mark_threshold:
                    costs[y, x] = 0 if 16 - len(known | marked) <= unknown_threshold else 255
    for x, y, z in observation.points:
        if z > parameters.max_obstacle_height or math.dist((x, y, z), origin) >= parameters.obstacle_range:
            continue
        j, i = math.floor((x - low[0]) / side), math.floor((y - low[1]) / side)
        k = math.floor((max(z, bottom) - bottom) / z_side)
        if 0 <= j < width and 0 <= i < height and k < parameters.z_voxels:
            known, marked = columns[i, j]
            known.discard(k)
            marked.add(k)
            if len(marked) > parameters.mark_threshold:
                costs[i, j] = 254


@pytest.mark.parametrize("seed", range(4))
def test_random_clouds_equal_the_naive_twin(seed: int) -> None:
    random = np.random.default_rng(seed)
    voxels = layer(
        (13, 17),
        default=255,
        z_resolution=0.3,
        z_voxels=[10, 16, 5, 8][seed],
        unknown_threshold=[9, 13, 4, 2][seed],
        mark_threshold=[0, 1, 0, 1][seed],
        raytrace_range=[100.0, 6.0, 4.5, 9.0][seed],
        obstacle_range=7.0,
        max_obstacle_height=2.0,
    )
    columns = {cell: (set(), set()) for cell in np.ndindex(13, 17)}
    costs = np.full((13, 17), 255, dtype=np.uint8)
    for _ in range(15):
        origin = random.uniform([2.0, 2.0, 0.1], [15.0, 11.0, 1.3])
        observation = seen(random.uniform([-3.0, -3.0, -0.3], [20.0, 16.0, 2.4], (25, 3)), origin)
        apply(voxels, observation)
        naive_update(columns, costs, observation, voxels.parameters, voxels.extent)
        np.testing.assert_array_equal(voxels.costs, costs)
    assert {0, 254} <= set(np.unique(costs).tolist())


def test_moving_and_forgetting_keep_voxels_with_their_cells() -> None:
    voxels = layer()
    apply(voxels, seen([(4.5, 3.5, 0.5)]))
    marked = int(voxels.voxels[3, 4])
    voxels.place(voxels.extent.moved(1, 2))
    assert (voxels.voxels[2, 2], voxels.costs[2, 2]) == (marked, 254)
    assert voxels.voxels[7, 9] == 0xFFFF
    voxels.forget(np.ones(voxels.extent.shape, dtype=np.bool_))
    assert (voxels.voxels == 0xFFFF).all()
    assert (voxels.costs == 255).all()


def test_a_costmap_with_a_voxel_layer_and_a_cloud() -> None:
    parameters = LayeredParameters.standard("global", robot_radius=0.1, inflation_radius=0.0)
    sensing = dataclasses.replace(parameters.layers[1], kind="voxel", name="voxels", sources=(SOURCE,))
    parameters = dataclasses.replace(parameters, layers=(parameters.layers[0], sensing, parameters.layers[2]))
    layered = LayeredCostmap(parameters, name="global", static=OccupancyGrid(np.zeros((40, 40), dtype=np.int8), 0.1))
    local = np.array([[1.0, 0.5, -0.2], [1.0, 0.0, -0.6], [0.5, 0.0, 20.0]], dtype=np.float32)
    cloud = PointCloud(stamp_ns=0, frame_id="camera", points_m=local)
    source = dataclasses.replace(SOURCE, min_obstacle_height=0.05, max_obstacle_height=1.0)
    observation = observe_cloud(cloud, np.array([1.0, 2.0, math.pi / 2]), source, 0.0, 0.5)
    np.testing.assert_allclose(observation.points, [[0.5, 3.0, 0.3]], atol=1e-6)
    layered.observe(observation)
    layered.update([1.0, 2.0, 0.0])
    assert np.argwhere(layered.window().costs == 254).tolist() == [[30, 5]]
