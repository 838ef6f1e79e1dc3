# SPDX-License-Identifier: MIT
"""The rig of cameras of a recording: models, their places, the base frame and the IMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import CalibrationError
from slamcli.geometry import se3
from slamcli.geometry.frame_tree import FrameTree
from slamcli.measurements import CameraModel, CameraRig, Image, ImuNoise, RigCalibration
from slamcli.recordings import Recording
from slamcli.recordings.camera_topics import find_model

ROBOT_FRAMES = ("base_link", "base_footprint", "base")
BODY_FRAMES = ("body", "imu0", "imu")
# Depth cameras see from about 0.3 m to 10 m: a scene that lies beyond this as a whole is in another unit, or outdoors.
_NEAR_M, _FAR_M = 1.0, 8.0
_CAMERA_OPTION = "give it with --camera FILE (a camera_calibration, ORB-SLAM or Kalibr YAML), or name its topic with --camera-info-topic"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigSources:
    """What a rig is built from."""

    mode: str
    main: Image
    """First image of the left, colour or only camera."""
    partner: Image | None
    """First image of the right camera, or of the depth."""
    imu_frame: str | None
    """Frame of the IMU that is used; None without one."""
    imu_noise: ImuNoise | None
    """As the recording says it."""
    given: RigCalibration | None
    """By files."""
    camera_info: str | None
    base_frame: str | None
    """As the user names it."""
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BuiltRig:
    """A rig and the frame whose poses are asked for."""

    rig: CameraRig
    base_frame: str
    camera_frame: str


def build_rig(recording: Recording, sources: RigSources) -> BuiltRig:
    """Return the rig.

    Raises
    ------
    CalibrationError
        If a camera has no calibration, the two cameras' places are unknown, or sizes do not fit.
    """
    given = sources.given
    main = _model(recording, sources.main, None if given is None else given.main, sources.camera_info)
    right, T_main_right = None, None
    if sources.mode == "stereo" and sources.partner is not None:
        right = _model(recording, sources.partner, None if given is None else given.right, None)
        T_main_right = _between(recording, main, right, sources)
    if sources.mode == "rgbd" and sources.partner is not None:
        _check_depth(recording, sources.main, sources.partner)
    frame = sources.main.frame_id or main.frame_id or "camera"
    T_main_imu = _imu_place(recording, frame, sources)
    base_frame, T_base_main, upright = _base(recording, frame, sources, T_main_imu)
    rig = CameraRig(
        mode=sources.mode,  # type: ignore[arg-type]
        main=main,
        right=right,
        T_main_right=T_main_right,
        baseline_m=_virtual_baseline(given, main) if sources.mode == "rgbd" else None,
        T_base_main=T_base_main,
        inertial=sources.imu_frame is not None,
        T_main_imu=T_main_imu,
        imu_noise=(given.imu_noise if given is not None else None) or sources.imu_noise or ImuNoise(),
        rate_hz=sources.rate_hz,
        base_is_upright=upright,
    )
    return BuiltRig(rig=rig, base_frame=base_frame, camera_frame=frame)


def _virtual_baseline(given: RigCalibration | None, main: CameraModel) -> float | None:
    """Return the baseline that files give to RGB-D, metres."""
    if given is None:
        return None
    return given.bf / float(main.intrinsics[0, 0]) if given.bf is not None else given.baseline_m


def has_imu_place(recording: Recording, camera_frame: str, imu_frame: str, given: RigCalibration | None) -> bool:
    """Return whether it is known where the IMU sits at the camera."""
    known = given is not None and given.T_main_imu is not None
    return known or (bool(imu_frame) and recording.frames().connected(camera_frame, imu_frame))


def _model(recording: Recording, image: Image, given: CameraModel | None, named: str | None) -> CameraModel:
    """Return the model of a camera, for the size of its images."""
    recorded = find_model(recording, image.topic, named)
    model = given if given is not None else recorded
    if model is None:
        raise CalibrationError(f"{recording.name}: no calibration of the camera on {image.topic}: {_CAMERA_OPTION}")
    if given is not None and recorded is not None:
        _tell_difference(recording, image.topic, given, recorded)
    if given is None and "rect" in image.topic.rsplit("/image", 1)[-1]:
        model = _rectified(model)
    if not model.intrinsics[0, 0] > 0.0:
        raise CalibrationError(
            f"{recording.name}: the camera on {image.topic} is not calibrated (focal length 0): {_CAMERA_OPTION}"
        )
    return replace(_sized(recording, model, image), topic=image.topic)


def _tell_difference(recording: Recording, topic: str, given: CameraModel, recorded: CameraModel) -> None:
    # Of another size: the field of view is what must be the same.
    scale = recorded.width / given.width if given.width > 0 and recorded.width > 0 else 1.0
    ours, theirs = given.intrinsics[0, 0] * scale, recorded.intrinsics[0, 0]
    if theirs > 0.0 and abs(ours / theirs - 1.0) > 0.01:
        recording.log.warn(
            f"the given calibration (fx {ours:.6g} px) is used for {topic}; the recording's own says {theirs:.6g} px:"
            " if the file is of another camera, leave it out or take its Camera entries out"
        )


def _rectified(model: CameraModel) -> CameraModel:
    """Return the model of images that are rectified already: that of P, without distortion."""
    if not model.projection[0, 0] > 0.0:
        return model
    return replace(
        model,
        intrinsics=model.projection[:, :3].copy(),
        distortion=np.zeros_like(model.distortion),
        rectification=np.eye(3),
    )


def _sized(recording: Recording, model: CameraModel, image: Image) -> CameraModel:
    """Return a model for the size of the images: scaled where they show the same view in other pixels."""
    height, width = image.pixels.shape[:2]
    if (model.width, model.height) == (width, height):
        return model
    if model.width <= 0 or model.height <= 0:
        return replace(model, width=width, height=height)
    x, y = width / model.width, height / model.height
    if abs(x / y - 1.0) > 0.01:
        raise CalibrationError(
            f"{recording.name}: images on {image.topic} have {width} x {height} pixels, and the calibration is for"
            f" {model.width} x {model.height}: {_CAMERA_OPTION}"
        )
    recording.log.warn(
        f"images on {image.topic} have {width} x {height} pixels, and the calibration is for {model.width} x {model.height}:"
        f" it is scaled by {x:.3g}"
    )
    scale = np.array([[x, 0.0, 0.5 * x - 0.5], [0.0, y, 0.5 * y - 0.5], [0.0, 0.0, 1.0]])
    return replace(
        model, width=width, height=height, intrinsics=scale @ model.intrinsics, projection=scale @ model.projection
    )


def _between(
    recording: Recording, main: CameraModel, right: CameraModel, sources: RigSources
) -> NDArray[np.float64] | None:
    """Return the pose of the right camera in the main one's frame; None where the right camera's P holds the baseline."""
    given = sources.given
    if given is not None and given.T_main_right is not None:
        return given.T_main_right
    if right.projection[0, 3] < 0.0 < right.projection[0, 0]:
        return None
    tree = recording.frames()
    frames = sources.main.frame_id, sources.partner.frame_id if sources.partner is not None else ""
    if frames[0] != frames[1] and tree.connected(*frames):
        T = tree.lookup(*frames)
        if np.linalg.norm(T[:3, 3]) > 1e-4:
            return T
    raise CalibrationError(
        f"{recording.name}: where does the camera on {right.topic} sit beside that on {main.topic}? Its CameraInfo holds no"
        f" baseline in P, and tf does not connect {frames[0] or '(no frame)'} with {frames[1] or '(no frame)'}: give both"
        " with --camera FILE (Kalibr, or ORB-SLAM with Stereo.T_c1_c2 or Camera.bf), or --static-tf"
    )


def _check_depth(recording: Recording, colour: Image, depth: Image) -> None:
    """Warn of depth that is not seen from the colour camera."""
    if depth.pixels.shape[:2] != colour.pixels.shape[:2]:
        recording.log.warn(
            f"depth on {depth.topic} has {depth.pixels.shape[1]} x {depth.pixels.shape[0]} pixels, colour on {colour.topic}"
            f" {colour.pixels.shape[1]} x {colour.pixels.shape[0]}: the nearest depth is taken, as of the same view"
        )
    if depth.frame_id and colour.frame_id and depth.frame_id != colour.frame_id:
        tree = recording.frames()
        apart = tree.connected(colour.frame_id, depth.frame_id) and (
            np.linalg.norm(tree.lookup(colour.frame_id, depth.frame_id)[:3, 3]) > 1e-3
        )
        named = any(word in depth.topic.lower() for word in ("registered", "aligned"))
        if apart and not named:
            recording.log.warn(
                f"depth on {depth.topic} is seen from {depth.frame_id}, colour from {colour.frame_id}: it is not registered"
                " to the colour camera, and depth will be read beside its pixel (choose with --depth-topic)"
            )
    tell_depth_unit(recording, depth)


def tell_depth_unit(recording: Recording, depth: Image) -> None:
    """Warn of depth that is none, or in another unit than its encoding says, by what rooms and cameras are like."""
    values = depth.pixels[::4, ::4].ravel()
    values = values[np.isfinite(values) & (values > 0.0)]
    if len(values) < 0.02 * depth.pixels[::4, ::4].size:
        recording.log.warn(
            f"the first depth image on {depth.topic} has depth in {len(values)} of {depth.pixels[::4, ::4].size} pixels only"
        )
        return
    typical, far = (float(value) for value in np.percentile(values, (50, 98)))
    if typical > _FAR_M or far < _NEAR_M:
        recording.log.warn(
            f"depth on {depth.topic} is {typical:.3g} m typically and {far:.3g} m at most: is the unit right? Give raw units"
            " per metre with --depth-scale (1000 for millimetres, 5000 for TUM RGB-D, 1 for metres)"
        )


def _imu_place(recording: Recording, camera_frame: str, sources: RigSources) -> NDArray[np.float64] | None:
    """Return the pose of the IMU in the main camera's frame; None without an IMU.

    Raises
    ------
    CalibrationError
        If an IMU is used and its place is unknown.
    """
    given = sources.given
    if given is not None and given.T_main_imu is not None:
        return given.T_main_imu
    if sources.imu_frame is None:
        return None
    tree = recording.frames()
    if tree.connected(camera_frame, sources.imu_frame):
        return tree.lookup(camera_frame, sources.imu_frame)
    raise CalibrationError(
        f"{recording.name}: where does the IMU ({sources.imu_frame or 'no frame'}) sit at the camera ({camera_frame})? tf does"
        " not say it: give it with --camera FILE (IMU.T_b_c1 or Tbc of ORB-SLAM, T_cam_imu of Kalibr) or --static-tf"
    )


def _base(
    recording: Recording, camera_frame: str, sources: RigSources, T_main_imu: NDArray[np.float64] | None
) -> tuple[str, NDArray[np.float64], bool]:
    """Return the base frame, the main camera's pose in it, and whether its z points up.

    It is what the user names, the robot's frame or the body that tf puts the camera on, the IMU where a file says its
    place, else the camera itself.
    """
    tree = recording.frames()
    if sources.base_frame is not None:
        if sources.base_frame == camera_frame:
            return camera_frame, np.eye(4), False
        if not tree.connected(sources.base_frame, camera_frame):
            raise CalibrationError(
                f"--base-frame {sources.base_frame}: tf does not connect it with the camera ({camera_frame});"
                f" give its place with --static-tf {sources.base_frame},{camera_frame},x,y,z,yaw,pitch,roll"
            )
        return sources.base_frame, tree.lookup(sources.base_frame, camera_frame), _is_robot(sources.base_frame)
    found = _usual_base(tree, camera_frame, ROBOT_FRAMES) or _usual_base(tree, camera_frame, BODY_FRAMES)
    if found is not None:
        return found, tree.lookup(found, camera_frame), _is_robot(found)
    given = sources.given
    if given is not None and given.T_main_imu is not None and T_main_imu is not None:
        return sources.imu_frame or "imu", se3.inverse(T_main_imu), False
    return camera_frame, np.eye(4), False


def _is_robot(frame: str) -> bool:
    return frame.rsplit("/", 1)[-1] in ROBOT_FRAMES


def _usual_base(tree: FrameTree, camera_frame: str, usual: Sequence[str]) -> str | None:
    """Return the frame of a usual name that carries the camera without moving against it."""
    for name in usual:
        for frame in tree.frames:
            named = frame == name or frame.endswith(f"/{name}")
            if (
                named
                and frame != camera_frame
                and tree.connected(frame, camera_frame)
                and tree.is_static(frame, camera_frame)
            ):
                return frame
    return None
