# SPDX-License-Identifier: MIT
"""``slamcli map`` with cameras on wrong input: one line, exit code 2, nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.errors import UsageError
from slamcli.measurements import Image
from slamcli.pipelines.map_request import MapRequest
from slamcli.recordings import create_recording
from slamcli.runtime import RunLog

START = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Colour and depth without calibration."""
    path = tmp_path_factory.mktemp("cameras") / "room.mcap"
    grey, depth = np.zeros((24, 32), np.uint8), np.full((24, 32), 2.0, np.float32)
    with create_recording(path) as writer:
        for i in range(4):
            stamp = START + i * 50_000_000
            writer.write("/rgb/image", Image(stamp_ns=stamp, frame_id="c", encoding="mono8", pixels=grey))
            writer.write("/depth/image", Image(stamp_ns=stamp, frame_id="c", encoding="depth", pixels=depth))
    return path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no calibration of the camera on /rgb/image: give it with --camera FILE"),
        (("--mode", "stereo"), "--mode stereo needs images of a left and a right camera"),
        (("--mode", "2d"), "--mode 2d: orbslam3 has mono, stereo, rgbd"),
        (("--camera", "none.yaml"), "none.yaml: no such file"),
        (("--depth-topic", "/rgb/image"), "--depth-topic /rgb/image: holds mono8, not depth"),
        (("--left-topic", "/rgb/image"), "name the right camera's images too, with --right-topic"),
        (("--rgb-topic", "/rgb/imag"), "no topic '/rgb/imag'; did you mean /rgb/image?"),
        (("--camera-info-topic", "/info"), "no topic '/info'"),
        (("--scan-topic", "/scan"), "--scan-topic /scan: orbslam3 has no use for it"),
        (("--config", "gmapping.launch"), "starts no node of orbslam3"),
        (("--config", "backpack_2d.lua"), "orbslam3 reads settings (.yaml) and launch files"),
        (("--set", "ORBextractor.nFeature=500"), "did you mean ORBextractor.nFeatures"),
        (("--set", "Camera1.fx=500"), "Camera1.fy is missing: Camera1 is calibrated in part"),
        (("--algo", "gmapping", "--left-topic", "/rgb/image"), "slamcli: "),
    ],
)
def test_wrong_use_is_one_line(
    recording: Path, tmp_path: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    algo = () if "--algo" in words else ("--algo", "orbslam3")
    assert run(["map", *algo, str(recording), "-o", str(out), *words]) == 2
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not out.exists()


def test_options_of_cameras_are_recorded_in_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def stop(request: MapRequest, log: RunLog) -> None:
        asked.append(request)
        raise UsageError("seen")

    monkeypatch.setattr("slamcli.pipelines.map.run_map", stop)
    words = [
        "--left-topic",
        "/l",
        "--right-topic",
        "/r",
        "--camera-info-topic",
        "/i",
        "--camera",
        "/data/rig.yaml",
        "--mode",
        "stereo",
    ]
    assert run(["map", "--algo", "orbslam3", "/data/a.bag", *words]) == 2
    command = asked[0].command
    assert command.startswith("slamcli map --algo orbslam3 a.bag --seed 0")
    assert "--left-topic /l --right-topic /r --camera-info-topic /i" in command
    assert "--camera rig.yaml" in command
    assert "--mode stereo" in command
    assert asked[0].cameras.right == "/r"


def test_config_show_and_check_know_the_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("%YAML:1.0\nCamera.fx:525.0\nThDepth: 0\n")
    assert run(["config", "show", "--algo", "orbslam3", "--config", str(path), "--changed"]) == 2
    assert f"{path}:3: Stereo.ThDepth=0: must be between" in capsys.readouterr().err
    assert run(["config", "check", str(path), "--json"]) == 1
    messages = [finding["message"] for finding in json.loads(capsys.readouterr().out)["findings"]]
    assert any(message.startswith("ThDepth 0: every point counts as far") for message in messages)
