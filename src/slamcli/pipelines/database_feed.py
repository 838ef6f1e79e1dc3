# SPDX-License-Identifier: MIT
"""Measurements out of databases: every node gives odometry, its scan and its images once more."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slamcli.geometry import quaternion, se3
from slamcli.mapper import InputPlan
from slamcli.measurements import (
    CameraModel,
    CameraRig,
    Image,
    ImuSample,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    Measurement,
    Odometry,
    PointCloud,
    RgbdFrame,
    SessionStart,
    StereoPair,
)
from slamcli.pipelines.database_nodes import StoredNode, StoredSession
from slamcli.pipelines.reading_ahead import read_ahead
from slamcli.pipelines.scan_cloud import scan_of
from slamcli.rtabmap.signature import NodeImages, NodeScan
from slamcli.runtime import RunLog

_TOPICS = {"rgbd": ("/rgb", "/depth"), "stereo": ("/left", "/right"), "mono": ("/rgb", "")}
_SCAN, _ODOMETRY, _LANDMARKS, _IMU = "/scan", "/odom", "/landmarks", "/imu"
_GRAVITY_M_S2 = 9.81
_DEFAULT_RATE_HZ = 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DatabaseFeed:
    """Where measurements come from; `measurements` may be read once."""

    sessions: tuple[StoredSession, ...]
    plan: InputPlan
    base_frame: str
    log: RunLog

    @property
    def cameras(self) -> None:
        """No recorded cameras: images are those that the nodes keep."""
        return

    @property
    def rig(self) -> CameraRig | None:
        """The camera whose images the nodes keep: without distortion, rectified."""
        images = next((session.images for session in self.sessions if session.images is not None), None)
        mode = self.plan.camera_mode
        if images is None or mode is None:
            return None
        left, right = _TOPICS[mode]
        steps = np.diff([node.stamp_ns for node in self.sessions[0].nodes])
        steps = steps[steps > 0]
        return CameraRig(
            mode=mode,  # type: ignore[arg-type]
            main=_model(images, left, 0.0),
            right=_model(images, right, images.camera.baseline_m) if mode == "stereo" else None,
            T_base_main=images.T_base_camera,
            rate_hz=1e9 / float(np.median(steps)) if len(steps) else _DEFAULT_RATE_HZ,
            # A base that is the camera itself was held in a hand: nobody knows which way is up.
            base_is_upright=not np.allclose(images.T_base_camera[:3, :3], np.eye(3), atol=1e-3),
        )

    @property
    def T_base_laser(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802 - frames stand in names
        """Mount of the range sensor by topic, float64 (4, 4)."""
        scan = self._scan
        return {} if scan is None else {_SCAN: scan.T_base_sensor}

    @property
    def T_base_sensor(self) -> Mapping[str, NDArray[np.float64]]:  # noqa: N802
        """Landmarks are seen from the base, and so is what is up."""
        taken = {_LANDMARKS: self.plan.landmarks, _IMU: self.plan.imu}
        return {topic: np.eye(4) for topic, used in taken.items() if used}

    @property
    def topics(self) -> Mapping[str, Any]:
        """What was taken, by role, for ``run.json``."""
        found: dict[str, Any] = {"databases": list(dict.fromkeys(session.path.name for session in self.sessions))}
        if self.plan.camera_mode is not None:
            roles = {"stereo": ("left", "right"), "rgbd": ("rgb", "depth"), "mono": ("rgb", "")}[self.plan.camera_mode]
            found |= {role: f"/{role}" for role in roles if role}
        if self._scan is not None:
            found["scan"] = _SCAN
        return {**found, "odometry": _ODOMETRY if self.plan.odometry else "none"}

    @property
    def frames(self) -> Mapping[str, Any]:
        """The frames, by role, for ``run.json``."""
        return {"base": self.base_frame}

    @property
    def length_s(self) -> float:
        """Seconds that the sessions last together."""
        return sum((s.nodes[-1].stamp_ns - s.nodes[0].stamp_ns) / 1e9 for s in self.sessions if s.nodes)

    def measurements(self) -> Iterator[Measurement]:
        """Yield, for each node, its odometry, which way is up, landmarks, scan and images, all under its stamp; sessions one after the other.

        The odometry's covariance is that of the motion since the node before, as the link between them holds it. Planar
        scans are scans again (see `slamcli.pipelines.scan_cloud.scan_of`), others clouds in their sensor's frame. They are read ahead on a thread.
        """
        yield from read_ahead(self._read, self.log)

    @property
    def _scan(self) -> NodeScan | None:
        if not self.plan.num_point_clouds and not self.plan.num_laser_scans:
            return None
        return next((session.scan for session in self.sessions if session.scan is not None), None)

    def _read(self, log: RunLog) -> Iterator[Measurement]:
        num_other = 0
        for number, session in enumerate(self.sessions):
            if number and session.nodes:
                yield SessionStart(
                    stamp_ns=session.nodes[0].stamp_ns, source=f"{session.path.name}, map {session.map_id}"
                )
            for node in session.nodes:
                yield from self._before(node, session)
                if self._scan is not None:
                    scan = session.database.read_scan(node.id)
                    if scan is not None:
                        yield _sweep(scan, self._scan.T_base_sensor, node.stamp_ns)
                if self.plan.camera_mode is not None:
                    images = session.database.read_images(node.id)
                    frame = None if images is None else _frame(images, self.plan.camera_mode, node.stamp_ns)
                    if images is not None and (frame is None or images.colour.shape[:2] != self._size):
                        num_other += 1
                    elif frame is not None:
                        yield frame
        if num_other:
            log.warn(f"{num_other} nodes whose images are of another kind or size than the first are left out")

    @property
    def _size(self) -> tuple[int, ...]:
        images = next(session.images for session in self.sessions if session.images is not None)
        return images.colour.shape[:2]

    def _before(self, node: StoredNode, session: StoredSession) -> Iterator[Measurement]:
        if self.plan.odometry and node.T_odom_base is not None:
            position, quat = se3.to_position_quaternion(node.T_odom_base)
            yield Odometry(
                stamp_ns=node.stamp_ns, frame_id="odom", child_frame_id=self.base_frame, position_m=position,
                quat_xyzw=quat, covariance=node.covariance, topic=_ODOMETRY,
            )  # fmt: skip
        if self.plan.imu and node.id in session.gravity:
            R_level_base = session.gravity[node.id]
            yield ImuSample(
                stamp_ns=node.stamp_ns, frame_id=self.base_frame, angular_rad_s=np.zeros(3),
                acceleration_m_s2=R_level_base.T @ [0.0, 0.0, _GRAVITY_M_S2], quat_xyzw=quaternion.from_matrix(R_level_base),
                topic=_IMU,
            )  # fmt: skip
        if self.plan.landmarks and node.id in session.landmarks:
            seen = []
            for link in session.landmarks[node.id]:
                position, quat = se3.to_position_quaternion(link.T_from_to)
                seen.append(LandmarkObservation(id=str(-link.to_id), position_m=position, quat_xyzw=quat))
            yield Landmarks(
                stamp_ns=node.stamp_ns, frame_id=self.base_frame, observations=tuple(seen), topic=_LANDMARKS
            )


def _model(images: NodeImages, topic: str, baseline_m: float) -> CameraModel:
    camera = images.camera
    projection = np.hstack([camera.matrix, np.zeros((3, 1))])
    projection[0, 3] = -camera.fx * baseline_m
    return CameraModel(
        stamp_ns=0, frame_id="camera", width=camera.width, height=camera.height, distortion_model="plumb_bob",
        distortion=np.zeros(5), intrinsics=camera.matrix, rectification=np.eye(3), projection=projection, topic=topic,
    )  # fmt: skip


def _frame(images: NodeImages, mode: str, stamp_ns: int) -> Image | RgbdFrame | StereoPair | None:
    names = _TOPICS[mode]

    def image(pixels: NDArray[Any], encoding: str, topic: str) -> Image:
        return Image(stamp_ns=stamp_ns, frame_id="camera", encoding=encoding, pixels=pixels, topic=topic)

    main = image(images.colour, "mono8" if images.colour.ndim == 2 else "rgb8", names[0])
    if mode == "rgbd":
        return None if images.depth is None else RgbdFrame(colour=main, depth=image(images.depth, "depth", names[1]))
    if mode == "stereo":
        return None if images.right is None else StereoPair(left=main, right=image(images.right, "mono8", names[1]))
    return main


def _sweep(scan: NodeScan, T_base_sensor: NDArray[np.float64], stamp_ns: int) -> LaserScan | PointCloud:
    """Return a node's scan in the frame of the sensor that is mounted at `T_base_sensor`: all measured at one moment."""
    T_sensor_base = se3.inverse(T_base_sensor)
    points = scan.points.astype(np.float64) @ T_sensor_base[:3, :3].T + T_sensor_base[:3, 3]
    if scan.planar:
        return scan_of(points[:, :2], stamp_ns=stamp_ns, frame_id="scan", topic=_SCAN, range_max_m=scan.range_max_m)
    return PointCloud(stamp_ns=stamp_ns, frame_id="scan", points_m=points.astype(np.float32), topic=_SCAN)
