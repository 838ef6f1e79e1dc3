# SPDX-License-Identifier: MIT
"""A camera with an IMU that rides past points: an exact visual-inertial bundle and a disturbed start."""

from __future__ import annotations

import numpy as np
from imu_worlds import GRAVITY, NOISE, T_CAMERA_IMU, Ride, ride_samples, ride_state
from scipy.spatial.transform import Rotation

from slamcli.posegraph.visual_inertial_problem import VisualInertialProblem
from slamcli.vision.bundle_problem import BundleProblem
from slamcli.vision.pinhole import Pinhole

CAMERA = Pinhole(fx=400.0, fy=410.0, cx=320.0, cy=240.0, width=640, height=480, baseline_m=0.1)


def world(
    times, *, seed=0, points=300, pixel=0.5, stereo=False, scale_error=0.0, disturbed=1.0, noise=NOISE, fixed=1, **more
):
    """Return a problem off its minimum, and its truth: poses (C, 4, 4), points, velocities and biases (S, ...)."""
    rng, ride, times = np.random.default_rng(seed), Ride(), np.asarray(times, float)
    biases = np.concatenate([rng.normal(size=3) * 0.02, rng.normal(size=3) * 0.1])
    samples, off = ride_samples(ride, times[0] - 0.5, times[-1] + 0.5, noise=noise, biases=biases, seed=seed)
    states = [ride_state(ride, t) for t in times]
    T = np.array([T_CAMERA_IMU @ np.linalg.inv(s.T_map_imu) for s in states])
    velocities = np.array([s.velocity_map for s in states])
    true_biases = off[np.searchsorted(samples.stamps_ns, np.round(times * 1e9).astype(np.int64))]
    # points wherever some camera sees them, two to eight metres ahead
    of = rng.integers(0, len(T), points)
    pixels = rng.uniform([20, 20], [620, 460], (points, 2))
    at_camera = CAMERA.back_project(pixels, rng.uniform(2, 8, points))
    back = np.linalg.inv(T[of])
    places = np.einsum("pij,pj->pi", back[:, :3, :3], at_camera) + back[:, :3, 3]
    cameras, which, seen, right = [], [], [], []
    for c in range(len(T)):
        there = places @ T[c, :3, :3].T + T[c, :3, 3]
        ahead = np.flatnonzero(there[:, 2] > 0.5)
        pixels = CAMERA.project(there[ahead])
        inside = (pixels > 0).all(axis=1) & (pixels < [640, 480]).all(axis=1)
        ahead, pixels = ahead[inside], pixels[inside]
        cameras.append(np.full(len(ahead), c))
        which.append(ahead)
        seen.append(pixels + rng.normal(size=pixels.shape) * pixel)
        right.append(pixels[:, 0] - CAMERA.bf / there[ahead, 2] + rng.normal(size=len(ahead)) * pixel)
    camera_index, point_index, seen = np.concatenate(cameras), np.concatenate(which), np.concatenate(seen)
    right = np.concatenate(right) if stereo else np.full(len(camera_index), np.nan)
    held = np.zeros(len(T), bool)
    held[:fixed] = True
    start, begin = T.copy(), disturbed * (~held)[:, None]
    shaken = Rotation.from_rotvec(rng.normal(size=(len(T), 3)) * 0.01 * begin).as_matrix()
    start[:, :3, :3] = shaken @ T[:, :3, :3]
    start[:, :3, 3] = T[:, :3, 3] * (1 + scale_error) + rng.normal(size=(len(T), 3)) * 0.02 * begin
    bundle = BundleProblem(
        T_camera_map=start, fixed=held, points=places * (1 + scale_error) + rng.normal(size=places.shape) * 0.05 * disturbed,
        camera_index=camera_index, point_index=point_index, pixels=seen, right=right,
        sigmas=np.full(len(seen), max(pixel, 0.01)), camera=CAMERA,
    )  # fmt: skip
    n = np.arange(len(T))
    problem = VisualInertialProblem(
        bundle=bundle, cameras=n, stamps_ns=np.round(times * 1e9).astype(np.int64),
        velocities=velocities + rng.normal(size=velocities.shape) * 0.1 * disturbed,
        biases=np.tile(biases, (len(T), 1)) * (1 - disturbed), held=np.zeros(len(T), bool),
        links=np.stack([n[:-1], n[1:]], axis=1), samples=samples, noise=NOISE, T_camera_imu=T_CAMERA_IMU,
        gravity_map=GRAVITY, **more,
    )  # fmt: skip
    return problem, T, places, velocities, true_biases
