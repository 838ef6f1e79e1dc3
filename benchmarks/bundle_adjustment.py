# SPDX-License-Identifier: MIT
"""Local and full bundle adjustment by slamcli, and full bundle adjustment by GTSAM on the same problem, in one run.

python benchmarks/bundle_adjustment.py [--cameras 200] [--points 20000] [--seen 10] [--threads 2] [--repeat 3]

Cameras on a ring look out at points on the walls of a round hall; each point is seen by some of those that can see it, 70 %
with a right column, one pixel of noise times the octave's scale. The start is dead reckoning with drift, points where
their first camera sees them. Both optimisers have the same Huber losses and stop at a relative decrease of the cost of 1e-6;
GTSAM's Levenberg-Marquardt runs with its defaults (multifrontal Cholesky, COLAMD). Exits with 1 where the two minima
differ by more than 1e-4 of the cost.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np

from slamcli.geometry import quaternion, se3
from slamcli.vision import bundle_adjustment
from slamcli.vision.bundle_adjustment import adjust_bundle, adjust_in_rounds
from slamcli.vision.bundle_problem import MONO_BOUND, STEREO_BOUND, BundleProblem
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=525.0, fy=525.0, cx=319.5, cy=239.5, width=640, height=480, baseline_m=0.08)
TOLERANCE = 1e-6


def ring(cameras: int, share: float) -> np.ndarray:
    """T_camera_map (C, 4, 4) of cameras on `share` of a ring of 4 m that look outwards."""
    angle = 2 * np.pi * share * np.arange(cameras) / cameras
    place = np.stack([4 * np.cos(angle), 4 * np.sin(angle), 0.3 * np.sin(5 * angle)], axis=1)
    ahead = np.stack([np.cos(angle), np.sin(angle), np.zeros(cameras)], axis=1)
    down = np.tile([0.0, 0.0, -1.0], (cameras, 1))
    turn = np.stack([np.cross(down, ahead), down, ahead], axis=2)
    return se3.inverse(se3.from_rotation_translation(turn, place))


def noisy_steps(T: np.ndarray, rng: np.random.Generator, angle: float, distance: float) -> np.ndarray:
    """The same cameras by dead reckoning, each step off by `angle` (rad) and `distance` (m)."""
    out = T.copy()
    for i in range(1, len(T)):
        off = se3.from_position_quaternion(
            rng.normal(size=3) * distance, quaternion.from_roll_pitch_yaw(*rng.normal(size=3) * angle)
        )
        out[i] = off @ (T[i] @ se3.inverse(T[i - 1])) @ out[i - 1]
    return out


def hall(cameras: int, points: int, seen: int, fixed: int, share: float, rng: np.random.Generator) -> BundleProblem:
    """The problem of the module's description."""
    T = ring(cameras, share)
    rows: list[tuple[int, int]] = []
    xyz = []
    while len(xyz) < points:
        angle, radius = rng.uniform(0, 2 * np.pi * share), rng.uniform(8, 12)
        point = np.array([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-2.5, 2.5)])
        local = T[:, :3, :3] @ point + T[:, :3, 3]
        pixel = CAMERA.project(local)
        sees = (local[:, 2] > 1) & (pixel >= 0).all(axis=1) & (pixel < (640, 480)).all(axis=1)
        can = np.flatnonzero(sees)
        if len(can) < 2:
            continue
        chosen = np.sort(rng.choice(can, min(seen, len(can)), replace=False))
        rows.extend((int(k), len(xyz)) for k in chosen)
        xyz.append(point)
    k, j = np.array(rows, np.int64).T
    places = np.array(xyz)
    sigmas = 1.2 ** rng.integers(0, 4, len(k)).astype(float)
    local = np.einsum("nij,nj->ni", T[k, :3, :3], places[j]) + T[k, :3, 3]
    pixels = CAMERA.project(local) + sigmas[:, None] * rng.normal(size=(len(k), 2))
    right = pixels[:, 0] - CAMERA.bf / local[:, 2] + sigmas * rng.normal(size=len(k))
    right[rng.random(len(k)) < 0.3] = np.nan
    start = noisy_steps(T, rng, 0.001, 0.005)
    start[:fixed] = T[:fixed]
    first = np.searchsorted(j, np.arange(points))
    depth = local[first, 2] * (1 + 0.02 * rng.normal(size=points))
    back = se3.inverse(start[k[first]])
    guess = np.einsum("nij,nj->ni", back[:, :3, :3], CAMERA.back_project(pixels[first], depth)) + back[:, :3, 3]
    return BundleProblem(
        T_camera_map=start, fixed=np.arange(cameras) < fixed, points=guess, camera_index=k, point_index=j,
        pixels=pixels, right=right, sigmas=sigmas, camera=CAMERA,
    )  # fmt: skip


def run_gtsam(problem: BundleProblem) -> tuple[float, float, float, int]:
    """Seconds and CPU seconds of the optimisation alone, half the losses at its end, iterations."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    mono = gtsam.Cal3_S2(CAMERA.fx, CAMERA.fy, 0.0, CAMERA.cx, CAMERA.cy)
    stereo = gtsam.Cal3_S2Stereo(CAMERA.fx, CAMERA.fy, 0.0, CAMERA.cx, CAMERA.cy, CAMERA.baseline_m)
    huber = gtsam.noiseModel.mEstimator.Huber.Create
    hubers = {False: huber(float(np.sqrt(STEREO_BOUND))), True: huber(float(np.sqrt(MONO_BOUND)))}
    for i, T in enumerate(problem.T_camera_map):
        pose = gtsam.Pose3(se3.inverse(T))
        values.insert(gtsam.symbol("x", i), pose)
        if problem.fixed[i]:
            graph.add(gtsam.NonlinearEqualityPose3(gtsam.symbol("x", i), pose))
    for i, point in enumerate(problem.points):
        values.insert(gtsam.symbol("l", i), point)
    for k, j, pixel, column, sigma in zip(
        problem.camera_index.tolist(), problem.point_index.tolist(), problem.pixels, problem.right.tolist(),
        problem.sigmas.tolist(), strict=True,
    ):  # fmt: skip
        x, point = gtsam.symbol("x", k), gtsam.symbol("l", j)
        one = bool(np.isnan(column))
        noise = gtsam.noiseModel.Robust.Create(hubers[one], gtsam.noiseModel.Isotropic.Sigma(2 if one else 3, sigma))
        if one:
            graph.add(gtsam.GenericProjectionFactorCal3_S2(pixel, noise, x, point, mono))
        else:
            seen = gtsam.StereoPoint2(float(pixel[0]), column, float(pixel[1]))
            graph.add(gtsam.GenericStereoFactor3D(seen, noise, x, point, stereo))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(TOLERANCE)
    settings.setAbsoluteErrorTol(0.0)
    began, cpu = time.perf_counter(), time.process_time()
    optimiser = gtsam.LevenbergMarquardtOptimizer(graph, values, settings)
    result = optimiser.optimize()
    took, worked = time.perf_counter() - began, time.process_time() - cpu
    return took, worked, graph.error(result), optimiser.iterations()


def best(repeat: int, work: Callable[[], Any]) -> tuple[float, float, Any]:
    """Least seconds and least CPU seconds of several runs, and what the last one returned."""
    seconds, worked, result = [], [], None
    for _ in range(repeat):
        began, cpu = time.perf_counter(), time.process_time()
        result = work()
        seconds.append(time.perf_counter() - began)
        worked.append(time.process_time() - cpu)
    return min(seconds), min(worked), result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--cameras", type=int, default=200)
    parser.add_argument("--points", type=int, default=20000)
    parser.add_argument("--seen", type=int, default=10)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeat", type=int, default=3)
    chosen = parser.parse_args()
    bundle_adjustment.warm()
    local = hall(15, 2000, 10, 3, 0.05, np.random.default_rng(2))
    for threads in sorted({1, chosen.threads}):
        for tolerance in (1e-5, 0.0):
            took, cpu, ours = best(20, lambda n=threads, t=tolerance: adjust_in_rounds(local, threads=n, tolerance=t))
            print(
                f"local, 15 cameras, 2000 points, {len(local)} observations, {threads} thread(s), tolerance {tolerance:g}: "
                f"{1e3 * took:.1f} ms ({1e3 * cpu:.1f} ms of CPU), {ours.iterations} iterations"
            )
    full = hall(chosen.cameras, chosen.points, chosen.seen, 1, 1.0, np.random.default_rng(1))
    name = f"full, {chosen.cameras} cameras, {chosen.points} points, {len(full)} observations"
    for threads in sorted({1, chosen.threads}):
        took, cpu, ours = best(
            chosen.repeat, lambda n=threads: adjust_bundle(full, iterations=50, threads=n, tolerance=TOLERANCE)
        )
        print(
            f"{name}: slamcli, {threads} thread(s): {took:.3f} s ({cpu:.3f} s of CPU), {ours.iterations} iterations, cost {ours.cost_before:.1f} "
            f"-> {ours.cost:.3f}"
        )
    seconds, worked, cost, iterations = run_gtsam(full)
    print(f"{name}: GTSAM: {seconds:.3f} s ({worked:.3f} s of CPU), "
          f"{iterations} iterations, cost {cost:.3f}")  # fmt: skip
    print(
        f"GTSAM takes {seconds / took:.1f} times as long, {worked / cpu:.1f} times the CPU; costs differ by {abs(cost / ours.cost - 1):.1e}"
    )
    return 0 if abs(cost / ours.cost - 1) < 1e-4 else 1


if __name__ == "__main__":
    sys.exit(main())
