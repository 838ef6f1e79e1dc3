# SPDX-License-Identifier: MIT
"""``slamcli warmup``: compile all kernels beforehand."""

from __future__ import annotations

import importlib
import time

import click

from slamcli.cli import kernel_cache
from slamcli.cli.console import Console, print_json
from slamcli.cli.options import json_option, verbosity_options

# Modules under slamcli with a `warm()` that calls each of their kernels on tiny input.
ROOMS = (
    "cartographer.projection_3d",
    "cartographer.sweep_3d",
    "evaluation.neighbourhoods",
    "evaluation.redrawn_map",
    "grids.depth_projection",
    "grids.distance",
    "grids.first_seen",
    "grids.ground",
    "grids.hybrid_blocks",
    "grids.probability_grid",
    "grids.rays",
    "grids.submap_drawing",
    "grids.surfel_map",
    "grids.tsdf_grid",
    "grids.voxel_odds",
    "grids.voxel_rays",
    "localization.laser_model",
    "localization.motion_model",
    "localization.particles",
    "localization.refinement",
    "navigation.dwa_scoring",
    "navigation.curves",
    "navigation.frontiers",
    "navigation.grid_search",
    "navigation.hybrid_astar",
    "navigation.inflation_layer",
    "navigation.motion_check",
    "navigation.navfn",
    "navigation.obstacle_layer",
    "navigation.path_shape",
    "navigation.potential_search",
    "navigation.scan_observation",
    "navigation.voxel_layer",
    "navigation.shortest_path",
    "navigation.teb.band",
    "navigation.teb.homotopy",
    "navigation.teb.obstacle_field",
    "navigation.teb.optimise",
    "navigation.theta_star",
    "orbslam3.essential_graph",
    "orbslam3.sparse_map",
    "posegraph.drift",
    "posegraph.imu_integration",
    "posegraph.imu_preintegration",
    "posegraph.inertial_links",
    "posegraph.planar_covariances",
    "posegraph.spatial",
    "posegraph.visual_inertial",
    "registration.agreement",
    "registration.branch_and_bound",
    "registration.branch_and_bound_3d",
    "registration.grid_matching",
    "registration.rotational_histogram",
    "registration.surfel_matching",
    "registration.tile_matching",
    "registration.volume_matching",
    "registration.voxel_filter",
    "rtabmap.bayes_filter",
    "rtabmap.dictionary",
    "rtabmap.likelihood",
    "simulation.drive",
    "simulation.plant",
    "simulation.raycast",
    "simulation.render",
    "simulation.site",
    "simulation.social_force",
    "simulation.space",
    "simulation.texture",
    "trajectory.attitude",
    "vision.binary_index",
    "vision.bundle_adjustment",
    "vision.camera_system",
    "vision.depth_coding",
    "vision.keyframe_database",
    "vision.lens",
    "vision.matching",
    "vision.orb",
    "vision.pnp",
    "vision.point_projection",
    "vision.pose_optimisation",
    "vision.row_matching",
    "vision.similarity_optimisation",
    "vision.similarity_ransac",
    "vision.stereo_matching",
    "vision.triangulation",
    "vision.two_view",
    "vision.vocabulary",
    "vision.vocabulary_training",
)


@click.command()
@json_option
@verbosity_options
def command(as_json: bool, verbosity: int) -> int:
    """Compile all kernels beforehand, for images and CI.

    Compiled code is kept beside slamcli's modules, or, where that folder cannot be written to, in the user's cache
    folder ($NUMBA_CACHE_DIR if it is set, otherwise $XDG_CACHE_HOME/slamcli or ~/.cache/slamcli). With a full cache this
    takes a second or two.
    """
    seconds: dict[str, float] = {}
    with Console(verbosity) as console:
        for name in ROOMS:
            start = time.perf_counter()
            importlib.import_module(f"slamcli.{name}").warm()
            seconds[name] = time.perf_counter() - start
            console.say(f"{name}: {seconds[name]:.2f} s")
        total = sum(seconds.values())
        console.say(f"all kernels are compiled ({total:.1f} s); the cache is {kernel_cache.directory()}")
    if as_json:
        print_json({"seconds": seconds, "total_s": total, "cache": str(kernel_cache.directory())}, "warmup")
    return 0
