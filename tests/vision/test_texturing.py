# SPDX-License-Identifier: MIT
"""Pictures on a mesh: which view a triangle takes, and where its corners lie on the sheet."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import UsageError
from slamcli.formats.textured_meshes import write_textured
from slamcli.geometry import se3
from slamcli.grids.depth_mesh import EMPTY, Mesh
from slamcli.vision.pinhole import Pinhole
from slamcli.vision.posed_view import PosedView
from slamcli.vision.texturing import textured

CAMERA = Pinhole(fx=100.0, fy=100.0, cx=50.0, cy=40.0, width=101, height=81)


def plane(half=0.5, steps=8, grey=120):
    """A square one metre along z, facing a camera at the origin."""
    at = np.linspace(-half, half, steps + 1)
    x, y = np.meshgrid(at, at)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]).astype(np.float32)
    triangles = []
    for i in range(steps):
        for j in range(steps):
            a = i * (steps + 1) + j
            b, c, d = a + 1, a + steps + 1, a + steps + 2
            triangles += [[a, c, b], [b, c, d]]
    return Mesh(vertices, np.full((len(vertices), 3), grey, np.uint8), np.array(triangles, np.int32))


def view(z=0.0, shade=120, x=0.0, depth=None):
    """A camera that looks along z from (x, 0, z), whose image brightens to the right."""
    colour = (
        np.repeat((np.arange(101) * 0.5 + shade - 25)[None, :, None], 81, axis=0).repeat(3, axis=2).astype(np.uint8)
    )
    T = se3.from_rotation_translation(np.eye(3), np.array([x, 0.0, z]))
    return PosedView(colour, np.full((81, 101), 1.0 - z if depth is None else depth, np.float32), CAMERA, T)


def shades(mesh):
    """What the picture shows at the corners of each triangle, (F, 3)."""
    height, width = mesh.picture.shape[:2]
    column, row = mesh.places[:, 0] * width, (1.0 - mesh.places[:, 1]) * height
    return mesh.picture[np.minimum(row, height - 1).astype(int), np.minimum(column, width - 1).astype(int), 0][
        mesh.corners
    ]


def test_corners_lie_where_the_camera_sees_them():
    mesh = plane(half=0.3)
    found = textured(mesh, [view()], 0.05)
    x = mesh.vertices[mesh.triangles][..., 0]
    expected = 120 - 25 + 0.5 * (50 + 100 * x)
    np.testing.assert_allclose(shades(found), expected, atol=2.0)
    assert found.picture.shape[1] >= 256
    assert len(found.places) < 3 * len(mesh.triangles)


def test_the_nearer_view_is_taken_and_made_as_bright_as_the_mesh():
    mesh = plane(half=0.1, grey=120)
    found = textured(mesh, [view(0.0, 120), view(0.5, 150)], 0.05)
    middle = shades(found).mean()
    assert middle == pytest.approx(120.0, abs=2.0)  # 150 of the nearer view, times 0.8
    spread = np.ptp(shades(found))
    assert spread == pytest.approx(0.8 * 0.5 * 100 * 0.2 / 0.5, abs=4.0)  # of the nearer view: twice as many pixels


def test_what_is_hidden_or_turned_away_has_the_colour_of_the_mesh():
    hidden = textured(plane(grey=77), [view(depth=0.4)], 0.05)
    np.testing.assert_allclose(shades(hidden), 77, atol=9)
    mesh = plane(grey=77)
    back = Mesh(mesh.vertices, mesh.colours, np.ascontiguousarray(mesh.triangles[:, ::-1]))
    np.testing.assert_allclose(shades(textured(back, [view()], 0.05)), 77, atol=9)
    np.testing.assert_allclose(shades(textured(mesh, [], 0.05)), 77, atol=9)


def test_neighbours_agree_on_a_view():
    mesh = plane(half=0.2, steps=20)
    rng = np.random.default_rng(0)
    views = [view(x=float(x)) for x in rng.uniform(-0.01, 0.01, 6)]
    found = textured(mesh, views, 0.05)
    column = found.places[found.corners[:, 0], 0] * found.picture.shape[1] // 101
    row = (1 - found.places[found.corners[:, 0], 1]) * found.picture.shape[0] // 81
    tiles = column + 100 * row
    same = (tiles[0::2] == tiles[1::2]).mean()  # both triangles of a square
    assert same > 0.9


def test_the_same_bytes_every_time():
    mesh, views = plane(), [view(), view(0.3), view(x=0.2)]
    first, second = textured(mesh, views, 0.05), textured(mesh, views, 0.05)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


def test_nothing_has_no_picture(tmp_path):
    empty = textured(EMPTY, [view()], 0.05)
    assert (len(empty.places), len(empty.triangles)) == (0, 0)
    with pytest.raises(UsageError, match=r"as \.obj"):
        write_textured(tmp_path / "a.ply", empty)


def test_files_name_each_other(tmp_path):
    mesh = textured(plane(steps=1), [view()], 0.05)
    write_textured(tmp_path / "model.obj", mesh)
    lines = (tmp_path / "model.obj").read_text().splitlines()
    assert lines[0] == "mtllib model.mtl"
    assert "map_Kd model.jpg" in (tmp_path / "model.mtl").read_text()
    assert (tmp_path / "model.jpg").read_bytes()[:2] == b"\xff\xd8"
    assert sum(line.startswith("v ") for line in lines) == 4
    faces = [line for line in lines if line.startswith("f ")]
    assert len(faces) == 2
    assert [part.split("/")[0] for part in faces[0].split()[1:]] == [str(1 + k) for k in mesh.triangles[0]]
