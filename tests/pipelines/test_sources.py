# SPDX-License-Identifier: MIT
"""What a folder, a pattern, a list or an address stands for, and what each input is called."""

from __future__ import annotations

import pytest

from slamcli.errors import UsageError
from slamcli.pipelines.sources import RECORDINGS, TRAJECTORIES, Source, find_sources, is_many, stem_of

POSES = "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def touch(*names: str) -> None:
    from pathlib import Path

    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(POSES)


def texts(*words: str, kind=RECORDINGS) -> list[str]:
    return [source.text for source in find_sources(words, kind)]


def names(*words: str, kind=RECORDINGS) -> list[str]:
    return [source.name for source in find_sources(words, kind)]


def test_a_folder_stands_for_the_recordings_directly_in_it_by_name():
    touch("runs/b.mcap", "runs/a.bag", "runs/notes.md", "runs/.hidden.mcap", "runs/deep/c.mcap", "runs/deep/d.mcap")
    touch("runs/ros2/metadata.yaml", "runs/ros2/x_0.mcap", "runs/tum/rgb/1.png", "runs/tum/groundtruth.txt")
    assert is_many("runs", RECORDINGS)
    assert texts("runs") == ["runs/a.bag", "runs/b.mcap", "runs/ros2", "runs/tum"]
    assert names("runs/") == ["a", "b", "ros2", "tum"]


def test_a_bag_folder_is_one_recording_and_loose_bags_are_not():
    touch("ros2/metadata.yaml", "ros2/x_0.mcap", "ros2/x_1.mcap", "split/x_0.db3", "split/x_1.db3", "one/x.mcap")
    touch("loose/x.mcap", "loose/y.mcap", "days/x_2026_01_01.mcap", "days/x_2026_01_02.mcap")
    assert [is_many(word, RECORDINGS) for word in ("ros2", "split", "one", "loose", "days")] == [False] * 3 + [True] * 2
    assert texts("ros2", "split", "one") == ["ros2", "split", "one"]


def test_a_pattern_takes_what_it_says_and_without_a_suffix_what_fits():
    touch("runs/a.mcap", "runs/b.mcap", "runs/b.truth.tum", "runs/c.bag", "more/deep/d.mcap")
    assert texts("runs/*.mcap") == ["runs/a.mcap", "runs/b.mcap"]
    assert texts("runs/*") == ["runs/a.mcap", "runs/b.mcap", "runs/c.bag"]
    assert texts("**/[ad].mcap") == ["more/deep/d.mcap", "runs/a.mcap"]
    assert texts("runs/b.*") == ["runs/b.mcap", "runs/b.truth.tum"]


def test_a_path_that_is_there_is_no_pattern():
    touch("runs/a[1].mcap", "@b.mcap")
    assert not is_many("runs/a[1].mcap", RECORDINGS)
    assert texts("runs/a[1].mcap", "@b.mcap") == ["runs/a[1].mcap", "@b.mcap"]


def test_a_list_is_relative_to_its_folder_and_may_hold_everything(here):
    touch("runs/a.mcap", "runs/sub/b.mcap", "runs/sub/c.mcap", "d.mcap")
    (here / "runs/list.txt").write_text(
        f"# nightly\na.mcap\n\n  sub/*.mcap  \n../d.mcap\nmissing.mcap\nfile://{here}/d.mcap\nhttps://h/x.mcap?sig=1\n"
    )
    assert is_many("@runs/list.txt", RECORDINGS)
    assert texts("@runs/list.txt") == [
        "runs/a.mcap", "runs/sub/b.mcap", "runs/sub/c.mcap", "runs/../d.mcap", "runs/missing.mcap", f"{here}/d.mcap",
        "https://h/x.mcap?sig=1",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("none/*.mcap", "none/\\*.mcap: no recording matches"),
        ("empty", "empty: no recording lies in this folder"),
        ("@none.txt", "@none.txt: the list cannot be read: No such file"),
        ("@remarks.txt", "the list is empty: write one recording per line"),
        ("@nested.txt", "a list in a list"),
        ("@binary.txt", "it is no text"),
        ("foo://x/y/*", "foo:// is no store that fsspec knows"),
        ("https://h/*.mcap", "web servers have no listing: write the addresses into a @list.txt"),
    ],
)
def test_what_stands_for_nothing_is_one_line(here, word, message):
    (here / "empty").mkdir()
    (here / "remarks.txt").write_text("# nothing\n")
    (here / "nested.txt").write_text("@remarks.txt\n")
    (here / "binary.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match=message):
        find_sources([word], RECORDINGS)


def test_names_differ_and_no_order_changes_them():
    touch("x/run.mcap", "y/run.mcap", "z/run.bag", "z/run.mcap", "x/other.mcap", "x/Other.bag", "jobs.mcap")
    words = ["x/run.mcap", "y/run.mcap", "z/run.bag", "z/run.mcap", "x/other.mcap", "x/Other.bag", "jobs.mcap"]
    found = names(*words)
    assert found[:2] == ["x-run", "y-run"]
    assert found[6] == "jobs-input"
    assert [name.rpartition("-")[0] for name in found[2:6]] == ["run", "run", "other", "Other"]
    assert len({name.casefold() for name in found}) == 7
    assert dict(zip(reversed(words), names(*reversed(words)), strict=True)) == dict(zip(words, found, strict=True))
    assert texts("x/run.mcap", "x/run.mcap") == ["x/run.mcap"]


def test_what_name_and_dir_stand_for():
    touch("x/run.mcap", "y/run.mcap", "results/a/trajectory.tum", "results/b/trajectory.tum")
    assert [(s.stem, s.folder) for s in find_sources(["x/run.mcap", "y/run.mcap"], RECORDINGS)] == [
        ("run", "x"),
        ("run", "y"),
    ]
    [a, b] = find_sources(["results/*/trajectory.tum"], TRAJECTORIES)
    assert a == Source(text="results/a/trajectory.tum", stem="a", folder="results/a", name="a")
    assert (b.stem, b.name) == ("b", "b")
    [one] = find_sources(["results/a/trajectory.tum"], TRAJECTORIES)
    assert one.name == "a"


def test_the_folder_of_a_fleet_stands_for_its_results():
    touch("maps/a/trajectory.tum", "maps/b/trajectory.tum", "maps/summary.csv", "maps/jobs/a.json", "maps/c/map.yaml")
    assert is_many("maps", TRAJECTORIES)
    assert not is_many("maps/a", TRAJECTORIES)
    touch("tum/rgb/1.png", "tum/groundtruth.txt", "tum/accelerometer.txt")
    assert not is_many("tum", TRAJECTORIES)
    assert texts("maps", kind=TRAJECTORIES) == ["maps/a/trajectory.tum", "maps/b/trajectory.tum"]


def test_a_topic_of_each_of_many_recordings():
    touch("runs/a.mcap", "runs/b.mcap")
    assert texts("runs/*.mcap:/odom", kind=TRAJECTORIES) == ["runs/a.mcap:/odom", "runs/b.mcap:/odom"]
    assert names("runs/*.mcap:odom>base_link", kind=TRAJECTORIES) == ["a", "b"]


def test_suffixes_go_and_other_dots_stay():
    assert [stem_of(n) for n in ("a.clf.gz", "run-1.5.mcap", "x.db3.zstd", "2026.01.02", "a.truth.tum")] == [
        "a", "run-1.5", "x", "2026.01.02", "a.truth",
    ]  # fmt: skip
