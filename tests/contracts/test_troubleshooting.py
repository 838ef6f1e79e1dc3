# SPDX-License-Identifier: MIT
"""Faults that the troubleshooting page names: what it says they look like, and that its mends mend them."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.cli.main import run

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "troubleshooting.md").read_text()


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """A drive of 40 s through a cluttered room, and its truth."""
    folder = tmp_path_factory.mktemp("drive")
    bag, truth = folder / "ok.mcap", folder / "ok.tum"
    world = ["generate", "cluttered_room", str(bag), "--truth", str(truth), "--duration", "40", "--seed", "1", "-q"]
    assert run(world) == 0
    return bag, truth


def said(capsys, *words: str) -> tuple[int, str]:
    capsys.readouterr()
    code = run([*words])
    printed = capsys.readouterr()
    return code, " ".join((printed.out + printed.err).split())


def test_scans_without_a_place_on_the_robot(healthy, tmp_path, capsys):
    without = str(tmp_path / "without.mcap")
    assert said(capsys, "convert", str(healthy[0]), without, "--exclude-topics", "/tf_static")[0] == 0
    code, printed = said(capsys, "doctor", without)
    assert code == 1
    assert "no transform from base_link to the scanner's frame laser" in printed
    assert "no transform from base_link to the scanner's frame laser" in PAGE
    for mend in (["--laser-pose", "0,0,0"], ["--static-tf", "base_link,laser,0.1,0,0.3,0,0,0"]):
        assert said(capsys, "doctor", without, *mend)[0] == 0


def test_mirrored_scans(healthy, capsys):
    code, printed = said(capsys, "doctor", str(healthy[0]), "--flip-scan")  # what is right becomes mirrored
    assert code == 1
    assert "scans turn against the odometry in" in printed
    assert "they are mirrored" in printed
    assert "scans turn against the odometry in 14 of 14 turns: they are mirrored" in PAGE
    assert said(capsys, "doctor", str(healthy[0]))[0] == 0


def test_a_score_that_no_scan_reaches_and_a_misspelt_parameter(tmp_path, capsys):
    node = '<launch><node pkg="gmapping" type="slam_gmapping" name="a"><param name="{}" value="400"/></node></launch>'
    launch = tmp_path / "typo.launch"
    launch.write_text(node.format("minimumscore"))
    code, printed = said(capsys, "config", "check", str(launch), "--beams", "360")
    assert code == 1
    assert "unknown parameter 'minimumscore'; did you mean minimumScore?" in printed
    launch.write_text(node.format("minimumScore"))
    code, printed = said(capsys, "config", "check", str(launch), "--beams", "360")
    assert code == 1
    assert "this one has 360" in printed


def test_stamps_that_do_not_meet(healthy, tmp_path, capsys):
    truth = healthy[1]
    shifted = tmp_path / "shifted.tum"
    rows = [line.split(" ", 1) for line in truth.read_text().splitlines() if not line.startswith("#")]
    shifted.write_text("".join(f"{float(stamp) - 0.05:.6f} {rest}\n" for stamp, rest in rows))
    code, printed = said(capsys, "evaluate", str(truth), str(shifted))
    assert code == 1
    assert "are within 0.01 s of each other" in printed
    assert "they overlap" in printed
    assert said(capsys, "evaluate", str(truth), str(shifted), "--t-offset", "-0.05", "--max", "ate.rmse=0.001")[0] == 0
    nanoseconds = tmp_path / "ns.tum"
    nanoseconds.write_text("".join(f"{float(stamp) * 1e9:.0f} {rest}\n" for stamp, rest in rows))
    assert "stamps are read as nanoseconds" in said(capsys, "evaluate", str(truth), str(nanoseconds))[1]
    assert "stamps are read as nanoseconds" in PAGE


def test_a_recording_that_was_cut_off(healthy, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    content = healthy[0].read_bytes()
    cut.write_bytes(content[: len(content) * 2 // 3])
    assert "bytes are lost" in said(capsys, "info", str(cut))[1]
    assert said(capsys, "convert", str(cut), str(tmp_path / "whole.mcap"))[0] == 0
    assert "bytes are lost" not in said(capsys, "info", str(tmp_path / "whole.mcap"))[1]
