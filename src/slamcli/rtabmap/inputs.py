# SPDX-License-Identifier: MIT
"""Which sensors RTAB-Map takes of those that a recording offers, and which parameters follow from that."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from slamcli.errors import RecordingError, UsageError
from slamcli.mapper import InputPlan, SensorOffer
from slamcli.parameters import as_dict, resolve
from slamcli.rtabmap.parameters import NodeGroup, RtabmapParameters
from slamcli.runtime import RunLog

MODES = ("rgbd", "stereo", "scan")
ROLES = frozenset({"images", "scans", "points", "odometry", "imu", "landmarks"})
_NEEDS = {
    "rgbd": "colour and depth images (--rgb-topic, --depth-topic)",
    "stereo": "images of a left and a right camera (--left-topic, --right-topic)",
    "scan": "laser scans or point clouds (--scan-topic, --points-topic)",
}
_SUBSCRIBED = ("subscribe_depth", "subscribe_rgb", "subscribe_stereo", "subscribe_scan", "subscribe_scan_cloud")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Taken:
    """Sensors that are used."""

    cameras: str | None
    """``rgbd``, ``stereo``, ``mono`` or none."""
    num_scans: int = 0
    num_clouds: int = 0
    flat: bool = False
    """Whether clouds are those of a planar scanner."""
    odometry: bool = False
    imu: bool = False

    @property
    def ranges(self) -> bool:
        return self.num_scans + self.num_clouds > 0

    @property
    def planar(self) -> bool:
        """Whether range sensors are planar: the robot moves in the plane."""
        return self.ranges and (self.num_scans > 0 or self.flat)


def plan_inputs(parameters: RtabmapParameters, given: Collection[str], offer: SensorOffer, log: RunLog) -> InputPlan:
    """Return which sensors are taken: what the user names or subscribes to, else all that RTAB-Map can use.

    Parameters that the user left alone and that these sensors need otherwise are set, as RTAB-Map's ROS node and its
    own examples do; the log says which.

    Raises
    ------
    RecordingError, UsageError
        If there is nothing to map from, or not what the mode that is asked for needs.
    """
    taken = _taken(parameters.node, given, offer, log)
    log.note(f"maps from {_sources(taken)}{'' if offer.mode else ' (choose with --mode)'}")
    settled = _settle(parameters, given, taken, log)
    return InputPlan(
        parameters=settled,
        num_laser_scans=taken.num_scans,
        num_multi_echo_laser_scans=None,
        num_point_clouds=taken.num_clouds,
        spatial=not settled.reg.force_3dof,
        keep_scans=True,
        clouds_as_scans=taken.flat and taken.num_clouds > 0,
        samples_first=not _in_recorded_order(settled, taken),
        odometry=taken.odometry,
        imu=taken.imu,
        landmarks=offer.landmarks and not settled.optimizer.landmarks_ignored,
        base_frame=settled.node.frame_id or None,
        odom_frame=settled.node.odom_frame_id or None,
        map_frame=settled.node.map_frame_id,
        camera_mode=taken.cameras,
    )


def _in_recorded_order(settled: RtabmapParameters, taken: _Taken) -> bool:
    """Return whether planar scans are aligned when the recording has ended.

    Where clocks run backwards again and again only the order in which scans and odometry were recorded tells which
    belong together.
    """
    return taken.cameras is None and settled.slamcli.odometry == "scan" and settled.reg.force_3dof


def _taken(node: NodeGroup, given: Collection[str], offer: SensorOffer, log: RunLog) -> _Taken:
    asked = _asked(node, given, offer)
    cameras: str | None = next((mode for mode in ("rgbd", "stereo") if mode in offer.cameras and asked[mode]), None)
    scans = offer.num_laser_scans + offer.num_multi_echo_laser_scans if asked["scans"] else 0
    clouds = offer.num_point_clouds if asked["points"] else 0
    if scans and clouds and not offer.named & {"scans", "points"}:
        log.note("point clouds are not used, there are scans (choose with --points-topic)")
        clouds = 0
    if cameras is None and scans + clouds and "mono" in offer.cameras and asked["rgbd"]:
        # Without depth nothing ties what is seen to where the robot is but the recording's odometry.
        if "images" in offer.named and offer.odometry:
            cameras = "mono"
        else:
            log.note(
                "images of one camera without depth are not used (--rgb-topic takes them, with the recording's odometry)"
            )
    if cameras is None and not scans + clouds:
        _refuse(offer)
    left_out = [name for name, there in _there(offer, cameras, scans, clouds).items() if there]
    if left_out:
        log.note(f"{' and '.join(left_out)} not used: {_why(offer)}")
    taken = _Taken(
        cameras=cameras,
        num_scans=scans if "scans" in offer.named else min(scans, 1),
        num_clouds=clouds if "points" in offer.named else min(clouds, 1),
        flat=offer.flat_clouds,
        odometry=offer.odometry and ("odometry" in offer.named or node.subscribe_odom is not False),
        imu=offer.imu and ("imu" in offer.named or offer.imu_placed or cameras is None),
    )
    if offer.imu and not taken.imu:
        log.note("the IMU is left out, as its place at the camera is not known (--imu-topic takes it)")
    return taken


def _asked(node: NodeGroup, given: Collection[str], offer: SensorOffer) -> dict[str, bool]:
    """Return which kinds of sensors are asked for.

    Where a configuration subscribes to some of them the others are as in RTAB-Map's node: depth images on, the rest
    off; where it says nothing all are.
    """
    silent = not any(name in given for name in _SUBSCRIBED)
    depth = node.subscribe_depth is not False and node.subscribe_rgb is not False and not node.subscribe_stereo
    by_file = {
        "rgbd": silent or depth,
        "stereo": silent or bool(node.subscribe_stereo),
        "scans": silent or bool(node.subscribe_scan),
        "points": silent or bool(node.subscribe_scan_cloud),
    }
    if offer.mode == "scan":
        ranges = {"scans": silent or by_file["scans"], "points": silent or by_file["points"]}
        by_file = {"rgbd": False, "stereo": False, **(ranges if any(ranges.values()) else dict.fromkeys(ranges, True))}
    elif offer.mode:
        own = {"scans": not silent and by_file["scans"], "points": not silent and by_file["points"]}
        by_file = {"rgbd": offer.mode == "rgbd", "stereo": offer.mode == "stereo", **own}
    elif "images" in offer.named:
        by_file |= {"rgbd": True, "stereo": True}
    return by_file | {role: True for role in ("scans", "points") if role in offer.named}


def _refuse(offer: SensorOffer) -> None:
    """Say what is missing."""
    if offer.mode:
        raise UsageError(f"--mode {offer.mode} needs {_NEEDS[offer.mode]}; the recording has {_what(offer)}")
    if offer.num_laser_scans + offer.num_multi_echo_laser_scans + offer.num_point_clouds or offer.cameras - {"mono"}:
        raise UsageError(
            f"the configuration subscribes to nothing that the recording has ({_what(offer)}): --mode overrules it"
        )
    if "mono" in offer.cameras:
        raise RecordingError(
            "images of one camera alone: rtabmap needs depth images, a stereo pair or a range sensor beside it"
            " (--algo orbslam3 maps with one camera)"
        )
    raise RecordingError("no images with depth, stereo pair, laser scans or point clouds that rtabmap could use")


def _there(offer: SensorOffer, cameras: str | None, scans: int, clouds: int) -> dict[str, bool]:
    """Return what the recording offers and is not taken, by its name."""
    laser = offer.num_laser_scans + offer.num_multi_echo_laser_scans
    return {
        "images are": cameras is None and bool(offer.cameras - {"mono"}),
        "scans are": laser > 0 and not scans,
        "point clouds are": offer.num_point_clouds > 0 and not clouds and not scans,
    }


def _why(offer: SensorOffer) -> str:
    if offer.mode:
        return f"--mode {offer.mode}"
    return "the configuration does not subscribe to them (subscribe_depth, subscribe_stereo, subscribe_scan, subscribe_scan_cloud)"


def _what(offer: SensorOffer) -> str:
    words = {
        "colour with depth": "rgbd" in offer.cameras,
        "a stereo pair": "stereo" in offer.cameras,
        "one camera": offer.cameras == {"mono"},
        "laser scans": offer.num_laser_scans + offer.num_multi_echo_laser_scans > 0,
        "point clouds": offer.num_point_clouds > 0,
    }
    return " and ".join(word for word, there in words.items() if there) or "none of what rtabmap maps from"


def _sources(taken: _Taken) -> str:
    """Return what is used, in words."""
    cameras = {"rgbd": "colour with depth", "stereo": "a stereo pair", "mono": "one camera", None: ""}[taken.cameras]
    ranges = ("planar scans" if taken.planar else "3D sweeps") if taken.ranges else ""
    odometry = "the recording's odometry" if taken.odometry else "its own odometry"
    *first, last = [word for word in (cameras, ranges, odometry) if word]
    return f"{', '.join(first)} and {last}"


def _settle(parameters: RtabmapParameters, given: Collection[str], taken: _Taken, log: RunLog) -> RtabmapParameters:
    """Return the parameters with those set that the sensors ask for and the user left alone."""
    values = as_dict(parameters)
    choices = {name: value for name, value in _needed(taken).items() if name not in given and value != values[name]}
    if values["Grid/Sensor"] == 0 or choices.get("Grid/Sensor") == 0:
        # As the node does: scanners see farther than depth cameras.
        choices = choices if "Grid/RangeMax" in given else {"Grid/RangeMax": 0.0} | choices
    else:
        choices.pop("Grid/RangeMax", None)
    if choices:
        told = ", ".join(f"{name} {_shown(value)}" for name, value in choices.items())
        log.note(f"set for {_sensors(taken)}: {told} (--set overrules)")
    if values["slamcli.odometry"] == "auto":
        by_camera = "guided" if taken.odometry else "visual"
        ways = {"rgbd": by_camera, "stereo": by_camera, "mono": "recording", None: "scan"}
        choices |= {"slamcli.odometry": ways[taken.cameras]}
    settled = resolve(RtabmapParameters, values, choices)
    _warn(settled, taken, log)
    return settled


def _warn(settled: RtabmapParameters, taken: _Taken, log: RunLog) -> None:
    """Say what the user's own values cannot do with these sensors."""
    if not taken.ranges and settled.reg.strategy > 0:
        log.warn(
            f"Reg/Strategy {settled.reg.strategy} needs scans, and none are used: no loop closure will be accepted"
        )
    if taken.cameras is None and settled.reg.strategy != 1:
        log.warn(
            f"Reg/Strategy {settled.reg.strategy} needs images, and none are used: no loop closure will be accepted"
        )
    if settled.rgbd.create_occupancy_grid and settled.grid.sensor != 1 and not taken.ranges:
        log.warn(f"Grid/Sensor {settled.grid.sensor} asks for scans, and none are used")
    if settled.rgbd.create_occupancy_grid and settled.grid.sensor != 0 and taken.cameras in (None, "mono"):
        log.warn(f"Grid/Sensor {settled.grid.sensor} asks for depth images, and none are used")
    if taken.cameras is not None and not settled.mem.bin_data_kept:
        log.warn("Mem/BinDataKept is off: images are not kept, so no map, cloud or dense model is made of them")
    if not taken.ranges and settled.rgbd.proximity_path_max_neighbors > 0:
        log.note("RGBD/ProximityPathMaxNeighbors has no effect: no scans are used")


def _needed(taken: _Taken) -> dict[str, Any]:
    """Return the values that RTAB-Map's node or its examples have for these sensors instead of the defaults."""
    if not taken.ranges:
        return {}
    needed: dict[str, Any] = {
        "Reg/Strategy": 1,
        "RGBD/ProximityPathMaxNeighbors": 10 if taken.planar else 1,
        "RGBD/NeighborLinkRefining": taken.odometry,
        "Grid/Sensor": 0,
    }
    if taken.cameras is None:
        needed["Kp/MaxFeatures"] = -1
        # Scans alone close a loop by proximity or not at all, however long it is.
        needed["RGBD/ProximityMaxGraphDepth"] = 0
    return needed | (_PLANAR if taken.planar else _SWEEPS)


_PLANAR: dict[str, Any] = {"Reg/Force3DoF": True}
# RTAB-Map's example for 3D lidars, which makes no grid; that of the plane, with rings on the ground, needs these.
_SWEEPS: dict[str, Any] = {
    "Icp/VoxelSize": 0.1,
    "Icp/MaxCorrespondenceDistance": 1.0,
    "Icp/MaxTranslation": 3.0,
    "Icp/PointToPlaneK": 20,
    "Icp/CorrespondenceRatio": 0.2,
    "Icp/OutlierRatio": 0.7,
    "Icp/Epsilon": 0.001,
    "Odom/ScanKeyFrameThr": 0.4,
    "OdomF2M/ScanSubtractRadius": 0.1,
    "OdomF2M/ScanMaxSize": 15000,
    "Mem/STMSize": 30,
    "RGBD/ProximityMaxGraphDepth": 0,
    "Grid/3D": False,
    "Grid/RayTracing": True,
    "Grid/RangeMax": 20.0,
    "Grid/MaxObstacleHeight": 2.0,
    "Icp/PointToPlaneGroundNormalsUp": 0.8,
}


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"


def _sensors(taken: _Taken) -> str:
    ranges = "planar scans" if taken.planar else "3D sweeps"
    return ranges if taken.cameras is None else f"{ranges} with images"
