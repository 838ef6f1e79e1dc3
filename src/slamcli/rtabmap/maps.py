# SPDX-License-Identifier: MIT
"""All maps of a run: made at the end, from the nodes' sensors and where the nodes are then."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.grids import OccupancyGrid
from slamcli.grids.octree import Octree
from slamcli.grids.voxel_odds import VoxelOdds
from slamcli.measurements import PointCloud
from slamcli.rtabmap.assembly import GridAssembly
from slamcli.rtabmap.grid_settings import above_floor, assembly_settings, local_grid_settings
from slamcli.rtabmap.local_grid import SCAN, LocalGrid, LocalGridSettings, local_grid
from slamcli.rtabmap.node_cloud import NodeCloud
from slamcli.rtabmap.node_points import moved, with_depth
from slamcli.rtabmap.parameters import RtabmapParameters
from slamcli.rtabmap.signature import NodeImages, NodeScan

Sensors = Callable[[int], tuple[NodeImages | None, NodeScan | None]]
Keep = Callable[[int, LocalGrid], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Maps:
    """What the nodes saw, map frame; None for what none of them saw."""

    grid: OccupancyGrid | None
    cloud: PointCloud | None
    octree: Octree | None


def build_maps(
    nodes: Iterable[tuple[int, NDArray[np.float64]]],
    sensors: Sensors,
    parameters: RtabmapParameters,
    *,
    map_frame: str = "map",
    stamp_ns: int = 0,
    octree: bool = False,
    floor_m: float | None = None,
    keep: Keep | None = None,
) -> Maps:
    """Return the maps of nodes; their sensors are read one after the other and forgotten, so memory grows with the place alone.

    Parameters
    ----------
    nodes
        Ids and final poses T_map_base, float64 (4, 4); made into maps in the order of their ids.
    sensors
        What a node saw, by its id.
    stamp_ns
        Of the cloud.
    octree
        Whether to make an octree; otherwise there is one only where ``Grid/3D`` and ``Grid/RayTracing`` are on.
    floor_m
        z of the floor in the map, where the cameras were held by hand and their height above it is not known otherwise;
        see `slamcli.rtabmap.grid_settings.above_floor`.
    keep
        Takes each node's local grid, for the database.

    Notes
    -----
    The map of planar scanners has neither cloud nor octree. With ``RGBD/CreateOccupancyGrid`` off there is a cloud alone.
    """
    ordered = sorted(nodes, key=lambda node: node[0])
    poses = np.array([T for _, T in ordered], dtype=np.float64).reshape(-1, 4, 4)
    chosen = assembly_settings(parameters).chosen(poses)
    settings = local_grid_settings(parameters)
    if floor_m is not None:
        settings = above_floor(settings, floor_m)
    making = _Making(parameters, settings, octree or (settings.spatial and settings.ray_tracing), keep)
    for row in chosen.tolist():
        node_id, T_map_base = ordered[row]
        making.add(node_id, T_map_base, *sensors(node_id))
    return making.maps(map_frame, stamp_ns)


class _Making:
    """The maps while they are made."""

    def __init__(
        self, parameters: RtabmapParameters, settings: LocalGridSettings, octree: bool, keep: Keep | None
    ) -> None:
        self._parameters, self._settings, self._keep = parameters, settings, keep
        assembly = assembly_settings(parameters)
        grids = parameters.rgbd.create_occupancy_grid
        self._assembly = GridAssembly(settings.cell_size_m, assembly) if grids else None
        self._voxels = VoxelOdds(settings.cell_size_m, assembly.odds) if octree else None
        self._cloud = NodeCloud(settings)
        self._semi_global = parameters.stereo.dense_strategy == 1

    def add(
        self, node_id: int, T_map_base: NDArray[np.float64], images: NodeImages | None, scan: NodeScan | None
    ) -> None:
        """Add one node."""
        if self._settings.sensor != SCAN:
            seen = with_depth(images, semi_global=self._semi_global)
            images = images if seen is None else seen
        self._cloud.add(images, scan, T_map_base)
        found = None
        if self._assembly is not None:
            found = local_grid(images, scan, T_map_base, self._settings)
            if found is not None:
                self._assembly.add(found, T_map_base)
                if self._keep is not None:
                    self._keep(node_id, found)
        if self._voxels is not None:
            traced = replace(self._settings, spatial=True, ray_tracing=True)
            if found is None or traced != self._settings:
                found = local_grid(images, scan, T_map_base, traced)
            if found is not None and found.spatial:
                self._voxels.add(*(moved(part, T_map_base) for part in (found.ground, found.obstacles, found.empty)))

    def maps(self, map_frame: str, stamp_ns: int) -> Maps:
        """Return them."""
        octree = None if self._voxels is None else self._voxels.octree()
        depth = self._parameters.grid_global.flood_fill_depth
        if octree is not None and depth > 0 and len(octree):
            octree = octree.reached_from(np.zeros(3), depth)
        return Maps(
            grid=None if self._assembly is None else self._assembly.grid(map_frame),
            cloud=self._cloud.cloud(map_frame, stamp_ns),
            octree=octree if octree is not None and len(octree) else None,
        )
