# SPDX-License-Identifier: MIT
"""What a node keeps of a scan."""

from __future__ import annotations

import numpy as np

from slamcli.parameters import resolve
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.scan_thinning import kept_scan
from slamcli.rtabmap.signature import NodeScan


def scan() -> NodeScan:
    points = np.column_stack([np.arange(100) * 0.01, np.zeros(100), np.zeros(100)]).astype(np.float32)
    return NodeScan(points=points, planar=True, T_base_sensor=np.eye(4), open_ends=points[:10])


def kept(**values: float) -> NodeScan:
    settings = resolve(RtabmapParameters, {f"Mem/LaserScan{name}": value for name, value in values.items()}).mem
    return kept_scan(scan(), settings)


def test_all_of_it_by_default() -> None:
    assert len(kept().points) == 100


def test_every_few_points() -> None:
    found = kept(DownsampleStepSize=4)
    np.testing.assert_allclose(found.points[:, 0], np.arange(0, 100, 4) * 0.01, atol=1e-6)
    assert found.open_ends is not None
    assert len(found.open_ends) == 3


def test_one_point_of_each_voxel() -> None:
    found = kept(VoxelSize=0.1)
    assert 10 <= len(found.points) <= 11
    assert found.points.dtype == np.float32
    assert found.open_ends is not None
    assert len(found.open_ends) == 10
