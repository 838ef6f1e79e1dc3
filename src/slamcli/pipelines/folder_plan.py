# SPDX-License-Identifier: MIT
"""Which topics of a recording go into a data-set folder, and what is known of their sensors."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import RecordingError
from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import CameraModel, FrameTransform, Image, ImuSample, Odometry, StampedPose
from slamcli.recordings.camera_topics import depth_rank, find_model, first_image, stereo_partner
from slamcli.recordings.folders import TRUTH_TOPIC
from slamcli.recordings.folders.writing import ExportedCamera, ExportedImu, Target
from slamcli.recordings.imu_noise import recorded_noise
from slamcli.recordings.recording import Recording

_BODY_FRAMES = ("body", "imu0")
_TRANSPORTS = ("compressed", "compressedDepth", "theora")
_TRUE = ("truth", "_gt", "/gt", "mocap", "vicon", "optitrack")


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderPlan:
    """What is written, by topic."""

    cameras: dict[str, ExportedCamera]
    depth: dict[str, ExportedCamera]
    imu: dict[str, ExportedImu]
    truth: str | None
    """Topic of the true poses."""


def plan_folder(recording: Recording, layout: str, target: Target, chosen: Collection[str]) -> FolderPlan:
    """Return what of a recording's chosen topics goes into a folder; what has no place there is told.

    Raises
    ------
    RecordingError
        If there are no images of a camera.
    """
    firsts = _first_images(recording, chosen)
    colour = [name for name, image in firsts.items() if image.encoding != "depth"]
    if not colour:
        raise RecordingError(f"{recording.name}: no images of a camera: nothing to write to a {target.title}")
    names = _ordered(colour, layout, firsts)[: target.max_cameras]
    depth = sorted(
        (name for name in firsts if name not in colour), key=lambda n: depth_rank(firsts[n], firsts[names[0]])
    )
    depth = depth[: 1 if target.takes_depth else 0]
    imus = [topic.name for topic in recording.topics(ImuSample) if topic.name in chosen and topic.count != 0]
    imus = imus[: 1 if target.takes_imu else 0]
    frames = recording.frames()
    truth = _truth_topic(recording, chosen)
    body = _body_frame(recording, truth, frames, firsts[names[0]].frame_id)
    folders = _folders(names, layout, firsts)
    cameras = {
        name: ExportedCamera(
            folder=folder,
            is_colour=firsts[name].encoding != "mono8",
            model=_model(recording, name),
            T_body_camera=_place(frames, body, firsts[name].frame_id),
        )
        for name, folder in zip(names, folders, strict=True)
    }
    _place_by_baseline(list(cameras.values()), [firsts[name].frame_id for name in names], frames)
    plan = FolderPlan(
        cameras=cameras,
        depth={name: ExportedCamera(folder="depth", is_colour=False, model=None) for name in depth},
        imu={name: _imu(recording, name, frames, body) for name in imus},
        truth=truth,
    )
    _tell_left_out(recording, plan, chosen, target)
    return plan


def _first_images(recording: Recording, chosen: Collection[str]) -> dict[str, Image]:
    """Return the first image of each topic that holds any, the topics with the most images first.

    A topic that is another one's compressed twin (image_transport) is left aside.
    """
    topics = sorted(recording.topics(Image), key=lambda topic: -(topic.count or 0))
    names = {topic.name for topic in topics if topic.name in chosen and topic.count != 0}
    firsts = {}
    for topic in topics:
        base, _, last = topic.name.rpartition("/")
        is_twin = last in _TRANSPORTS and base in names
        first = first_image(recording, topic) if topic.name in names and not is_twin else None
        if first is not None:
            firsts[topic.name] = first
    return firsts


def _ordered(colour: list[str], layout: str, firsts: dict[str, Image]) -> list[str]:
    """Return the cameras with left ones before their right ones; KITTI takes a pair of grey and a pair of colour."""
    pairs: list[list[str]] = []
    rest = list(colour)
    for left in colour:
        right = stereo_partner(left, rest) if left in rest else None
        if right is not None:
            pairs.append([left, right])
            rest = [name for name in rest if name not in (left, right)]
    if layout != "kitti":
        return [*(name for pair in pairs for name in pair), *rest]
    grey = next((pair for pair in pairs if firsts[pair[0]].encoding == "mono8"), [])
    both = next((pair for pair in pairs if firsts[pair[0]].encoding != "mono8"), [])
    return [*grey, *both] or colour[:1]


def _folders(names: list[str], layout: str, firsts: dict[str, Image]) -> list[str]:
    if layout == "tum":
        return ["rgb"]
    if layout == "euroc":
        return [f"mav0/cam{number}/data" for number in range(len(names))]
    free = {False: ["image_0", "image_1"], True: ["image_2", "image_3"]}
    return [free[firsts[name].encoding != "mono8"].pop(0) for name in names]


def _model(recording: Recording, image_topic: str) -> CameraModel | None:
    model = find_model(recording, image_topic)
    if model is None or not model.intrinsics[0, 0] > 0:
        recording.log.warn(f"{image_topic}: no calibration (sensor_msgs/CameraInfo): the folder has none of it")
        return None
    return model


def _imu(recording: Recording, topic: str, frames: FrameTree, body: str) -> ExportedImu:
    first = next(iter(recording.measurements([topic])))
    if not frames.connected(body, first.frame_id):
        recording.log.warn(
            f"{topic}: no transform from {body} to {first.frame_id}: the IMU is written as if it sat there"
        )
    return ExportedImu(T_body_imu=_place(frames, body, first.frame_id), noise=recorded_noise(recording.raw, topic))


def _truth_topic(recording: Recording, chosen: Collection[str]) -> str | None:
    topics = [topic.name for kind in (StampedPose, Odometry, FrameTransform) for topic in recording.topics(kind)]
    named = [name for name in topics if name in chosen and any(word in name.lower() for word in _TRUE)]
    return TRUTH_TOPIC if TRUTH_TOPIC in named else next(iter(named), None)


def _body_frame(recording: Recording, truth: str | None, frames: FrameTree, camera: str) -> str:
    """Return the frame that the true poses are of: as they say, else the body of EuRoC, else the first camera."""
    first = None if truth is None else next(iter(recording.measurements([truth])), None)
    child = getattr(first, "child_frame_id", "")
    candidates = (child, *_BODY_FRAMES) if child else _BODY_FRAMES
    return next((frame for frame in candidates if frame in frames.frames and frames.connected(frame, camera)), camera)


def _place(frames: FrameTree, body: str, frame: str) -> NDArray[np.float64]:
    """Return the fixed transform to a sensor, float64 (4, 4); the identity where it is unknown."""
    return frames.lookup(body, frame) if body != frame and frames.connected(body, frame) else np.eye(4)


def _place_by_baseline(cameras: list[ExportedCamera], frame_ids: list[str], frames: FrameTree) -> None:
    """Place right cameras that no transform places by their projection matrix."""
    for left, right, a, b in zip(cameras, cameras[1:], frame_ids, frame_ids[1:], strict=False):
        if right.model is None or (a != b and frames.connected(a, b)):
            continue
        baseline_m = -float(right.model.projection[0, 3] / right.model.projection[0, 0])
        if baseline_m > 0:
            shift = np.eye(4)
            shift[0, 3] = baseline_m
            right.T_body_camera = left.T_body_camera @ shift


def _tell_left_out(recording: Recording, plan: FolderPlan, chosen: Collection[str], target: Target) -> None:
    written = {*plan.cameras, *plan.depth, *plan.imu, plan.truth}
    expressed = (CameraModel, FrameTransform)
    implied = {topic.name for kind in expressed for topic in recording.topics(kind)}
    implied |= {name for name in chosen if name.endswith("/noise")}
    left = [name for name in chosen if name not in written and name not in implied]
    if left:
        recording.log.warn(f"left out, a {target.title} has no place for them: {', '.join(sorted(left)[:8])}")
