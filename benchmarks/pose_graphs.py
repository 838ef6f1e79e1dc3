# SPDX-License-Identifier: MIT
"""Pose graphs shaped as Cartographer's, adjusted by slamcli and by GTSAM from the same dead reckoning, in one run.

python benchmarks/pose_graphs.py [--repeat 3]

Nodes along six laps of a building, each in two submaps, linked with the next by two edges (local SLAM and odometry), and
loops to submaps within 15 m under a Huber loss. Both optimisers stop at a relative decrease of the cost of 1e-6; GTSAM's
own edges take the logarithm of the error, so both results are judged by slamcli's cost. GTSAM's Levenberg-Marquardt runs
with its defaults (multifrontal Cholesky, its own threads).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.posegraph import planar_covariances, spatial
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges, optimise_planar
from slamcli.posegraph.spatial import SpatialEdges, optimise_spatial

HUBER = Loss(kind="huber", scale=3.0)


def laps(nodes: int) -> np.ndarray:
    """True poses (nodes, 4, 4) along six laps that differ."""
    t = np.linspace(0, 12 * np.pi, nodes)
    place = np.stack([20 * np.cos(t) + 3 * np.cos(7.3 * t), 15 * np.sin(t) + 2 * np.sin(3.1 * t), np.sin(0.37 * t)], 1)
    along = np.gradient(place, axis=0)
    yaw = np.arctan2(along[:, 1], along[:, 0])
    turn = quaternion.from_roll_pitch_yaw(0.05 * np.sin(3 * t), 0.05 * np.cos(2 * t), yaw)
    return se3.from_position_quaternion(place, turn)


def graph(nodes: int, submaps: int, loops: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Truth (P, 4, 4), submaps first; first, second, sigmas (N, 2) of translation and rotation, robust of the edges."""
    path = laps(nodes)
    each = nodes // submaps
    truth = np.concatenate([path[np.arange(submaps) * each], path])
    n = np.arange(nodes)
    own = np.minimum(n // each, submaps - 1)
    later = np.flatnonzero(own > 0)
    node, submap = rng.integers(0, nodes, 20 * loops), rng.integers(0, submaps, 20 * loops)
    near = np.linalg.norm(path[node, :2, 3] - truth[submap, :2, 3], axis=1) < 15
    chosen = np.flatnonzero(near & (np.abs(own[node] - submap) > 1))[:loops]
    kinds = [
        (own, n + submaps, (0.02, 0.005), False),
        (own[later] - 1, later + submaps, (0.02, 0.005), False),
        (n[:-1] + submaps, n[1:] + submaps, (0.005, 0.002), False),
        (n[:-1] + submaps, n[1:] + submaps, (0.005, 0.002), False),
        (submap[chosen], node[chosen] + submaps, (0.02, 0.005), True),
    ]
    first, second = (np.concatenate([kind[i] for kind in kinds]) for i in (0, 1))
    sigmas = np.concatenate([np.tile(kind[2], (len(kind[0]), 1)) for kind in kinds])
    robust = np.concatenate([np.full(len(kind[0]), kind[3]) for kind in kinds])
    return truth, first, second, sigmas, robust


def planar_case(truth, first, second, sigmas, robust, rng):
    poses = se3.to_se2(truth)
    c, s = np.cos(poses[first, 2]), np.sin(poses[first, 2])
    d = poses[second] - poses[first]
    measured = np.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], d[:, 2]], axis=1)
    measured += rng.normal(size=measured.shape) * sigmas[:, [0, 0, 1]]
    edges = PlanarEdges(
        first=first, second=second, measured=measured, translation_weight=1 / sigmas[:, 0],
        rotation_weight=1 / sigmas[:, 1], robust=robust,
    )  # fmt: skip
    return edges, [gtsam.Pose2(*m) for m in measured], lambda poses: se3.to_se2(poses)


def spatial_case(truth, first, second, sigmas, robust, rng):
    measured = se3.inverse(truth[first]) @ truth[second]
    measured[:, :3, 3] += rng.normal(size=(len(first), 3)) * sigmas[:, :1]
    small = quaternion.from_roll_pitch_yaw(*(rng.normal(size=len(first)) * sigmas[:, 1] for _ in range(3)))
    measured[:, :3, :3] = measured[:, :3, :3] @ quaternion.to_matrix(small)
    rows = np.concatenate(se3.to_position_quaternion(measured), axis=1)
    edges = SpatialEdges(
        first=first, second=second, measured=rows, translation_weight=1 / sigmas[:, 0], rotation_weight=1 / sigmas[:, 1],
        robust=robust,
    )  # fmt: skip
    return (
        edges,
        [gtsam.Pose3(m) for m in measured],
        lambda poses: np.concatenate(se3.to_position_quaternion(poses), axis=1),
    )


def dead_reckoning(truth: np.ndarray, submaps: int, chain: np.ndarray) -> np.ndarray:
    """Poses (P, 4, 4) where the first link of each node says they are; submaps stand where their first node does."""
    start = truth.copy()
    for i, link in enumerate(chain):
        start[submaps + i + 1] = start[submaps + i] @ link
    each = (len(truth) - submaps) // submaps
    start[:submaps] = start[submaps + np.arange(submaps) * each]
    return start


def run_gtsam(
    start: list[Any], first, second, measured: list[Any], sigmas, robust, dimension: int
) -> tuple[float, Any]:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    factor = gtsam.BetweenFactorPose2 if dimension == 2 else gtsam.BetweenFactorPose3
    for i, pose in enumerate(start):
        values.insert(i, pose)
    prior = gtsam.PriorFactorPose2 if dimension == 2 else gtsam.PriorFactorPose3
    graph.add(prior(0, start[0], gtsam.noiseModel.Isotropic.Sigma(3 if dimension == 2 else 6, 1e-6)))
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER.scale)
    for a, b, m, (t, r), loop in zip(first.tolist(), second.tolist(), measured, sigmas, robust, strict=True):
        order = [t, t, r] if dimension == 2 else [r, r, r, t, t, t]
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.array(order))
        graph.add(factor(a, b, m, gtsam.noiseModel.Robust.Create(huber, noise) if loop else noise))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-6)
    settings.setAbsoluteErrorTol(0.0)
    began = time.perf_counter()
    optimiser = gtsam.LevenbergMarquardtOptimizer(graph, values, settings)
    result = optimiser.optimize()
    took = time.perf_counter() - began
    if dimension == 2:
        found = [result.atPose2(i) for i in range(len(start))]
        return took, np.array([[p.x(), p.y(), p.theta()] for p in found])
    return took, np.array([result.atPose3(i).matrix() for i in range(len(start))])


def run(nodes: int, submaps: int, loops: int, dimension: int, repeat: int) -> None:
    rng = np.random.default_rng(7)
    truth, first, second, sigmas, robust = graph(nodes, submaps, loops, rng)
    case = planar_case if dimension == 2 else spatial_case
    edges, measured, rows = case(truth, first, second, sigmas, robust, rng)
    links = np.flatnonzero((first >= submaps) & (second >= submaps))[: nodes - 1]
    if dimension == 2:
        chain, lift = se3.from_se2(edges.measured[links]), se3.from_se2(rows(truth))
    else:
        chain, lift = se3.from_position_quaternion(edges.measured[links, :3], edges.measured[links, 3:]), truth
    start = dead_reckoning(lift, submaps, chain)
    optimise: Callable[..., Any] = optimise_planar if dimension == 2 else optimise_spatial
    fixed = np.arange(len(start)) == 0
    began, ours = [], None
    for _ in range(repeat):
        began.append(time.perf_counter())
        ours = optimise(rows(start), fixed, edges, loss=HUBER, max_iterations=50)
        began[-1] = time.perf_counter() - began[-1]
    theirs_start = [gtsam.Pose2(*p) for p in rows(start)] if dimension == 2 else [gtsam.Pose3(m) for m in start]
    times = []
    for _ in range(repeat):
        took, found = run_gtsam(theirs_start, first, second, measured, sigmas, robust, dimension)
        times.append(took)
    theirs = optimise(found if dimension == 2 else rows(found), fixed, edges, loss=HUBER, max_iterations=0)
    error = np.sqrt(np.mean(np.sum((ours.poses[:, :2] - truth[:, :2, 3]) ** 2, axis=1)))
    drift = np.sqrt(np.mean(np.sum((start[:, :2, 3] - truth[:, :2, 3]) ** 2, axis=1)))
    us, them = min(began), min(times)
    print(
        f"{dimension}D {nodes:5} nodes {submaps:3} submaps {len(first):6} edges: slamcli {us:6.2f} s ({ours.iterations} it., "
        f"{us / max(ours.iterations, 1):.3f} s each), cost {ours.cost_after:.1f}; GTSAM {them:6.2f} s, cost "
        f"{theirs.cost_after:.1f}; ratio {them / us:.1f}; error {drift:.2f} -> {error:.4f} m",
        flush=True,
    )
    if dimension == 2:
        began = [time.perf_counter()]
        covariances = planar_covariances.PlanarCovariances(ours.poses, fixed, edges, ours.weights)
        began.append(time.perf_counter())
        covariances.relative(0, np.arange(len(start)))
        began.append(time.perf_counter())
        build, query = np.diff(began)
        print(f"   marginals of all poses {build:.3f} s, of all relative to one pose {query * 1e3:.1f} ms", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many runs counts")
    repeat = parser.parse_args().repeat
    planar_covariances.warm()
    spatial.warm()
    for nodes, submaps, loops in ((2000, 20, 8000), (5000, 60, 20000)):
        for dimension in (2, 3):
            run(nodes, submaps, loops, dimension, repeat)


if __name__ == "__main__":
    main()
