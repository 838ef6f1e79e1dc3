# SPDX-License-Identifier: MIT
"""Names of RTAB-Map's parameters in older versions, groups of parts that are not here, and its ROS nodes."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from slamcli.native.launch import LaunchNode
from slamcli.native.settings import Setting

RENAMED = {
    "Grid/FromDepth": "Grid/Sensor",
    "RGBD/SavedLocalizationIgnored": "RGBD/StartAtOrigin",
    "Icp/PMForce4DoF": "Icp/Force4DoF",
    "Icp/PM": "Icp/Strategy",
    "Icp/PMOutlierRatio": "Icp/OutlierRatio",
    "RGBD/MaxLocalizationDistance": "RGBD/MaxLoopClosureDistance",
    "Aruco/Dictionary": "Marker/Dictionary",
    "Aruco/MarkerLength": "Marker/Length",
    "Aruco/MaxDepthError": "Marker/MaxDepthError",
    "Aruco/VarianceLinear": "Marker/VarianceLinear",
    "Aruco/VarianceAngular": "Marker/VarianceAngular",
    "Grid/OctoMapOccupancyThr": "GridGlobal/OccupancyThr",
    "Grid/ProjRayTracing": "Grid/RayTracing",
    "Grid/DepthMin": "Grid/RangeMin",
    "Grid/DepthMax": "Grid/RangeMax",
    "Icp/PointToPlaneNormalNeighbors": "Icp/PointToPlaneK",
    "Rtabmap/VhStrategy": "VhEp/Enabled",
    "Grid/3DGroundIsObstacle": "Grid/GroundIsObstacle",
    "Optimizer/Slam2D": "Reg/Force3DoF",
    "Grid/FlatObstaclesDetected": "Grid/FlatObstacleDetected",
    "Reg/Force2D": "Reg/Force3DoF",
    "OdomF2M/ScanSubstractRadius": "OdomF2M/ScanSubtractRadius",
    "Mem/ImageDecimation": "Mem/ImagePostDecimation",
    "OdomLocalMap/HistorySize": "OdomF2M/MaxSize",
    "OdomF2F/GuessMotion": "Odom/GuessMotion",
    "OdomBow/LocalHistorySize": "OdomF2M/MaxSize",
    "OdomFlow/GuessMotion": "Odom/GuessMotion",
    "Kp/WordsPerImage": "Kp/MaxFeatures",
    "RGBD/PoseScanMatching": "RGBD/NeighborLinkRefining",
    "RGBD/ScanMatchingSize": "RGBD/NeighborLinkRefining",
    "Odom/FeatureType": "Vis/FeatureType",
    "Odom/Type": "Vis/FeatureType",
    "Odom/EstimationType": "Vis/EstimationType",
    "Odom/MaxFeatures": "Vis/MaxFeatures",
    "Odom/MaxWords": "Vis/MaxFeatures",
    "Odom/InlierDistance": "Vis/InlierDistance",
    "Odom/MinInliers": "Vis/MinInliers",
    "Odom/Iterations": "Vis/Iterations",
    "Odom/RefineIterations": "Vis/RefineIterations",
    "Odom/MaxDepth": "Vis/MaxDepth",
    "Odom/RoiRatios": "Vis/RoiRatios",
    "Odom/Force2D": "Reg/Force3DoF",
    "Odom/PnPReprojError": "Vis/PnPReprojError",
    "Odom/PnPFlags": "Vis/PnPFlags",
    "Odom/LocalHistory": "OdomF2M/MaxSize",
    "Odom/NearestNeighbor": "Vis/CorNNType",
    "Odom/NNDR": "Vis/CorNNDR",
    "OdomBow/NNType": "Vis/CorNNType",
    "OdomBow/NNDR": "Vis/CorNNDR",
    "OdomFlow/WinSize": "Vis/CorFlowWinSize",
    "OdomFlow/Iterations": "Vis/CorFlowIterations",
    "OdomFlow/Eps": "Vis/CorFlowEps",
    "OdomFlow/MaxLevel": "Vis/CorFlowMaxLevel",
    "OdomSubPix/WinSize": "Vis/SubPixWinSize",
    "OdomSubPix/Iterations": "Vis/SubPixIterations",
    "OdomSubPix/Eps": "Vis/SubPixEps",
    "LccReextract/Activated": "RGBD/LoopClosureReextractFeatures",
    "LccReextract/LoopClosureFeatures": "RGBD/LoopClosureReextractFeatures",
    "LccBow/EpipolarGeometryVar": "Vis/EpipolarGeometryVar",
    "LccBow/MaxDepth": "Vis/MaxDepth",
    "LccIcp3/PointToPlane": "Icp/PointToPlane",
    "LccIcp3/PointToPlaneNormalNeighbors": "Icp/PointToPlaneK",
    "LccIcp2/MaxCorrespondenceDistance": "Icp/MaxCorrespondenceDistance",
    "LccIcp2/Iterations": "Icp/Iterations",
    "LccIcp2/CorrespondenceRatio": "Icp/CorrespondenceRatio",
    "LccIcp2/VoxelSize": "Icp/VoxelSize",
    "RGBD/LocalLoopDetectionByTime": "RGBD/ProximityByTime",
    "RGBD/LocalLoopDetectionTime": "RGBD/ProximityByTime",
    "RGBD/LocalLoopDetectionBySpace": "RGBD/ProximityBySpace",
    "RGBD/LocalLoopDetectionSpace": "RGBD/ProximityBySpace",
    "RGBD/LocalLoopDetectionRadius": "RGBD/LocalRadius",
    "RGBD/LocalLoopDetectionMaxGraphDepth": "RGBD/ProximityMaxGraphDepth",
    "RGBD/LocalLoopDetectionMaxDiffID": "RGBD/ProximityMaxGraphDepth",
    "RGBD/LocalLoopDetectionPathFilteringRadius": "RGBD/ProximityPathFilteringRadius",
    "RGBD/LocalLoopDetectionPathRawPosesUsed": "RGBD/ProximityPathRawPosesUsed",
    "RGBD/OptimizeStrategy": "Optimizer/Strategy",
    "RGBD/OptimizeEpsilon": "Optimizer/Epsilon",
    "RGBD/OptimizeIterations": "Optimizer/Iterations",
    "RGBD/ToroIterations": "Optimizer/Iterations",
    "RGBD/OptimizeRobust": "Optimizer/Robust",
    "RGBD/OptimizeSlam2D": "Reg/Force3DoF",
    "RGBD/OptimizeSlam2d": "Reg/Force3DoF",
    "RGBD/OptimizeVarianceIgnored": "Optimizer/VarianceIgnored",
    "Stereo/WinSize": "Stereo/WinWidth",
    "GFTT/MaxCorners": "Vis/MaxFeatures",
    "Rtabmap/DetectorStrategy": "Kp/DetectorStrategy",
    "Mem/RehearsedNodesKept": "Mem/NotLinkedNodesKept",
}
"""Name of today by the name of an older version, where the value means the same."""
REMOVED = {
    "Vis/CorCrossCheck": "Vis/CorNNType",
    "Grid/Scan2dMaxFilledRange": "Grid/RangeMax",
    "Grid/FullUpdate": "",
    "GridGlobal/FullUpdate": "",
    "Reg/VarianceFromInliersCount": "",
    "Reg/VarianceNormalized": "",
    "OdomF2M/FixedMapPath": "",
    "RGBD/ProximityPathScansMerged": "",
    "RGBD/LocalLoopDetectionPathScansMerged": "",
    "RGBD/PlanVirtualLinksMaxDiffID": "",
    "Mem/LocalSpaceLinksKeptInWM": "",
    "Odom/ParticleFiltering": "Odom/FilteringStrategy",
    "Odom/VarianceFromInliersCount": "",
    "OdomF2F/KeyFrameThr": "Odom/KeyFrameThr",
    "OdomFlow/KeyFrameThr": "Odom/KeyFrameThr",
    "LccReextract/FeatureType": "Vis/FeatureType",
    "LccReextract/MaxWords": "Vis/MaxFeatures",
    "LccReextract/MaxDepth": "Vis/MaxDepth",
    "LccReextract/RoiRatios": "Vis/RoiRatios",
    "LccReextract/NNType": "Vis/CorNNType",
    "LccReextract/NNDR": "Vis/CorNNDR",
    "LccBow/EstimationType": "Vis/EstimationType",
    "LccBow/InlierDistance": "Vis/InlierDistance",
    "LccBow/MinInliers": "Vis/MinInliers",
    "LccBow/Iterations": "Vis/Iterations",
    "LccBow/RefineIterations": "Vis/RefineIterations",
    "LccBow/Force2D": "Reg/Force3DoF",
    "LccBow/VarianceFromInliersCount": "",
    "LccBow/PnPReprojError": "Vis/PnPReprojError",
    "LccBow/PnPFlags": "Vis/PnPFlags",
    "LccIcp/Type": "Reg/Strategy",
    "LccIcp3/Decimation": "",
    "LccIcp3/MaxDepth": "",
    "LccIcp3/VoxelSize": "Icp/VoxelSize",
    "LccIcp3/Samples": "Icp/DownsamplingStep",
    "LccIcp3/MaxCorrespondenceDistance": "Icp/MaxCorrespondenceDistance",
    "LccIcp3/Iterations": "Icp/Iterations",
    "LccIcp3/CorrespondenceRatio": "Icp/CorrespondenceRatio",
}
"""Names of older versions that RTAB-Map reads no more: what comes near, or nothing."""
_SWITCHES = {"Grid/FromDepth", "Icp/PM"}
"""Those of them whose values were true and false, and are numbers now."""
NOT_HERE = {
    "KAZE", "BRISK", "FREAK", "AKAZE", "SuperPointRpautrat", "OdomLIOSAM", "MarkerAprilTag", "MarkerOpenCV", "Db", "SuperPoint", "SPTorch", "PyDetector", "PyDescriptor", "PyMatcher", "SuperGlue", "GMS",
    "StereoBM", "StereoSGBM", "Ceres", "OdomMono", "OdomFovis", "OdomViso2", "OdomORBSLAM", "OdomORBSLAM2", "OdomOKVIS",
    "OdomLOAM", "OdomMSCKF", "OdomVINS", "OdomVINSFusion", "OdomOpenVINS", "OdomOpen3D", "OdomCuVSLAM", "OdomDVO", "OdomFLOAM",
    "CuVSLAM", "LccIcp2", "LccIcp3", "LccBow", "LccReextract", "Aruco",
}  # fmt: skip
"""Groups of parameters of parts that are not here, and those of which nothing is left."""
NODES = ("rtabmap",)
ODOMETRY_NODES = ("rgbd_odometry", "stereo_odometry", "icp_odometry", "rgbdicp_odometry")
PACKAGES = ("rtabmap_ros", "rtabmap_slam", "rtabmap_odom")


def type_of(node: LaunchNode) -> str:
    """Return the type of a node of RTAB-Map in a launch file, also of one that is loaded as a nodelet; "" of others."""
    kind, package = node.type, node.package
    if kind == "nodelet":
        words = node.args.split()
        loaded = words[1] if len(words) > 1 and words[0] in ("load", "standalone") else ""
        package, _, kind = loaded.partition("/")
    return kind if package in PACKAGES and kind in (*NODES, *ODOMETRY_NODES) else ""


@dataclass(frozen=True, slots=True)
class Today:
    """A setting as today's RTAB-Map has it."""

    setting: Setting | None
    """Under its name of today; None if nothing reads it."""
    remark: str = ""
    """What was changed."""
    absent: str = ""
    """The group of a part that is not here."""


def of_today(setting: Setting) -> Today:
    """Return a setting under its name of today, as RTAB-Map itself takes those of older versions."""
    name = setting.name
    group = name.partition("/")[0]
    if name in RENAMED:
        value = _as_number(setting.value) if name in _SWITCHES else setting.value
        new = RENAMED[name]
        return Today(dataclasses.replace(setting, name=new, value=value), f"{name} is called {new} today")
    if name in REMOVED:
        near = f"; {REMOVED[name]} comes near" if REMOVED[name] else ""
        return Today(None, f"{name} is of an older version and not read any more{near}")
    if group in NOT_HERE:
        return Today(None, f"{name} belongs to a part that is not here", group)
    return Today(setting)


def _as_number(value: object) -> object:
    return {"true": 1, "false": 0}.get(str(value).lower(), value)
