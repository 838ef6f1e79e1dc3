# SPDX-License-Identifier: MIT
"""Jobs are runs of the command line, and what was done is not done again."""

from __future__ import annotations

import pytest

from slamcli.errors import UsageError
from slamcli.pipelines.jobs import Job, run_jobs


def job(tmp_path, name, source, **changes):
    output = tmp_path / f"{name}.yaml"
    return Job(
        name=name,
        arguments=("map-tools", "convert", str(source), str(output)),
        output=output,
        inputs=(source,),
        **changes,
    )


def test_a_failed_job_does_not_stop_the_others_and_says_why(tmp_path, small_map):
    outcomes = run_jobs([job(tmp_path, "bad", tmp_path / "nothing.yaml"), job(tmp_path, "good", small_map)], workers=2)
    assert [outcome.exit_code for outcome in outcomes] == [2, 0]
    assert "nothing.yaml" in outcomes[0].message
    assert outcomes[1].peak_memory_bytes > 10e6
    assert (tmp_path / "good.yaml").exists()


def test_what_is_done_is_not_run_again_until_its_input_or_output_changes(tmp_path, small_map):
    jobs, records = [job(tmp_path, "one", small_map)], tmp_path / "jobs"
    assert [run_jobs(jobs, records=records)[0].reused for _ in range(2)] == [False, True]
    jobs[0].output.unlink()
    assert not run_jobs(jobs, records=records)[0].reused
    small_map.write_text(small_map.read_text() + "# a remark\n")
    assert not run_jobs(jobs, records=records)[0].reused


def test_a_failed_job_runs_again(tmp_path):
    jobs = [job(tmp_path, "bad", tmp_path / "nothing.yaml")]
    assert [run_jobs(jobs, records=tmp_path / "jobs")[0].reused for _ in range(2)] == [False, False]


def test_names_must_differ(tmp_path, small_map):
    with pytest.raises(UsageError, match="one"):
        run_jobs([job(tmp_path, "one", small_map)] * 2)


@pytest.fixture
def small_map(tmp_path):
    (tmp_path / "room.pgm").write_bytes(b"P5 3 3 255\n" + bytes([0, 0, 0, 0, 254, 0, 0, 0, 0]))
    path = tmp_path / "room.yaml"
    path.write_text(
        "image: room.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path
