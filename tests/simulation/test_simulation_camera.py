# SPDX-License-Identifier: MIT
"""Camera recordings: lenses, stereo and depth agree with the truth to a fraction of a pixel; time, noise and faults."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from slamcli.errors import ConfigError, UsageError
from slamcli.geometry import quaternion
from slamcli.measurements import CameraModel, FrameTransform, Image
from slamcli.simulation import Simulation, World, load_world, resolve_settings, shapes
from slamcli.simulation.builtin import find_world
from slamcli.simulation.optics import camera_model, optics, rectifying_turns
from slamcli.simulation.relief import Relief, Terrain
from slamcli.simulation.world import CarriedPath

QUIET = {
    "camera.width": 96, "camera.height": 72, "camera.noise": 0.0, "laser.enabled": False, "odometry.enabled": False,
    "texture.texel": 0.02, "robot.base_frame": "body", "depth.noise": 0.0, "depth.step": 0.0, "depth.dropout": 0.0,
    "carried.sway": 0.0, "carried.shake": 0.0, "robot.rest": 0.0,
}  # fmt: skip


def room():
    """A room of 4 x 3 x 2.5 m with a box in it; the rig looks at the box and turns and moves."""
    walls = shapes.rectangle(np.array([0.0, 0, 4, 3]))
    panels = np.column_stack([walls, np.tile([0.0, 2.5, 0.6], (4, 1))])
    ground = Terrain(np.zeros((2, 2)), 5.0, -0.5, -0.5)
    ceiling = Terrain(np.full((2, 2), 2.5), 5.0, -0.5, -0.5)
    relief = Relief(ground, ceiling, panels, np.array([[3.0, 1.6, 1.0, 0.0, 0.3, 0.4, 0.0, 1.3, 0.4]]))
    poses = np.array([[0.6, 1.0, 1.2, 0, 0, 0], [0.9, 1.5, 1.4, 0.05, 0.1, 0.2], [1.2, 1.9, 1.3, 0, 0.1, -0.1]])
    return World("room", walls, path=CarriedPath(poses), relief=relief)


def simulate(kind, duration=1.0, seed=1, world=None, **settings):
    values = {**QUIET, "camera.kind": kind, **{k.replace("__", "."): v for k, v in settings.items()}}
    return Simulation(world or room(), resolve_settings(values), seed=seed, duration_s=duration)


def recorded(simulation, kind=Image):
    """What was recorded of a kind, by topic."""
    found = {}
    for message in simulation.messages():
        if isinstance(message.measurement, kind):
            found.setdefault(message.topic, []).append(message.measurement)
    return found


def pose_of(simulation, time_s, number=0):
    """T_map_camera (4, 4) of a camera at a time."""
    positions, rotations = simulation.ride.at(np.array([time_s]))
    camera = simulation._rig.cameras[number]
    pose = np.eye(4)
    pose[:3, :3] = rotations[0] @ camera.rotation
    pose[:3, 3] = positions[0] + rotations[0] @ camera.position
    return pose


def sampled(picture, pixels):
    """Bilinear values of a picture (H, W[, C]) at pixels (N, 2)."""
    at = pixels.astype(np.float32)
    return cv2.remap(picture.astype(np.float32), at[:, None, 0], at[:, None, 1], cv2.INTER_LINEAR)[:, 0]


def shift_between(here, there, pixels, moved):
    """How far (2,) picture `there` at `moved` has to be shifted to look like `here` at `pixels`, least squares."""
    smooth = [cv2.GaussianBlur(p.astype(np.float32), (0, 0), 1.0) for p in (here, there)]
    gx, gy = (
        sampled(cv2.Sobel(smooth[1], cv2.CV_32F, 1, 0) / 8, moved),
        sampled(cv2.Sobel(smooth[1], cv2.CV_32F, 0, 1) / 8, moved),
    )
    difference = sampled(smooth[0], pixels) - sampled(smooth[1], moved)
    kept = np.abs(difference) < 20
    return np.linalg.lstsq(np.column_stack([gx, gy])[kept], difference[kept], rcond=None)[0], np.abs(difference).mean()


def reprojected(depth, model, T_there_here):
    """Pixels (N, 2) with depth in one image, and where they lie in the other, those that do."""
    v, u = np.nonzero(depth > 0)
    k = model.intrinsics
    ray = np.column_stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(len(u))])
    there = (ray * depth[v, u][:, None]) @ T_there_here[:3, :3].T + T_there_here[:3, 3]
    moved = there[:, :2] / there[:, 2:] * [k[0, 0], k[1, 1]] + k[:2, 2]
    inside = (moved.min(axis=1) > 3) & (moved[:, 0] < model.width - 4) & (moved[:, 1] < model.height - 4)
    inside &= (u > 3) & (v > 3) & (u < model.width - 4) & (v < model.height - 4)
    return np.column_stack([u, v])[inside].astype(float), moved[inside]


def test_what_one_image_shows_lies_in_another_where_depth_and_truth_say():
    simulation = simulate("rgbd", duration=2.0, camera__rate=2.0, camera__width=160, camera__height=120, texture__texel=0.01,
                          depth__encoding="32FC1")  # fmt: skip
    images = recorded(simulation)
    grey = [cv2.cvtColor(m.pixels, cv2.COLOR_RGB2GRAY) for m in images["/camera/color/image_raw"]]
    depths = [m.pixels for m in images["/camera/aligned_depth_to_color/image_raw"]]
    model = recorded(simulation, CameraModel)["/camera/color/camera_info"][0]
    poses = [pose_of(simulation, t) for t in simulation.frame_times_s]
    compared = 0
    for i, j in itertools.combinations(range(len(grey)), 2):
        pixels, moved = reprojected(depths[i], model, np.linalg.inv(poses[j]) @ poses[i])
        if len(pixels) > 4000:
            shift, off = shift_between(grey[i], grey[j], pixels, moved)
            assert np.abs(shift).max() < 0.08
            assert off < 12
            compared += 1
    assert compared >= 4
    assert np.linalg.norm(poses[0][:3, 3] - poses[-1][:3, 3]) > 0.3


def test_depth_is_exact_without_noise_and_stereo_has_the_disparity_of_it():
    simulation = simulate("rgbd", duration=0.1, depth__encoding="32FC1", depth__holes=False)
    depth = recorded(simulation)["/camera/aligned_depth_to_color/image_raw"][0].pixels
    model = recorded(simulation, CameraModel)["/camera/color/camera_info"][0]
    at_map = pose_of(simulation, 0.0)
    v, u = np.mgrid[:72, :96]
    k = model.intrinsics
    points = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)], axis=-1) * depth[..., None]
    x, y, z = np.moveaxis(points @ at_map[:3, :3].T + at_map[:3, 3], -1, 0)
    faces = np.stack([x, 4 - x, y, 3 - y, z, 2.5 - z, x - 2.7, y - 1.2, y - 2.0, z - 1.3])
    assert np.abs(faces).min(axis=0).max() < 1e-5
    assert (np.abs(x - 2.7) < 1e-5).sum() > 100  # the box is seen

    pair = simulate("stereo", duration=0.1, camera__x=0.1, camera__baseline=0.1, texture__texel=0.01)
    images = recorded(pair)
    left, right = (images[f"/stereo/{side}/image_rect"][0].pixels for side in ("left", "right"))
    v, u = (a.ravel()[::2] for a in np.mgrid[6:66, 20:90])
    moved = np.column_stack([u - 0.1 * k[0, 0] / depth[v, u], v])
    shift, off = shift_between(left, right, np.column_stack([u, v]).astype(float), moved)
    assert np.abs(shift).max() < 0.08
    assert off < 10
    info = recorded(pair, CameraModel)["/stereo/right/camera_info"][0]
    assert info.projection[0, 3] == pytest.approx(-0.1 * k[0, 0])


@pytest.mark.parametrize("lens", ["radtan", "fisheye"])
def test_lenses_are_those_of_opencv(lens):
    p = resolve_settings({"camera.lens": lens, "camera.fov": 100.0, "camera.distortion": "-0.05,0.01,0.001,-0.002"})
    seen, model = optics(p, 80, 60), camera_model(p, 80, 60)
    rays = seen.directions.reshape(-1, 1, 3)
    none = np.zeros(3)
    if lens == "radtan":
        pixels = cv2.projectPoints(rays, none, none, model.intrinsics, model.distortion)[0]
        assert model.distortion_model == "plumb_bob"
    else:
        pixels = cv2.fisheye.projectPoints(rays, none, none, model.intrinsics, model.distortion)[0]
        assert model.distortion_model == "equidistant"
        np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)
    v, u = np.mgrid[:60, :80]
    np.testing.assert_allclose(pixels.reshape(60, 80, 2), np.stack([u, v], axis=-1), atol=1e-5)
    np.testing.assert_allclose(
        seen.directions[:, 1:] - seen.directions[:, :-1], (seen.right[:, 1:] + seen.right[:, :-1]) / 2, atol=3e-4
    )


def test_a_pair_to_be_rectified_is_rectified_by_its_calibration():
    simulation = simulate("stereo", duration=0.05, camera__rectified=False, camera__lens="radtan", camera__fov=80.0,
                          camera__width=160, camera__height=120, texture__texel=0.01)  # fmt: skip
    images, models = recorded(simulation), recorded(simulation, CameraModel)
    flat = []
    for side in ("left", "right"):
        info = models[f"/stereo/{side}/camera_info"][0]
        new = info.projection[:, :3]
        maps = cv2.initUndistortRectifyMap(
            info.intrinsics, info.distortion, info.rectification, new, (160, 120), cv2.CV_32FC1
        )
        flat.append(cv2.remap(images[f"/stereo/{side}/image_raw"][0].pixels, *maps, cv2.INTER_LINEAR))
    found = cv2.goodFeaturesToTrack(flat[0][:, 30:150], 60, 0.05, 6)[:, 0] + [30, 0]
    moved, good, _ = cv2.calcOpticalFlowPyrLK(*flat, found.astype(np.float32), None, winSize=(11, 11))
    gaps = (moved - found)[good[:, 0] == 1]
    assert np.median(np.abs(gaps[:, 1])) < 0.12
    assert np.median(gaps[:, 0]) < -1.0
    info = models["/stereo/right/camera_info"][0]
    assert -info.projection[0, 3] / info.projection[0, 0] == pytest.approx(0.12)
    transforms = {m.measurement.child_frame_id: m.measurement for m in simulation.messages() if m.topic == "/tf_static"}
    left, right = (transforms[f"stereo_{side}_optical_frame"] for side in ("left", "right"))
    turn = quaternion.to_matrix(left.quat_xyzw).T @ quaternion.to_matrix(right.quat_xyzw)
    aside = quaternion.to_matrix(left.quat_xyzw).T @ (right.position_m - left.position_m)
    np.testing.assert_allclose(rectifying_turns(turn, aside)[1], info.rectification, atol=1e-9)


def test_topics_stamps_encodings_and_frames():
    rgbd = simulate("rgbd", duration=0.5, camera__rate=10.0)
    messages = list(rgbd.messages())
    assert [m.log_time_ns for m in messages] == sorted(m.log_time_ns for m in messages)
    images = recorded(rgbd)
    assert set(images) == {"/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"}
    assert images["/camera/color/image_raw"][0].encoding == "rgb8"
    assert images["/camera/aligned_depth_to_color/image_raw"][0].pixels.dtype == np.uint16
    start = 1_700_000_000_000_000_000
    for found in images.values():
        assert [m.stamp_ns - start for m in found] == [0, 10**8, 2 * 10**8, 3 * 10**8, 4 * 10**8, 5 * 10**8]
    truth = rgbd.truth()
    assert truth.stamps_ns.tolist() == [m.stamp_ns for m in images["/camera/color/image_raw"]]
    static = [m.measurement for m in messages if isinstance(m.measurement, FrameTransform)]
    assert [(t.parent_frame_id, t.child_frame_id) for t in static] == [("body", "camera_color_optical_frame")]
    mono = recorded(simulate("mono", duration=0.1))
    assert list(mono) == ["/camera/image_raw"]
    assert mono["/camera/image_raw"][0].encoding == "mono8"
    bgr = recorded(simulate("mono", duration=0.01, camera__encoding="bgr8"))["/camera/image_raw"][0]
    rgb = recorded(simulate("mono", duration=0.01, camera__encoding="rgb8"))["/camera/image_raw"][0]
    np.testing.assert_array_equal(bgr.pixels[..., ::-1], rgb.pixels)


def test_noise_has_its_deviation_and_the_seed_decides():
    still = recorded(simulate("mono", duration=0.05))["/camera/image_raw"][0].pixels.astype(float)
    draws = [
        recorded(simulate("mono", duration=0.05, seed=s, camera__noise=4.0))["/camera/image_raw"] for s in (1, 1, 2)
    ]
    for one, other in zip(draws[0], draws[1], strict=True):
        np.testing.assert_array_equal(one.pixels, other.pixels)
    middle = (still > 100) & (still < 150)
    noise = [d[0].pixels.astype(float)[middle] - still[middle] for d in draws]
    assert 3.6 < noise[0].std() < 4.4
    assert np.abs(np.corrcoef(noise[0], noise[2])[0, 1]) < 0.1


def test_depth_noise_grows_with_the_square_and_holes_lie_at_borders_and_beyond_range():
    plain = {"duration": 0.01, "depth__encoding": "32FC1", "camera__width": 160, "camera__height": 120}
    topic = "/camera/aligned_depth_to_color/image_raw"
    true_m = recorded(simulate("rgbd", depth__holes=False, **plain))[topic][0].pixels
    noisy = recorded(simulate("rgbd", depth__holes=False, depth__noise=0.01, **plain))[topic][0].pixels
    far, near = true_m > 2.8, (true_m < 2.0) & (true_m > 1.0)
    ratio = (noisy - true_m)[far].std() / (noisy - true_m)[near].std()
    assert ratio == pytest.approx((true_m[far] ** 2).mean() / (true_m[near] ** 2).mean(), rel=0.25)
    holed = recorded(simulate("rgbd", **plain))[topic][0].pixels
    assert 0 < (holed == 0).sum() < 900
    assert (holed[(holed > 0)] == true_m[(holed > 0)]).all()
    short = recorded(simulate("rgbd", depth__range_max=2.5, **plain))[topic][0].pixels
    assert (short[true_m > 2.5] == 0).all()
    stepped = recorded(simulate("rgbd", depth__step=0.01, **plain))[topic][0].pixels
    np.testing.assert_allclose(1 / stepped[stepped > 0] / 0.01, np.rint(1 / stepped[stepped > 0] / 0.01), atol=1e-3)


def test_rolling_shutter_and_motion_blur():
    fast = {
        "duration": 0.3,
        "camera__rate": 5.0,
        "robot__speed": 3.0,
        "robot__turn_rate": 3.0,
        "robot__acceleration": 20.0,
    }
    topic = "/camera/image_raw"
    sharp = recorded(simulate("mono", **fast))[topic][1].pixels.astype(float)
    rolled = recorded(simulate("mono", camera__readout=0.03, **fast))[topic][1].pixels.astype(float)
    off = np.abs(sharp - rolled).mean(axis=1)
    assert off[34:38].mean() < 0.35 * off[[0, 1, 2, -3, -2, -1]].mean()
    blurred = recorded(simulate("mono", camera__motion_blur=True, camera__exposure=0.03, **fast))[topic][
        1
    ].pixels.astype(float)
    assert np.abs(np.diff(blurred)).mean() < 0.9 * np.abs(np.diff(sharp)).mean()
    assert blurred.mean() == pytest.approx(sharp.mean(), abs=4)


def test_exposure_wanders_and_corners_darken():
    images = recorded(simulate("mono", duration=4.0, camera__rate=5.0, camera__swing=1.0))["/camera/image_raw"]
    steady = recorded(simulate("mono", duration=4.0, camera__rate=5.0))["/camera/image_raw"]
    gains = np.array([np.median(a.pixels / np.maximum(b.pixels, 1.0)) for a, b in zip(images, steady, strict=True)])
    assert gains.max() > 1.2
    assert gains.min() < 0.8
    dark = recorded(simulate("mono", duration=0.01, camera__vignetting=0.5))["/camera/image_raw"][0].pixels
    assert dark[0, 0] == pytest.approx(steady[0].pixels[0, 0] * 0.5, abs=1.5)
    assert dark[36, 48] == pytest.approx(steady[0].pixels[36, 48], abs=1.5)


def test_faults_that_can_be_asked_for():
    def taken(**settings):
        return recorded(simulate("rgbd", duration=1.0, camera__rate=10.0, **settings))

    colour, depth = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
    plain = taken()
    black = [m.pixels.max() == 0 for m in taken(camera__black_from=0.35, camera__black_seconds=0.3)[colour]]
    assert black == [False] * 4 + [True] * 3 + [False] * 4
    lost = taken(camera__drop=0.5)
    assert 1 <= len(lost[colour]) < 10
    assert {m.stamp_ns for m in lost[colour]} != {m.stamp_ns for m in lost[depth]}
    np.testing.assert_allclose(taken(depth__scale=0.2)[depth][0].pixels, plain[depth][0].pixels * 0.2, atol=1.01)
    late = taken(clock__depth_offset=0.04)
    assert [m.stamp_ns - n.stamp_ns for m, n in zip(late[depth], plain[depth], strict=True)] == [40_000_000] * 11
    np.testing.assert_array_equal(late[depth][5].pixels, plain[depth][5].pixels)
    delayed = taken(depth__delay=0.1)
    np.testing.assert_array_equal(delayed[depth][5].pixels, plain[depth][6].pixels)
    small = simulate("rgbd", duration=1.0, camera__rate=10.0, camera__resize_at=0.45)
    assert [m.pixels.shape for m in recorded(small)[colour]] == [(72, 96, 3)] * 5 + [(36, 48, 3)] * 6
    infos = recorded(small, CameraModel)["/camera/color/camera_info"]
    assert infos[-1].width == 48
    assert infos[-1].intrinsics[0, 0] == pytest.approx(infos[0].intrinsics[0, 0] / 2)
    bare = recorded(simulate("mono", duration=0.01, texture__plain=1.0))["/camera/image_raw"][0].pixels
    assert (
        np.abs(np.diff(bare[:20].astype(float))).mean()
        < 0.3
        * np.abs(
            np.diff(recorded(simulate("mono", duration=0.01))["/camera/image_raw"][0].pixels[:20].astype(float))
        ).mean()
    )


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("stereo", {"camera.lens": "radtan"}, "rectified=false"),
        ("mono", {"camera.distortion": "1,2"}, "needs camera.lens"),
        ("mono", {"camera.lens": "radtan", "camera.distortion": "1,x"}, "not numbers"),
        ("mono", {"camera.lens": "fisheye", "camera.distortion": "1,2"}, "takes 4"),
        ("mono", {"camera.lens": "radtan", "camera.distortion": "-0.9,0,0,0", "camera.fov": 120.0}, "folds"),
        ("mono", {"camera.lens": "fisheye", "camera.distortion": "-0.9,0,0,0", "camera.fov": 190.0}, "corners"),
        ("mono", {"camera.fov": 179.0}, "fisheye"),
        ("rgbd", {"depth.range_max": 0.2}, "not below"),
    ],
)
def test_cameras_that_cannot_be(kind, settings, message):
    values = {**QUIET, "camera.kind": kind, **settings}
    with pytest.raises(ConfigError, match=message):
        Simulation(room(), resolve_settings(values), duration_s=1.0)


def test_a_rig_without_sensors_is_refused():
    with pytest.raises(UsageError, match="without sensors"):
        simulate("none")


def test_a_robot_that_drives_takes_pictures_too():
    world = World("room", shapes.rectangle(np.array([0, 0, 8, 5.0])), start=(2, 2, 0))
    settings = {"laser.enabled": True, "odometry.enabled": True, "robot.base_frame": "base_link"}
    simulation = Simulation(world, resolve_settings({**QUIET, **settings, "camera.kind": "mono"}), duration_s=0.3)
    topics = {m.topic for m in simulation.messages()}
    assert topics >= {"/scan", "/odom", "/tf", "/camera/image_raw", "/camera/camera_info"}
    assert recorded(simulation)["/camera/image_raw"][0].pixels.std() > 10


@pytest.mark.parametrize("name", ["visual_room", "visual_loop", "visual_street", "visual_desk"])
def test_built_in_worlds_are_full_of_corners(name):
    world = load_world(find_world(name))
    changed = {
        "camera.kind": "mono",
        "camera.rate": 0.1,
        "camera.width": 640,
        "camera.height": 480,
        "camera.noise": 2.0,
    }
    images = recorded(Simulation(world, resolve_settings(world.settings, changed), duration_s=20.0))[
        "/camera/image_raw"
    ]
    for image in images:
        assert len(cv2.FastFeatureDetector_create(20).detect(cv2.GaussianBlur(image.pixels, (3, 3), 0))) > 1000
        assert 40 < image.pixels.mean() < 200
