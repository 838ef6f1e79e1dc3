# SPDX-License-Identifier: MIT
"""Meshes in files: PLY with coloured vertices and triangles."""

from __future__ import annotations

import os
from pathlib import Path

from slamcli.formats.ply import ply_bytes
from slamcli.grids.depth_mesh import Mesh
from slamcli.outputs import atomic_file


def write_mesh(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write a mesh as binary PLY, whole or not at all; `read_cloud` reads its vertices.

    Raises
    ------
    UsageError
        If the file cannot be written.
    """
    columns = {name: mesh.vertices[:, i] for i, name in enumerate("xyz")}
    with atomic_file(Path(path), "wb") as stream:
        stream.write(ply_bytes(columns, mesh.colours, mesh.triangles))
