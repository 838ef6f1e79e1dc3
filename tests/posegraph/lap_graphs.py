# SPDX-License-Identifier: MIT
"""Pose graphs of a robot that drives laps, with truth."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from slamcli.geometry import se3
from slamcli.posegraph.pose_problem import PoseEdges, PoseKnowledge, PoseProblem

SIGMAS = np.array([0.02, 0.02, 0.02, 0.004, 0.004, 0.004])


def lap_graph(nodes=60, closures=20, *, seed=0, planar=False, wrong=0, sigmas=SIGMAS):
    """Two laps of a circle of 5 m: odometry and closures between the laps, with noise of `sigmas`; `wrong` closures are not true."""
    rng = np.random.default_rng(seed)
    angle = 4 * np.pi * np.arange(nodes) / nodes
    tilt = 0.0 if planar else 0.1
    rotvec = np.column_stack([tilt * np.sin(3 * angle), tilt * np.cos(2 * angle), np.zeros(nodes)])
    rotation = Rotation.from_rotvec(np.outer(angle + np.pi / 2, [0, 0, 1])) * Rotation.from_rotvec(rotvec)
    place = np.column_stack([5 * np.cos(angle), 5 * np.sin(angle), (0.0 if planar else 0.5) * np.sin(angle)])
    truth = se3.from_rotation_translation(rotation.as_matrix(), place)
    old = rng.choice(nodes // 2 - 1, closures, replace=closures > nodes // 2 - 1)
    first = np.concatenate([np.arange(nodes - 1), old])
    second = np.concatenate([np.arange(1, nodes), old + nodes // 2])
    T = se3.inverse(truth[first]) @ truth[second]
    noise = sigmas * rng.normal(size=(len(first), 6))
    if planar:
        noise[:, [2, 3, 4]] = 0.0
    T[:, :3, 3] += noise[:, :3]
    T[:, :3, :3] = Rotation.from_rotvec(noise[:, 3:]).as_matrix() @ T[:, :3, :3]
    if wrong:
        T[-wrong:, :2, 3] += rng.uniform(1.0, 2.0, (wrong, 2))
    start = np.empty_like(truth)
    start[0] = truth[0]
    for k in range(1, nodes):
        start[k] = start[k - 1] @ T[k - 1]
    edges = PoseEdges(
        first=first, second=second, T_first_second=T, information=np.tile(np.diag(sigmas**-2.0), (len(first), 1, 1)),
        robust=np.arange(len(first)) >= nodes - 1,
    )  # fmt: skip
    return PoseProblem(keys=np.arange(nodes) + 1, T_map_pose=start, root=0, edges=edges, known=nothing()), truth


def nothing():
    return PoseKnowledge(
        row=np.zeros(0, np.int64), T_map_pose=np.zeros((0, 4, 4)), information=np.zeros((0, 6, 6)),
        gravity=np.zeros(0, np.bool_),
    )  # fmt: skip


def rms(T, truth):
    return float(np.sqrt(np.mean(np.sum((T[:, :3, 3] - truth[:, :3, 3]) ** 2, axis=1))))
