# SPDX-License-Identifier: MIT
"""Rays in space: the kernel against a naive twin that tries every triangle, and things whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.simulation import relief
from slamcli.simulation.relief import Relief, Terrain
from slamcli.simulation.space import Space, shorten

LEVEL = Terrain(np.zeros((41, 41)), 0.25, 0.0, 0.0)


def naive_ranges(r: Relief, origins, directions, limit):
    """Distances to the nearest of all triangles (Moeller and Trumbore 1997) and cylinders, in NumPy."""
    triangles = []
    for f in [r.ground] + ([r.ceiling] if r.ceiling else []):
        x, y = np.meshgrid(
            f.x0 + np.arange(f.heights.shape[1]) * f.cell_m, f.y0 + np.arange(f.heights.shape[0]) * f.cell_m
        )
        p = np.stack([x, y, f.heights], axis=2)
        a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, :-1], p[1:, 1:]
        triangles += [np.stack([a, b, c], axis=2).reshape(-1, 3, 3), np.stack([b, c, d], axis=2).reshape(-1, 3, 3)]
    quads = []
    for x0, y0, x1, y1, low, high, _ in r.panels:
        quads.append([[x0, y0, low], [x1, y1, low], [x1, y1, high], [x0, y0, high]])
    for x, y, c, s, length, width, low, high, _ in r.boxes:
        corners = [
            [x + c * i * length - s * j * width, y + s * i * length + c * j * width]
            for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
        quads += [[[*p, z] for p in corners] for z in (low, high)]
        for p, q in zip(corners, corners[1:] + corners[:1], strict=True):
            quads.append([[*p, low], [*q, low], [*q, high], [*p, high]])
    for q in np.array(quads).reshape(-1, 4, 3):
        triangles += [q[None, :3], q[None, [0, 2, 3]]]
    triangles = np.concatenate(triangles)
    ranges = []
    for o, d in zip(origins, directions, strict=True):
        e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        h = np.cross(d, e2)
        det = (e1 * h).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = o - triangles[:, 0]
            u = (s * h).sum(1) / det
            q = np.cross(s, e1)
            v = (d * q).sum(1) / det
            t = (e2 * q).sum(1) / det
        ok = (np.abs(det) > 1e-12) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t >= 0)
        best = t[ok].min(initial=np.inf)
        for cx, cy, radius, low, high, _ in r.cylinders:
            a, b = d[0] ** 2 + d[1] ** 2, (o[0] - cx) * d[0] + (o[1] - cy) * d[1]
            c = (o[0] - cx) ** 2 + (o[1] - cy) ** 2 - radius**2
            if b * b > a * c:
                roots = [(-b + sign * np.sqrt(b * b - a * c)) / a for sign in (-1, 1)]
                best = min([best, *(t for t in roots if t >= 0 and low <= o[2] + t * d[2] <= high)])
            for z in (low, high):
                t = (z - o[2]) / d[2]
                if t >= 0 and np.hypot(*(o + t * d - [cx, cy, z])[:2]) <= radius:
                    best = min(best, t)
        ranges.append(best if best < limit else np.inf)
    return np.array(ranges)


@pytest.mark.kernels
@pytest.mark.parametrize("seed", range(4))
def test_the_naive_twin_agrees(seed):
    rng = np.random.default_rng(seed)
    ground = relief.raise_hills(Terrain(np.zeros((41, 37)), 0.3, -1.0, 2.0), 1.2, 2.0, seed)
    ceiling = Terrain(ground.heights + 3.0, 0.3, -1.0, 2.0) if seed % 2 else None
    xy = rng.uniform([-1.0, 2.0], [9.0, 14.0], (12, 2))
    low = rng.uniform(-1.0, 1.0, 12)
    panels = np.column_stack([xy[:4], rng.uniform([-1.0, 2.0], [9.0, 14.0], (4, 2)), low[:4], low[:4] + 2, np.ones(4)])
    yaw = rng.uniform(0, 6, 4)
    boxes = np.column_stack(
        [xy[4:8], np.cos(yaw), np.sin(yaw), rng.uniform(0.2, 1.0, (4, 2)), low[4:8], low[4:8] + 1, np.ones(4)]
    )
    cylinders = np.column_stack([xy[8:], rng.uniform(0.1, 0.8, 4), low[8:], low[8:] + 1.5, np.ones(4)])
    world = Relief(ground, ceiling, panels, boxes, cylinders)
    origins = np.column_stack([rng.uniform([-2.0, 1.0], [11.0, 15.0], (300, 2)), rng.uniform(1.5, 2.5, 300)])
    directions = rng.standard_normal((300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    ranges = Space(world).cast(origins, directions, 20.0)[:, 0]
    np.testing.assert_allclose(ranges, naive_ranges(world, origins, directions, 20.0), atol=1e-9)
    assert 0.3 < np.isfinite(ranges).mean() < 1.0


def test_straight_down_meets_the_ground_and_straight_up_the_ceiling():
    ceiling = Terrain(LEVEL.heights + 2.5, 0.25, 0.0, 0.0)
    origins = np.array([[3.3, 4.4, 1.0], [3.3, 4.4, 1.0], [3.25, 4.5, 1.0]])
    hits = Space(Relief(LEVEL, ceiling)).cast(origins, np.array([[0, 0, -1.0], [0, 0, 1.0], [0, 0, -1.0]]), 10.0)
    np.testing.assert_allclose(hits, [[1.0, relief.GROUND, 1.0], [1.5, relief.CEILING, 1.0], [1.0, relief.GROUND, 1.0]])


def test_incidence_and_reflectivity_are_those_of_what_was_met():
    panel = np.array([[5.0, 0.0, 5.0, 10.0, 0.0, 3.0, 0.7]])
    directions = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [0.8, 0.0, 0.6]])
    hits = Space(Relief(LEVEL, panels=panel)).cast(np.tile([1.0, 2.0, 0.1], (3, 1)), directions, 10.0)
    np.testing.assert_allclose(hits, [[4.0, 0.7, 1.0], [5.0, 0.7, 0.8], [np.inf, 0.0, 0.0]])


def test_a_ray_passes_under_a_lintel_and_over_a_low_wall():
    panels = np.array(
        [[3.0, 0.0, 3.0, 10.0, 2.0, 3.0, 0.5], [4.0, 0.0, 4.0, 10.0, 0.0, 0.5, 0.5], [6.0, 0, 6.0, 10, 0, 3, 0.5]]
    )
    hits = Space(Relief(LEVEL, panels=panels)).cast(np.array([[1.0, 5.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]), 10.0)
    assert hits[0, 0] == 5.0


@pytest.mark.kernels
def test_bodies_move_while_the_sensor_turns():
    hits = np.array([[8.0, 0.5, 1.0]] * 3)
    body = np.array([[4.0, 0.0, 0.5, 1.0, 0.0, 0.0, 1.7]])
    origins, directions = np.array([[0, 0, 1.0]] * 3), np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    nearer = shorten(hits, origins, directions, np.array([0.0, 1.0, 0.0]), body, 10.0)
    np.testing.assert_allclose(nearer[:, 0], [3.5, 4.5, 8.0])
    assert shorten(hits, np.add(origins, [0, 0, 1.0]), directions, np.zeros(3), body, 10.0)[0, 0] == 8.0


def test_wheels_ride_a_smooth_surface_through_the_nodes():
    terrain = relief.raise_hills(LEVEL, 0.5, 3.0, 1)
    nodes = np.array([[0.25 * 7, 0.25 * 9], [0.25 * 30, 0.25 * 2]])
    np.testing.assert_allclose(terrain.at(nodes), [terrain.heights[9, 7], terrain.heights[2, 30]], atol=1e-12)
    assert np.ptp(terrain.heights) == pytest.approx(0.5)
    assert terrain.highest(np.array([[5.0, 5.0]])) >= terrain.at(np.array([[5.0, 5.0]]))[0]


def test_a_ramp_rises_smoothly_and_stays_up_within_its_bounds():
    terrain = relief.raise_ramp(LEVEL, np.array([2.0, 5.0]), np.array([6.0, 5.0]), 0.8, np.array([0, 4, 10, 6.0]))
    along = terrain.at(np.array([[1.0, 5.0], [4.0, 5.0], [7.0, 5.0], [7.0, 8.0]]))
    np.testing.assert_allclose(along, [0.0, 0.4, 0.8, 0.0], atol=1e-3)
