# SPDX-License-Identifier: MIT
"""Pictures and rays against naive twins, and what faces a world is made of."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import ConfigError
from slamcli.simulation import _render_kernels, _texture_kernels, render, texture
from slamcli.simulation.relief import Relief, Terrain, raise_hills
from slamcli.simulation.render import Optics, Scene
from slamcli.simulation.surfaces import CEILING, GROUND, THING, WALL, surfaces_of

pytestmark = pytest.mark.kernels

FLAT = Terrain(np.zeros((2, 2)), 4.0, 0.0, 0.0)


def naive_octave(shape, lattice, step, weight):
    added = np.zeros(shape)
    for row in range(shape[0]):
        for column in range(shape[1]):
            top, left = int(row / step), int(column / step)
            fy, fx = row / step - top, column / step - left
            fy, fx = fy * fy * (3 - 2 * fy), fx * fx * (3 - 2 * fx)
            square = lattice[top : top + 2, left : left + 2]
            added[row, column] = weight * (np.array([1 - fy, fy]) @ square @ np.array([1 - fx, fx]))
    return added


def naive_figure(canvas, kind, x, y, half_w, half_h, c, s, colour, opacity):
    """Rectangles (0), ellipses (1) and checks (5) with four samples a texel."""
    painted = canvas.copy()
    for row in range(canvas.shape[0]):
        for column in range(canvas.shape[1]):
            hits = 0
            for oy in (0.25, 0.75):
                for ox in (0.25, 0.75):
                    dx, dy = column + ox - x, row + oy - y
                    a, b = (c * dx + s * dy) / half_w, (c * dy - s * dx) / half_h
                    inside = abs(a) <= 1 and abs(b) <= 1
                    inside &= kind != 1 or a * a + b * b <= 1
                    inside &= kind != 5 or (np.floor((a + 1) * 2) + np.floor((b + 1) * 2)) % 2 == 0
                    hits += inside
            painted[row, column] += opacity * hits / 4 * (np.array(colour) - painted[row, column])
    return painted


def test_noise_and_figures_are_those_of_the_naive_twin():
    rng = np.random.default_rng(1)
    lattice = rng.random((4, 5)).astype(np.float32)
    canvas = np.zeros((13, 17, 3), np.float32)
    _texture_kernels.add_octave(canvas, lattice, 5.0, 30.0)
    np.testing.assert_allclose(canvas[..., 1], naive_octave((13, 17), lattice, 5.0, 30.0), atol=1e-4)
    for kind in (0, 1, 5):
        expected = naive_figure(canvas, kind, 8.3, 5.9, 6.1, 3.2, 0.8, 0.6, (200.0, 10.0, 90.0), 0.7)
        figure = np.array([[kind, 8.3, 5.9, 6.1, 3.2, 0.8, 0.6, 200.0, 10.0, 90.0, 0.7, 0]])
        _texture_kernels.paint(canvas, figure)
        np.testing.assert_allclose(canvas, expected, atol=1e-3)


@pytest.mark.parametrize(("kind", "share"), [(2, 0.47), (3, 0.5), (4, 4 / 7), (6, 5 / 15), (7, 0.51)])
def test_figures_cover_their_share(kind, share):
    canvas = np.zeros((60, 60, 3), np.float32)
    _texture_kernels.paint(
        canvas, np.array([[kind, 30, 30, 30, 30, 1.0, 0.0, 100, 100, 100, 1.0, 0b000_010_101_010_010]])
    )
    assert canvas[..., 0].mean() / 100 == pytest.approx(share, abs=0.02)


def test_mip_levels_are_means_and_pictures_depend_on_seed_and_number():
    sizes = np.array([[37, 20], [16, 16]])
    album = texture.make_album(sizes, np.array([False, True]), np.ones(2), 4)
    begin, width, height = album.levels[0, 0]
    fine = album.texels[begin : begin + width * height].reshape(height, width, 3).astype(int)
    begin, width, height = album.levels[0, 1]
    coarse = album.texels[begin : begin + width * height].reshape(height, width, 3)
    assert (width, height) == (19, 10)
    padded = np.pad(fine, ((0, 0), (0, 1), (0, 0)), mode="edge")
    means = (padded[0::2, 0::2] + padded[1::2, 0::2] + padded[0::2, 1::2] + padded[1::2, 1::2] + 2) // 4
    np.testing.assert_array_equal(coarse, means)
    assert album.levels[0, -1, 1:].tolist() == [1, 1]
    begin, width, height = album.levels[1, 0]
    assert np.ptp(album.texels[begin : begin + width * height], axis=0).max() == 0  # plain
    again = texture.make_album(sizes, np.array([False, True]), np.ones(2), 4)
    np.testing.assert_array_equal(album.texels, again.texels)
    assert (texture.make_album(sizes, np.array([False, True]), np.ones(2), 5).texels != album.texels).mean() > 0.5
    assert (album.grey().texels[:, 0] - album.texels @ [0.299, 0.587, 0.114]).max() < 0.51


def naive_light(surfaces, album, texel_m, face, ray, origin):
    """Bilinear value of the finest level where a ray meets a face."""
    plane, mapping = surfaces.planes[face], surfaces.maps[face]
    distance = (plane[3] - plane[:3] @ origin) / (plane[:3] @ ray)
    u, v = (mapping[:, :3] @ (origin + distance * ray) + mapping[:, 3]) / texel_m - 0.5
    begin, width, height = album.levels[surfaces.pictures[face], 0]
    picture = album.texels[begin : begin + width * height].reshape(height, width, -1).astype(float)
    left, top = int(u), int(v)
    square = picture[top : top + 2, left : left + 2]
    fx, fy = u - left, v - top
    value = np.einsum("i,ijc,j->c", [1 - fy, fy], square, [1 - fx, fx])
    return value * surfaces.brightness[face], distance


def test_light_and_distance_are_those_of_the_naive_twin():
    relief = Relief(FLAT, None, np.array([[3.0, 0.0, 3.0, 4.0, 0.0, 2.0, 0.5]]))
    scene = Scene(relief, seed=2, texel_m=0.05, plain_share=0.0, grey=False)
    rng = np.random.default_rng(3)
    rays = np.column_stack([np.ones(40), rng.uniform(-0.4, 0.4, 40), rng.uniform(-0.3, 0.3, 40)])
    rotation, origin = np.eye(3)[None], np.array([[0.5, 2.0, 1.0]])
    step = np.full((40, 3), 1e-4)
    faces, light, distances, slants = scene._look(rays, step, step, np.zeros(40, np.int64), rotation, origin)
    wall = surfaces_of(relief)
    assert set(wall.kinds.tolist()) == {GROUND, WALL}
    for i, ray in enumerate(rays):
        assert wall.kinds[wall.pictures[faces[i]]] == WALL
        value, distance = naive_light(wall, scene._album, 0.05, faces[i], ray, origin[0])
        np.testing.assert_allclose(light[i], value, atol=1e-6)
        assert distances[i] == pytest.approx(2.5) == distance
        assert slants[i] == pytest.approx(1 / np.linalg.norm(ray))


def slanted(size, scene):
    """What a camera with `size` x `size` pixels sees that looks along the ground at a slant."""
    step = 0.6 / size
    pixels = (np.arange(size) + 0.5) * step - 0.3
    u, v = np.meshgrid(pixels, pixels)
    ahead = np.stack([u, v, np.ones_like(u)], axis=-1)
    right, down = (np.broadcast_to(change, ahead.shape).copy() for change in ([step, 0.0, 0.0], [0.0, step, 0.0]))
    turn = np.array([[0.0, -0.5, 0.9], [-1, 0, 0], [0, -0.9, -0.5]])
    poses = np.repeat(turn[None], size, axis=0), np.tile([-12.0, 2.0, 5.0], (size, 1))
    return scene.view(Optics(directions=ahead, right=right, down=down), *poses).light[..., 0]


def test_a_pixel_sees_the_mean_of_what_it_covers():
    relief = Relief(Terrain(np.zeros((2, 2)), 50.0, -25.0, -25.0))
    scene = Scene(relief, seed=2, texel_m=0.12, plain_share=0.0, grey=True)
    coarse, fine = slanted(10, scene), slanted(80, scene)
    mean = fine.reshape(10, 8, 10, 8).mean(axis=(1, 3))
    single = fine[4::8, 4::8]
    assert fine.std() > 20
    assert np.abs(coarse - mean).mean() < 0.5 * np.abs(single - mean).mean()
    assert np.abs(coarse - mean).mean() < 3


def test_edges_and_sky():
    seen = np.array([[1, 1, 2], [1, 1, 2], [3, 1, 2]])
    edges = np.zeros((3, 3), np.bool_)
    _render_kernels.find_edges(seen, edges)
    assert edges.tolist() == [[False, True, True], [True, True, True], [True, True, True]]
    scene = Scene(Relief(FLAT), seed=1, texel_m=0.1, plain_share=0.0, grey=True)
    up = np.array([[[0.0, 0.0, 1.0]]])
    view = scene.view(Optics(directions=up, right=up, down=up), np.eye(3)[None], np.array([[1.0, 1.0, 1.0]]))
    assert view.depth_m[0, 0] == np.inf
    assert view.surfaces[0, 0] == -1
    assert view.light[0, 0, 0] > 200


def test_faces_of_boxes_pillars_hills_and_ceilings():
    box = np.array([[2.0, 2.0, 0.6, 0.8, 0.5, 0.25, 0.7, 1.0, 0.4]])
    pillar = np.array([[1.0, 3.0, 0.2, 0.0, 1.5, 0.4]])
    ceiling = Terrain(np.full((2, 2), 2.5), 4.0, 0.0, 0.0)
    made = surfaces_of(Relief(FLAT, ceiling, boxes=box, cylinders=pillar))
    kinds = np.bincount(made.kinds, minlength=4)
    assert kinds.tolist() == [0, 6 + 2, 1, 1]
    assert (made.kinds[[0, 1]] == [GROUND, CEILING]).all()
    assert THING == 1
    np.testing.assert_allclose(np.linalg.norm(made.planes[:, :3], axis=1), 1.0)
    for corners, plane, mapping, picture in zip(made.corners, made.planes, made.maps, made.pictures, strict=True):
        np.testing.assert_allclose(corners @ plane[:3], plane[3], atol=1e-12)
        on_picture = corners @ mapping[:, :3].T + mapping[:, 3]
        assert on_picture.min() > -1e-9
        assert (on_picture <= made.sizes[picture] + 1e-9).all()
    hills = raise_hills(Terrain(np.zeros((9, 9)), 0.5, 0.0, 0.0), 0.5, 2.0, 1)
    assert len(surfaces_of(Relief(hills)).planes) == 2 * 64
    with pytest.raises(ConfigError, match=r"relief\.cell"):
        surfaces_of(Relief(Terrain(np.arange(1500.0 * 1500).reshape(1500, 1500), 0.1, 0.0, 0.0)))


def test_pictures_that_would_not_fit_into_memory_are_coarser(monkeypatch):
    monkeypatch.setattr(render, "_MOST_TEXELS", 10_000)
    ground = Terrain(np.zeros((2, 2)), 100.0, 0.0, 0.0)
    scene = Scene(Relief(ground), seed=1, texel_m=0.01, plain_share=0.0, grey=True)
    assert scene.texel_m == pytest.approx(np.sqrt(100 * 100 * 4 / 3 / 1e4))
