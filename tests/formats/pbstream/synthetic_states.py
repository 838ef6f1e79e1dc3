# SPDX-License-Identifier: MIT
"""States with a bit of everything, for round trips."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.grids.hybrid_grid import HybridGrid
from slamcli.grids.probability_grid import ProbabilityGrid
from slamcli.grids.tsdf_grid import TsdfGrid
from slamcli.measurements import ImuSample, LandmarkObservation, Landmarks, Odometry, StampedPose
from slamcli.posegraph import Constraint, Id, MapState, Node, Submap, TrajectoryData

START_NS = 1_101_864_661_428_951_800


def transforms(random: np.random.Generator, n: int) -> np.ndarray:
    return se3.from_position_quaternion(
        random.normal(scale=20, size=(n, 3)), quaternion.normalise(random.normal(size=(n, 4)))
    )


def millimetres(random: np.random.Generator, n: int) -> np.ndarray:
    """Points that the file can hold, in the order in which it holds them: whole blocks one after the other."""
    steps = random.integers(-30_000, 30_000, size=(n, 3))
    _, block = np.unique(steps >> 10, axis=0, return_inverse=True)
    return steps[np.argsort(block.ravel(), kind="stable")].astype(np.float32) * np.float32(0.001)


def hybrid_grid(random: np.random.Generator, resolution_m: float) -> HybridGrid:
    indices = np.unique(random.integers(-500, 500, size=(300, 3)), axis=0).astype(np.int32)
    return HybridGrid(indices, random.integers(1, 32768, len(indices)).astype(np.uint16), resolution_m)


def content(kind: str, random: np.random.Generator) -> dict[str, Any]:
    """What a submap of a kind holds."""
    cells = random.integers(0, 32768, size=(7, 11)).astype(np.uint16)
    cells[0] = cells[:, :2] = 0
    if kind == "probability":
        return {"grid": ProbabilityGrid(cells, 0.05, (-3.25, 7.1))}
    if kind == "tsdf":
        weights = np.where(cells > 0, random.integers(1, 32768, size=cells.shape), 0).astype(np.uint16)
        return {"grid": TsdfGrid(cells, weights, 0.05, (1.5, -2.0), 0.3, 10.0)}
    return {
        "high_resolution": hybrid_grid(random, 0.1),
        "low_resolution": hybrid_grid(random, 0.45),
        "rotational_histogram": random.random(120).astype(np.float32),
    }


def make_state(kind: str, seed: int = 0, trajectories: tuple[int, ...] = (0, 2)) -> MapState:
    """Return a state of kind probability, tsdf or 3d."""
    random = np.random.default_rng(seed)
    nodes, submaps, constraints = [], [], []
    for trajectory in trajectories:
        for number, (T_local, T_map) in enumerate(zip(transforms(random, 5), transforms(random, 5), strict=True)):
            more = {}
            if kind == "3d":
                more["low_resolution_points_m"] = millimetres(random, 12)
                more["rotational_histogram"] = random.random(120).astype(np.float32)
            nodes.append(
                Node(
                    id=Id(trajectory, number), stamp_ns=START_NS + 100_000_000 * number, T_local_node=T_local,
                    T_map_node=T_map, gravity_alignment_xyzw=quaternion.normalise(random.normal(size=4)),
                    points_m=millimetres(random, 40), **more,
                )
            )  # fmt: skip
        for number, (T_local, T_map) in enumerate(zip(transforms(random, 2), transforms(random, 2), strict=True)):
            submaps.append(
                Submap(
                    id=Id(trajectory, number), T_local_submap=T_local, T_map_submap=T_map,
                    num_range_data=180 - number, finished=number == 0, **content(kind, random),
                )
            )  # fmt: skip
        constraints += [
            Constraint(
                submap=Id(trajectory, i % 2), node=Id(trajectory, i), T_submap_node=T, translation_weight=500.0 + i,
                rotation_weight=1600.0, kind="inter" if i == 3 else "intra",
            )
            for i, T in enumerate(transforms(random, 5))
        ]  # fmt: skip
    return MapState(
        nodes=tuple(nodes), submaps=tuple(submaps), constraints=tuple(constraints), **sensor_data(random, trajectories)
    )


def sensor_data(random: np.random.Generator, trajectories: tuple[int, ...]) -> dict[str, Any]:
    def pose(i: int) -> dict[str, Any]:
        return {
            "stamp_ns": START_NS + i * 10_000_000, "position_m": random.normal(size=3),
            "quat_xyzw": quaternion.normalise(random.normal(size=4)),
        }  # fmt: skip

    seen = {key: value for key, value in pose(0).items() if key != "stamp_ns"}
    observation = LandmarkObservation(id="door", translation_weight=2.0, rotation_weight=0.5, **seen)
    return {
        "imu": {
            key: tuple(
                ImuSample(stamp_ns=START_NS + i * 5_000_000, frame_id="imu", angular_rad_s=random.normal(size=3),
                          acceleration_m_s2=random.normal(size=3))
                for i in range(4)
            )
            for key in trajectories
        },
        "odometry": {trajectories[0]: tuple(Odometry(frame_id="odom", **pose(i)) for i in range(3))},
        "fixed_frame_poses": {trajectories[-1]: tuple(StampedPose(frame_id="gps", **pose(i)) for i in range(2))},
        "landmarks": {"door": transforms(random, 1)[0], "Tür 2": transforms(random, 1)[0]},
        "landmark_observations": {
            trajectories[0]: (Landmarks(stamp_ns=START_NS, frame_id="camera", observations=(observation,)),)
        },
        "trajectory_data": {
            trajectories[0]: TrajectoryData(gravity_m_s2=9.81, imu_calibration_xyzw=quaternion.normalise(random.normal(size=4))),
            trajectories[-1]: TrajectoryData(T_map_fixed_frame=transforms(random, 1)[0]),
        },
        "options": {key: bytes([10, key]) for key in trajectories},
    }  # fmt: skip


_NOT_KEPT = {"frame_id", "child_frame_id", "frozen", "topic", "linear_m_s", "covariance"}


def assert_same(a: Any, b: Any, rotations: float = 0.0, what: str = "state") -> None:
    """Everything that the format keeps is the same to the last bit, rotations and corners within `rotations`."""
    if dataclasses.is_dataclass(a):
        assert type(a) is type(b), what
        for field in dataclasses.fields(a):
            if field.name not in _NOT_KEPT and not (field.name == "angular_rad_s" and isinstance(a, Odometry)):
                assert_same(getattr(a, field.name), getattr(b, field.name), rotations, f"{what}.{field.name}")
    elif isinstance(a, dict):
        assert list(a) == list(b), what
        for key in a:
            assert_same(a[key], b[key], rotations, f"{what}[{key}]")
    elif isinstance(a, tuple) and not isinstance(a, Id):
        assert len(a) == len(b), what
        for i, (one, other) in enumerate(zip(a, b, strict=True)):
            assert_same(one, other, rotations, f"{what}[{i}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, what
        if a.shape == (4, 4):
            assert np.array_equal(a[:3, 3], b[:3, 3]), what
            assert np.abs(a - b).max() <= rotations, what
        else:
            assert np.array_equal(a, b), what
    elif isinstance(a, float):
        assert abs(a - b) <= rotations, what
    else:
        assert a == b, what
