# SPDX-License-Identifier: MIT
"""The command line that a fleet makes of an input."""

from __future__ import annotations

from pathlib import Path

import pytest

from slamcli.pipelines.fleet import FleetRequest, job_of
from slamcli.pipelines.sources import Source


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SLAMCLI_CACHE", raising=False)


def request(*words: str, after: tuple[str, ...] = (), **changes) -> FleetRequest:
    return FleetRequest(command="map", sources=(), words=words, after=after, output=Path("out"), **changes)


LOCAL = Source(text="runs/a.mcap", stem="a", folder="runs", name="runs-a")
REMOTE = Source(text="s3://bucket/june/a.mcap", stem="a", folder="s3://bucket/june", name="a")


def test_a_run_is_what_a_person_would_type():
    Path("c.lua").write_text("")
    job = job_of(LOCAL, request("--algo=gmapping", "--config=c.lua", "--truth={dir}/{name}.tum", after=("{name}.ref",)))
    assert job.arguments == (
        "map", "--algo=gmapping", "--config=c.lua", "--truth=runs/a.tum", "--output", "out/runs-a", "--", "runs/a.mcap",
        "a.ref",
    )  # fmt: skip
    assert (job.name, job.output, job.remote) == ("runs-a", Path("out/runs-a"), ())
    assert job.inputs == (Path("runs/a.mcap"), Path("c.lua"))


def test_addresses_become_places_in_the_cache(monkeypatch):
    words = ("--truth={dir}/{name}.tum", "--config=file:///etc/c.lua", "--scan-topic=/scan")
    job = job_of(REMOTE, request(*words, keep_inputs=True))
    assert job.arguments == (
        "map", "--truth=out/cache/a/1/a.tum", "--config=/etc/c.lua", "--scan-topic=/scan", "--output", "out/a", "--",
        "out/cache/a/0/a.mcap",
    )  # fmt: skip
    assert job.remote == (
        ("s3://bucket/june/a.mcap", Path("out/cache/a/0/a.mcap")),
        ("s3://bucket/june/a.tum", Path("out/cache/a/1/a.tum")),
    )
    assert job.keeps_remote
    assert job.inputs == ()
    monkeypatch.setenv("SLAMCLI_CACHE", "/scratch")
    places = [str(job_of(REMOTE, request()).remote[0][1]) for _ in range(2)]
    other = job_of(REMOTE, FleetRequest(command="map", sources=(), words=(), output=Path("other"))).remote[0][1]
    assert places[0] == places[1]
    assert places[0].startswith("/scratch/")
    assert places[0].endswith("/a/0/a.mcap")
    assert str(other) != places[0]  # two fleets at once do not share it
