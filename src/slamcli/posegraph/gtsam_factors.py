# SPDX-License-Identifier: MIT
"""Graphs of poses in GTSAM's terms: its factors, values, order and axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import se3
from slamcli.posegraph.pose_problem import GtsamSettings, PoseProblem

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
FLAT = np.array([0, 1, 5])
"""x, y and yaw of (x, y, z, rotation vector)."""
ROOT_SIGMA = 1e-4
"""m and rad: how firmly the root is held."""
LOOSE_SIGMA = 1e3
"""m and rad: of the root where a pose from elsewhere places it, and of its roll and pitch where gravity tells them."""


def library() -> Any:
    """Return GTSAM, which is loaded when the first graph is optimised: few commands need it."""
    import gtsam

    return gtsam


def pose_values(problem: PoseProblem, rows: Integers, planar: bool) -> Any:
    """Return GTSAM's values of some rows."""
    gtsam = library()
    values = gtsam.Values()
    keys = problem.keys[rows].tolist()
    if planar:
        for key, (x, y, yaw) in zip(keys, se3.to_se2(problem.T_map_pose[rows]).tolist(), strict=True):
            values.insert(key, gtsam.Pose2(x, y, yaw))
    else:
        for key, T in zip(keys, problem.T_map_pose[rows], strict=True):
            values.insert(key, gtsam.Pose3(T))
    return values


def solved_poses(problem: PoseProblem, result: Any, planar: bool) -> Floats:
    """Return float64 (N, 4, 4), all moved so that the root is where it was."""
    gtsam = library()
    order = np.argsort(problem.keys, kind="stable")
    poses = np.empty((len(order), 4, 4))
    start = problem.T_map_pose[problem.root]
    if planar:
        poses[order] = se3.from_se2(gtsam.utilities.extractPose2(result))
        start = se3.from_se2(se3.to_se2(start))
    else:
        rows = gtsam.utilities.extractPose3(result)
        poses[order] = se3.from_rotation_translation(rows[:, :9].reshape(-1, 3, 3), rows[:, 9:])
    if np.any(problem.known.gravity) or len(problem.known.row):
        return poses
    # Rotations that are not quite any more would grow from call to call, where each has another root.
    moved = start @ se3.inverse(poses[problem.root]) @ poses
    return se3.from_position_quaternion(*se3.to_position_quaternion(moved))


def fingerprints(problem: PoseProblem) -> list[bytes]:
    """Return what each factor is made of, edges, then what is known, then the root."""
    keys, edges, known = problem.keys, problem.edges, problem.known
    prints = [
        b"e" + keys[i].tobytes() + keys[j].tobytes() + T.tobytes() + information.tobytes() + robust.tobytes()
        for i, j, T, information, robust in zip(
            edges.first, edges.second, edges.T_first_second, edges.information, edges.robust, strict=True
        )
    ]
    prints += [
        b"k" + keys[i].tobytes() + T.tobytes() + information.tobytes() + gravity.tobytes()
        for i, T, information, gravity in zip(
            known.row, known.T_map_pose, known.information, known.gravity, strict=True
        )
    ]
    # Two measurements may be the same to the byte: the second counts too.
    seen: dict[bytes, int] = {}
    for row, one in enumerate(prints):
        seen[one] = seen.get(one, -1) + 1
        prints[row] = one + seen[one].to_bytes(4, "little")
    held = bytes([_placed(problem), bool(np.any(known.gravity))])
    return [*prints, b"r" + keys[problem.root].tobytes() + held]


def pose_factors(problem: PoseProblem, settings: GtsamSettings, chosen: list[int] | None = None) -> list[Any]:
    """Return GTSAM's factors in the order of `fingerprints`: all, or the chosen ones."""
    edges, known = problem.edges, problem.known
    count, more = len(edges.first), len(known.row)
    rows = np.arange(count + more + 1) if chosen is None else np.array(chosen, np.int64)
    wanted = rows[rows < count]
    factors = _between(problem, wanted, settings.planar)
    for row in rows[(rows >= count) & (rows < count + more)] - count:
        factors += _knowledge(problem, int(row), settings)
    if len(rows) and rows[-1] == count + more:
        factors.append(_root_prior(problem, settings.planar))
    return factors


def _between(problem: PoseProblem, rows: Integers, planar: bool) -> list[Any]:
    gtsam = library()
    edges = problem.edges
    first, second = problem.keys[edges.first[rows]].tolist(), problem.keys[edges.second[rows]].tolist()
    T = edges.T_first_second[rows]
    information = _turned(edges.information[rows], T, planar)
    measured: list[Any] = (
        [gtsam.Pose2(*row) for row in se3.to_se2(T).tolist()] if planar else [gtsam.Pose3(M) for M in T]
    )
    make: Any = gtsam.BetweenFactorPose2 if planar else gtsam.BetweenFactorPose3
    return [
        make(i, j, M, gtsam.noiseModel.Gaussian.Information(weight))
        for i, j, M, weight in zip(first, second, measured, information, strict=True)
    ]


def _turned(information: Floats, T: Floats, planar: bool) -> Floats:
    """Return information in GTSAM's order and axes: of the rotation first, along those of the pose that is seen."""
    turn = np.zeros((len(T), 6, 6))
    if planar:
        turn[:, :2, :2] = se3.from_se2(se3.to_se2(T))[:, :2, :2]
        turn[:, 2, 2] = 1.0
        small = _marginal(information)
        return np.ascontiguousarray(turn[:, :3, :3].transpose(0, 2, 1) @ small @ turn[:, :3, :3])
    turn[:, :3, 3:] = turn[:, 3:, :3] = T[:, :3, :3]
    turned: Floats = turn.transpose(0, 2, 1) @ information @ turn
    return np.ascontiguousarray(0.5 * (turned + turned.transpose(0, 2, 1)))


def _marginal(information: Floats) -> Floats:
    """Return the information (E, 3, 3) about x, y and yaw, whatever the other three are."""
    rest = np.array([2, 3, 4])
    cross = information[:, FLAT[:, None], rest]
    inner = information[:, rest[:, None], rest] + 1e-12 * np.eye(3)
    known = information[:, FLAT[:, None], FLAT]
    if not cross.any():
        return known
    small: Floats = known - cross @ np.linalg.solve(inner, cross.transpose(0, 2, 1))
    return 0.5 * (small + small.transpose(0, 2, 1))


def _knowledge(problem: PoseProblem, row: int, settings: GtsamSettings) -> list[Any]:
    gtsam = library()
    known = problem.known
    key, T = int(problem.keys[known.row[row]]), known.T_map_pose[row]
    if known.gravity[row]:
        if settings.planar:  # the plane is level: one factor that says nothing keeps the order
            return [gtsam.PriorFactorPose2(key, gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 1e9))]
        up = gtsam.Unit3(np.array([0.0, 0.0, 1.0]))
        seen = gtsam.Unit3(T[2, :3].copy())
        tilt = gtsam.noiseModel.Isotropic.Sigma(2, settings.gravity_sigma)
        return [gtsam.AttitudeFactorPose3(key, up, tilt, seen)]
    information = _turned(known.information[row : row + 1], T[None], settings.planar)[0]
    noise = gtsam.noiseModel.Gaussian.Information(information)
    if settings.planar:
        return [gtsam.PriorFactorPose2(key, gtsam.Pose2(*se3.to_se2(T).tolist()), noise)]
    return [gtsam.PriorFactorPose3(key, gtsam.Pose3(T), noise)]


def _root_prior(problem: PoseProblem, planar: bool) -> Any:
    gtsam = library()
    key, T = int(problem.keys[problem.root]), problem.T_map_pose[problem.root]
    if planar:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, LOOSE_SIGMA if _placed(problem) else ROOT_SIGMA)
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*se3.to_se2(T).tolist()), noise)
    firm = 1.0 / (LOOSE_SIGMA if _placed(problem) else ROOT_SIGMA) ** 2
    information = firm * np.eye(6)
    if np.any(problem.known.gravity):
        information[3, 3] = information[4, 4] = 1.0 / LOOSE_SIGMA**2  # roll and pitch, about the map's axes
    information = _turned(information[None], T[None], planar=False)[0]
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(T), gtsam.noiseModel.Gaussian.Information(information))


def _placed(problem: PoseProblem) -> bool:
    """Whether some pose is known from elsewhere, so that the root need not be held."""
    return bool(np.any(~problem.known.gravity)) if len(problem.known.row) else False
