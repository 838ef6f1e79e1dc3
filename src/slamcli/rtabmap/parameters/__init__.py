# SPDX-License-Identifier: MIT
"""Every parameter of RTAB-Map under its own name, those of its ROS nodes, and slamcli's own, declared once.

Where RTAB-Map's defaults depend on what it was built with, those of a build with OpenCV's non-free modules missing, g2o,
GTSAM and libpointmatcher are taken, with few exceptions (docs/rtabmap.md). Names of older versions are read as these; see `slamcli.native.rtabmap_names`.
"""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import group
from slamcli.rtabmap.parameters.closing import BayesGroup, RgbdGroup, VhEpGroup
from slamcli.rtabmap.parameters.features import (
    BriefGroup,
    FastGroup,
    GfttGroup,
    OrbGroup,
    SiftGroup,
    StereoGroup,
    SurfGroup,
)
from slamcli.rtabmap.parameters.graph import G2oGroup, GtsamGroup, OptimizerGroup
from slamcli.rtabmap.parameters.grids import GridGlobalGroup, GridGroup
from slamcli.rtabmap.parameters.memory import MemGroup, RtabmapGroup
from slamcli.rtabmap.parameters.odometry import IcpGroup, OdomF2mGroup, OdomGroup
from slamcli.rtabmap.parameters.system import DbSqlite3Group, ImuFilterGroup, MarkerGroup, NodeGroup, SlamcliGroup
from slamcli.rtabmap.parameters.vision import KpGroup, RegGroup, VisGroup


@dataclass(frozen=True, slots=True, kw_only=True)
class RtabmapParameters:
    """All groups: ``parameters.kp.max_features`` is ``Kp/MaxFeatures``."""

    rtabmap: RtabmapGroup = group(RtabmapGroup(), name="Rtabmap", separator="/")
    mem: MemGroup = group(MemGroup(), name="Mem", separator="/")
    kp: KpGroup = group(KpGroup(), name="Kp", separator="/")
    vis: VisGroup = group(VisGroup(), name="Vis", separator="/")
    rgbd: RgbdGroup = group(RgbdGroup(), name="RGBD", separator="/")
    optimizer: OptimizerGroup = group(OptimizerGroup(), name="Optimizer", separator="/")
    grid: GridGroup = group(GridGroup(), name="Grid", separator="/")
    grid_global: GridGlobalGroup = group(GridGlobalGroup(), name="GridGlobal", separator="/")
    odom: OdomGroup = group(OdomGroup(), name="Odom", separator="/")
    odom_f2m: OdomF2mGroup = group(OdomF2mGroup(), name="OdomF2M", separator="/")
    icp: IcpGroup = group(IcpGroup(), name="Icp", separator="/")
    reg: RegGroup = group(RegGroup(), name="Reg", separator="/")
    bayes: BayesGroup = group(BayesGroup(), name="Bayes", separator="/")
    vhep: VhEpGroup = group(VhEpGroup(), name="VhEp", separator="/")
    g2o: G2oGroup = group(G2oGroup(), name="g2o", separator="/")
    gtsam: GtsamGroup = group(GtsamGroup(), name="GTSAM", separator="/")
    stereo: StereoGroup = group(StereoGroup(), name="Stereo", separator="/")
    gftt: GfttGroup = group(GfttGroup(), name="GFTT", separator="/")
    orb: OrbGroup = group(OrbGroup(), name="ORB", separator="/")
    fast: FastGroup = group(FastGroup(), name="FAST", separator="/")
    brief: BriefGroup = group(BriefGroup(), name="BRIEF", separator="/")
    surf: SurfGroup = group(SurfGroup(), name="SURF", separator="/")
    sift: SiftGroup = group(SiftGroup(), name="SIFT", separator="/")
    marker: MarkerGroup = group(MarkerGroup(), name="Marker", separator="/")
    imu_filter: ImuFilterGroup = group(ImuFilterGroup(), name="ImuFilter", separator="/")
    db_sqlite3: DbSqlite3Group = group(DbSqlite3Group(), name="DbSqlite3", separator="/")
    node: NodeGroup = group(NodeGroup(), name="")
    slamcli: SlamcliGroup = group(SlamcliGroup(), name="slamcli")


__all__ = [
    "BayesGroup",
    "BriefGroup",
    "DbSqlite3Group",
    "FastGroup",
    "G2oGroup",
    "GfttGroup",
    "GridGlobalGroup",
    "GridGroup",
    "GtsamGroup",
    "IcpGroup",
    "ImuFilterGroup",
    "KpGroup",
    "MarkerGroup",
    "MemGroup",
    "NodeGroup",
    "OdomF2mGroup",
    "OdomGroup",
    "OptimizerGroup",
    "OrbGroup",
    "RegGroup",
    "RgbdGroup",
    "RtabmapGroup",
    "RtabmapParameters",
    "SiftGroup",
    "SlamcliGroup",
    "StereoGroup",
    "SurfGroup",
    "VhEpGroup",
    "VisGroup",
]
