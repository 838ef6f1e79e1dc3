# SPDX-License-Identifier: MIT
"""Settings of simulated cameras and of what they look at, declared once."""

from __future__ import annotations

from dataclasses import dataclass

from slamcli.parameters import parameter
from slamcli.simulation.setting import number


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraParameters:
    """Settings of one camera, a stereo pair or an RGB-D camera."""

    camera_kind: str = parameter(
        "none", "What is recorded.", name="camera.kind", choices=("none", "mono", "stereo", "rgbd")
    )
    camera_width: int = parameter(640, "Pixels of a row.", name="camera.width", minimum=16, maximum=4096)
    camera_height: int = parameter(480, "Rows of an image.", name="camera.height", minimum=16, maximum=4096)
    camera_rate: float = number("camera.rate", 30.0, "Hz", "Images per second.", 0.01, 1000.0)
    camera_fov: float = number(
        "camera.fov", 65.0, "deg", "Horizontal field of view (fisheye: width over focal length).", 5.0, 220.0
    )
    camera_lens: str = parameter(
        "pinhole",
        "Distortion: none, radial-tangential (plumb_bob), or Kannala-Brandt (equidistant).",
        name="camera.lens",
        choices=("pinhole", "radtan", "fisheye"),
    )
    camera_distortion: str = parameter(
        "",
        "Coefficients with commas: k1,k2,p1,p2[,k3], or k1,k2,k3,k4 (left out: typical ones).",
        name="camera.distortion",
    )
    camera_baseline: float = number("camera.baseline", 0.12, "m", "From the left to the right camera.", 0.001, 10.0)
    camera_rectified: bool = parameter(
        True, "Stereo images without distortion and with common rows.", name="camera.rectified"
    )
    camera_misalignment: float = number(
        "camera.misalignment",
        0.6,
        "deg",
        "How far the right camera is turned about each axis, where not rectified.",
        None,
    )
    camera_encoding: str = parameter(
        "auto",
        "Pixels (auto: colour for RGB-D, else grey).",
        name="camera.encoding",
        choices=("auto", "mono8", "rgb8", "bgr8"),
    )
    camera_compressed: bool = parameter(
        False, "CompressedImage messages (JPEG, depth as PNG) instead of raw ones.", name="camera.compressed"
    )
    camera_exposure: float = number("camera.exposure", 0.008, "s", "Time for which the shutter is open.", 0.0, 1.0)
    camera_motion_blur: bool = parameter(
        False, "Means over the exposure (up to 8 moments of it) instead of its middle.", name="camera.motion_blur"
    )
    camera_readout: float = number(
        "camera.readout", 0.0, "s", "Time from the first to the last row of a rolling shutter (0: global).", 0.0, 1.0
    )
    camera_noise: float = number(
        "camera.noise", 2.0, "1", "Standard deviation of a pixel, grey levels of 255.", 0.0, 100.0
    )
    camera_swing: float = number(
        "camera.swing",
        0.0,
        "1",
        "Change of exposure: brightness wanders between 1 / (1 + swing) and 1 + swing.",
        0.0,
        10.0,
    )
    camera_swing_seconds: float = number("camera.swing_seconds", 4.0, "s", "How long one wandering takes.", 0.1)
    camera_vignetting: float = number("camera.vignetting", 0.0, "1", "Loss of light in the corners.", 0.0, 1.0)
    camera_x: float = number("camera.x", 0.1, "m", "Mount of the left or only camera, forward of the base.", None)
    camera_y: float = number("camera.y", 0.0, "m", "Mount, left of the base.", None)
    camera_z: float = number("camera.z", 0.4, "m", "Mount, above the base.", None)
    camera_roll: float = number("camera.roll", 0.0, "deg", "Mount, turned about its line of sight.", None)
    camera_pitch: float = number("camera.pitch", 0.0, "deg", "Mount, looking down.", None)
    camera_yaw: float = number("camera.yaw", 0.0, "deg", "Mount, turned left.", None)
    camera_drop: float = number("camera.drop", 0.0, "1", "Share of images that are lost.", 0.0, 1.0)
    camera_black_from: float = number("camera.black_from", 0.0, "s", "When the images turn black.")
    camera_black_seconds: float = number("camera.black_seconds", 0.0, "s", "For how long (0: never).")
    camera_resize_at: float = number("camera.resize_at", 0.0, "s", "When images become half as large (0: never).")

    depth_range_min: float = number("depth.range_min", 0.3, "m", "Nearest depth that is measured.")
    depth_range_max: float = number("depth.range_max", 8.0, "m", "Farthest depth that is measured.", 0.1)
    depth_noise: float = number("depth.noise", 0.0012, "1/m", "Standard deviation at 1 m; grows with the square.")
    depth_step: float = number(
        "depth.step",
        0.0026,
        "1/m",
        "Step of the inverse depth: 2.6 mm at 1 m, 23 mm at 3 m, as a Kinect has it (0: none).",
    )
    depth_holes: bool = parameter(
        True, "No depth at the borders of things and on surfaces seen at a slant.", name="depth.holes"
    )
    depth_dropout: float = number("depth.dropout", 0.002, "1", "Share of further pixels without depth.", 0.0, 1.0)
    depth_encoding: str = parameter(
        "16UC1", "Whole millimetres or fractions of a metre.", name="depth.encoding", choices=("16UC1", "32FC1")
    )
    depth_scale: float = number("depth.scale", 1.0, "1", "Written over measured depth.", 0.0001, 10_000.0)
    depth_delay: float = number(
        "depth.delay", 0.0, "s", "How much later than the colours depth is taken (and stamped).", -10.0, 10.0
    )

    texture_seed: int = parameter(1, "Of the pictures on all surfaces.", name="texture.seed", minimum=0)
    texture_texel: float = number("texture.texel", 0.004, "m", "Finest detail of the pictures.", 0.0005, 1.0)
    texture_plain: float = number(
        "texture.plain", 0.0, "1", "Share of walls and ceilings of one colour without texture.", 0.0, 1.0
    )
