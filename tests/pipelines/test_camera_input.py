# SPDX-License-Identifier: MIT
"""What a tier that sees is fed: topics, mode, calibration, places, and what is said of bad input."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slamcli.errors import CalibrationError, InputError, RecordingError, UsageError
from slamcli.measurements import CameraModel, FrameTransform, Image, ImuSample, RgbdFrame, StereoPair
from slamcli.orbslam3 import TIER
from slamcli.pipelines.camera_calibration import load_calibration, read_calibration
from slamcli.pipelines.camera_input import CameraFeed
from slamcli.pipelines.camera_request import depth_unit, feed_of
from slamcli.pipelines.config import load_native
from slamcli.recordings import Mends, create_recording, open_recording
from slamcli.recordings.camera_topics import CameraNames, stereo_partner
from slamcli.recordings.sensor_picks import TopicNames
from slamcli.runtime import RunLog
from slamcli.vision.preparation import Preparation

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
START = 1_700_000_000_000_000_000
MS = 1_000_000
SIZE = (32, 24)
K = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
CAMERA_YAML = """image_width: 32
image_height: 24
camera_matrix: {rows: 3, cols: 3, data: [31.0, 0, 15.5, 0, 31.0, 11.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, 0, 0, 0, 0]}
"""
SETTINGS = "Camera.fx: 33.0\nCamera.fy: 33.0\nCamera.cx: 15.5\nCamera.cy: 11.5\n"


def image(i: int, frame: str = "camera", size: tuple[int, int] = SIZE, value: int = 50) -> Image:
    pixels = np.full((size[1], size[0]), value, np.uint8)
    return Image(stamp_ns=START + i * 50 * MS, frame_id=frame, encoding="mono8", pixels=pixels)


def depth(i: int, metres: float = 2.0, frame: str = "camera", size: tuple[int, int] = SIZE) -> Image:
    pixels = np.full((size[1], size[0]), metres, np.float32)
    return Image(stamp_ns=START + i * 50 * MS + 2 * MS, frame_id=frame, encoding="depth", pixels=pixels)


def info(shift: float = 0.0, size: tuple[int, int] = SIZE, distortion: float = 0.0, fx: float = 30.0) -> CameraModel:
    matrix = K.copy()
    matrix[0, 0] = matrix[1, 1] = fx
    P = np.hstack([matrix, [[shift], [0.0], [0.0]]])
    return CameraModel(
        stamp_ns=START, frame_id="camera", width=size[0], height=size[1], distortion_model="plumb_bob",
        distortion=np.array([distortion, 0.0, 0.0, 0.0, 0.0]), intrinsics=matrix, rectification=np.eye(3), projection=P,
    )  # fmt: skip


def imu(i: int) -> ImuSample:
    return ImuSample(
        stamp_ns=START + i * 10 * MS,
        frame_id="imu_frame",
        angular_rad_s=np.zeros(3),
        acceleration_m_s2=np.array([0, 0, 9.81]),
    )


def place(parent: str, child: str, position: tuple[float, float, float]) -> FrameTransform:
    return FrameTransform(
        stamp_ns=START, parent_frame_id=parent, child_frame_id=child, position_m=np.array(position),
        quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]), static=True,
    )  # fmt: skip


def record(path: Path, topics: dict[str, list[Any]], places: tuple[FrameTransform, ...] = ()) -> Path:
    with create_recording(path) as writer:
        if places:
            writer.write_transforms("/tf_static", places, log_time_ns=START)
        entries = [(m.stamp_ns, topic, m) for topic, found in topics.items() for m in found]
        for _, topic, measurement in sorted(entries, key=lambda entry: entry[:2]):
            writer.write(topic, measurement)
    return path


def rgbd_topics(**changes: Any) -> dict[str, list[Any]]:
    return {
        "/camera/rgb/camera_info": [info()],
        "/camera/rgb/image_raw": [image(i) for i in range(6)],
        "/camera/depth/image_raw": [depth(i) for i in range(6)],
        **changes,
    }


def stereo_topics(
    shift: float = -3.0, frames: tuple[str, str] = ("camera", "camera"), **changes: Any
) -> dict[str, list[Any]]:
    return {
        "/left/camera_info": [info()],
        "/left/image_raw": [image(i, frames[0]) for i in range(6)],
        "/right/camera_info": [info(shift)],
        "/right/image_raw": [image(i, frames[1], value=60) for i in range(6)],
        **changes,
    }


class Fed:
    """A feed, its log, and what it gives."""

    def __init__(
        self, path: Path, *, mode: str | None = None, names: CameraNames | None = None, cameras: tuple[Path, ...] = (),
        config: tuple[Path, ...] = (), sets: tuple[str, ...] = (), mends: Mends | None = None, base_frame: str | None = None,
        imu_topic: str | None = None, scans: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        self.log = RunLog()
        native = load_native("orbslam3", config, sets, self.log)
        with open_recording(path, mends=depth_unit(mends or Mends(), native), log=self.log) as recording:
            self.feed: CameraFeed = feed_of(
                recording, TIER, native, TopicNames(base_frame=base_frame, imu=imu_topic, scans=scans), names or CameraNames(),
                cameras, self.log, mode=mode, start_s=None, duration_s=None,
            )  # fmt: skip
            self.measurements = list(self.feed.measurements())
        self.kinds = Counter(type(m).__name__ for m in self.measurements)
        self.rig = self.feed.rig


def test_colour_and_depth(tmp_path: Path) -> None:
    fed = Fed(record(tmp_path / "a.mcap", rgbd_topics()))
    assert fed.kinds == {"RgbdFrame": 6}
    assert fed.feed.topics == {"rgb": "/camera/rgb/image_raw", "depth": "/camera/depth/image_raw"}
    assert (fed.rig.mode, fed.rig.main.intrinsics[0, 0], fed.feed.base_frame) == ("rgbd", 30.0, "camera")
    assert fed.rig.rate_hz == pytest.approx(20.0)
    assert fed.feed.length_s == pytest.approx(0.25)
    assert any("mode rgbd" in note for note in fed.log.notes)
    assert fed.log.warnings == []
    frame = fed.measurements[0]
    assert isinstance(frame, RgbdFrame)
    assert Preparation(fed.rig).prepare(frame).depth is not None


def test_one_camera_when_asked(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", rgbd_topics())
    assert Fed(path, mode="mono").kinds == {"Image": 6}
    with pytest.raises(UsageError, match="--mode stereo needs images of a left and a right camera"):
        Fed(path, mode="stereo")
    with pytest.raises(UsageError, match="--mode fast: orbslam3 has mono, stereo"):
        Fed(path, mode="fast")
    with pytest.raises(UsageError, match="--mode mono-inertial needs an IMU"):
        Fed(path, mode="mono-inertial")
    with pytest.raises(UsageError, match="--scan-topic /scan: orbslam3 has no use"):
        Fed(path, scans=("/scan",))


def test_stereo_with_the_baseline_in_p(tmp_path: Path) -> None:
    fed = Fed(record(tmp_path / "a.mcap", stereo_topics()))
    assert fed.kinds == {"StereoPair": 6}
    assert fed.rig.T_main_right is None
    prepared = Preparation(fed.rig)
    assert prepared.camera.baseline_m == pytest.approx(0.1)
    frame = fed.measurements[0]
    assert isinstance(frame, StereoPair)
    assert frame.right.pixels[0, 0] == 60


def test_stereo_with_places_in_tf(tmp_path: Path) -> None:
    frames = ("base_link/left", "base_link/right")
    places = (place("base_link", frames[0], (1.0, 0.0, 0.5)), place("base_link", frames[1], (1.2, 0.0, 0.5)))
    fed = Fed(record(tmp_path / "a.mcap", stereo_topics(0.0, frames), places))
    assert fed.rig.T_main_right is not None
    np.testing.assert_allclose(fed.rig.T_main_right[:3, 3], [0.2, 0.0, 0.0], atol=1e-12)
    assert (fed.feed.base_frame, fed.rig.base_is_upright) == ("base_link", True)
    np.testing.assert_allclose(fed.rig.T_base_main[:3, 3], [1.0, 0.0, 0.5])
    alone = Fed(tmp_path / "a.mcap", base_frame=frames[0])
    np.testing.assert_array_equal(alone.rig.T_base_main, np.eye(4))
    with pytest.raises(CalibrationError, match="tf does not connect"):
        Fed(tmp_path / "a.mcap", base_frame="arm")


def test_stereo_whose_place_is_unknown(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", stereo_topics(0.0))
    with pytest.raises(CalibrationError, match=r"holds no baseline in P.*--camera FILE"):
        Fed(path)
    settings = tmp_path / "s.yaml"
    settings.write_text(SETTINGS + "Camera.bf: 6.6\n")
    fed = Fed(path, cameras=(settings,))
    assert Preparation(fed.rig).camera.baseline_m == pytest.approx(0.2)
    assert any("the recording's own says 30 px" in warning for warning in fed.log.warnings)


def test_imu_is_used_when_asked_or_calibrated(tmp_path: Path) -> None:
    topics = rgbd_topics(**{"/imu": [imu(i) for i in range(40)]})
    path = record(tmp_path / "a.mcap", topics, (place("camera", "imu_frame", (0.0, 0.1, 0.0)),))
    assert Fed(path).kinds == {"RgbdFrame": 6}  # its noise is unknown
    fed = Fed(path, mode="rgbd-inertial")
    assert fed.kinds["ImuSample"] == 26  # up to the last frame at 250 ms
    assert fed.rig.T_main_imu is not None
    np.testing.assert_allclose(fed.rig.T_main_imu[:3, 3], [0.0, 0.1, 0.0])
    assert fed.feed.topics["imu"] == "/imu"
    assert Fed(path, imu_topic="/imu").rig.inertial
    noisy = Fed(path, sets=("IMU.NoiseGyro=0.001",))
    assert noisy.rig.inertial
    assert noisy.rig.imu_noise.gyroscope == 0.001
    assert not Fed(path, sets=("IMU.NoiseGyro=0.001",), imu_topic="none").rig.inertial


def test_imu_whose_place_is_unknown(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", rgbd_topics(**{"/imu": [imu(i) for i in range(40)]}))
    with pytest.raises(CalibrationError, match=r"where does the IMU \(imu_frame\) sit"):
        Fed(path, mode="rgbd-inertial")
    fed = Fed(path, mode="rgbd-inertial", sets=("Tbc=1 0 0 0.1 0 1 0 0 0 0 1 0 0 0 0 1",))
    assert fed.feed.base_frame == "imu_frame"
    np.testing.assert_allclose(fed.rig.T_base_main[:3, 3], [0.1, 0.0, 0.0])


def test_gyroscope_and_accelerometer_on_topics_of_their_own(tmp_path: Path) -> None:
    def half(i: float, what: str) -> ImuSample:
        stamp = START + round(i * MS)
        turn, force = (
            (np.array([0.1, 0.0, i]), np.zeros(3)) if what == "gyro" else (np.zeros(3), np.array([0.0, i, 9.8]))
        )
        return ImuSample(stamp_ns=stamp, frame_id="imu_frame", angular_rad_s=turn, acceleration_m_s2=force)

    topics = rgbd_topics(**{
        "/camera/gyro/sample": [half(i * 5.0, "gyro") for i in range(80)],
        "/camera/accel/sample": [half(2.0 + i * 16.0, "accel") for i in range(30)],
    })  # fmt: skip
    path = record(tmp_path / "a.mcap", topics, (place("camera", "imu_frame", (0.0, 0.1, 0.0)),))
    fed = Fed(path, mode="rgbd-inertial")
    samples = [m for m in fed.measurements if isinstance(m, ImuSample)]
    assert fed.feed.topics["imu"] == ["/camera/gyro/sample", "/camera/accel/sample"]
    assert fed.kinds["RgbdFrame"] == 6
    assert [(s.stamp_ns - START) // MS for s in samples[:3]] == [
        5,
        10,
        15,
    ]  # the one at 0 has no acceleration before it
    for sample in samples:
        ms = (sample.stamp_ns - START) / MS
        np.testing.assert_allclose(sample.angular_rad_s, [0.1, 0.0, ms])
        np.testing.assert_allclose(sample.acceleration_m_s2, [0.0, ms, 9.8])
    assert samples[-1].stamp_ns >= START + 250 * MS


def test_the_missions_settings_and_launch_file(tmp_path: Path) -> None:
    big = (640, 480)
    topics = rgbd_topics(**{
        "/camera/rgb/camera_info": [info(size=big)],
        "/camera/rgb/image_raw": [image(i, size=big) for i in range(2)],
        "/camera/depth/image_raw": [depth(i, size=big) for i in range(2)],
    })  # fmt: skip
    path = record(tmp_path / "a.mcap", topics)
    for config in ("TUM_RGBD.yaml", "orb_slam3_stereo.launch"):
        fed = Fed(path, config=(CONFIGS / config,))
        camera = Preparation(fed.rig).camera
        assert (camera.fx, camera.cx) == (525.0, 319.5)
        assert camera.bf == pytest.approx(40.0)
        assert fed.feed.plan.parameters.device.stereo.th_depth == 40.0
    assert any(
        "the launch file's topic /camera/left/image_raw is not in the recording" in note for note in fed.log.notes
    )


def test_legacy_names_are_set_too(tmp_path: Path) -> None:
    fed = Fed(record(tmp_path / "a.mcap", rgbd_topics()), sets=("ThDepth=35", "Camera.bf=3.0"))
    assert fed.feed.plan.parameters.device.stereo.th_depth == 35.0
    assert fed.rig.baseline_m == pytest.approx(0.1)


def test_depth_unit_by_the_settings_goes_behind_the_option(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", rgbd_topics())

    def first_depth(**arguments: Any) -> float:
        frame = Fed(path, **arguments).measurements[0]
        assert isinstance(frame, RgbdFrame)
        return float(frame.depth.pixels[0, 0])

    assert first_depth() == 2.0
    assert first_depth(sets=("DepthMapFactor=2.0",)) == 2.0  # metres (32FC1) are metres, whatever the settings are for
    assert first_depth(sets=("DepthMapFactor=2.0",), mends=Mends(depth_units_per_m=4.0)) == 0.5


def test_calibration_files_of_every_kind(tmp_path: Path) -> None:
    ros, orb = tmp_path / "ros.yaml", tmp_path / "orb.yaml"
    ros.write_text(CAMERA_YAML)
    orb.write_text("%YAML:1.0\n" + SETTINGS)
    topics = rgbd_topics()
    del topics["/camera/rgb/camera_info"]
    path = record(tmp_path / "a.mcap", topics)
    assert Fed(path, cameras=(ros,)).rig.main.intrinsics[0, 0] == 31.0
    assert Fed(path, cameras=(orb,)).rig.main.intrinsics[0, 0] == 33.0
    mended = Mends(camera_models={"": info(fx=35.0)})
    assert Fed(path, mends=mended).rig.main.intrinsics[0, 0] == 35.0
    pair = load_calibration((ros, orb))
    assert pair is not None
    assert pair.right is not None
    assert pair.right.intrinsics[0, 0] == 33.0
    bad = tmp_path / "bad.yaml"
    bad.write_text("a: 1\n")
    with pytest.raises(CalibrationError, match="no calibration file; known are"):
        read_calibration(bad)
    with pytest.raises(CalibrationError, match="no such file"):
        read_calibration(tmp_path / "none.yaml")
    with pytest.raises(UsageError, match="3 files with cameras"):
        load_calibration((ros, orb, ros))


def drop(*names: str) -> dict[str, list[Any]]:
    return {name: found for name, found in rgbd_topics().items() if name not in names}


@pytest.mark.parametrize(
    ("topics", "error", "words"),
    [
        (drop("/camera/rgb/camera_info"), CalibrationError, r"no calibration of the camera on /camera/rgb/image_raw: give it with --camera FILE"),
        (rgbd_topics(**{"/camera/rgb/camera_info": [info(fx=0.0)]}), CalibrationError, "not calibrated"),
        (rgbd_topics(**{"/camera/rgb/camera_info": [info(size=(32, 32))]}), CalibrationError, "32 x 24 pixels, and the calibration is for 32 x 32"),
        ({"/camera/rgb/camera_info": [info()]}, RecordingError, "no camera images"),
        (rgbd_topics(**{"/camera/depth/image_raw": [replace(depth(i), stamp_ns=START + 10**10 + i) for i in range(3)]}), RecordingError,
         r"was taken within 20 ms of one on /camera/rgb/image_raw \(the first ones are \+10.000 s apart\): shift the stamps with --time-offset"),
    ],
)  # fmt: skip
def test_bad_recordings(tmp_path: Path, topics: dict[str, list[Any]], error: type[InputError], words: str) -> None:
    path = record(tmp_path / "a.mcap", topics)
    with pytest.raises(error, match=words):
        Fed(path)


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        (rgbd_topics(**{"/camera/depth/image_raw": [depth(i, 2000.0) for i in range(6)]}), "is 2e+03 m typically and 2e+03 m at most: is the unit right"),
        (rgbd_topics(**{"/camera/depth/image_raw": [depth(i, 0.4) for i in range(6)]}), "is 0.4 m typically"),
        (rgbd_topics(**{"/camera/depth/image_raw": [depth(i, 0.0) for i in range(6)]}), "has depth in 0 of 48 pixels only"),
        (rgbd_topics(**{"/camera/depth/image_raw": [depth(i, size=(16, 12)) for i in range(6)]}), "16 x 12 pixels, colour on /camera/rgb/image_raw 32 x 24"),
        (rgbd_topics(**{"/camera/rgb/image_raw": [image(i, size=(32, 24) if i != 3 else (16, 12)) for i in range(6)]}), "1 of 6 images are not 32 x 24 pixels"),
        (rgbd_topics(**{"/camera/depth/image_raw": [depth(i) for i in (0, 1, 2, 4, 5)]}), "1 of 6 images of /camera/rgb/image_raw have no depth image"),
        (rgbd_topics(**{"/camera/rgb/camera_info": [info(size=(64, 48))]}), "it is scaled by 0.5"),
    ],
)  # fmt: skip
def test_what_is_said_of_poor_recordings(tmp_path: Path, topics: dict[str, list[Any]], words: str) -> None:
    fed = Fed(record(tmp_path / "a.mcap", topics))
    assert any(words in warning for warning in fed.log.warnings), fed.log.warnings


def test_depth_of_another_camera_is_said(tmp_path: Path) -> None:
    topics = rgbd_topics(**{"/camera/depth/image_raw": [depth(i, frame="ir") for i in range(6)]})
    fed = Fed(record(tmp_path / "a.mcap", topics, (place("camera", "ir", (0.025, 0.0, 0.0)),)))
    assert any("is seen from ir, colour from camera: it is not registered" in warning for warning in fed.log.warnings)


def test_registered_depth_and_raw_images_are_preferred(tmp_path: Path) -> None:
    topics = rgbd_topics(**{
        "/camera/aligned_depth_to_color/image_raw": [depth(i) for i in range(6)],
        "/camera/depth/image_raw": [depth(i, frame="ir") for i in range(6)],
        "/camera/infra1/image_rect_raw": [image(i, frame="ir") for i in range(6)],
    })  # fmt: skip
    fed = Fed(record(tmp_path / "a.mcap", topics))
    assert fed.feed.topics == {"rgb": "/camera/rgb/image_raw", "depth": "/camera/aligned_depth_to_color/image_raw"}
    assert any("also there: /camera/infra1/image_rect_raw, /camera/depth/image_raw" in note for note in fed.log.notes)


def test_named_topics(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", {**stereo_topics(), **rgbd_topics()})
    assert Fed(path).rig.mode == "stereo"
    assert Fed(path, names=CameraNames(rgb="/camera/rgb/image_raw")).rig.mode == "rgbd"
    assert Fed(path, names=CameraNames(left="/left/image_raw")).feed.partner == "/right/image_raw"
    assert Fed(path, names=CameraNames(right="/right/image_raw")).feed.main == "/left/image_raw"
    with pytest.raises(UsageError, match="not both"):
        Fed(path, names=CameraNames(left="/left/image_raw", rgb="/camera/rgb/image_raw"))
    with pytest.raises(UsageError, match="name the right camera's images too"):
        Fed(path, names=CameraNames(left="/camera/rgb/image_raw"))
    with pytest.raises(RecordingError, match="holds depth, not colour"):
        Fed(path, names=CameraNames(rgb="/camera/depth/image_raw"))
    with pytest.raises(RecordingError, match="holds mono8, not depth"):
        Fed(path, names=CameraNames(depth="/left/image_raw"))
    with pytest.raises(RecordingError, match="no topic '/nothing'"):
        Fed(path, names=CameraNames(rgb="/nothing"))
    other = Fed(path, names=CameraNames(rgb="/camera/rgb/image_raw", camera_info="/left/camera_info"))
    assert other.rig.main.intrinsics[0, 0] == 30.0


def test_rectified_images_take_p(tmp_path: Path) -> None:
    model = info(distortion=0.2)
    model.projection[0, 0] = model.projection[1, 1] = 28.0
    fed = Fed(
        record(tmp_path / "a.mcap", {"/cam/camera_info": [model], "/cam/image_rect": [image(i) for i in range(3)]})
    )
    assert fed.rig.main.intrinsics[0, 0] == 28.0
    assert not fed.rig.main.distortion.any()


def test_partners_by_name() -> None:
    names = [
        "/gray/left/image",
        "/gray/right/image",
        "/cam0/image_raw",
        "/cam1/image_raw",
        "/a/infra1/x",
        "/a/infra2/x",
    ]
    assert stereo_partner("/gray/left/image", names) == "/gray/right/image"
    assert stereo_partner("/cam0/image_raw", names) == "/cam1/image_raw"
    assert stereo_partner("/a/infra1/x", names) == "/a/infra2/x"
    assert stereo_partner("/cam1/image_raw", names) is None
