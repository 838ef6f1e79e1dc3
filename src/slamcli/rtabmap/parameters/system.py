# SPDX-License-Identifier: MIT
"""``Marker``, ``ImuFilter``, ``DbSqlite3``, the parameters of the ROS nodes, and slamcli's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from slamcli.errors import ConfigError
from slamcli.parameters import parameter
from slamcli.rtabmap.parameters.declaring import choice, count, number, share, switch, text


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerGroup:
    """``Marker``: of ``RGBD/MarkerDetection``."""

    strategy: int = choice(
        "Strategy", 0, "library that finds markers", {0: "OpenCV"}, {1: "the AprilTag library"}, effective=False
    )
    dictionary: int = count(
        "Dictionary", 0, "family of markers: 0-3 ArUco 4x4 (50, 100, 250, 1000), 4-7 5x5, 8-11 6x6, 12-15 7x7, 16 original, 17-20 AprilTag 16h5, 25h9, 36h10, 36h11",
        "", 0, 20,
    )  # fmt: skip
    length: float = number(
        "Length", 0.0, "edge of a marker; 0: found by its depth image, once (-1: for each marker anew)", "m", -1.0, 1e3
    )
    lengths: str = text("Lengths", "", "edges by marker in metres, as in 1:0.1 2:0.2; others have Marker/Length")
    max_depth_error: float = number(
        "MaxDepthError",
        0.01,
        "depths of a marker's corners may differ by this from its plane's, where depth gives its edge",
        "m",
        0.0,
        1e3,
    )
    variance_linear: float = number("VarianceLinear", 0.001, "variance of a marker's place", "m^2", 1e-12, 1e9)
    variance_angular: float = number("VarianceAngular", 0.01, "variance of a marker's direction", "rad^2", 1e-12, 1e9)
    variance_orientation_ignored: bool = switch(
        "VarianceOrientationIgnored", False, "a marker counts by its place alone"
    )
    max_range: float = number("MaxRange", 0.0, "markers farther away are dropped; 0: none", "m")
    min_range: float = number("MinRange", 0.0, "markers nearer are dropped; 0: none", "m")
    priors: str = text("Priors", "", "poses of markers in the map: number x y z roll pitch yaw, separated by |")
    priors_variance_linear: float = number("PriorsVarianceLinear", 0.001, "variance of their places", "m^2", 1e-12, 1e9)
    priors_variance_angular: float = number(
        "PriorsVarianceAngular", 0.001, "variance of their directions", "rad^2", 1e-12, 1e9
    )

    def __post_init__(self) -> None:
        """Refuse texts that are no edges or poses."""
        self.length_of_each  # noqa: B018
        self.prior_of_each  # noqa: B018

    @property
    def length_of_each(self) -> dict[int, float]:
        """`lengths` by marker, metres.

        Raises
        ------
        ConfigError
            If they are not pairs of a number and a length.
        """
        found = {}
        for word in self.lengths.replace("|", " ").split():
            marker, colon, edge = word.partition(":")
            try:
                found[int(marker)] = float(edge)
            except ValueError as error:
                raise ConfigError(
                    f"Marker/Lengths={self.lengths!r}: write NUMBER:METRES, separated by blanks"
                ) from error
            if not colon or not found[int(marker)] > 0.0:
                raise ConfigError(f"Marker/Lengths={self.lengths!r}: edges are above 0 m")
        return found

    @property
    def prior_of_each(self) -> dict[int, tuple[float, ...]]:
        """`priors` by marker: x, y, z (m), roll, pitch, yaw (rad) in the map.

        Raises
        ------
        ConfigError
            If they are not seven numbers each.
        """
        found = {}
        for one in filter(None, (part.strip() for part in self.priors.split("|"))):
            words = one.split()
            try:
                found[int(words[0])] = tuple(float(word) for word in words[1:])
            except ValueError as error:
                raise ConfigError(
                    f"Marker/Priors={self.priors!r}: write NUMBER X Y Z ROLL PITCH YAW, separated by |"
                ) from error
            if len(words) != 7:
                raise ConfigError(f"Marker/Priors={self.priors!r}: write NUMBER X Y Z ROLL PITCH YAW, separated by |")
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuFilterGroup:
    """``ImuFilter``: which way is down, from raw IMU messages."""

    madgwick_gain: float = share("MadgwickGain", 0.1, "how strongly the accelerometer corrects the gyroscope")
    madgwick_zeta: float = number("MadgwickZeta", 0.0, "drift of the gyroscope's bias", "rad/s", 0.0, 1.0)
    complementary_gain_acc: float = share(
        "ComplementaryGainAcc", 0.01, "the same of the complementary filter", effective=False
    )
    complementary_bias_alpha: float = share(
        "ComplementaryBiasAlpha", 0.01, "bias of the complementary filter", effective=False
    )
    complementary_do_bias_estimation: bool = switch(
        "ComplementaryDoBiasEstimation", True, "bias of the complementary filter", effective=False
    )
    complementary_do_adpative_gain: bool = switch(
        "ComplementaryDoAdpativeGain", True, "gain of the complementary filter", effective=False
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DbSqlite3Group:
    """``DbSqlite3``."""

    in_memory: bool = switch(
        "InMemory", False, "the database is kept in memory and written at the end: a killed run leaves nothing"
    )
    cache_size: int = count("CacheSize", 10000, "pages that SQLite caches", "pages")
    journal_mode: int = choice(
        "JournalMode", 3, "how SQLite protects a write; MEMORY and OFF, which do not survive a killed run, are taken as DELETE",
        {0: "DELETE", 1: "TRUNCATE", 2: "PERSIST", 3: "MEMORY", 4: "OFF"},
    )  # fmt: skip
    synchronous: int = choice("Synchronous", 0, "when SQLite waits for the disk", {0: "OFF", 1: "NORMAL", 2: "FULL"})
    temp_store: int = choice(
        "TempStore", 2, "where SQLite keeps temporary tables", {0: "DEFAULT", 1: "FILE", 2: "MEMORY"}
    )


def _of_node(name: str, default: Any, help: str, **more: Any) -> Any:
    return parameter(default, help, name=name, **more)


def _not_here(name: str, default: Any, help: str) -> Any:
    return parameter(default, help, name=name, effective=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeGroup:
    """What the ROS nodes ``rtabmap``, ``rgbd_odometry``, ``stereo_odometry`` and ``icp_odometry`` take by themselves."""

    frame_id: str = _of_node(
        "frame_id", "", "the robot's frame; nothing: found from the recording (the node: base_link)"
    )
    map_frame_id: str = _of_node("map_frame_id", "map", "name of the map's frame")
    odom_frame_id: str = _of_node(
        "odom_frame_id", "", "odometry comes from the transforms of this frame instead of its topic"
    )
    subscribe_depth: bool | None = _of_node(
        "subscribe_depth", None, "take depth images; default: if there are", kind=bool
    )
    subscribe_rgb: bool | None = _of_node(
        "subscribe_rgb", None, "take colour images; default: as subscribe_depth", kind=bool
    )
    subscribe_stereo: bool | None = _of_node(
        "subscribe_stereo", None, "take stereo images; default: if there are", kind=bool
    )
    subscribe_scan: bool | None = _of_node("subscribe_scan", None, "take laser scans; default: if there are", kind=bool)
    subscribe_scan_cloud: bool | None = _of_node(
        "subscribe_scan_cloud", None, "take point clouds; default: if there are", kind=bool
    )
    subscribe_odom: bool | None = _of_node("subscribe_odom", None, "take odometry; default: if there is", kind=bool)
    approx_sync_max_interval: float = number(
        "approx_sync_max_interval",
        0.0,
        "images of two cameras belong together up to this difference of their stamps; 0: found from the recording",
        "s",
    )
    approx_sync: bool = _not_here(
        "approx_sync", True, "whether stamps may differ: they may, by approx_sync_max_interval"
    )
    queue_size: int = _not_here("queue_size", 10, "messages that wait for their partners; here all do")
    sync_queue_size: int = _not_here("sync_queue_size", 10, "messages that wait for their partners; here all do")
    topic_queue_size: int = _not_here("topic_queue_size", 10, "messages that wait to be read; here all do")
    wait_for_transform: bool = _not_here("wait_for_transform", True, "wait for transforms; here all are known")
    wait_for_transform_duration: float = _not_here(
        "wait_for_transform_duration", 0.2, "how long the node waits for a transform; here all are known"
    )
    database_path: str = _not_here("database_path", "", "the database: --database names it")
    publish_tf: bool = _not_here("publish_tf", True, "broadcast where the odometry's frame is in the map")
    tf_delay: float = _not_here("tf_delay", 0.05, "period of that broadcast, seconds")
    tf_tolerance: float = _not_here("tf_tolerance", 0.1, "how far it is dated into the future, seconds")


@dataclass(frozen=True, slots=True, kw_only=True)
class SlamcliGroup:
    """``slamcli``: what slamcli has and RTAB-Map has not."""

    pairing_tolerance: float | None = parameter(
        None, "images of two cameras belong together up to this difference of their stamps; default: node's approx_sync_max_interval, else 0.02 with depth and 0.005 of stereo, half a frame at most",
        kind=float, unit="s", minimum=0.0, maximum=10.0, extension=True,
    )  # fmt: skip
    odometry: str = parameter(
        "auto", "where the motion between frames is from: the recording's odometry alone (as RTAB-Map does where it subscribes to it), own visual odometry, visual odometry that the recording's guides and carries where nothing is seen, or own scan odometry; auto: guided or visual with cameras, scan without",
        choices=("auto", "recording", "visual", "guided", "scan"), extension=True,
    )  # fmt: skip
    depth_weight: float = parameter(
        3.0, "how much better depth images are believed than a stereo camera of g2o/Baseline would tell depth", minimum=0.01, maximum=1000.0,
        extension=True,
    )  # fmt: skip
    final_searches: int = parameter(
        1, "how many times the finished map is searched for places near each other that no closure ties yet (as rtabmap-detectMoreLoopClosures)",
        minimum=0, maximum=100, extension=True,
    )  # fmt: skip
