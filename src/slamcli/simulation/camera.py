# SPDX-License-Identifier: MIT
"""Cameras on the rig: which there are, where they sit, and what each of them records at a time."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slamcli.errors import ConfigError
from slamcli.geometry import quaternion
from slamcli.measurements import CameraModel, Image, Measurement
from slamcli.simulation import exposure, optics
from slamcli.simulation.message import Message
from slamcli.simulation.parameters import SimulationParameters
from slamcli.simulation.render import Optics, Scene, View
from slamcli.simulation.ride import Ride

Array = NDArray[np.float64]

COMPRESSED = "sensor_msgs/msg/CompressedImage"
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes of an optical frame (x right, y down, z ahead) in one that looks along x (REP 103)."""
_MOST_MOMENTS = 8
_NEAR_M = 1.5  # what moves by in a blurred image is taken to be so far away


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera:
    """One camera: its names and its pose in the base frame."""

    name: str
    frame: str
    prefix: str
    """Of its topics."""
    image: str
    """Last part of the topic of its images."""
    rotation: Array
    """float64 (3, 3), optical frame in base."""
    position: Array
    """float64 (3,), metres."""
    model: CameraModel
    half_model: CameraModel
    """The calibration of half as large images."""


class CameraRig:
    """The cameras that `camera.kind` asks for; `messages` gives what they record."""

    def __init__(
        self, scene: Callable[[], Scene], ride: Ride, parameters: SimulationParameters, seed: int,
        stamp_ns: Callable[[float], int],
    ) -> None:  # fmt: skip
        """Set the cameras up.

        Parameters
        ----------
        scene
            Makes the world that they see, which takes seconds; called when the first image is due.
        ride
            Motion of the base frame.
        seed
            Of the noise.
        stamp_ns
            Turns seconds from the start into a stamp.

        Raises
        ------
        ConfigError
            If the lens or the pair cannot be.
        """
        p = parameters
        if p.camera_kind == "stereo" and p.camera_rectified and p.camera_lens != "pinhole":
            raise ConfigError(
                f"camera.lens={p.camera_lens}: rectified images have no distortion: set camera.rectified=false"
            )
        if p.depth_range_min >= p.depth_range_max:
            raise ConfigError(
                f"depth.range_min {p.depth_range_min:g} m is not below depth.range_max {p.depth_range_max:g} m"
            )
        self._make_scene, self._ride, self._parameters, self._seed, self._stamp_ns = scene, ride, p, seed, stamp_ns
        self.cameras = _cameras(p)
        self._optics: dict[tuple[int, int], Optics] = {}
        self._last: tuple[tuple[str, float, int, int], View] | None = None
        self._swing = exposure.Swing(p, self._draws("swing", 0))
        self._optics_of(p.camera_width, p.camera_height)  # says what is wrong with the lens before anything is written

    def messages(self, times_s: Array) -> Iterator[Message]:
        """Yield calibration and images of every camera, frame by frame: colour before depth, left before right."""
        p = self._parameters
        for number, time_s in enumerate(times_s.tolist()):
            log = self._stamp_ns(time_s + (p.camera_readout + p.camera_exposure) / 2)
            if p.camera_kind == "rgbd":
                yield from self._colour_and_depth(number, time_s, log)
            else:
                for camera in self.cameras:
                    yield from self._picture(camera, number, time_s, log)

    @cached_property
    def _scene(self) -> Scene:
        return self._make_scene()

    @property
    def is_coloured(self) -> bool:
        """Whether images have colours."""
        p = self._parameters
        return p.camera_kind == "rgbd" if p.camera_encoding == "auto" else p.camera_encoding != "mono8"

    def _colour_and_depth(self, number: int, time_s: float, log_ns: int) -> Iterator[Message]:
        camera, p = self.cameras[0], self._parameters
        yield from self._picture(camera, number, time_s, log_ns)
        if self._is_lost("depth", number):
            return
        width, height = self._size(time_s)
        taken_s = time_s + p.depth_delay
        view = self._view(camera, taken_s, width, height)
        depth = exposure.measured_depth(view, p, self._draws("depth", number))
        stamp = self._stamp_ns(taken_s + p.clock_camera_offset + p.clock_depth_offset)
        log = log_ns + max(round(p.depth_delay * 1e9), 0)
        prefix = "/camera/aligned_depth_to_color"
        yield self._calibration(camera, prefix, stamp, log, time_s)
        if p.camera_compressed:
            topic, msgtype = f"{prefix}/image_raw/compressedDepth", COMPRESSED
        else:
            topic, msgtype = f"{prefix}/image_raw", None
            if p.depth_encoding == "16UC1":
                depth = np.clip(np.rint(np.nan_to_num(depth) * 1000.0), 0, 65535).astype(np.uint16)
        image = Image(stamp_ns=stamp, frame_id=camera.frame, encoding="depth", pixels=depth, topic=topic)
        yield Message(log, topic, image, msgtype)

    def _picture(self, camera: Camera, number: int, time_s: float, log_ns: int) -> Iterator[Message]:
        p = self._parameters
        if self._is_lost(camera.name, number):
            return
        offset = p.clock_right_offset if camera.name == "right" else 0.0
        stamp = self._stamp_ns(time_s + p.clock_camera_offset + offset)
        width, height = self._size(time_s)
        light = self._exposed(camera, time_s, width, height)
        if p.camera_black_from <= time_s < p.camera_black_from + p.camera_black_seconds:
            light = np.zeros_like(light)
        pixels = exposure.developed(light, p, self._swing.at(time_s), self._draws(camera.name, number))
        encoding = ("rgb8" if p.camera_encoding == "auto" else p.camera_encoding) if self.is_coloured else "mono8"
        if encoding == "bgr8":
            pixels = np.ascontiguousarray(pixels[..., ::-1])
        topic = f"{camera.prefix}/{camera.image}" + ("/compressed" if p.camera_compressed else "")
        yield self._calibration(camera, camera.prefix, stamp, log_ns, time_s)
        image = Image(stamp_ns=stamp, frame_id=camera.frame, encoding=encoding, pixels=pixels, topic=topic)
        yield Message(log_ns, topic, image, COMPRESSED if p.camera_compressed else None)

    def _calibration(self, camera: Camera, prefix: str, stamp_ns: int, log_ns: int, time_s: float) -> Message:
        topic = f"{prefix}/camera_info"
        model = camera.half_model if self._is_small(time_s) else camera.model
        told: Measurement = dataclasses.replace(model, stamp_ns=stamp_ns, frame_id=camera.frame, topic=topic)
        return Message(log_ns, topic, told)

    def _exposed(self, camera: Camera, time_s: float, width: int, height: int) -> NDArray[np.float32]:
        """Return the mean light (H, W, C) over the time for which the shutter is open."""
        p = self._parameters
        if not p.camera_motion_blur:
            return self._view(camera, time_s, width, height).light
        positions, rotations = self._ride.at(time_s + np.array([-0.5, 0.5]) * p.camera_exposure)
        angle = np.arccos(np.clip((np.trace(rotations[0].T @ rotations[1]) - 1.0) / 2, -1.0, 1.0))
        moved = (angle + float(np.linalg.norm(positions[1] - positions[0])) / _NEAR_M) * camera.model.intrinsics[0, 0]
        count = int(np.clip(np.ceil(moved), 1, _MOST_MOMENTS))
        moments = ((np.arange(count) + 0.5) / count - 0.5) * p.camera_exposure
        total = np.zeros((height, width, 3 if self.is_coloured else 1), np.float32)
        for moment in moments.tolist():
            total += self._view(camera, time_s + moment, width, height).light
        return total / np.float32(count)

    def _view(self, camera: Camera, time_s: float, width: int, height: int) -> View:
        """Return what a perfect camera sees, each row at its own time; the last view is kept, for depth after colours."""
        wanted = (camera.name, time_s, width, height)
        if self._last is not None and self._last[0] == wanted:
            return self._last[1]
        rows = np.arange(height) / max(height - 1, 1) - 0.5
        positions, rotations = self._ride.at(time_s + rows * self._parameters.camera_readout)
        view = self._scene.view(
            self._optics_of(width, height),
            np.ascontiguousarray(rotations @ camera.rotation),
            positions + rotations @ camera.position,
        )
        self._last = wanted, view
        return view

    def _optics_of(self, width: int, height: int) -> Optics:
        if (width, height) not in self._optics:
            self._optics[width, height] = optics.optics(self._parameters, width, height)
        return self._optics[width, height]

    def _is_small(self, time_s: float) -> bool:
        return 0.0 < self._parameters.camera_resize_at <= time_s

    def _size(self, time_s: float) -> tuple[int, int]:
        p = self._parameters
        return (
            (p.camera_width // 2, p.camera_height // 2) if self._is_small(time_s) else (p.camera_width, p.camera_height)
        )

    def _is_lost(self, name: str, number: int) -> bool:
        return bool(self._draws(f"lost {name}", number).random() < self._parameters.camera_drop)

    def _draws(self, name: str, number: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, zlib.crc32(name.encode()), number])


def _cameras(p: SimulationParameters) -> tuple[Camera, ...]:
    turn = quaternion.to_matrix(
        quaternion.from_roll_pitch_yaw(*np.radians([p.camera_roll, p.camera_pitch, p.camera_yaw]))
    )
    rotation, position = turn @ _OPTICAL, np.array([p.camera_x, p.camera_y, p.camera_z])
    sizes = (p.camera_width, p.camera_height), (p.camera_width // 2, p.camera_height // 2)
    if p.camera_kind != "stereo":
        model, half = (optics.camera_model(p, *size) for size in sizes)
        frame, prefix = (
            ("camera_color_optical_frame", "/camera/color")
            if p.camera_kind == "rgbd"
            else ("camera_optical_frame", "/camera")
        )
        return (Camera(
            name="main", frame=frame, prefix=prefix, image="image_raw", rotation=rotation, position=position, model=model,
            half_model=half,
        ),)  # fmt: skip
    off = 0.0 if p.camera_rectified else np.radians(p.camera_misalignment)
    between = quaternion.to_matrix(quaternion.from_roll_pitch_yaw(off, -off, off))
    aside = np.array([p.camera_baseline, 0.0, 0.0])
    turns = optics.rectifying_turns(between, aside)
    pair = []
    for name, turned, moved, into, baseline in (
        ("left", np.eye(3), np.zeros(3), turns[0], 0.0),
        ("right", between, aside, turns[1], p.camera_baseline),
    ):
        model, half = (optics.camera_model(p, *size, rectification=into, baseline_m=baseline) for size in sizes)
        pair.append(Camera(
            name=name, frame=f"stereo_{name}_optical_frame", prefix=f"/stereo/{name}",
            image="image_rect" if p.camera_rectified else "image_raw", rotation=rotation @ turned,
            position=position + rotation @ moved, model=model, half_model=half,
        ))  # fmt: skip
    return tuple(pair)
