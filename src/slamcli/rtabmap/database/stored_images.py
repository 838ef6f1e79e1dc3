# SPDX-License-Identifier: MIT
"""Images of a node as the database holds them, as what its cameras saw."""

from __future__ import annotations

import sqlite3
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import FormatError
from slamcli.rtabmap.database.calibration_blobs import unpack_cameras
from slamcli.rtabmap.database.records import StoredCamera
from slamcli.rtabmap.database.schema import Layout
from slamcli.rtabmap.signature import NodeImages
from slamcli.vision.image_coding import decode_depth, decode_image, is_depth
from slamcli.vision.pinhole import Pinhole


def read_images(connection: sqlite3.Connection, layout: Layout, node_id: int, camera: int = 0) -> NodeImages | None:
    """Return what a camera of a node saw; None for a node without images.

    Images of several cameras lie side by side, equally wide.

    Raises
    ------
    FormatError
        If the bytes are damaged, the node has no such camera, or its images have no calibration.
    """
    row = connection.execute("SELECT image, depth, calibration FROM Data WHERE id=?", (node_id,)).fetchone()
    if row is None or not row[0]:
        return None
    colour = decode_image(row[0])
    cameras = unpack_cameras(row[2], layout.version)
    if not cameras or not 0 <= camera < len(cameras):
        raise FormatError(f"its images are of {len(cameras)} calibrated cameras; camera {camera} is none of them")
    depth = right = None
    if row[1] and is_depth(row[1]):
        depth = decode_depth(row[1])
    elif row[1]:
        right = _grey(decode_image(row[1]))
    parts = (None if image is None else _part(image, camera, len(cameras)) for image in (colour, depth, right))
    colour_part, depth_part, right_part = parts
    shape = colour.shape[:2] if colour_part is None else colour_part.shape[:2]
    return NodeImages(
        colour=colour if colour_part is None else colour_part,
        camera=_sized(cameras[camera], shape),
        T_base_camera=cameras[camera].T_base_camera,
        depth=None if depth_part is None else _enlarged(depth_part, shape),
        right=right_part,
    )


def _part(image: NDArray, camera: int, count: int) -> NDArray:
    width = image.shape[1] // count
    return np.ascontiguousarray(image[:, camera * width : (camera + 1) * width])


def _grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the brightness of an image, red first, as OpenCV weighs it."""
    if image.ndim == 2:
        return image
    red, green, blue = (image[:, :, channel].astype(np.int64) for channel in range(3))
    return ((4899 * red + 9617 * green + 1868 * blue + 8192) >> 14).astype(np.uint8)


def _sized(camera: StoredCamera, shape: tuple[int, ...]) -> Pinhole:
    """Return the pinhole camera of an image; a calibration of another size is scaled to it."""
    height, width = shape[:2]
    pinhole = camera.pinhole
    if pinhole.width in (0, width):
        return replace(pinhole, width=width, height=height)
    factor = width / pinhole.width
    return replace(
        pinhole,
        fx=pinhole.fx * factor,
        fy=pinhole.fy * factor,
        cx=pinhole.cx * factor,
        cy=pinhole.cy * factor,
        width=width,
        height=height,
    )


def _enlarged(depth: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return a depth image that was kept smaller at the size of the colour image, each pixel repeated."""
    if depth.shape == tuple(shape[:2]):
        return depth
    rows, columns = shape[0] / depth.shape[0], shape[1] / depth.shape[1]
    if rows != columns or rows != int(rows) or rows < 1:
        raise FormatError(f"a depth image of {depth.shape[1]} x {depth.shape[0]} beside one of {shape[1]} x {shape[0]}")
    return np.repeat(np.repeat(depth, int(rows), axis=0), int(columns), axis=1)
