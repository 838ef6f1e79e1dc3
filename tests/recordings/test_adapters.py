# SPDX-License-Identifier: MIT
from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from memory_recording import MemoryContainer

from slamcli.errors import DataError, RecordingError
from slamcli.geometry import quaternion
from slamcli.grids import OccupancyGrid
from slamcli.measurements import (
    CameraModel,
    FrameTransform,
    GeoFix,
    Image,
    ImuSample,
    LandmarkObservation,
    Landmarks,
    LaserScan,
    Odometry,
    PointCloud,
    StampedPose,
    StampedTwist,
)
from slamcli.recordings.adapters import (
    ADAPTERS,
    DecodeContext,
    StampedGrid,
    StampedPath,
    StampedPoses,
    StampedText,
    encoder_for,
    landmark_list,
    message_factory,
)
from slamcli.recordings.adapters import image as image_adapter
from slamcli.recordings.adapters.compressed_image import damage_of, image_size
from slamcli.recordings.mends import Mends
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

STAMP = 1_700_000_000_123_456_789
RNG = np.random.default_rng(7)
QUAT = quaternion.from_roll_pitch_yaw(0.1, -0.2, 2.5)


def _scan(**changes: Any) -> LaserScan:
    values: dict[str, Any] = dict(
        stamp_ns=STAMP,
        frame_id="laser",
        angle_min_rad=-1.5,
        angle_increment_rad=0.25,
        range_min_m=0.125,
        range_max_m=8.0,
        ranges_m=np.array([1.0, np.inf, np.nan, 0.05, 3.5, -np.inf], dtype=np.float32),
        time_increment_s=0.001953125,
        scan_time_s=0.125,
    )
    return LaserScan(**{**values, **changes})


MEASUREMENTS: list[tuple[str, Any]] = [
    ("sensor_msgs/msg/LaserScan", _scan(intensities=np.arange(6, dtype=np.float32))),
    ("sensor_msgs/msg/LaserScan", _scan(angle_min_rad=1.5, angle_increment_rad=-0.25)),
    ("sensor_msgs/msg/LaserScan", _scan(ranges_m=np.zeros(0, dtype=np.float32))),
    ("sensor_msgs/msg/MultiEchoLaserScan", _scan(intensities=np.arange(6, dtype=np.float32))),
    (
        "sensor_msgs/msg/PointCloud2",
        PointCloud(
            stamp_ns=STAMP,
            frame_id="lidar",
            points_m=RNG.normal(size=(5, 3)).astype(np.float32),
            offset_ns=np.array([0, 100, 50_000_000, 70_000_000, 99_999_999]),
            intensities=RNG.random(5).astype(np.float32),
        ),
    ),
    (
        "sensor_msgs/msg/PointCloud2",
        PointCloud(
            stamp_ns=STAMP,
            frame_id="lidar",
            points_m=np.ones((2, 3), dtype=np.float32),
            offset_ns=np.array([-100_000_000, 0]),
        ),
    ),
    (
        "sensor_msgs/msg/PointCloud2",
        PointCloud(
            stamp_ns=STAMP,
            frame_id="lidar",
            points_m=RNG.normal(size=(4, 3)).astype(np.float32),
            offset_ns=np.array([0, 10, 50_000_000, 99_999_999]),
            intensities=RNG.random(4).astype(np.float32),
            rings=np.array([0, 1, 1, 2], dtype=np.uint16),
            shape=(3, 5),
            cells=np.array([2, 5, 9, 14]),
        ),
    ),
    ("sensor_msgs/msg/PointCloud2", PointCloud(stamp_ns=STAMP, frame_id="l", points_m=np.zeros((0, 3), np.float32))),
    (
        "sensor_msgs/msg/Imu",
        ImuSample(
            stamp_ns=STAMP,
            frame_id="imu",
            angular_rad_s=np.array([0.1, 0.2, 0.3]),
            acceleration_m_s2=np.array([0.0, 0.5, 9.8]),
            quat_xyzw=QUAT,
        ),
    ),
    (
        "sensor_msgs/msg/Imu",
        ImuSample(stamp_ns=STAMP, frame_id="imu", angular_rad_s=np.zeros(3), acceleration_m_s2=np.ones(3)),
    ),
    (
        "sensor_msgs/msg/Image",
        Image(stamp_ns=STAMP, frame_id="c", encoding="mono8", pixels=RNG.integers(0, 255, (5, 7), np.uint8)),
    ),
    (
        "sensor_msgs/msg/Image",
        Image(stamp_ns=STAMP, frame_id="c", encoding="rgb8", pixels=RNG.integers(0, 255, (5, 7, 3), np.uint8)),
    ),
    (
        "sensor_msgs/msg/Image",
        Image(
            stamp_ns=STAMP,
            frame_id="c",
            encoding="depth",
            pixels=np.array([[0.5, np.nan], [0.0, 3.25]], dtype=np.float32),
        ),
    ),
    (
        "sensor_msgs/msg/CameraInfo",
        CameraModel(
            stamp_ns=STAMP,
            frame_id="c",
            width=640,
            height=480,
            distortion_model="plumb_bob",
            distortion=np.array([0.1, -0.2, 0.0, 0.001, 0.0]),
            intrinsics=np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]),
            rectification=np.eye(3),
            projection=np.array([[500.0, 0, 320, -50], [0, 500, 240, 0], [0, 0, 1, 0]]),
        ),
    ),
    (
        "nav_msgs/msg/Odometry",
        Odometry(
            stamp_ns=STAMP,
            frame_id="odom",
            child_frame_id="base_link",
            position_m=np.array([1.0, -2.0, 0.25]),
            quat_xyzw=QUAT,
            covariance=np.diag(np.arange(1.0, 7.0)),
            linear_m_s=np.array([0.5, 0.0, 0.0]),
            angular_rad_s=np.array([0.0, 0.0, 0.25]),
        ),
    ),
    (
        "geometry_msgs/msg/PoseStamped",
        StampedPose(stamp_ns=STAMP, frame_id="map", position_m=np.array([1.0, 2.0, 3.0]), quat_xyzw=QUAT),
    ),
    (
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        StampedPose(
            stamp_ns=STAMP,
            frame_id="map",
            position_m=np.array([1.0, 2.0, 3.0]),
            quat_xyzw=QUAT,
            covariance=np.diag(np.arange(1.0, 7.0)),
        ),
    ),
    (
        "geometry_msgs/msg/TwistStamped",
        StampedTwist(
            stamp_ns=STAMP, frame_id="base", linear_m_s=np.array([1.0, 0, 0]), angular_rad_s=np.array([0, 0, 0.5])
        ),
    ),
    (
        "geometry_msgs/msg/Twist",
        StampedTwist(
            stamp_ns=STAMP, frame_id="", linear_m_s=np.array([1.0, 0, 0]), angular_rad_s=np.array([0, 0, 0.5])
        ),
    ),
    (
        "tf2_msgs/msg/TFMessage",
        FrameTransform(
            stamp_ns=STAMP,
            parent_frame_id="odom",
            child_frame_id="base",
            position_m=np.array([1.0, 2.0, 3.0]),
            quat_xyzw=QUAT,
        ),
    ),
    (
        "geometry_msgs/msg/TransformStamped",
        FrameTransform(
            stamp_ns=STAMP,
            parent_frame_id="odom",
            child_frame_id="base",
            position_m=np.array([1.0, 2.0, 3.0]),
            quat_xyzw=QUAT,
        ),
    ),
    (
        "nav_msgs/msg/OccupancyGrid",
        StampedGrid(
            stamp_ns=STAMP,
            grid=OccupancyGrid(
                cells=RNG.integers(-1, 101, (4, 6)).astype(np.int8), resolution_m=0.05, origin=(-1.0, 2.0, 0.5)
            ),
        ),
    ),
    (
        "nav_msgs/msg/Path",
        StampedPath(
            stamp_ns=STAMP,
            path=Trajectory.from_se2([STAMP, STAMP + 1, STAMP + 2], [[0, 0, 0], [1, 0, 0.5], [2, 1, 1.0]], "map"),
        ),
    ),
    (
        "geometry_msgs/msg/PoseArray",
        StampedPoses(
            stamp_ns=STAMP, frame_id="map", positions_m=RNG.normal(size=(4, 3)), quats_xyzw=np.tile(QUAT, (4, 1))
        ),
    ),
    (
        "geometry_msgs/msg/PoseArray",
        StampedPoses(stamp_ns=STAMP, frame_id="map", positions_m=np.zeros((0, 3)), quats_xyzw=np.zeros((0, 4))),
    ),
    ("std_msgs/msg/String", StampedText(stamp_ns=STAMP, text="aborted: no path – the goal lies in a wall")),
    (
        "sensor_msgs/msg/NavSatFix",
        GeoFix(
            stamp_ns=STAMP,
            frame_id="gps",
            latitude_deg=48.25,
            longitude_deg=-11.5,
            altitude_m=512.0,
            covariance_m2=np.diag([1.0, 2.0, 4.0]),
        ),
    ),
    (
        "cartographer_ros_msgs/msg/LandmarkList",
        Landmarks(
            stamp_ns=STAMP,
            frame_id="camera",
            observations=(
                LandmarkObservation(
                    id="tag 7",
                    position_m=np.array([1.0, 2.0, 3.0]),
                    quat_xyzw=QUAT,
                    translation_weight=2.0,
                    rotation_weight=0.0,
                ),
            ),
        ),
    ),
    ("cartographer_ros_msgs/msg/LandmarkList", Landmarks(stamp_ns=STAMP, frame_id="c", observations=())),
]


def assert_equal(a: Any, b: Any, where: str = "") -> None:
    """Compare two records field by field, arrays by value and dtype."""
    assert type(a) is type(b), where
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            if field.name != "topic":
                assert_equal(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, np.ndarray):
        assert a.shape == b.shape, where
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15 if a.dtype == np.float64 else 0, err_msg=where)
    elif isinstance(a, tuple):
        for x, y in zip(a, b, strict=True):
            assert_equal(x, y, where)
    elif isinstance(a, float):
        assert a == pytest.approx(b, abs=1e-12), where
    else:
        assert a == b, where


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@pytest.mark.parametrize(("msgtype", "measurement"), MEASUREMENTS, ids=lambda v: v if isinstance(v, str) else "")
def test_every_measurement_survives_writing_and_reading(encoding: str, msgtype: str, measurement: Any) -> None:
    container = MemoryContainer(encoding)
    container.writer().write("/topic", measurement, msgtype=msgtype)
    recording = container.recording()
    (read,) = list(recording.measurements(["/topic"]))
    assert not recording.log.warnings
    assert_equal(read, measurement)
    assert getattr(read, "topic", "/topic") == "/topic"


def test_every_adapter_is_tried_above() -> None:
    tried = {msgtype for msgtype, _ in MEASUREMENTS}
    assert {adapter.msgtypes[0] for adapter in ADAPTERS} - tried == {"sensor_msgs/msg/CompressedImage"}


def test_the_first_adapter_of_a_type_writes_it() -> None:
    assert encoder_for(_scan()).msgtypes[0] == "sensor_msgs/msg/LaserScan"
    with pytest.raises(RecordingError, match="cannot write LaserScan as nav_msgs/msg/Path: it can be written as"):
        encoder_for(_scan(), "nav_msgs/msg/Path")
    with pytest.raises(RecordingError, match="cannot write int: it can be written as no message type"):
        encoder_for(3)


def test_poses_of_a_wrong_shape_are_refused() -> None:
    with pytest.raises(DataError, match=r"poses: \(2, 3\) positions, \(1, 4\) orientations"):
        StampedPoses(stamp_ns=0, frame_id="map", positions_m=np.zeros((2, 3)), quats_xyzw=np.zeros((1, 4)))


def _context(topic: str = "/t", **mends: Any) -> DecodeContext:
    return DecodeContext(topic, Mends(**mends), RunLog())


def _scan_message(**changes: Any) -> Any:
    messages = message_factory("cdr")
    message = encoder_for(_scan()).encode(_scan(), messages)
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def _decode(message: Any, context: DecodeContext) -> Any:
    adapter = next(a for a in ADAPTERS if a.msgtypes[0] == message.__msgtype__)
    (measurement,) = adapter.decode(message, STAMP, context)
    return measurement


def test_angle_max_that_does_not_fit_is_counted_and_the_increment_followed() -> None:
    context = _context()
    scan = _decode(_scan_message(angle_max=3.0), context)
    assert scan.angle_increment_rad == 0.25
    assert list(context.log.counts) == [
        "/t: scans whose angle_max does not fit the number of beams (angle_increment is followed)"
    ]
    # One increment more or less is how many drivers write a full circle.
    for angle_max in (-1.5 + 6 * 0.25, -1.5 + 4 * 0.25):
        context = _context()
        _decode(_scan_message(angle_max=angle_max), context)
        assert not context.log.counts


def test_a_missing_increment_is_taken_from_angle_max() -> None:
    context = _context()
    assert _decode(_scan_message(angle_increment=0.0, angle_max=1.0), context).angle_increment_rad == 0.5
    assert sum(context.log.counts.values()) == 1


def test_a_flipped_scan_runs_the_other_way_round() -> None:
    scan = _decode(_scan_message(), _context(flip_scan=True))
    np.testing.assert_allclose(scan.angles_rad, -_scan().angles_rad)
    np.testing.assert_array_equal(scan.ranges_m, _scan().ranges_m)


def test_frames_are_renamed_and_lose_their_slash() -> None:
    message = _scan_message()
    message.header.frame_id = "/laser"
    assert _decode(message, _context()).frame_id == "laser"
    assert _decode(message, _context(renamed_frames={"laser": "lidar"})).frame_id == "lidar"


def test_an_unset_orientation_is_the_identity_and_counted() -> None:
    messages = message_factory("cdr")
    pose = StampedPose(stamp_ns=STAMP, frame_id="m", position_m=np.zeros(3), quat_xyzw=np.zeros(4))
    context = _context()
    read = _decode(encoder_for(pose).encode(pose, messages), context)
    np.testing.assert_array_equal(read.quat_xyzw, [0, 0, 0, 1])
    assert sum(context.log.counts.values()) == 1


def _cloud(fields: list[tuple[str, int, int]], data: bytes, step: int, **changes: Any) -> Any:
    messages = message_factory("cdr")
    values = dict(height=1, width=len(data) // step, bigendian=False, row_step=len(data))
    values.update(changes)
    return messages.make(
        "sensor_msgs/msg/PointCloud2",
        messages.header(STAMP, "lidar"),
        values["height"],
        values["width"],
        [messages.make("sensor_msgs/msg/PointField", name, offset, kind, 1) for name, offset, kind in fields],
        values["bigendian"],
        step,
        values["row_step"],
        np.frombuffer(data, dtype=np.uint8),
        False,
    )


XYZ = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]


def test_an_organised_padded_cloud_without_its_invalid_points() -> None:
    table = np.zeros((2, 3), dtype={"names": ["x", "y", "z", "i"], "formats": ["<f4", "<f4", "<f4", "<u2"],
                                    "offsets": [0, 4, 8, 16], "itemsize": 20})  # fmt: skip
    table["x"] = [[1, 2, np.nan], [4, np.inf, 6]]
    table["i"] = [[1, 2, 3], [4, 5, 6]]
    rows = b"".join(row.tobytes() + b"\xff" * 4 for row in table)
    cloud = _decode(_cloud([*XYZ, ("i", 16, 4)], rows, 20, height=2, width=3, row_step=64), _context())
    np.testing.assert_array_equal(cloud.points_m[:, 0], [1, 2, 4, 6])
    np.testing.assert_array_equal(cloud.intensities, [1, 2, 4, 6])


def test_a_big_endian_cloud_of_doubles() -> None:
    data = np.array([[1.5, 2.5, 3.5]], dtype=">f8").tobytes()
    cloud = _decode(_cloud([("x", 0, 8), ("y", 8, 8), ("z", 16, 8)], data, 24, bigendian=True), _context())
    np.testing.assert_array_equal(cloud.points_m, [[1.5, 2.5, 3.5]])


def test_points_at_exactly_zero_are_no_returns_and_times_are_cut_with_them() -> None:
    table = np.zeros(4, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("timestamp", "<f8")])
    table["x"], table["timestamp"] = [1, 0, np.nan, 4], STAMP // 10**9 + np.array([0.25, 0.26, 0.27, 0.28])
    fields = [*XYZ, ("timestamp", 12, 8)]
    cloud = _decode(_cloud(fields, table.tobytes(), 20, height=2, width=2, row_step=40), _context())
    np.testing.assert_array_equal(cloud.points_m[:, 0], [1, 4])
    np.testing.assert_allclose(cloud.offset_ns, np.array([250_000_000, 280_000_000]) - STAMP % 10**9, atol=500)


def test_point_times_of_another_clock_are_counted() -> None:
    table = np.zeros(2, dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<f8")])
    table["x"], table["t"] = 1.0, [5321.0, 5321.1]
    context = _context()
    cloud = _decode(_cloud([*XYZ, ("t", 12, 8)], table.tobytes(), 20), context)
    np.testing.assert_allclose(cloud.offset_ns, [0, 100_000_000], atol=10)
    assert [text.split(": ")[1] for text in context.log.counts] == [
        "clouds whose point times are of another clock than the stamp"
    ]
    table["t"] = [1e18, -1e18]
    context = _context()
    assert _decode(_cloud([*XYZ, ("t", 12, 8)], table.tobytes(), 20), context).offset_ns is None
    assert sum(context.log.counts.values()) == 1


@pytest.mark.parametrize(
    ("message", "complaint"),
    [
        (lambda: _cloud(XYZ[:2], b"\0" * 12, 12), "without field z"),
        (lambda: _cloud(XYZ, b"\0" * 12, 12, width=2), r"2 x 1 points of 12 bytes in 12 bytes"),
        (lambda: _cloud(XYZ, b"\0" * 12, 12, width=2**32 - 1, height=2**32 - 1), "in 12 bytes"),
        (lambda: _cloud([("x", 8, 8)], b"\0" * 12, 12), "beyond point_step 12"),
        (lambda: _cloud([("x", 0, 99)], b"\0" * 12, 12), "unknown datatype 99"),
    ],
)
def test_broken_clouds(message: Any, complaint: str) -> None:
    with pytest.raises(DataError, match=complaint):
        _decode(message(), _context())


def _image(encoding: str, pixels: np.ndarray, **changes: Any) -> Any:
    messages = message_factory("cdr")
    data = np.ascontiguousarray(pixels)
    values: dict[str, Any] = dict(
        height=data.shape[0], width=data.shape[1], big=0, step=data.strides[0], data=data.reshape(-1).view(np.uint8)
    )
    values.update(changes)
    return messages.make(
        "sensor_msgs/msg/Image", messages.header(STAMP, "c"), values["height"], values["width"], encoding,
        values["big"], values["step"], values["data"],
    )  # fmt: skip


def test_colour_with_alpha_loses_it() -> None:
    pixels = RNG.integers(0, 255, (4, 6, 4), np.uint8)
    for encoding, expected in (("bgra8", "bgr8"), ("rgba8", "rgb8")):
        image = _decode(_image(encoding, pixels), _context())
        assert image.encoding == expected
        np.testing.assert_array_equal(image.pixels, pixels[..., :3])


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_bayer_patterns_give_their_colour(pattern: str, bits: int) -> None:
    colour = {"r": 200, "g": 100, "b": 50}
    tile = np.array([[colour[pattern[0]], colour[pattern[1]]], [colour[pattern[2]], colour[pattern[3]]]])
    pixels = np.tile(tile, (4, 4)) * (1 if bits == 8 else 256)
    image = _decode(_image(f"bayer_{pattern}{bits}", pixels.astype(f"u{bits // 8}")), _context())
    assert image.encoding == "bgr8"
    np.testing.assert_array_equal(image.pixels[2:-2, 2:-2].reshape(-1, 3), np.tile([50, 100, 200], (16, 1)))


def test_yuv_in_both_byte_orders() -> None:
    grey = np.array([[[128, 90], [128, 90]]], dtype=np.uint8).repeat(4, axis=0)  # u y v y: no colour
    expected = round((90 - 16) * 255 / 219)
    uyvy = _decode(_image("yuv422", grey), _context())
    yuyv = _decode(_image("yuv422_yuy2", grey[..., ::-1]), _context())
    np.testing.assert_allclose(uyvy.pixels, expected, atol=1)
    np.testing.assert_array_equal(uyvy.pixels, yuyv.pixels)


def test_depth_in_millimetres_metres_and_given_units() -> None:
    raw = np.array([[0, 1500], [2500, 65535]], dtype=np.uint16)
    np.testing.assert_allclose(_decode(_image("16UC1", raw), _context()).pixels, raw / 1000, rtol=1e-6)
    mend = _context(depth_units_per_m=5000.0)
    np.testing.assert_allclose(_decode(_image("16UC1", raw), mend).pixels, raw / 5000, rtol=1e-6)
    big = _image("16UC1", raw.astype(">u2"), big=1)
    np.testing.assert_allclose(_decode(big, _context()).pixels, raw / 1000, rtol=1e-6)
    metres = np.array([[0.5, np.nan]], dtype=np.float32)
    np.testing.assert_array_equal(_decode(_image("32FC1", metres), _context()).pixels, metres)


def test_the_depth_unit_of_settings_is_for_whole_numbers() -> None:
    raw = np.arange(6, dtype=np.uint16).reshape(2, 3) * 1000
    context = _context(settings_depth_units_per_m=5000.0)
    np.testing.assert_allclose(_decode(_image("16UC1", raw), context).pixels, raw / 5000, rtol=1e-6)
    assert context.log.notes == []
    np.testing.assert_array_equal(_decode(_image("32FC1", raw.astype(np.float32)), context).pixels, raw)
    assert "DepthMapFactor 5000 is for whole numbers" in context.log.notes[0]
    both = _context(settings_depth_units_per_m=5000.0, depth_units_per_m=2.0)
    np.testing.assert_array_equal(_decode(_image("32FC1", raw.astype(np.float32)), both).pixels, raw / 2)


def test_mono16_is_depth_only_on_a_depth_topic() -> None:
    raw = np.array([[256, 51200]], dtype=np.uint16)
    assert _decode(_image("mono16", raw), _context("/camera/ir/image_raw")).pixels.tolist() == [[1, 200]]
    assert _decode(_image("mono16", raw), _context("/camera/depth/image_raw")).encoding == "depth"


@pytest.mark.parametrize(
    ("changes", "encoding", "complaint"),
    [
        ({"height": 10}, "mono8", r"image of 6 x 10 \(mono8, step 6\) in 24 bytes"),
        ({"step": 3}, "mono8", "step 3"),
        ({"height": 2**32 - 1, "width": 2**32 - 1, "step": 2**32 - 1}, "mono8", "in 24 bytes"),
        ({"height": 0}, "mono8", "image of 6 x 0"),
        ({}, "nv21", r"encoding 'nv21' is not decoded \(known: mono8"),
    ],
)
def test_broken_images(changes: dict[str, Any], encoding: str, complaint: str) -> None:
    with pytest.raises(DataError, match=complaint):
        _decode(_image(encoding, np.zeros((4, 6), np.uint8), **changes), _context())


def test_padded_rows_are_cut() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(4, 6)
    image = _decode(_image("mono8", pixels, width=5), _context())
    np.testing.assert_array_equal(image.pixels, pixels[:, :5])


def _compressed(format: str, data: Any) -> Any:
    messages = message_factory("cdr")
    return messages.make(
        "sensor_msgs/msg/CompressedImage", messages.header(STAMP, "c"), format, np.frombuffer(bytes(data), np.uint8)
    )


def _png(pixels: np.ndarray) -> bytes:
    import cv2

    return cv2.imencode(".png", pixels)[1].tobytes()


def test_compressed_images_written_and_read() -> None:
    smooth = np.stack([np.add.outer(np.arange(32), np.arange(48))] * 3, axis=-1).astype(np.uint8)
    smooth[..., 0] += 100
    for image in (
        Image(stamp_ns=STAMP, frame_id="c", encoding="rgb8", pixels=smooth),
        Image(stamp_ns=STAMP, frame_id="c", encoding="mono8", pixels=smooth[..., 0]),
    ):
        container = MemoryContainer()
        container.writer().write("/c/compressed", image, msgtype="sensor_msgs/msg/CompressedImage")
        (read,) = container.recording().measurements(["/c/compressed"])
        expected = smooth[..., ::-1] if image.encoding == "rgb8" else smooth[..., 0]
        assert read.encoding == ("bgr8" if image.encoding == "rgb8" else "mono8")
        assert np.abs(read.pixels.astype(int) - expected).mean() < 3


def test_png_colour_is_exact() -> None:
    pixels = RNG.integers(0, 255, (4, 6, 3), np.uint8)
    image = _decode(_compressed("png", _png(pixels)), _context())
    assert image.encoding == "bgr8"
    np.testing.assert_array_equal(image.pixels, pixels)


def test_compressed_depth_in_millimetres_and_as_inverse_depth() -> None:
    depth = np.array([[0.5, 1.0], [4.0, np.nan]], dtype=np.float32)
    container = MemoryContainer()
    image = Image(stamp_ns=STAMP, frame_id="c", encoding="depth", pixels=depth)
    container.writer().write("/d/compressedDepth", image, msgtype="sensor_msgs/msg/CompressedImage")
    (read,) = container.recording().measurements(["/d/compressedDepth"])
    np.testing.assert_array_equal(read.pixels, [[0.5, 1.0], [4.0, 0.0]])

    a, b = np.float32(2000.0), np.float32(-99.5)
    quantised = np.where(np.isnan(depth), 0, np.rint(a / depth + b)).astype(np.uint16)
    header = np.array([1], "<i4").tobytes() + np.array([a, b], "<f4").tobytes()
    read = _decode(_compressed("32FC1; compressedDepth", header + _png(quantised)), _context())
    np.testing.assert_allclose(read.pixels, depth, rtol=2e-3)
    read = _decode(_compressed("16UC1; compressedDepth", bytes(12) + _png(quantised)), _context())
    np.testing.assert_allclose(read.pixels, quantised / 1000, rtol=1e-6)


def test_broken_compressed_images() -> None:
    bomb = b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR" + np.array([60000, 60000], ">u4").tobytes() + bytes(20)
    for layout, data, complaint in (
        ("jpeg", b"", "damaged"),
        ("jpeg", b"\xff\xd8garbage and more of it", "damaged"),
        ("png", bomb, "60000 x 60000 pixels is larger"),
        ("16UC1; compressedDepth", bytes(5), "compressed depth of 5 bytes"),
        ("16UC1; compressedDepth rvl", bytes(50), "only PNG is decoded"),
    ):
        with pytest.raises(DataError, match=complaint):
            _decode(_compressed(layout, data), _context())


def test_the_size_that_files_claim() -> None:
    import cv2

    pixels = np.zeros((21, 34, 3), np.uint8)
    assert image_size(_png(pixels)) == (34, 21)
    assert image_size(cv2.imencode(".jpg", pixels)[1].tobytes()) == (34, 21)
    assert image_size(b"\xff\xd8\xff") == (0, 0)


def test_a_given_calibration_replaces_the_recorded_one() -> None:
    recorded = next(m for t, m in MEASUREMENTS if t == "sensor_msgs/msg/CameraInfo")
    given = dataclasses.replace(recorded, width=320, stamp_ns=0, frame_id="")
    message = encoder_for(recorded).encode(recorded, message_factory("ros1"))
    for key in ("", "/t"):
        read = _decode(message, _context(camera_models={key: given}))
        assert (read.width, read.stamp_ns, read.frame_id) == (320, STAMP, "c")
    assert _decode(message, _context(camera_models={"/other": given})).width == 640


def test_all_known_encodings_have_a_layout() -> None:
    assert set(image_adapter._CV_BAYER) == {v[2] for k, v in image_adapter._LAYOUTS.items() if k.startswith("bayer")}


def test_multi_echo_takes_the_first_echo() -> None:
    messages = message_factory("cdr")
    scan = _scan()
    message = encoder_for(scan, "sensor_msgs/msg/MultiEchoLaserScan").encode(scan, messages)
    message.ranges[0] = SimpleNamespace(echoes=np.array([2.0, 5.0], np.float32))
    message.ranges[1] = SimpleNamespace(echoes=np.zeros(0, np.float32))
    read = _decode(message, _context())
    assert read.ranges_m[0] == 2.0
    assert np.isnan(read.ranges_m[1])


def test_a_receiver_without_a_fix() -> None:
    lost = GeoFix(
        stamp_ns=STAMP, frame_id="gps", latitude_deg=np.nan, longitude_deg=0.0, altitude_m=np.nan, has_fix=False
    )
    container = MemoryContainer()
    container.writer().write("/fix", lost)
    (read,) = list(container.recording().measurements(["/fix"]))
    assert not read.has_fix
    assert read.covariance_m2 is None


def test_landmarks_under_the_fields_old_name() -> None:
    q, p = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0), SimpleNamespace(x=1.0, y=2.0, z=3.0)
    pose = SimpleNamespace(position=p, orientation=q)
    entry = SimpleNamespace(id="a", tracking_from_landmark_transform=pose, translation_weight=3.0, rotation_weight=4.0)
    message = SimpleNamespace(header=SimpleNamespace(frame_id="/camera"), landmark=[entry])
    (read,) = landmark_list.ADAPTER.decode(message, STAMP, _context())
    assert read.frame_id == "camera"
    assert [(seen.id, seen.translation_weight, seen.rotation_weight) for seen in read.observations] == [("a", 3.0, 4.0)]


def test_damage_that_shows_without_decoding() -> None:
    import cv2

    png = bytes(cv2.imencode(".png", np.arange(600, dtype=np.uint8).reshape(20, 30))[1])
    jpeg = bytes(cv2.imencode(".jpg", np.zeros((20, 30), np.uint8))[1])
    assert damage_of(png) == damage_of(jpeg) == damage_of(b"P5 1 1 255 0") == damage_of(png + b"behind the end") == ""
    assert damage_of(png[:-5]) == f"damaged (cut off after {len(png) - 5} bytes)"
    assert damage_of(jpeg[:-2]) == f"damaged (cut off after {len(jpeg) - 2} bytes)"
    at = png.index(b"IDAT") + 8
    assert damage_of(png[:at] + bytes([png[at] ^ 1]) + png[at + 1 :]) == f"damaged (checksum of IDAT at byte {at - 12})"
    remark = b"\0\0\0\x01tEXtx" + bytes(4)  # its checksum is wrong, which harms no pixel
    assert damage_of(png[:33] + remark + png[33:]) == ""
