# SPDX-License-Identifier: MIT
"""Addresses are listed, and what lies behind them is fetched for as long as it is needed."""

from __future__ import annotations

import sys

import fsspec
import pytest
from obstore.fsspec import FsspecStore
from store_servers import store_server

from slamcli.errors import DependencyError, ProcessError, UsageError
from slamcli.pipelines.remote_files import fetched, fingerprint, list_remote, local_name, plain_url


@pytest.fixture
def store(monkeypatch):
    FsspecStore.clear_instance_cache()  # it remembers the address of the server before
    with store_server() as server:
        for name, value in server.environment.items():
            monkeypatch.setenv(name, value)
        server.objects = {
            "june/a.mcap": b"a" * 3000, "june/b.mcap": b"bb", "june/notes.txt": b"n", "june/ros2/metadata.yaml": b"m",
            "june/ros2/x_0.mcap": b"x", "june/ros2/deep/y": b"yy", "july/c.mcap": b"c",
        }  # fmt: skip
        yield server


def test_s3_is_listed_by_pattern_and_folder(store):
    assert list_remote("s3://bucket/june/*.mcap") == ["s3://bucket/june/a.mcap", "s3://bucket/june/b.mcap"]
    whole = ["s3://bucket/june/a.mcap", "s3://bucket/june/b.mcap", "s3://bucket/june/ros2"]
    assert list_remote("s3://bucket/june/") == whole
    assert list_remote("s3://bucket/june/*") == whole
    assert list_remote("s3://bucket/june/ros2/") == ["s3://bucket/june/ros2"]
    assert list_remote("s3://bucket/j*/[ac].mcap") == ["s3://bucket/july/c.mcap", "s3://bucket/june/a.mcap"]
    with pytest.raises(UsageError, match=r"s3://bucket/may/\*: nothing is there"):
        list_remote("s3://bucket/may/*")
    with pytest.raises(ProcessError, match="s3://bucket/may/: nothing is there"):
        list_remote("s3://bucket/may/")


def test_files_and_folders_of_s3_come_and_go(store, tmp_path):
    file, folder = tmp_path / "run" / "0" / "a.mcap", tmp_path / "run" / "1" / "ros2"
    with fetched([("s3://bucket/june/a.mcap", file), ("s3://bucket/june/ros2", folder)]):
        assert file.read_bytes() == b"a" * 3000
        found = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        assert found == {"metadata.yaml": b"m", "x_0.mcap": b"x", "deep/y": b"yy"}
    assert list(tmp_path.iterdir()) == []


def test_what_is_kept_is_not_fetched_again_until_it_changes(store, tmp_path):
    place = tmp_path / "run" / "0" / "b.mcap"
    remotes = [("s3://bucket/june/b.mcap", place)]
    for content, requests in ((b"bb", 1), (b"bb", 1), (b"cc", 2)):
        store.objects["june/b.mcap"] = content
        with fetched(remotes, keep=True):
            assert place.read_bytes() == content
        assert store.asked.count("GET /bucket/june/b.mcap") == requests


def test_web_servers_need_no_library(store, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    url = f"{store.address}/bucket/june/b.mcap?signature=secret"
    assert list_remote(url) == [url]
    place = tmp_path / "run" / "0" / local_name(url)
    with fetched([(url, place)]):
        assert (place.name, place.read_bytes()) == ("b.mcap", b"bb")
    before = fingerprint(url)
    store.objects["june/b.mcap"] = b"cc"
    assert fingerprint(url) != before


@pytest.mark.parametrize("scheme", ["s3", "http"])
def test_what_cannot_be_fetched_leaves_nothing(store, tmp_path, scheme):
    address = {"s3": "s3://bucket", "http": f"{store.address}/bucket"}[scheme]
    place = tmp_path / "run" / "0" / "z.mcap"
    with pytest.raises(ProcessError, match=r"june/z.mcap: (nothing is there|cannot be fetched: HTTP Error 404)"):  # noqa: SIM117
        with fetched([(f"{address}/june/z.mcap?secret", place)]):
            pytest.fail("it began")
    assert list(tmp_path.iterdir()) == []


def test_an_answer_that_breaks_off_is_none(store, tmp_path):
    store.cut = 100
    with pytest.raises(ProcessError, match="only 100 of 3,000 bytes came"):  # noqa: SIM117
        with fetched([(f"{store.address}/bucket/june/a.mcap", tmp_path / "run" / "0" / "a.mcap")]):
            pytest.fail("it began")
    assert list(tmp_path.iterdir()) == []


def test_a_fetch_can_be_stopped(store, tmp_path):
    with pytest.raises(InterruptedError):  # noqa: SIM117
        with fetched([("s3://b/june/a.mcap", tmp_path / "run" / "0" / "a.mcap")], is_stopped=lambda: True):
            pytest.fail("it began")
    assert list(tmp_path.iterdir()) == []


def test_other_stores_go_through_fsspec(tmp_path):
    files = fsspec.filesystem("memory")
    for name in ("a.bag", "b.bag", "note.txt"):
        files.pipe(f"/fleet/{name}", name.encode())
    assert list_remote("memory://fleet/*.bag") == ["memory://fleet/a.bag", "memory://fleet/b.bag"]
    assert list_remote("memory://fleet/") == ["memory://fleet/a.bag", "memory://fleet/b.bag"]
    place = tmp_path / "run" / "0" / "a.bag"
    before = fingerprint("memory://fleet/a.bag")
    with fetched([("memory://fleet/a.bag", place)]):
        assert place.read_bytes() == b"a.bag"
    files.pipe("/fleet/a.bag", b"other")
    assert fingerprint("memory://fleet/a.bag") != before


@pytest.mark.parametrize(
    ("missing", "url", "message"),
    [
        ("fsspec", "s3://b/*.mcap", r"s3:// needs fsspec: pip install 'slamcli\[fleet\]'"),
        ("obstore.fsspec", "s3://b/*.mcap", r"s3:// needs obstore: pip install 'slamcli\[fleet\]'"),
        ("paramiko", "sftp://h/*.mcap", "sftp:// needs a library that is missing: .*paramiko"),
    ],
)
def test_a_missing_library_is_named(monkeypatch, missing, url, message):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(DependencyError, match=message):
        list_remote(url)


def test_secrets_of_an_address_are_not_shown():
    assert plain_url("https://user:word@host/a%20b.mcap?X-Amz-Signature=1#x") == "https://host/a%20b.mcap"
    assert local_name("https://host/deep/a%20b.mcap?x=1") == "a b.mcap"
    assert local_name("s3://bucket/ros2/") == "ros2"
