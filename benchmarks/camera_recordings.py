# SPDX-License-Identifier: MIT
"""Recordings of cameras: every kind and lens, and such with one fault each, with true trajectories.

    python benchmarks/camera_recordings.py OUT [NAME ...] [--seed N]

writes OUT/NAME.mcap, OUT/NAME.truth.tum and OUT/NAME.map.yaml (but of desks and streets). docs/generate.md says what each is for.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from slamcli.errors import SlamcliError
from slamcli.pipelines.generate import generate

RGBD, STEREO, MONO = {"camera.kind": "rgbd"}, {"camera.kind": "stereo"}, {"camera.kind": "mono"}
IMU = {"imu.enabled": True}
SMALL = {**RGBD, "camera.width": 320, "camera.height": 240, "camera.rate": 15}
FISHEYE = {
    "camera.lens": "fisheye",
    "camera.fov": 150,
    "camera.rectified": False,
    "camera.width": 512,
    "camera.height": 512,
}
RADTAN = {
    "camera.lens": "radtan",
    "camera.fov": 80,
    "camera.rectified": False,
    "camera.width": 752,
    "camera.height": 480,
}
HARD = {
    "camera.motion_blur": True, "camera.exposure": 0.02, "camera.readout": 0.025, "camera.swing": 0.4, "camera.noise": 4,
}  # fmt: skip

# name: (world, settings, seconds or None for the world's path)
VARIANTS: dict[str, tuple[str, dict[str, float | str], float | None]] = {
    "room-rgbd": ("visual_room", {**RGBD, **IMU}, None),
    "room-stereo": ("visual_room", {**STEREO, **IMU, "camera.rate": 20}, None),
    "room-mono": ("visual_room", {**MONO, **IMU}, None),
    "desk-mono": ("visual_desk", {**MONO, **IMU, "camera.rate": 20}, None),
    "street-stereo": ("visual_street", {**STEREO, **IMU}, None),
    "loop-rgbd": ("visual_loop", {**RGBD, **IMU, "camera.rate": 15}, None),
    "loop-mono": ("visual_loop", {**MONO, **IMU}, None),
    "desk-fisheye": ("visual_desk", {**STEREO, **IMU, **FISHEYE, "camera.rate": 20}, None),
    "room-radtan": ("visual_room", {**STEREO, **IMU, **RADTAN, "camera.rate": 20}, 15.0),
    "room-hard": ("visual_room", {**RGBD, **IMU, **HARD}, 15.0),
    "plain-walls": ("visual_room", {**SMALL, "texture.plain": 1}, 10.0),
    "depth-scale": ("visual_room", {**SMALL, "depth.scale": 5}, 4.0),
    "depth-stamps": ("visual_room", {**SMALL, "clock.depth_offset": 0.25}, 4.0),
    "depth-late": ("visual_room", {**SMALL, "depth.delay": 0.1}, 4.0),
    "black": ("visual_room", {**SMALL, "camera.black_from": 3, "camera.black_seconds": 2}, 8.0),
    "lost": ("visual_loop", {**SMALL, **IMU, "camera.black_from": 20, "camera.black_seconds": 4}, None),
    "drops": ("visual_room", {**SMALL, "camera.drop": 0.4}, 8.0),
    "resize": ("visual_room", {**SMALL, "camera.resize_at": 3}, 6.0),
    "blurred": ("visual_room", {**SMALL, "camera.motion_blur": True, "camera.exposure": 0.06}, 6.0),
    "stereo-stamps": ("visual_room", {**SMALL, **STEREO, "clock.right_offset": 0.02}, 4.0),
    "imu-late": ("visual_room", {**SMALL, **MONO, **IMU, "clock.imu_offset": 0.05}, 10.0),
}


def main() -> None:
    """Write the variants that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(VARIANTS)}")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.names or VARIANTS:
        if name not in VARIANTS:
            parser.error(f"no variant {name!r}; there are {', '.join(VARIANTS)}")
        world, settings, duration_s = VARIANTS[name]
        stem = arguments.out / name
        plan = f"{stem}.map.yaml" if world in ("visual_room", "visual_loop") else None
        try:
            made = generate(
                world, f"{stem}.mcap", seed=arguments.seed, duration_s=duration_s, settings=settings,
                truth=f"{stem}.truth.tum", map_path=plan,
            )  # fmt: skip
        except SlamcliError as error:
            parser.exit(1, f"{name}: {error}\n")
        images = sum(count for topic, count in made.messages.items() if "/image_" in topic)
        print(
            f"{name}: {made.duration_s:.0f} s, {made.length_m:.0f} m, {images} images, {images / made.seconds:.1f} a second",
            flush=True,
        )


if __name__ == "__main__":
    main()
