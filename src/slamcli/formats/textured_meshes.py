# SPDX-License-Identifier: MIT
"""Meshes with a picture on them: Wavefront OBJ with its material and a JPEG."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from slamcli.errors import UsageError
from slamcli.outputs import atomic_file
from slamcli.vision.texturing import TexturedMesh

_QUALITY = 92


def write_textured(path: Path, mesh: TexturedMesh) -> None:
    """Write ``NAME.obj``, and ``NAME.mtl`` and ``NAME.jpg`` beside it.

    Raises
    ------
    UsageError
        If the suffix is another one, or a file cannot be written.
    """
    if path.suffix != ".obj":
        raise UsageError(f"{path}: meshes with pictures are written as .obj")
    done, encoded = cv2.imencode(
        ".jpg", np.ascontiguousarray(mesh.picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
    )
    if not done:
        raise UsageError(f"{path}: the picture of {mesh.picture.shape[1]} x {mesh.picture.shape[0]} cannot be encoded")
    with atomic_file(path.with_suffix(".jpg"), "wb") as stream:
        stream.write(encoded.tobytes())
    material = f"newmtl pictures\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {path.stem}.jpg\n"
    with atomic_file(path.with_suffix(".mtl"), "wb") as stream:
        stream.write(material.encode())
    lines = [f"mtllib {path.stem}.mtl", "usemtl pictures"]
    lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u:.6f} {v:.6f}" for u, v in mesh.places.tolist()]
    faces = np.stack([mesh.triangles + 1, mesh.corners + 1], axis=2).reshape(-1, 6)
    lines += [f"f {a}/{i} {b}/{j} {c}/{k}" for a, i, b, j, c, k in faces.tolist()]
    with atomic_file(path, "wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii"))
