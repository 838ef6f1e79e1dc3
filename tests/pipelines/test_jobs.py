# SPDX-License-Identifier: MIT
"""Jobs are runs of the command line, and what was done is not done again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from pathlib import Path

import pytest
from held_runs import hold, holding, until

from slamcli.errors import UsageError
from slamcli.pipelines import jobs as jobs_module
from slamcli.pipelines.job_process import size_text
from slamcli.pipelines.jobs import Job, JobOutcome, run_job, run_jobs
from slamcli.pipelines.process_tree import end_tree, tree, tree_memory_bytes


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
def waiting(tmp_path, small_map, monkeypatch):
    """A job that waits to be let go."""
    monkeypatch.setenv("PYTHONPATH", holding(tmp_path / "hold"))
    hold(small_map.with_name("held.yaml"))
    small_map.with_name("held.yaml").write_text(small_map.read_text())
    return job(tmp_path, "wait", small_map.with_name("held.yaml"))


def test_a_missed_threshold_is_an_outcome_that_stands(tmp_path):
    truth = tmp_path / "truth.tum"
    truth.write_text("".join(f"{i} {i} {i * i} 0 0 0 0 1\n" for i in range(9)))
    poses = tmp_path / "poses.tum"
    poses.write_text("".join(f"{i} {i} {(i % 3) ** 2} 0 0 0 0 1\n" for i in range(9)))
    words = ("evaluate", str(poses), str(truth), "--max", "ate.rmse=1e-9", "-o", str(tmp_path / "out"))
    jobs = [Job(name="one", arguments=words, output=tmp_path / "out", inputs=(poses, truth))]
    first, second = (run_jobs(jobs, records=tmp_path / "jobs")[0] for _ in range(2))
    assert (first.exit_code, first.wrote, first.missed, first.reused) == (1, True, True, False)
    assert (second.missed, second.reused) == (True, True)
    assert "9 poses matched" in first.stdout
    assert "ate.rmse" in first.message
    assert run_jobs(jobs, records=tmp_path / "jobs", keep_stdout=False)[0].stdout == ""


def test_a_job_that_takes_too_much_memory_is_ended_and_says_so(tmp_path, small_map):
    big, good = job(tmp_path, "big", small_map), job(tmp_path, "good", small_map)
    assert run_job(good, memory_limit_bytes=10**9).done
    outcome = run_job(big, memory_limit_bytes=20_000_000)
    assert outcome.exit_code == -signal.SIGKILL
    assert outcome.message == "needed more than 20 MB of memory (--max-memory)"
    assert not big.output.exists()


def test_the_memory_of_a_process_counts_what_it_started():
    code = "import subprocess, sys; x = b'x' * 50_000_000; subprocess.run([sys.executable, '-c', sys.argv[1]])"
    inner = "import time; y = b'y' * 60_000_000; print('there', flush=True); time.sleep(60)"
    with subprocess.Popen(
        [sys.executable, "-c", code, inner], stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        assert len(tree(process.pid)) == 2
        assert 110e6 < tree_memory_bytes(process.pid) < 200e6
        end_tree(process.pid)
    assert tree_memory_bytes(process.pid) == 0


def test_stopping_ends_jobs_and_those_that_wait_never_begin(tmp_path, small_map, waiting):
    def stop(outcome):
        until(lambda: len(tree(os.getpid())) > 1)
        raise KeyboardInterrupt

    jobs = [job(tmp_path, "good", small_map), waiting, *(job(tmp_path, f"x{i}", small_map) for i in range(9))]
    with pytest.raises(KeyboardInterrupt):
        run_jobs(jobs, workers=2, records=tmp_path / "jobs", told=stop)
    assert tree(os.getpid()) == [os.getpid()]
    done = {path.stem for path in (tmp_path / "jobs").iterdir()}
    assert "good" in done
    assert "wait" not in done
    assert len(done) < 6
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".slamcli")]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_jobs_end_with_whoever_started_them(waiting, ending):
    code = (
        "import sys; from pathlib import Path; from slamcli.pipelines.jobs import Job, run_jobs\n"
        f"run_jobs([Job(name='wait', arguments={waiting.arguments!r}, output=Path({str(waiting.output)!r}))])"
    )
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE) as process:
        inner = until(lambda: tree(process.pid)[1:])[0]
        until(lambda: b"map-tools" in Path(f"/proc/{inner}/cmdline").read_bytes())
        time.sleep(0.3)  # it holds on to its lifeline by now
        process.send_signal(ending)
        process.communicate(timeout=20)
    until(lambda: not Path(f"/proc/{inner}").exists())


def test_a_job_that_cannot_be_started_is_a_failure(tmp_path, small_map):
    words = job(tmp_path, "x", small_map)
    outcome = run_job(Job(name="x", arguments=words.arguments, output=words.output, folder=tmp_path / "none"))
    assert (outcome.exit_code, outcome.done) == (1, False)
    assert "could not be started" in outcome.message


def test_fresh_runs_all_and_workers_run_together(tmp_path, small_map):
    jobs = [job(tmp_path, f"x{i}", small_map) for i in range(2)]
    most = 0

    def watch():
        nonlocal most
        while not ended.wait(0.01):
            most = max(most, len(tree(os.getpid())) - 1)

    ended = threading.Event()
    watcher = threading.Thread(target=watch)
    watcher.start()
    run_jobs(jobs, workers=2, records=tmp_path / "jobs")
    ended.set()
    watcher.join()
    assert most == 2
    assert [one.reused for one in run_jobs(jobs, records=tmp_path / "jobs")] == [True, True]
    assert [one.reused for one in run_jobs(jobs[:1], records=tmp_path / "jobs", fresh=True)] == [False]


def test_a_thousand_jobs_take_no_memory_here(tmp_path, monkeypatch):
    def run(job, **_):
        return JobOutcome(
            name=job.name, exit_code=0, message="", stdout="x" * 50_000, wall_s=0.0, cpu_s=0.0, peak_memory_bytes=0
        )

    monkeypatch.setattr(jobs_module, "run_job", run)
    many = [job(tmp_path, f"x{i}", tmp_path / "none") for i in range(1000)]
    tracemalloc.start()
    outcomes = run_jobs(many, workers=2, records=tmp_path / "jobs", keep_stdout=False)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(outcomes) == 1000
    assert peak < 8e6  # what they printed is 50 MB
    assert len(list((tmp_path / "jobs").iterdir())) == 1000


def test_sizes_are_written_as_a_person_does():
    assert [size_text(n) for n in (2_000_000_000, 1_500_000, 12, 20_000)] == ["2 GB", "1.5 MB", "12 bytes", "20 kB"]


@pytest.fixture
def small_map(tmp_path):
    (tmp_path / "room.pgm").write_bytes(b"P5 3 3 255\n" + bytes([0, 0, 0, 0, 254, 0, 0, 0, 0]))
    path = tmp_path / "room.yaml"
    path.write_text(
        "image: room.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path
