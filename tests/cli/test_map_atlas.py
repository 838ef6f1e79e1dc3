# SPDX-License-Identifier: MIT
"""``slamcli map`` with an atlas: saved, gone on from, localised in; what does not fit is one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from slamcli.cli.main import run
from slamcli.formats.atlas_files import read_atlas
from slamcli.formats.trajectories import read_tum

ROOT = Path(__file__).resolve().parents[2]
DESK = str(ROOT / "sample_data" / "desk_rgbd.mcap")


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """The folder of a map of the desk."""
    folder = tmp_path_factory.mktemp("atlas") / "desk"
    assert run(["map", "--algo", "orbslam3", DESK, "-o", str(folder), "--save-atlas", str(folder.parent / "kept.npz"), "-q"]) == 0  # fmt: skip
    return folder


def summary(folder):
    return json.loads((folder / "run.json").read_text())["summary"]


def test_the_atlas_lies_in_the_folder_and_where_it_was_asked_for(desk):
    assert "atlas.npz" in json.loads((desk / "run.json").read_text())["outputs"]
    assert (desk / "atlas.npz").read_bytes() == (desk.parent / "kept.npz").read_bytes()
    (saved,) = read_atlas(desk / "atlas.npz").maps
    assert saved.num_keyframes >= 2
    assert saved.num_points == summary(desk)["points"]
    assert saved.T_world_map is not None


def test_localising_gives_the_same_places_and_writes_no_atlas(desk, tmp_path):
    command = ["map", "--algo", "orbslam3", DESK, "--load-atlas", str(desk / "atlas.npz"), "--localise-only", "-q"]
    assert run([*command, "-o", str(tmp_path / "found"), "--start", "1"]) == 0
    assert not (tmp_path / "found" / "atlas.npz").exists()
    whole, part = read_tum(desk / "trajectory.tum"), read_tum(tmp_path / "found" / "trajectory.tum")
    assert len(part.stamps_ns) == 21
    rows = np.searchsorted(whole.stamps_ns, part.stamps_ns)
    assert np.array_equal(whole.stamps_ns[rows], part.stamps_ns)
    assert np.abs(whole.positions_m[rows] - part.positions_m).max() < 0.01
    assert summary(tmp_path / "found")["up_from"] == "atlas"
    recorded = json.loads((tmp_path / "found" / "run.json").read_text())
    assert "--load-atlas atlas.npz --localise-only" in recorded["command"]
    assert [entry["name"] for entry in recorded["inputs"]] == ["desk_rgbd.mcap", "atlas.npz"]


def test_mapping_goes_on_with_words_of_the_recording(desk, tmp_path):
    command = ["map", "--algo", "orbslam3", DESK, "--load-atlas", str(desk / "atlas.npz"), "--vocabulary", "recording"]
    assert run([*command, "-o", str(tmp_path / "more"), "-q"]) == 0
    (saved,) = read_atlas(tmp_path / "more" / "atlas.npz").maps
    assert saved.num_keyframes >= read_atlas(desk / "atlas.npz").maps[0].num_keyframes


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--load-atlas", "{osa}"], "an atlas of ORB-SLAM3 (.osa)"),
        (["--load-atlas", "{text}"], "no atlas of slamcli"),
        (["--localise-only"], "name the atlas to localise in"),
        (["--save-atlas", "{folder}"], "is a folder"),
        (["--vocabulary", "{text}"], "no vocabulary"),
        (["--load-atlas", "{desk}", "--set", "ORBextractor.nLevels=6"], "nLevels 8 and scaleFactor 1.2, here 6"),
        (["--load-atlas", "{desk}", "--mode", "mono"], "the atlas was made with another camera"),
        (
            ["--load-atlas", "{desk}", "--mode", "rgbd-inertial", "--set", "IMU.NoiseGyro=1e-3"],
            "not go on mapping there: take --mode rgbd",
        ),
    ],
)
def test_what_does_not_fit_is_one_line_and_writes_nothing(desk, tmp_path, capsys, arguments, message):
    (tmp_path / "map.osa").write_bytes(b"22 serialization::archive")
    (tmp_path / "notes.txt").write_text("notes")
    places = {"osa": tmp_path / "map.osa", "text": tmp_path / "notes.txt", "folder": tmp_path, "desk": desk / "atlas.npz"}  # fmt: skip
    words = [argument.format(**places) for argument in arguments]
    assert run(["map", "--algo", "orbslam3", DESK, "-o", str(tmp_path / "out"), *words, "-q"]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_tiers_that_do_not_see_have_no_use_for_it(desk, tmp_path, capsys):
    office = str(ROOT / "sample_data" / "office.bag")
    assert run(["map", "--algo", "gmapping", office, "-o", str(tmp_path / "x"), "--load-atlas", str(desk / "atlas.npz")]) == 2  # fmt: skip
    assert "gmapping does not see; --algo orbslam3 does" in capsys.readouterr().err
