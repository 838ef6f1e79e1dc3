# SPDX-License-Identifier: MIT
"""Every pixel's depth behind the ideal camera: points on the plane they were drawn from, whatever the lens."""

from __future__ import annotations

import numpy as np
import pytest

from slamcli.errors import DataError
from slamcli.measurements import CameraModel, CameraRig, Image, RgbdFrame
from slamcli.vision.dense_depth import DenseDepth
from slamcli.vision.preparation import Preparation

WIDTH, HEIGHT, FOCAL = 160, 120, 140.0
LENSES = {"none": np.zeros(5), "barrel": np.array([-0.2, 0.05, 0.001, -0.001, 0.0])}


def depth_of(lens, range_m=5.0):
    K = np.array([[FOCAL, 0, 79.5], [0, FOCAL, 59.5], [0, 0, 1.0]])
    model = CameraModel(
        stamp_ns=0, frame_id="c", width=WIDTH, height=HEIGHT, distortion_model="plumb_bob", distortion=LENSES[lens],
        intrinsics=K, rectification=np.eye(3), projection=np.column_stack([K, np.zeros(3)]),
    )  # fmt: skip
    preparation = Preparation(CameraRig(mode="rgbd", main=model))
    return DenseDepth(preparation, range_m), preparation


def frame(depth, colour=None):
    grey = np.tile(np.arange(WIDTH, dtype=np.uint8), (HEIGHT, 1))
    return RgbdFrame(
        colour=Image(stamp_ns=7, frame_id="c", encoding="mono8" if colour is None else "rgb8", pixels=grey if colour is None else colour),
        depth=Image(stamp_ns=7, frame_id="c", encoding="depth", pixels=depth),
    )  # fmt: skip


@pytest.mark.parametrize("lens", LENSES)
def test_points_lie_on_the_rays_of_their_pixels(lens):
    dense, preparation = depth_of(lens)
    points, colours = dense.points(frame(np.full((HEIGHT, WIDTH), 2.0, np.float32)))
    assert len(points) == WIDTH * HEIGHT
    np.testing.assert_allclose(points[:, 2], 2.0)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    rays = preparation.to_pinhole(np.column_stack([u.ravel(), v.ravel()]).astype(float)).pixels
    np.testing.assert_allclose(preparation.camera.project(points), rays, atol=1e-9)
    np.testing.assert_array_equal(colours[:, 0], u.ravel())


@pytest.mark.parametrize("lens", LENSES)
def test_the_image_of_the_ideal_camera_shows_the_same(lens):
    dense, preparation = depth_of(lens)
    sloped = np.tile(np.linspace(1.5, 2.5, WIDTH, dtype=np.float32), (HEIGHT, 1))
    points, _ = dense.points(frame(sloped))
    depth, colour = dense.images(frame(sloped))
    at = np.rint(preparation.camera.project(points)).astype(int)
    inside = ((at >= 0) & (at < (WIDTH, HEIGHT))).all(axis=1)
    np.testing.assert_allclose(depth[at[inside, 1], at[inside, 0]], points[inside, 2], atol=0.02)
    assert (depth > 0).mean() > 0.85
    assert (colour[..., 0][depth > 0] == colour[..., 2][depth > 0]).all()


def test_what_is_unknown_far_or_at_an_edge_is_left_out():
    depth = np.full((HEIGHT, WIDTH), 1.0, np.float32)
    depth[:, 80:] = 3.0
    depth[:30], depth[30:60], depth[-1, 0] = 0.0, np.nan, 6.0
    dense, _ = depth_of("none")
    points, _ = dense.points(frame(depth))
    assert len(points) == 60 * (WIDTH - 2) - 3  # both sides of the jump; the far pixel and the two beside it
    assert set(np.round(points[:, 2], 3)) == {1.0, 3.0}


def test_a_frame_of_another_rig_is_refused():
    dense, _ = depth_of("none")
    small = frame(np.ones((HEIGHT, WIDTH), np.float32), colour=np.zeros((HEIGHT, WIDTH // 2, 3), np.uint8))
    with pytest.raises(DataError, match="80 x 120 pixels"):
        dense.points(small)
