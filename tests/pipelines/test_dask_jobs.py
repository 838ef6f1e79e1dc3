# SPDX-License-Identifier: MIT
"""Jobs on a real Dask cluster of this machine: a scheduler and two workers."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from slamcli.errors import UsageError
from slamcli.pipelines import dask_jobs
from slamcli.pipelines.jobs import Job, run_jobs
from slamcli.pipelines.process_tree import tree

pytest.importorskip("distributed", reason="Dask is not installed (pip install 'slamcli[fleet]')")
from dask_machines import machines
from held_runs import hold, holding, let_go, until

MAP = "image: room.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cluster")
    with machines(folder, "one", "two", PYTHONPATH=holding(folder / "hold")) as found:
        yield found


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.pgm").write_bytes(b"P5 3 3 255\n" + bytes([0, 0, 0, 0, 254, 0, 0, 0, 0]))
    (tmp_path / "room.yaml").write_text(MAP)
    return tmp_path


def job(name: str, source: str = "room.yaml") -> Job:
    output = Path(f"{name}.yaml")
    words = ("map-tools", "convert", source, str(output))
    return Job(name=name, arguments=words, output=output, inputs=(Path(source),) if source == "room.yaml" else ())


def waiting(name: str) -> Job:
    Path(f"{name}.held.yaml").write_text(MAP)
    hold(Path(f"{name}.held.yaml"))
    return replace(job(name, f"{name}.held.yaml"), inputs=())


def busy(cluster) -> dict[str, int]:
    """The process that each worker has at work for a job."""
    found = {name: [one for one in tree(worker.pid)[1:] if is_run(one)] for name, worker in cluster.workers.items()}
    return {name: inner[0] for name, inner in found.items() if inner}


def is_run(process: int) -> bool:
    try:
        return b"map-tools" in Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return False


def run(cluster, jobs, **options):
    return run_jobs(jobs, workers=0, records=Path("jobs"), scheduler=cluster.address, **options)


def test_jobs_run_on_workers_as_they_do_here(cluster):
    outcomes = run(cluster, [job("a"), job("b"), job("c", "none.yaml")])
    assert [one.exit_code for one in outcomes] == [0, 0, 2]
    assert "none.yaml" in outcomes[2].message
    assert outcomes[0].peak_memory_bytes > 10e6
    here = run_jobs([job("d")])[0]
    assert here.done
    assert Path("a.yaml").read_text().replace("a.pgm", "d.pgm") == Path("d.yaml").read_text()
    assert sorted(path.name for path in Path("jobs").iterdir()) == ["a.json", "b.json", "c.json"]
    assert [one.reused for one in run(cluster, [job("a"), job("b")])] == [True, True]


def test_the_output_may_be_made_here_of_what_the_job_made_there(cluster):
    later = replace(job("a"), output=Path("a.figures"), makes=Path("a.yaml"))
    told = lambda outcome: later.output.write_text(str(outcome.done))  # noqa: E731 - as sweep measures a run
    assert run(cluster, [later], told=told)[0].done
    assert later.output.read_text() == "True"
    assert run(cluster, [later])[0].reused


def test_a_lost_worker_is_replaced_and_a_job_that_loses_two_is_given_up(cluster):
    outcomes: list = []
    jobs = [waiting("x")]
    thread = threading.Thread(target=lambda: outcomes.extend(run(cluster, jobs)), daemon=True)
    thread.start()
    first = until(lambda: busy(cluster))
    cluster.kill(next(iter(first)))
    until(lambda: not Path(f"/proc/{next(iter(first.values()))}").exists())  # the job went with its worker
    until(lambda: busy(cluster))
    let_go(Path("x.held.yaml"))
    thread.join(timeout=30)
    assert [one.exit_code for one in outcomes] == [0]

    outcomes.clear()
    Path("x.yaml").unlink()
    hold(Path("x.held.yaml"))
    thread = threading.Thread(target=lambda: outcomes.extend(run(cluster, jobs)), daemon=True)
    thread.start()
    for name in ("three", "four"):
        cluster.add(name)
        found = until(lambda: busy(cluster))
        cluster.kill(next(iter(found)))
    thread.join(timeout=30)
    assert outcomes[0].message == "2 workers were lost while they ran it"
    assert not thread.is_alive()
    while len(cluster.workers) < 2:
        cluster.add(f"more {len(cluster.workers)}")


def test_stopping_ends_the_processes_on_the_workers(cluster):
    stopping = threading.Event()

    def stop(_):
        until(lambda: busy(cluster))
        stopping.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(cluster, [job("a"), waiting("x")], told=stop)
    assert stopping.is_set()
    until(lambda: not busy(cluster), seconds=10)


def test_the_processes_end_with_the_client(cluster, here):
    words = waiting("x").arguments
    code = (
        "from pathlib import Path; from slamcli.pipelines.jobs import Job, run_jobs\n"
        f"run_jobs([Job(name='x', arguments={words!r}, output=Path('x.yaml'))], records=Path('jobs'), scheduler={cluster.address!r})"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=here) as client:
        until(lambda: busy(cluster))
        client.kill()
    until(lambda: not busy(cluster), seconds=15)


def test_memory_is_bounded_on_workers_too(cluster):
    [outcome] = run(cluster, [job("a")], memory_limit_bytes=20_000_000)
    assert outcome.message == "needed more than 20 MB of memory (--max-memory)"


def test_what_a_worker_does_not_see_is_said(cluster, here, monkeypatch):
    order = dask_jobs._Order(
        version=dask_jobs.__version__, job=job("a"), folder=here, seen=(Path("elsewhere/a.mcap"),),
        tries=here / "tries", memory_limit_bytes=None, threads={},
    )  # fmt: skip
    from distributed import Client

    with Client(cluster.address, set_as_default=False) as client:
        unseen = client.submit(dask_jobs.run_order, order, pure=False).result()
        nowhere = client.submit(dask_jobs.run_order, replace(order, folder=Path("/none")), pure=False).result()
        other = client.submit(dask_jobs.run_order, replace(order, version="9.9"), pure=False).result()
    assert unseen.exit_code == nowhere.exit_code == other.exit_code == 2
    assert f"does not see {here}/elsewhere/a.mcap: inputs and output must lie on a file system" in unseen.message
    assert "does not see /none: " in nowhere.message
    assert "and this is 9.9: results could differ; install the same version" in other.message
    monkeypatch.setattr(dask_jobs, "_SEEN_S", 0.2)
    [lost] = run(cluster, [replace(job("a"), output=Path("other.yaml"))])
    assert lost.message.startswith("the worker wrote other.yaml, and it is not there")


def test_another_version_is_refused_before_anything_runs(cluster, monkeypatch):
    monkeypatch.setattr(dask_jobs, "__version__", "9.9")
    with pytest.raises(UsageError, match=r"worker tcp://.* has slamcli .*, and this is 9\.9: results could differ"):
        run(cluster, [job("a")])
    assert not Path("a.yaml").exists()


def test_a_scheduler_that_is_not_there_or_has_no_workers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_jobs, "_CONNECT_S", 0.5)
    with pytest.raises(UsageError, match=r"--scheduler tcp://127\.0\.0\.1:1: no Dask scheduler answers there"):
        run_jobs([job("a")], records=Path("jobs"), scheduler="tcp://127.0.0.1:1")
    for address in ("nonsense", "tcp://", "tcp://:8786", "tcp://host:port"):
        with pytest.raises(UsageError, match=f"--scheduler {address}: not an address of a Dask scheduler"):
            run_jobs([job("a")], records=Path("jobs"), scheduler=address)
    monkeypatch.setattr(dask_jobs, "_CONNECT_S", 30.0)
    monkeypatch.setattr(dask_jobs, "_FIRST_WORKER_S", 0.5)
    with (
        machines(tmp_path) as empty,
        pytest.raises(UsageError, match=r"it has no workers; start some: dask worker tcp"),
    ):
        run_jobs([job("a")], records=Path("jobs"), scheduler=empty.address)
    with pytest.raises(UsageError, match="need a folder for their records"):
        run_jobs([job("a")], scheduler="tcp://127.0.0.1:1")


def test_a_cluster_that_loses_all_workers_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_jobs, "_NO_WORKER_S", 1.0)
    outcomes: list = []
    with machines(tmp_path, "only", PYTHONPATH=holding(tmp_path / "hold")) as small:
        jobs = [waiting("x")]
        thread = threading.Thread(target=lambda: outcomes.extend(run(small, jobs)), daemon=True)
        thread.start()
        until(lambda: busy(small))
        small.kill("only")
        thread.join(timeout=30)
    assert outcomes[0].message.endswith("all workers are gone")
