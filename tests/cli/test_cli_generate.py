# SPDX-License-Identifier: MIT
"""``slamcli generate``: exit codes, JSON, and what it says to a person."""

from __future__ import annotations

import json

import pytest

from slamcli.cli.main import run

SHORT = ["--duration", "2", "--set", "laser.beams=31"]


def test_json_tells_everything(tmp_path, capsys):
    out = tmp_path / "o.mcap"
    code = run(["generate", "office", str(out), *SHORT, "--people", "1", "--imu", "--seed", "9", "--json",
                "--truth", str(tmp_path / "t.tum"), "--map-out", str(tmp_path / "m.yaml")])  # fmt: skip
    document = json.loads(capsys.readouterr().out)
    assert code == 0
    assert {"schema", "world", "path", "truth", "map", "record", "seed", "duration_s", "length_m", "messages", "slips_s", "settings",
            "seconds", "speed_x_real_time"} == set(document)  # fmt: skip
    assert document["seed"] == 9
    assert document["messages"]["/imu"] == 201
    assert document["settings"]["people.count"] == 1
    assert all((tmp_path / name).exists() for name in ("o.mcap", "t.tum", "m.yaml", "m.pgm"))


def test_a_person_reads_one_line_on_stderr(tmp_path, capsys):
    assert run(["generate", "office", str(tmp_path / "o.bag"), *SHORT]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert "office: 2.0 s" in said.err
    assert run(["generate", "office", str(tmp_path / "o.bag"), *SHORT, "-q"]) == 0
    assert capsys.readouterr().err == ""


def test_options_of_cameras(tmp_path, capsys):
    out = str(tmp_path / "o.mcap")
    options = ["--camera", "stereo-inertial", "--image-size", "40x30", "--rate", "5", "--exposure", "0.02", "--motion-blur",
               "--rolling-shutter", "0.01", "--compressed", "--set", "texture.texel=0.05", "--duration", "0.5"]  # fmt: skip
    assert run(["generate", "visual_room", out, *options, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    wanted = {"camera.kind": "stereo", "camera.width": 40, "camera.height": 30, "camera.rate": 5.0, "imu.enabled": True,
              "camera.exposure": 0.02, "camera.motion_blur": True, "camera.readout": 0.01, "camera.compressed": True}  # fmt: skip
    assert {key: document["settings"][key] for key in wanted} == wanted
    assert document["messages"]["/stereo/left/image_rect/compressed"] == 3
    assert document["messages"]["/imu"] == 101
    assert run(["generate", "visual_room", out, *options]) == 0
    assert "101 IMU samples, 6 images" in capsys.readouterr().err


def test_lists(capsys):
    assert run(["generate", "--list-worlds"]) == 0
    assert "office\n" in capsys.readouterr().out
    assert run(["generate", "--list-settings"]) == 0
    text = capsys.readouterr().out
    assert "laser.beams=180" in text
    assert "laser.sweep=auto" in text


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["ofice"], 2, "did you mean 'office'"),
        (["office", "--set", "laser.beam=3"], 2, "laser.beams"),
        (["office", "--set", "nothing.like=3"], 2, "--list-settings"),
        (["office", "--set", "laser.beams"], 2, "KEY=VALUE"),
        (["visual_room", "--start", "1,2"], 2, "follows the world's path"),
        (["visual_room", "--image-size", "640"], 2, "640x480"),
        (["visual_room", "--image-size", "8x8"], 2, "camera.width"),
        (["visual_room", "--camera", "fish"], 2, "rgbd"),
        (["visual_room", "--set", "camera.lens=fishy"], 2, "fisheye"),
        (["visual_room", "--set", "camera.fov=175"], 2, "camera.lens=fisheye"),
        (["office", "--start", "1,b"], 2, "X,Y,YAW"),
        (["office", "--start", "1,nan"], 2, "X,Y,YAW"),
        (["office", "--duration", "-1"], 2, "duration"),
        (["office", "--start", "0.45,2.6"], 1, "not within 0.5 m"),
        (["office", "--set", "slip.count=-1"], 2, "slip.count"),
        (["office", "--set", "laser.beams=inf"], 2, "whole number"),
        (["office", "--set", "laser.noise=inf"], 2, "between"),
        (["office", "--format", "foo"], 2, "foo"),
        (["office", "--compression", "foo"], 2, "foo"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(tmp_path, capsys, arguments, code, words):
    out = tmp_path / "o.bag"
    assert run(["generate", arguments[0], str(out), *arguments[1:]]) == code
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_spinning_scanner_in_any_world(tmp_path, capsys):
    out = tmp_path / "o.mcap"
    few = ["--set", "lidar3d.columns=60", "--set", "laser.enabled=false", "--truth", str(tmp_path / "o.tum")]
    assert run(["generate", "office", str(out), "--duration", "3", "--lidar3d", *few]) == 0
    assert "30 clouds" in capsys.readouterr().err
    assert len((tmp_path / "o.tum").read_text().splitlines()) == 30
