# SPDX-License-Identifier: MIT
"""Which SLAM systems can run on a recording, and with which topics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import CameraModel, GeoFix, Image, ImuSample, Landmarks, LaserScan, Odometry, PointCloud
from slamcli.recordings.camera_topics import colour_name_rank, depth_name_rank, info_topic, stereo_partner
from slamcli.recordings.sensor_picks import lies_flat
from slamcli.recordings.survey import TopicSurvey
from slamcli.recordings.topic_ranks import (
    CLOUDS,
    FIXES,
    IMUS,
    LANDMARKS,
    SCANS,
    Role,
    ranked,
    usable_odometry,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TierFit:
    """Whether one system can run, and how."""

    tier: str
    runs: bool
    mode: str
    """What it would run as, or why it cannot."""
    topics: Mapping[str, str]
    """Topic by role."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorTopics:
    """Topics of a recording by what they measure, the one that is taken first."""

    scans: tuple[str, ...]
    clouds: tuple[str, ...]
    flat_clouds: bool
    """Whether the first cloud is that of a planar scanner."""
    imus: tuple[str, ...]
    fixes: tuple[str, ...]
    landmarks: tuple[str, ...]
    odometry: str | None
    """An Odometry topic, ``tf``, or None."""
    colour: tuple[str, ...]
    depth: tuple[str, ...]
    stereo: tuple[str, str] | None
    calibrated: Mapping[str, str]
    """CameraInfo topic by image topic."""


def sensor_topics(surveys: Mapping[str, TopicSurvey], frames: FrameTree) -> SensorTopics:
    """Return the topics by what they measure."""

    def of(kind: type) -> list[str]:
        found = [s for s in surveys.values() if s.adapter is not None and s.adapter.produces is kind and _has_any(s)]
        return [s.topic.name for s in sorted(found, key=lambda s: -(s.topic.count or s.num))]

    def best(kind: type, role: Role) -> tuple[str, ...]:
        return tuple(topic.name for topic in ranked((surveys[name].topic for name in of(kind)), role))

    images = of(Image)
    depth = sorted((name for name in images if is_depth(surveys[name])), key=depth_name_rank)
    colour = sorted((name for name in images if name not in depth), key=colour_name_rank)
    infos = of(CameraModel)
    odometry = usable_odometry(surveys[name].topic for name in of(Odometry))
    clouds = best(PointCloud, CLOUDS)
    first = surveys[clouds[0]].first if clouds else None
    moving = any(not edge.static and "odom" in edge.parent for edge in frames.edges)
    return SensorTopics(
        scans=best(LaserScan, SCANS),
        clouds=clouds,
        flat_clouds=isinstance(first, PointCloud) and lies_flat(first),
        imus=best(ImuSample, IMUS),
        fixes=best(GeoFix, FIXES),
        landmarks=best(Landmarks, LANDMARKS),
        odometry=odometry[0].name if odometry else "tf" if moving else None,
        colour=tuple(colour),
        depth=tuple(depth),
        stereo=_stereo_pair(colour),
        calibrated={image: info for image in images if (info := info_topic(image, infos)) is not None},
    )


def is_depth(found: TopicSurvey) -> bool:
    """Return whether an image topic holds depth: by its first image, else by its name."""
    if isinstance(found.first, Image):
        return found.first.encoding == "depth"
    return "depth" in found.topic.name.lower()


def _has_any(found: TopicSurvey) -> bool:
    return (found.topic.count or found.num) > 0


def _stereo_pair(images: list[str]) -> tuple[str, str] | None:
    pairs = ((left, stereo_partner(left, images)) for left in images)
    return next(((left, right) for left, right in pairs if right is not None), None)


def fit_tiers(surveys: Mapping[str, TopicSurvey], frames: FrameTree) -> tuple[TierFit, ...]:
    """Return for each of the four systems whether it can run on these topics."""
    sensors = sensor_topics(surveys, frames)
    return tuple(fit(sensors) for fit in _FITS)


def _gmapping(sensors: SensorTopics) -> TierFit:
    if not sensors.scans:
        return _cannot("gmapping", "needs sensor_msgs/LaserScan")
    topics = {"scan": sensors.scans[0]}
    if sensors.odometry is None:
        return TierFit(tier="gmapping", runs=True, mode="scans alone (no odometry: expect less)", topics=topics)
    return TierFit(tier="gmapping", runs=True, mode="scans and odometry", topics={**topics, "odom": sensors.odometry})


def _cartographer(sensors: SensorTopics) -> TierFit:
    if not sensors.scans and not sensors.clouds:
        return _cannot("cartographer", "needs sensor_msgs/LaserScan or PointCloud2")
    spatial = not sensors.scans and not sensors.flat_clouds
    role, found = ("scan", sensors.scans) if sensors.scans else ("points", sensors.clouds)
    topics = {role: found[0]}
    for name, others in (("imu", sensors.imus), ("fixes", sensors.fixes), ("landmarks", sensors.landmarks)):
        if others:
            topics[name] = others[0]
    mode = "3D" if spatial else "2D"
    if spatial and not sensors.imus:
        mode += " (without an IMU: expect less)"
    elif sensors.odometry is None and not sensors.imus:
        mode += f", {'scans' if sensors.scans else 'point clouds'} alone"
    if len(found) > 1:
        mode += f", one of {len(found)} sensors unless --{role}-topic names more"
    return TierFit(tier="cartographer", runs=True, mode=mode, topics=_with_odometry(topics, sensors))


def _rtabmap(sensors: SensorTopics) -> TierFit:
    images: dict[str, str] = {}
    if sensors.colour and sensors.depth:
        images, cameras, modes = {"rgb": sensors.colour[0], "depth": sensors.depth[0]}, "RGB-D", ["rgbd"]
    elif sensors.stereo is not None:
        images, cameras, modes = {"left": sensors.stereo[0], "right": sensors.stereo[1]}, "stereo", ["stereo"]
    elif sensors.colour:
        images, cameras, modes = {"rgb": sensors.colour[0]}, "one camera", []
    else:
        cameras, modes = "", []
    if images and sensors.stereo is not None and modes == ["rgbd"]:
        modes.append("stereo")
    ranges = {"scan": sensors.scans[0]} if sensors.scans else {"points": sensors.clouds[0]} if sensors.clouds else {}
    if not modes and not ranges:
        return _cannot("rtabmap", "needs colour and depth images, a stereo pair, or scans or point clouds")
    kinds = [cameras] if cameras else []
    if ranges:
        kinds.append("planar scans" if sensors.scans or sensors.flat_clouds else "3D sweeps")
        modes.append("scan")
    kinds.append("odometry" if sensors.odometry is not None else "its own odometry")
    mode = ", ".join(kinds[:-1]) + f" and {kinds[-1]}"
    mode += f" (--mode {' or '.join(modes)})" if len(modes) > 1 else ""
    topics = {**images, **ranges, **({"imu": sensors.imus[0]} if sensors.imus else {})}
    if not images:
        return TierFit(tier="rtabmap", runs=True, mode=mode, topics=_with_odometry(topics, sensors))
    fit = _calibrated("rtabmap", mode, topics, sensors)
    return TierFit(tier="rtabmap", runs=True, mode=fit.mode, topics=_with_odometry(dict(fit.topics), sensors))


def _orbslam3(sensors: SensorTopics) -> TierFit:
    if sensors.stereo is not None:
        topics, mode = {"left": sensors.stereo[0], "right": sensors.stereo[1]}, "stereo"
    elif sensors.colour and sensors.depth:
        topics, mode = {"rgb": sensors.colour[0], "depth": sensors.depth[0]}, "RGB-D"
    elif sensors.colour:
        topics, mode = {"rgb": sensors.colour[0]}, "monocular"
    else:
        return _cannot("orbslam3", "needs camera images")
    if sensors.imus:
        topics["imu"] = sensors.imus[0]
        mode += " with IMU"
    return _calibrated("orbslam3", mode, topics, sensors)


_FITS: tuple[Callable[[SensorTopics], TierFit], ...] = (_gmapping, _cartographer, _rtabmap, _orbslam3)


def _cannot(tier: str, why: str) -> TierFit:
    return TierFit(tier=tier, runs=False, mode=why, topics={})


def _with_odometry(topics: dict[str, str], sensors: SensorTopics) -> dict[str, str]:
    return topics if sensors.odometry is None else {**topics, "odom": sensors.odometry}


def _calibrated(tier: str, mode: str, topics: dict[str, str], sensors: SensorTopics) -> TierFit:
    """Return the fit with the CameraInfo topic, or with the option that stands in for it."""
    first = next(iter(topics.values()))
    info = sensors.calibrated.get(first)
    if info is None:
        return TierFit(tier=tier, runs=True, mode=f"{mode}, calibration to be given with --camera-info", topics=topics)
    return TierFit(tier=tier, runs=True, mode=mode, topics={**topics, "camera_info": info})
