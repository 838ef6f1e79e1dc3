# SPDX-License-Identifier: MIT
"""Graphs of a drive around a circle whose local SLAM drifted, and a search for loops that knows the truth."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from slamcli.cartographer.graph_2d import Loop, PoseGraph2d, TrajectoryPart
from slamcli.cartographer.loop_search_2d import Found
from slamcli.cartographer.parameters import PoseGraph
from slamcli.geometry import se2
from slamcli.posegraph import Id

PER_SUBMAP = 10


def circle(count=120, turns=1.2, radius=8.0):
    """True poses (N, 3) around a circle, from the origin towards x."""
    angle = 2 * math.pi * turns * np.arange(count) / (count - 1)
    return np.column_stack([radius * np.sin(angle), radius * (1 - np.cos(angle)), se2.wrap_angle(angle)])


def drifted(path, turn=0.004):
    """The same motions, each turned by a little too much."""
    poses = [path[0]]
    for step in se2.between(path[:-1], path[1:]) + np.array([0.0, 0.0, turn]):
        poses.append(se2.compose(poses[-1], step))
    return np.array(poses)


def members_of(count):
    """Rows of the two submaps that hold each node, as local SLAM makes them."""
    return [tuple(s for s in (k // PER_SUBMAP - 1, k // PER_SUBMAP) if s >= 0) for k in range(count)]


def part_of(local, trajectory=0, frozen=False):
    """A trajectory with submaps of 20 nodes that overlap by half."""
    submaps = local[::PER_SUBMAP] * np.array([1.0, 1.0, 0.0])
    grids = [
        SimpleNamespace(cells=np.zeros((400, 400)), resolution_m=0.05, origin=(x - 10.0, y - 10.0))
        for x, y, _ in submaps
    ]
    return TrajectoryPart(
        trajectory=trajectory, frozen=frozen, submap_ids=[Id(trajectory, k) for k in range(len(submaps))],
        submap_local=submaps, submap_map=submaps.copy(), grids=grids, finished=[True] * len(submaps),
        node_ids=[Id(trajectory, k) for k in range(len(local))], node_local=local, node_map=local.copy(),
        points=[np.zeros((0, 2))] * len(local), members=members_of(len(local)), slack_m=np.zeros(len(local)),
    )  # fmt: skip


def graph_of(local, parameters=None):
    return PoseGraph2d(parameters or PoseGraph(), [part_of(local)])


class TrueSearch:
    """Stands for the search: finds every node that truly is within 4 m of the submap, where truth says."""

    def __init__(self, path, local, wrong=(), within_m=4.0):
        first = np.arange(0, len(path), PER_SUBMAP)
        # Submaps do not turn in the local frame; in truth they are turned by what local SLAM is off there.
        off = se2.compose(path[first], se2.inverse(local[first]))
        self.submaps = se2.compose(off, local[first] * np.array([1.0, 1.0, 0.0]))
        self.path, self.wrong, self.within_m, self.calls = path, dict(wrong), within_m, []

    def __call__(self, graph, trials, executor, round_, ambiguity=True):
        self.calls.append({submap: [trial.node for trial in part] for submap, part in sorted(trials.items())})
        found = []
        for submap, part in sorted(trials.items()):
            for trial in part:
                relative = se2.between(self.submaps[submap], self.path[trial.node])
                if (submap, trial.node) in self.wrong:
                    relative = relative + self.wrong[submap, trial.node]
                elif np.hypot(*relative[:2]) > self.within_m:
                    continue
                found.append(Found(Loop(submap, trial.node, relative, np.zeros((2, 2)), 0.8, round_), ""))
        return found


def errors(graph, path):
    """How far nodes (N,) are from the truth, metres; the first pose lies where it truly is."""
    return np.hypot(*(graph.node[:, :2] - path[:, :2]).T)
