# SPDX-License-Identifier: MIT
"""Films of results: frames, sizes, what grows in them, bytes."""

from __future__ import annotations

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from slamcli.cli.main import run
from slamcli.pipelines.replay import load_replay
from slamcli.pipelines.replay_tracks import GraphTrack
from slamcli.pipelines.view_paper import labels
from slamcli.reports.figures.map import UNKNOWN_COLOUR
from slamcli.reports.film_painter import PEN, palette
from slamcli.reports.growth_film import frame_poses, write_growth_film
from slamcli.trajectory.particle_track import ParticleTrack

sys.path.append(str(Path(__file__).parents[1] / "pipelines"))
import small_result as small


@pytest.fixture(scope="module")
def replay(tmp_path_factory):
    place = tmp_path_factory.mktemp("film")
    small.write_recording(place / "room.mcap")
    loaded = load_replay(small.write_result(place / "result", place / "room.mcap"))
    stamps = small.stamps_ns()
    poses = np.full((len(stamps), 8, 3), np.nan, np.float32)
    poses[:, :5] = small.poses_se2()[:, None].astype(np.float32) + np.array([0.0, 0.8, 0.0], np.float32)
    weights = np.zeros((len(stamps), 8), np.float32)
    weights[:, :5] = 0.2
    graph = GraphTrack(
        stamps_ns=stamps, positions_m=loaded.trajectory.positions_m - [0.0, 0.8, 0.0], edges=np.array([[15, 2]]), kinds=np.array([1], np.uint8),
        edge_stamps_ns=stamps[15:16], residual_m=np.zeros(1), residual_rad=np.zeros(1),
    )  # fmt: skip
    return replace(loaded, particles=ParticleTrack(stamps_ns=stamps, poses=poses, weights=weights), graph=graph)


def colours(path):
    with Image.open(path) as film:
        for i in range(film.n_frames):
            film.seek(i)
            yield np.asarray(film.convert("RGB"))


def test_the_map_grows_and_ends_whole(replay, tmp_path):
    told = write_growth_film(tmp_path / "run.gif", replay)
    frames = list(colours(tmp_path / "run.gif"))
    assert told == {
        "frames": small.STEPS,
        "width_px": frames[0].shape[1],
        "height_px": frames[0].shape[0],
        "growth": "scans",
    }
    assert len(frames) == small.STEPS
    assert max(frames[0].shape) <= 640 + 50
    unknown = [int((frame == UNKNOWN_COLOUR).all(axis=2).sum()) for frame in frames]
    assert unknown[0] > 2 * unknown[-1]
    assert all(later <= earlier + 50 for earlier, later in itertools.pairwise(unknown))


def test_everything_is_in_it_when_it_is_there(replay, tmp_path):
    write_growth_film(tmp_path / "run.gif", replay, title="a room")
    inks = {name: palette()[PEN[name]] for name in ("scan", "estimate", "robot", "plan", "local plan")}
    body = [frame[30:-30] for frame in colours(tmp_path / "run.gif")]
    there = {name: [bool((frame == ink).all(axis=2).any()) for frame in body] for name, ink in inks.items()}
    assert all(there["scan"])
    assert all(there["estimate"])
    assert all(there["robot"])
    assert there["plan"][1:] == [True] * (small.STEPS - 1)
    assert there["local plan"] == [i == 15 for i in range(small.STEPS)]


def test_the_same_replay_gives_the_same_bytes(replay, tmp_path):
    for name in ("a.gif", "b.gif"):
        write_growth_film(tmp_path / name, replay)
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_frames_are_spread_over_the_time_and_not_too_many():
    stamps = np.arange(5000, dtype=np.int64) * 100_000_000
    poses = frame_poses(stamps)
    assert len(poses) == 200
    assert (poses[0], poses[-1]) == (0, 4999)
    assert np.ptp(np.diff(poses)) <= 1
    assert frame_poses(np.array([5])) == [0]
    assert frame_poses(np.array([5, 9, 7, 20])) == [0, 2, 3]


@pytest.mark.parametrize("source", ["result", "result/trajectory.tum"])
def test_view_makes_films_of_results_and_trajectories(replay, tmp_path, source):
    folder = Path(replay.recording[0]).parent / source
    assert run(["view", str(folder), "-o", str(tmp_path / "run.gif"), "-q"]) == 0
    assert len(list(colours(tmp_path / "run.gif"))) == small.STEPS


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{result}/map.yaml", "-o", "x.gif"], "a film shows a trajectory"),
        (["{result}", "{result}", "-o", "x.gif"], "one result at a time"),
        (["{result}", "--width-cm", "9"], "--width-cm is for figures"),
        (["{result}", "--recording", "{recording}"], "--recording is for what plays"),
        (["{recording}", "-o", "x.gif"], "pictures are written as .png"),
    ],
)
def test_what_does_not_fit_is_refused(replay, tmp_path, monkeypatch, capsys, arguments, told):
    monkeypatch.chdir(tmp_path)
    place = replay.recording[0].parent
    names = {"result": str(place / "result"), "recording": str(replay.recording[0])}
    assert run(["view", *(argument.format(**names) for argument in arguments)]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_several_results_make_one_figure(replay, tmp_path, capsys):
    result = replay.recording[0].parent / "result"
    output = tmp_path / "both.svg"
    assert run(["view", str(result), str(result), "-o", str(output), "--width-cm", "12", "--json"]) == 0
    assert '"others"' in capsys.readouterr().out
    assert output.read_text().count("/result -->") >= 1


def test_labels_tell_sources_apart(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name / "result").mkdir(parents=True)
    sources = [tmp_path / "a/result", tmp_path / "b/result", tmp_path / "c.tum"]
    assert labels(sources) == ["a/result", "b/result", "c"]
