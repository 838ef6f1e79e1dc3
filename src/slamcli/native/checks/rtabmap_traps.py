# SPDX-License-Identifier: MIT
"""Values of RTAB-Map's parameters that do not do what they seem to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from slamcli.errors import ConfigError
from slamcli.native.checks.findings import ERROR, NOTE, WARNING, Finding, at
from slamcli.native.rtabmap_names import of_today
from slamcli.native.rtabmap_nodes import NodeGiven
from slamcli.native.settings import Setting
from slamcli.parameters import Declaration, convert


class Values:
    """What holds: given values over the defaults."""

    def __init__(
        self, given: Mapping[str, Setting], table: Sequence[Declaration], node: NodeGiven | None = None
    ) -> None:
        self.node = node
        """The mapping node, where the values are one's."""
        self.given = {today.name: today for today in (of_today(s).setting for s in given.values()) if today is not None}
        self._known = {entry.name: entry for entry in table}

    def __getitem__(self, name: str) -> Any:
        entry = self._known[name]
        setting = self.given.get(name)
        try:
            return entry.default if setting is None else convert(entry, setting.value)
        except ConfigError:
            return entry.default

    def first(self, *names: str) -> Setting | None:
        """Return the first of these that is given."""
        return next((self.given[name] for name in names if name in self.given), None)

    def scans(self) -> bool | None:
        """Return whether scans are subscribed to; None where no node says."""
        if self.node is None:
            return None
        return bool(self["subscribe_scan"] or self["subscribe_scan_cloud"])

    def depth(self) -> bool | None:
        """Return whether depth or stereo images are subscribed to; None where no node says."""
        if self.node is None:
            return None
        return bool(self["subscribe_depth"] is not False or self["subscribe_stereo"])


def check_traps(values: Values) -> Iterator[Finding]:
    """Yield values that do not do what they seem to; each is told at a place where it is given."""
    for trap in (_inputs, _sensors, _memory, _closures, _registration, _grids):
        yield from trap(values)
    yield from _switched_off(values)


def _inputs(values: Values) -> Iterator[Finding]:
    node = values.node
    if node is None:
        return
    frame = values.first("odom_frame_id")
    if frame is not None and values["odom_frame_id"] and (values["subscribe_odom"] or "odom" in node.remaps):
        yield at(
            frame,
            WARNING,
            "odom_frame_id is set: odometry comes from its transforms, the topic odom is not subscribed to",
        )
    queue = values.first("queue_size")
    if queue is not None:
        yield at(queue, NOTE, "queue_size is sync_queue_size and topic_queue_size in newer versions")
    if values["subscribe_depth"] and values["subscribe_stereo"]:
        yield at(
            values.given["subscribe_stereo"], ERROR, "subscribe_depth and subscribe_stereo: the node takes one of them"
        )
    if values["subscribe_scan"] and values["subscribe_scan_cloud"]:
        yield at(
            values.given["subscribe_scan_cloud"], WARNING, "subscribe_scan is true: subscribe_scan_cloud is ignored"
        )
    depth = str(node.remaps.get("depth/image", ""))
    if depth.rstrip("/").endswith("depth/image_raw") and "registered" not in depth and "aligned" not in depth:
        message = (
            f"depth/image is {depth}: depth must be registered to the colour image (depth_registered of many drivers)"
        )
        yield Finding(NOTE, node.file, node.line, message)
    for topic, switch in (("scan", "subscribe_scan"), ("scan_cloud", "subscribe_scan_cloud")):
        if topic in node.remaps and not values[switch]:
            yield Finding(
                WARNING, node.file, node.line, f"{topic} is remapped and not subscribed to: {switch} is not true"
            )


def _sensors(values: Values) -> Iterator[Finding]:
    strategy = values.first("Reg/Strategy")
    if values.scans() is False:
        if strategy is not None and values["Reg/Strategy"] > 0:
            yield at(
                strategy, WARNING, "Reg/Strategy asks for scans, and none are subscribed to: loop closures are refused"
            )
        if values["Grid/Sensor"] != 1 and "Grid/Sensor" in values.given:
            yield at(values.given["Grid/Sensor"], WARNING, "Grid/Sensor asks for scans, and none are subscribed to")
        if values["RGBD/ProximityPathMaxNeighbors"] > 0:
            where = values.given["RGBD/ProximityPathMaxNeighbors"]
            yield at(
                where, WARNING, "RGBD/ProximityPathMaxNeighbors merges scans, and none are subscribed to: no effect"
            )
    elif (
        values["Reg/Strategy"] == 0
        and "RGBD/ProximityPathMaxNeighbors" in values.given
        and values["RGBD/ProximityPathMaxNeighbors"] > 0
    ):
        where = values.given["RGBD/ProximityPathMaxNeighbors"]
        yield at(
            where,
            WARNING,
            "RGBD/ProximityPathMaxNeighbors merges scans, and Reg/Strategy 0 matches images alone: set 1 or 2",
        )
    if values.depth() is False and "Grid/Sensor" in values.given and values["Grid/Sensor"] > 0:
        yield at(values.given["Grid/Sensor"], WARNING, "Grid/Sensor asks for depth images, and none are subscribed to")
    if values["Kp/MaxFeatures"] < 0 and values["Reg/Strategy"] != 1:
        message = "Kp/MaxFeatures -1: images are not looked at, so that no place is known again by its looks"
        yield at(values.given["Kp/MaxFeatures"], WARNING, message)


def _memory(values: Values) -> Iterator[Finding]:
    similarity = values.first("Mem/RehearsalSimilarity")
    if similarity is not None and values["Mem/RehearsalSimilarity"] < 0.45:
        share = values["Mem/RehearsalSimilarity"]
        yield at(
            similarity, NOTE, f"Mem/RehearsalSimilarity {share:g}: far more nodes are merged than with the default 0.6"
        )
    read_only = values.first("Mem/LocalizationReadOnly")
    if read_only is not None and values["Mem/LocalizationReadOnly"]:
        if values["Mem/IncrementalMemory"]:
            yield at(read_only, WARNING, "Mem/LocalizationReadOnly has no effect: Mem/IncrementalMemory is true")
        bound = next((name for name in ("Rtabmap/MemoryThr", "Rtabmap/TimeThr") if values[name] > 0), None)
        if bound:
            yield at(
                read_only, WARNING, f"{bound} cannot be kept with Mem/LocalizationReadOnly: nothing can be transferred"
            )
    if not values["Mem/IncrementalMemory"]:
        own = values.given["Mem/IncrementalMemory"]
        fresh = values.node is not None and values.node.deletes_database
        if fresh:
            yield at(own, ERROR, "Mem/IncrementalMemory false localises in a map, and --delete_db_on_start deletes it")
    if values["Mem/ReduceGraph"] and values["Mem/RehearsalIdUpdatedToNewOne"]:
        yield at(
            values.given["Mem/ReduceGraph"],
            WARNING,
            "Mem/ReduceGraph and Mem/RehearsalIdUpdatedToNewOne: switch one off",
        )
    if not values["Kp/IncrementalDictionary"] and not values["Kp/DictionaryPath"]:
        yield at(
            values.given["Kp/IncrementalDictionary"],
            ERROR,
            "a fixed dictionary needs Kp/DictionaryPath: it has no words",
        )


def _closures(values: Values) -> Iterator[Finding]:
    loop = values.first("Rtabmap/LoopThr")
    if loop is not None and (values["Rtabmap/LoopThr"] > 0.5 or values["Rtabmap/LoopThr"] < 0.05):
        few = "few hypotheses reach it" if values["Rtabmap/LoopThr"] > 0.5 else "nearly every hypothesis reaches it"
        yield at(loop, WARNING, f"Rtabmap/LoopThr {values['Rtabmap/LoopThr']:g}: {few} (default 0.11)")
    aggressive = values.first("RGBD/AggressiveLoopThr", "Rtabmap/LoopThr")
    if aggressive is not None and values["RGBD/AggressiveLoopThr"] > values["Rtabmap/LoopThr"]:
        yield at(
            aggressive, WARNING, "RGBD/AggressiveLoopThr is above Rtabmap/LoopThr: sessions join later than loops close"
        )
    robust = values.first("Optimizer/Robust")
    if robust is not None and values["Optimizer/Robust"] and values["RGBD/OptimizeMaxError"] > 0:
        yield at(
            robust, WARNING, "Optimizer/Robust: RGBD/OptimizeMaxError rejects nothing then (RTAB-Map asks to set it 0)"
        )
    turn = values.first("RGBD/AngularUpdate")
    if turn is not None and values["RGBD/AngularUpdate"] >= 1.0:
        yield at(
            turn,
            WARNING,
            f"RGBD/AngularUpdate is in radians: {values['RGBD/AngularUpdate']:g} is {values['RGBD/AngularUpdate'] * 57.29578:.0f}°",
        )
    update = values.first("RGBD/LinearUpdate", "RGBD/AngularUpdate")
    if update is not None and values["RGBD/LinearUpdate"] == 0 and values["RGBD/AngularUpdate"] == 0:
        yield at(update, NOTE, "RGBD/LinearUpdate and RGBD/AngularUpdate 0: nodes are made while the robot stands, too")


def _registration(values: Values) -> Iterator[Finding]:
    inliers = values.first("Vis/MinInliers")
    if inliers is not None and values["Vis/MinInliers"] < 10:
        yield at(
            inliers,
            WARNING,
            f"Vis/MinInliers {values['Vis/MinInliers']}: wrong loop closures pass as well (default 20)",
        )
    radius = values.first("Icp/PointToPlaneRadius", "Icp/PointToPlaneK")
    if radius is not None and values["Icp/PointToPlaneRadius"] > 0 and values["Icp/PointToPlaneK"] > 0:
        message = f"Icp/PointToPlaneRadius and Icp/PointToPlaneK ({values['Icp/PointToPlaneK']}): set one of them 0"
        yield at(radius, WARNING, message)
    reach = values.first("Icp/MaxCorrespondenceDistance", "Icp/VoxelSize")
    if reach is not None and values["Icp/MaxCorrespondenceDistance"] < values["Icp/VoxelSize"]:
        yield at(
            reach,
            WARNING,
            "Icp/MaxCorrespondenceDistance is below Icp/VoxelSize: most points find no partner (usual: 10 times)",
        )
    for group in ("Mem", "Vis"):
        floor = values.first(f"{group}/DepthMaskFloorThr")
        if floor is not None and values[floor.name] > 0 and not values[f"{group}/DepthAsMask"]:
            yield at(floor, WARNING, f"{floor.name} has no effect: {group}/DepthAsMask is false")


def _grids(values: Values) -> Iterator[Finding]:
    normals = values.first("Grid/NormalsSegmentation")
    if normals is not None and not values["Grid/NormalsSegmentation"] and values["Grid/MaxGroundHeight"] == 0:
        yield at(
            normals, WARNING, "Grid/NormalsSegmentation false needs Grid/MaxGroundHeight: without it nothing is ground"
        )
    height = values.first("Grid/MaxObstacleHeight", "Grid/MaxGroundHeight")
    if height is not None and 0 < values["Grid/MaxObstacleHeight"] <= values["Grid/MaxGroundHeight"]:
        yield at(height, ERROR, "Grid/MaxObstacleHeight is not above Grid/MaxGroundHeight: no obstacle is left")
    reach = values.first("Grid/RangeMin", "Grid/RangeMax")
    if reach is not None and 0 < values["Grid/RangeMax"] <= values["Grid/RangeMin"]:
        yield at(reach, ERROR, "Grid/RangeMin is not below Grid/RangeMax: no point is left")
    width = values.first("Grid/FootprintWidth", "Grid/FootprintHeight")
    if width is not None and values[width.name] > 0 and values["Grid/FootprintLength"] == 0:
        yield at(width, WARNING, f"{width.name} has no effect without Grid/FootprintLength")
    clamped = values.first("GridGlobal/ProbClampingMin", "GridGlobal/ProbClampingMax")
    if clamped is not None and values["GridGlobal/ProbClampingMin"] >= values["GridGlobal/ProbClampingMax"]:
        yield at(clamped, ERROR, "GridGlobal/ProbClampingMin is not below GridGlobal/ProbClampingMax")


_Condition = Callable[[Values], bool]
_NEEDED: tuple[tuple[tuple[str, ...], _Condition, str], ...] = (
    (("VhEp/MatchCountMin", "VhEp/Ransac"), lambda v: v["VhEp/Enabled"], "VhEp/Enabled is false"),
    (("Marker/",), lambda v: v["RGBD/MarkerDetection"], "RGBD/MarkerDetection is false"),
    (("Odom/Particle",), lambda v: v["Odom/FilteringStrategy"] == 2, "Odom/FilteringStrategy is not 2"),
    (("Odom/Kalman",), lambda v: v["Odom/FilteringStrategy"] == 1, "Odom/FilteringStrategy is not 1"),
    (("Vis/InlierDistance", "Vis/RefineIterations"), lambda v: v["Vis/EstimationType"] == 0, "Vis/EstimationType is not 0 (3D to 3D)"),
    (("Vis/PnP",), lambda v: v["Vis/EstimationType"] == 1, "Vis/EstimationType is not 1 (PnP)"),
    (("GTSAM/",), lambda v: v["Optimizer/Strategy"] == 2, "Optimizer/Strategy is not 2 (GTSAM)"),
    (("Rtabmap/CreateIntermediateNodes",), lambda v: v["Rtabmap/DetectionRate"] > 0, "Rtabmap/DetectionRate is 0"),
    (("Icp/",), lambda v: v["Reg/Strategy"] > 0 or v["RGBD/NeighborLinkRefining"] or v.scans() is not False, "Reg/Strategy is 0 and no scans are subscribed to"),
)  # fmt: skip


def _switched_off(values: Values) -> Iterator[Finding]:
    """Yield values of what another one switches off."""
    for prefixes, holds, reason in _NEEDED:
        if holds(values):
            continue
        for name, setting in values.given.items():
            if name.startswith(prefixes):
                yield at(setting, WARNING, f"{name} has no effect: {reason}")
