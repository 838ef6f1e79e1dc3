# SPDX-License-Identifier: MIT
"""Small valid states of every kind of grid, for the fuzzer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from slamcli.formats.pbstream.writing import write_state
from slamcli.geometry import se3
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.measurements import ImuSample, Odometry
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def write_states(folder: Path) -> list[Path]:
    """Write one state of each kind and return their files."""
    random = np.random.default_rng(0)
    cells = random.integers(0, 32768, (12, 9)).astype(np.uint16)
    voxels = np.unique(random.integers(-20, 20, (80, 3)), axis=0).astype(np.int32)
    hybrid = HybridGrid(voxels, random.integers(1, 32768, len(voxels)).astype(np.uint16), 0.1)
    histogram = random.random(8).astype(np.float32)
    submaps: dict[str, dict[str, Any]] = {
        "probability": {"grid": ProbabilityGrid(cells, 0.05, (0.0, 0.0))},
        "tsdf": {"grid": TsdfGrid(cells, cells, 0.05, (0.0, 0.0), 0.3, 10.0)},
        "spatial": {"high_resolution": hybrid, "low_resolution": hybrid, "rotational_histogram": histogram},
    }
    paths = []
    for name, content in submaps.items():
        more = {"low_resolution_points_m": np.ones((3, 3), np.float32), "rotational_histogram": histogram}
        write_state(folder / f"{name}.pbstream", _state(content, more if name == "spatial" else {}))
        paths.append(folder / f"{name}.pbstream")
    return paths


def _state(content: dict[str, Any], more: dict[str, Any]) -> MapState:
    nodes = tuple(
        Node(id=Id(0, k), stamp_ns=(100 + k) * 10**9, T_local_node=se3.from_se2([k, 0.0, 0.0]),
             T_map_node=se3.from_se2([k, k * k / 9, 0.0]), gravity_alignment_xyzw=LEVEL,
             points_m=np.array([[1.0, 2.0, 0.0]], np.float32), **more)
        for k in range(4)
    )  # fmt: skip
    submap = Submap(
        id=Id(0, 0), T_local_submap=np.eye(4), T_map_submap=np.eye(4), num_range_data=4, finished=True, **content
    )
    constraint = Constraint(submap=submap.id, node=nodes[1].id, T_submap_node=np.eye(4), translation_weight=1.0,
                            rotation_weight=1.0, kind="inter")  # fmt: skip
    odometry = Odometry(stamp_ns=100 * 10**9, frame_id="odom", position_m=np.zeros(3), quat_xyzw=LEVEL)
    imu = ImuSample(stamp_ns=100 * 10**9, frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.ones(3))
    return MapState(
        nodes=nodes, submaps=(submap,), constraints=(constraint,), odometry={0: (odometry,)}, imu={0: (imu,)},
        landmarks={"door": np.eye(4)},
    )  # fmt: skip
