# SPDX-License-Identifier: MIT
"""How long one update of RTAB-Map's graph takes: by GTSAM anew, by GTSAM's increments, and by slamcli's own adjustment.

A robot drives two laps; after `--nodes` nodes with `--closures` closures, one more closure comes in. All conversions are
included, in CPU time (all run on one thread). Each is run from the poses as they were before that closure (as online), and from odometry alone.

    python benchmarks/graph_updates.py --nodes 1000 --closures 300
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "posegraph"))
from lap_graphs import lap_graph, rms

from slamcli.geometry import se3
from slamcli.posegraph.gtsam_poses import IncrementalPoses, optimise_poses
from slamcli.posegraph.losses import Loss
from slamcli.posegraph.planar import PlanarEdges, optimise_planar
from slamcli.posegraph.pose_problem import GtsamSettings
from slamcli.posegraph.spatial import SpatialEdges, optimise_spatial
from slamcli.rtabmap.graph import GraphOptimiser, graph_settings
from slamcli.rtabmap.links import Link, LinkKind
from slamcli.rtabmap.parameters import GtsamGroup, OptimizerGroup

REPEATS = 5


def best_ms(work, repeats: int = REPEATS) -> tuple[float, object]:
    times, result = [], None
    for _ in range(repeats):
        start = time.process_time()
        result = work()
        times.append(time.process_time() - start)
    return 1e3 * min(times), result


def ours(problem, planar: bool):
    edges, one = problem.edges, np.ones(len(problem.edges.first))
    fixed = np.arange(len(problem.keys)) == problem.root
    sigmas = {"translation_weight": 50 * one, "rotation_weight": 250 * one, "robust": one > 1}
    if planar:
        flat = PlanarEdges(
            first=edges.first, second=edges.second, measured=se3.to_se2(edges.T_first_second), **sigmas
        )  # fmt: skip
        start = se3.to_se2(problem.T_map_pose)
        return lambda: optimise_planar(start, fixed, flat, loss=Loss(), max_iterations=20)
    measured = np.concatenate(se3.to_position_quaternion(edges.T_first_second), axis=1)
    spatial = SpatialEdges(first=edges.first, second=edges.second, measured=measured, **sigmas)
    start = np.concatenate(se3.to_position_quaternion(problem.T_map_pose), axis=1)
    return lambda: optimise_spatial(start, fixed, spatial, loss=Loss(), max_iterations=20)


def without_last(problem):
    edges = problem.edges
    columns = {name: getattr(edges, name)[:-1] for name in type(edges).__slots__}
    return replace(problem, edges=replace(edges, **columns))


def as_links(problem) -> list[Link]:
    edges, keys = problem.edges, problem.keys.tolist()
    return [
        Link(
            from_id=keys[i], to_id=keys[j], T_from_to=T, information=information,
            kind=LinkKind.NEIGHBOR if j == i + 1 else LinkKind.GLOBAL_CLOSURE,
        )
        for i, j, T, information in zip(
            edges.first.tolist(), edges.second.tolist(), edges.T_first_second, edges.information, strict=True
        )
    ]  # fmt: skip


def measure(nodes: int, closures: int, planar: bool) -> None:
    problem, truth = lap_graph(nodes, closures, planar=planar)
    problem = replace(problem, edges=replace(problem.edges, robust=np.zeros(len(problem.edges.first), np.bool_)))
    settings = GtsamSettings(planar=planar)
    before = optimise_poses(without_last(problem), settings)
    warm = replace(problem, T_map_pose=before.T_map_pose)
    print(f"{'plane' if planar else 'space'}, {nodes} nodes, {closures} closures; error of odometry "
          f"{rms(problem.T_map_pose, truth):.3f} m, of the graph {rms(before.T_map_pose, truth):.3f} m")  # fmt: skip
    told = graph_settings(OptimizerGroup(), GtsamGroup(), planar=planar)
    links, ids = as_links(problem), problem.keys.tolist()
    held = GraphOptimiser(told)
    for name, graph in (("with one more closure", warm), ("from odometry", problem)):
        whole, _ = best_ms(lambda graph=graph: held.optimise(ids, graph.T_map_pose, links, root=1))
        gtsam, _ = best_ms(lambda graph=graph: optimise_poses(graph, settings))
        own, _ = best_ms(ours(graph, planar))
        print(f"  {name}: rtabmap's update {whole:.0f} ms, of it GTSAM {gtsam:.0f} ms; slamcli's own {own:.0f} ms")
    times = []
    for _ in range(REPEATS):
        incremental = IncrementalPoses(settings)
        incremental.optimise(without_last(problem))
        start = time.process_time()
        incremental.optimise(warm)
        times.append(time.process_time() - start)
    print(f"  with one more closure, by increments (iSAM2): {1e3 * min(times):.0f} ms")
    if planar:
        return
    robust = replace(warm, edges=replace(warm.edges, robust=np.arange(len(links)) >= nodes - 1))
    graduated, _ = best_ms(lambda: optimise_poses(robust, settings), 2)
    print(f"  with one more closure, Optimizer/Robust: {graduated:.0f} ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--closures", type=int, default=300)
    given = parser.parse_args()
    for planar in (False, True):
        measure(given.nodes, given.closures, planar)


if __name__ == "__main__":
    main()
