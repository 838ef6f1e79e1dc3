# SPDX-License-Identifier: MIT
"""A small result that has everything the player shows: map, scans, particles, graph with a loop, images, statistics."""

from __future__ import annotations

import json

import numpy as np
import small_result as small

from slamcli.formats.particles import write_particles
from slamcli.formats.trajectories import write_tum
from slamcli.measurements import Image
from slamcli.recordings import create_recording
from slamcli.trajectory import Trajectory
from slamcli.trajectory.particle_track import particle_track

EDGES = ((0, 5, "odometry", ""), (5, 15, "odometry", ""), (0, 15, "loop", "0.07"))
"""Poses that are nodes, kind, and residual in metres."""


def write(folder):
    """Write the recording and its result; return the latter's folder."""
    stamps, poses = small.stamps_ns(), small.poses_se2()
    with create_recording(folder / "room.mcap") as recording:
        for i, stamp in enumerate(stamps.tolist()):
            recording.write("/scan", small.scan_at(i))
            pixels = np.full((24, 32, 3), (10 * i, 90, 200), dtype=np.uint8)
            recording.write("/camera/image", Image(stamp_ns=stamp, frame_id="camera", pixels=pixels, encoding="rgb8"))
    steps = {
        "stamp_ns": stamps.tolist(),
        "neff": np.linspace(8, 3, small.STEPS).tolist(),
        "resampled": [int(i == 12) for i in range(small.STEPS)],
        "points": list(range(100, 100 + small.STEPS)),
    }
    result = small.write_result(folder / "result", folder / "room.mcap", steps=steps)
    spread = np.random.default_rng(0).normal(0, 0.1, (small.STEPS, 8, 3))
    weights = [np.full(8, 1 / 8)] * small.STEPS
    write_particles(result / "particles.npz", particle_track(stamps.tolist(), list(poses[:, None] + spread), weights))
    nodes = [0, 5, 15]
    write_tum(result / "keyframes.tum", Trajectory.from_se2(stamps[nodes], poses[nodes], "map", "base_link"))
    lines = ["stamp_a_s,stamp_b_s,kind,translation_residual_m"]
    lines += [f"{stamps[a] / 1e9:.9f},{stamps[b] / 1e9:.9f},{kind},{residual}" for a, b, kind, residual in EDGES]
    (result / "links.csv").write_text("\n".join(lines) + "\n")
    write_tum(folder / "truth.tum", Trajectory.from_se2(stamps, poses + np.array([0.0, 0.02, 0.0])))
    return result


def facts_of(page):
    """Return the facts that are embedded in a page."""
    return json.loads(page.partition('id="data-replay">')[2].partition("</script>")[0])
