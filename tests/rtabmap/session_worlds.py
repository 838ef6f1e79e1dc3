# SPDX-License-Identifier: MIT
"""A hall with points on its walls, in which a robot with a camera drives circles: sessions without images."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from visual_worlds import CAMERA, T_BASE_CAMERA, motion, signature

from slamcli.mapper import DatabaseChoice, Setup
from slamcli.rtabmap.node_input import NodeInput
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.sessions import open_session

STEPS = 16
"""Nodes of one round."""
FIRST_NS = 10**18


@dataclass
class SeeingFront:
    """What a session asks of the sensors."""

    camera = CAMERA
    T_base_camera = T_BASE_CAMERA


class Hall:
    """Four walls with points that look different from each other."""

    def __init__(self, seed=0, count=1800, half_m=5.0):
        rng = np.random.default_rng(seed)
        along, height = rng.uniform(-half_m, half_m, count), rng.uniform(-1.0, 2.0, count)
        side = rng.integers(0, 4, count)
        across = np.where(side % 2 == 0, half_m, -half_m)
        x, y = np.where(side < 2, along, across), np.where(side < 2, across, along)
        self.points = np.column_stack([x, y, height])
        self.descriptors = rng.integers(0, 256, (count, 32), dtype=np.uint8)
        self._rng = rng

    def look(self, T_map_base):
        """Features and points of what a robot sees somewhere."""
        seen = signature(
            1, T_map_base, self.points, self.descriptors, rng=self._rng, noise_px=0.3, flips=0.02, unknown=0.1
        )
        return seen.features, seen.points


def on_circle(step, radius_m=2.0):
    """Pose of the base, tangent to the circle."""
    angle = 2.0 * np.pi * step / STEPS
    return motion(x=radius_m * np.sin(angle), y=radius_m * (1.0 - np.cos(angle)) - radius_m, rotvec=(0.0, 0.0, angle))


def parameters(**groups):
    """Defaults with a short-term memory of five nodes and 200 words an image, and others as given by group."""
    groups["kp"] = {"max_features": 200, **groups.get("kp", {})}
    groups["mem"] = {"stm_size": 5, **groups.get("mem", {})}
    default = RtabmapParameters()
    return replace(default, **{name: replace(getattr(default, name), **values) for name, values in groups.items()})


def opened(path, settings, *, append=False, front=None):
    """A session on a database."""
    setup = Setup(T_base_laser={}, database=DatabaseChoice(path=path, append=append, keep=True))
    return open_session(settings, setup, SeeingFront() if front is None else front)


def node_inputs(hall, steps, *, T_odom_map=None, drift_rad=0.0, first_ns=FIRST_NS):
    """What becomes nodes along the circle; odometry turns by `drift_rad` too much at each step."""
    T_odom_map = np.eye(4) if T_odom_map is None else T_odom_map
    T_odom_base = None
    for k, step in enumerate(steps):
        pose = on_circle(step)
        if T_odom_base is None:
            T_odom_base = T_odom_map @ pose
        else:
            before = on_circle(steps[k - 1])
            T_odom_base = T_odom_base @ np.linalg.inv(before) @ pose @ motion(rotvec=(0.0, 0.0, drift_rad))
        features, points = hall.look(pose)
        yield NodeInput(
            stamp_ns=first_ns + k * 10**9, T_odom_base=T_odom_base, covariance=np.diag([4e-4] * 3 + [1e-4] * 3), began_anew=k == 0,
            features=features, points=points, images=None, scan=None, R_level_base=None,
        )  # fmt: skip


def errors(session, steps_of):
    """Largest distance (m) of nodes from the truth, by step, after the first of them is put where it is in truth."""
    ids = sorted(steps_of)
    truth = [on_circle(steps_of[i]) for i in ids]
    T = truth[0] @ np.linalg.inv(session.graph.T_map_base[ids[0]])
    return max(
        float(np.linalg.norm((T @ session.graph.T_map_base[i])[:3, 3] - t[:3, 3]))
        for i, t in zip(ids, truth, strict=True)
    )
