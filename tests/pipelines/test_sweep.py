# SPDX-License-Identifier: MIT
"""A whole sweep with a system whose errors are known: ranks, resuming, failures, files."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_mapping import FakeMapping, arc, write_tum

from slamcli.errors import EstimationError, UsageError
from slamcli.pipelines.config import check, load_native
from slamcli.pipelines.schemas import find_schema, first_deviation
from slamcli.pipelines.sweep import run_sweep
from slamcli.pipelines.sweep_document import sweep_document
from slamcli.pipelines.sweep_outputs import best_of, write_sweep
from slamcli.pipelines.sweep_request import Subject, SweepRequest
from slamcli.runtime import RunLog


def noise(values, seed):
    """The more particles the better, srr does harm below 0.1; seeds scatter by 1 mm."""
    particles, srr = float(values.get("particles", 30)), float(values.get("srr", 0.1))
    scatter = 0.001 * math.sin(7.0 * seed + particles)
    return 0.5 / particles + max(0.0, 0.1 - srr) + scatter


@pytest.fixture
def mapping(monkeypatch):
    fake = FakeMapping(noise)
    monkeypatch.setattr("slamcli.pipelines.jobs.run_job", fake)
    return fake


@pytest.fixture
def request_(tmp_path):
    recording, truth = tmp_path / "run.mcap", tmp_path / "run.truth.tum"
    recording.write_bytes(b"a recording")
    write_tum(truth, arc())
    return SweepRequest(
        algo="gmapping", subjects=(Subject(name="", inputs=(recording,), reference=str(truth)),),
        output=tmp_path / "out", sets=("particles=10,30,90", "srr=0.05,0.1"), num_seeds=6,
    )  # fmt: skip


def swept(request):
    log = RunLog()
    sweep = run_sweep(request, log)
    return sweep, sweep_document(sweep, best_of(sweep, "best.launch"), (), log)


def written(request):
    log = RunLog()
    sweep = run_sweep(request, log)
    return sweep, write_sweep(sweep, log)


def test_sets_are_ranked_by_their_median_and_compared_with_the_baseline(mapping, request_):
    sweep, document = swept(request_)
    assert len(mapping.ran) == 36
    assert [one.one.label for one in sweep.sets] == [
        "particles=90", "baseline", "particles=10", "particles=90, srr=0.05", "srr=0.05", "particles=10, srr=0.05",
    ]  # fmt: skip
    assert sweep.best.spread.median == pytest.approx(
        np.median([noise({"particles": 90}, s) for s in range(6)]), abs=2e-5
    )
    assert sweep.best.against_baseline.verdict == "better"
    assert sweep.sets[2].against_baseline.verdict == "worse"
    assert "better in 6 of 6 pairs: more than chance (sign test p = 0.031)" in document["verdict"]
    assert document["best"]["command"].startswith(
        f"slamcli map {request_.subjects[0].inputs[0]} --algo gmapping --config "
    )


def test_what_is_written(mapping, request_):
    _, document = written(request_)
    out = request_.output
    assert first_deviation(document, find_schema("sweep")) is None
    assert first_deviation(json.loads((out / "run.json").read_text()), find_schema("run")) is None
    assert {path.name for path in out.iterdir()} == set(document["outputs"])
    rows = list(csv.DictReader(io.StringIO((out / "sweep.csv").read_text())))
    assert len(rows) == 36
    assert rows[0]["particles"] == "90"
    assert float(rows[0]["objective"]) == float(rows[0]["ate.rmse"])
    assert "| 1 | 90 | 0.1 |" in (out / "sweep.md").read_text().replace("  ", " ")
    for picture in ("parameter-particles.png", "parameter-srr.png", "pairs.png", "time.png"):
        assert (out / picture).read_bytes().startswith(b"\x89PNG")
    page = (out / "report.html").read_text()
    assert "particles=90" in page
    assert "NaN" not in page
    assert "http" not in page.replace("http-equiv", "")
    assert load_native("gmapping", [out / "best.launch"]).parameters.particles == 90
    assert {finding.severity for finding in check([out / "best.launch"])} <= {"note"}


def test_only_the_folders_that_are_asked_for_stay(mapping, request_):
    for keep, kept in (("best", {f"b5a1-s{i}" for i in range(6)}), ("none", set()), ("all", None)):
        request = replace(request_, keep=keep, output=request_.output / keep)
        sweep, _ = swept(request)
        folders = {path.name for path in (request.output / "runs").iterdir() if path.is_dir()}
        best = {f"{sweep.best.one.name}-s{seed}" for seed in range(6)}
        assert len(folders) == (36 if kept is None else len(kept)), keep
        assert keep != "best" or folders == best
        assert len(list((request.output / "runs").glob("*.json"))) == 36


def test_nothing_is_run_twice(mapping, request_):
    _, first = swept(request_)
    mapping.ran.clear()
    _, second = swept(request_)
    assert mapping.ran == []
    assert without_times(first) == without_times(second)
    swept(replace(request_, num_seeds=7))
    assert {name.rpartition("-s")[2] for name in mapping.ran} == {"6"}
    assert len(mapping.ran) == 6
    mapping.ran.clear()
    swept(replace(request_, sets=("particles=10,30,90,200", "srr=0.05,0.1", "lstep=0.05,0.1")))
    assert len(mapping.ran) == (16 - 6) * 6
    mapping.ran.clear()
    sweep, _ = swept(replace(request_, objective="summary.nested.thing", keep="none"))
    assert mapping.ran == []
    assert sweep.best.one.is_baseline
    swept(replace(request_, objective="summary.nested.thing"))
    assert mapping.ran == [f"baseline-s{seed}" for seed in range(6)]  # the best one's folders, which are to stay


def test_another_truth_or_recording_runs_again_where_no_folder_is_left(mapping, request_, tmp_path):
    request = replace(request_, num_seeds=1)
    swept(request)
    mapping.ran.clear()
    write_tum(tmp_path / "run.truth.tum", arc() * 1.01)
    swept(request)
    assert len(mapping.ran) == 5  # the best one's folder is there: it is only measured again
    mapping.ran.clear()
    request.subjects[0].inputs[0].write_bytes(b"another recording")
    swept(request)
    assert len(mapping.ran) == 6


def test_a_sweep_that_was_stopped_goes_on(mapping, request_, tmp_path):
    mapping.stop_after = 13
    with pytest.raises(KeyboardInterrupt):
        swept(request_)
    mapping.stop_after = None
    _, stopped = written(request_)
    assert len(mapping.ran) == 36
    _, whole = written(replace(request_, output=tmp_path / "other"))
    assert without_times(stopped, tmp_path / "out") == without_times(whole, tmp_path / "other")
    assert (tmp_path / "out" / "parameter-srr.png").read_bytes() == (
        tmp_path / "other" / "parameter-srr.png"
    ).read_bytes()


def test_a_result_that_was_not_measured_when_the_sweep_died_is_made_again(mapping, request_):
    swept(request_)
    mapping.ran.clear()
    (request_.output / "runs" / "baseline-s0.json").unlink()
    (request_.output / "runs" / "baseline-s1.json").write_text('{"scoring": ')
    swept(request_)
    assert sorted(mapping.ran) == ["baseline-s0", "baseline-s1"]


def test_results_do_not_depend_on_the_workers(mapping, request_, tmp_path):
    found = []
    for workers in (1, 5):
        request = replace(request_, workers=workers, output=tmp_path / f"w{workers}")
        found.append(without_times(swept(request)[1], request.output))
    assert found[0] == found[1]


def test_failed_runs_count_and_put_a_set_last(mapping, request_):
    mapping.error_m = lambda v, s: "the filter died" if (v.get("particles"), s) == ("90", 2) else noise(v, s)
    log = RunLog()
    sweep = run_sweep(request_, log)
    assert sweep.best.one.is_baseline
    assert [one.spread.failed for one in sweep.sets] == [0, 0, 0, 0, 1, 1]
    assert sweep.sets[-2].one.label == "particles=90"
    assert "2 of 36 runs failed" in log.warnings[0]
    assert "the filter died" in log.warnings[0]
    mapping.ran.clear()
    run_sweep(request_, RunLog())
    assert len(mapping.ran) == 2  # what failed is tried again


def test_a_run_that_gets_lost_early_does_not_win(mapping, request_):
    mapping.share = lambda v, _: 0.3 if v.get("particles") == "90" else 1.0
    sweep, document = swept(request_)
    assert sweep.best.one.is_baseline
    lost = [run for run in document["runs"] if run["failure"]]
    assert len(lost) == 12
    assert "covers only 30 % of what the best run covers" in lost[0]["failure"]
    sweep, _ = swept(replace(request_, least_coverage=0.2))
    assert sweep.best.one.label == "particles=90"


def test_a_baseline_that_cannot_run_stops_the_sweep_at_once(mapping, request_):
    mapping.error_m = lambda *_: "usage: no such topic"
    with pytest.raises(UsageError, match="the baseline does not run: usage: no such topic"):
        swept(request_)
    assert len(mapping.ran) < 10
    assert not request_.output.exists()


def test_a_sweep_without_any_result_says_why(mapping, request_):
    mapping.error_m = lambda *_: "no scan matches"
    with pytest.raises(EstimationError, match="every run failed; the first one: no scan matches"):
        swept(request_)


def test_a_wrong_figure_is_said_after_the_first_run(mapping, request_):
    with pytest.raises(UsageError, match=r"did you mean summary\.poses"):
        swept(replace(request_, objective="summary.pose"))
    assert mapping.ran  # a run says which figures there are; how many of these quick ones are made by then is chance


def test_one_value_belongs_to_the_baseline(mapping, request_):
    sweep, document = written(replace(request_, sets=("particles=20,40", "srr=0.07"), num_seeds=1))
    assert document["fixed"] == {"srr": 0.07}
    assert load_native("gmapping", [request_.output / "best.launch"]).parameters.srr == 0.07
    assert sweep.best.one.label == "particles=40"
    assert sweep.best.spread.median == pytest.approx(noise({"particles": 40, "srr": 0.07}, 0), rel=1e-3)


def test_of_several_recordings_the_mean_rank_counts(mapping, request_, tmp_path):
    """One recording has errors a hundred times as large: it must not drown the others."""
    subjects = []
    for i in range(3):
        recording = tmp_path / f"r{i}.mcap"
        recording.write_bytes(b"%d" % i)
        subjects.append(Subject(name=f"r{i}", inputs=(recording,), reference=request_.subjects[0].reference))

    scale = {
        "r0.mcap": (1.0, {"10": 0.9, "90": 1.2}),
        "r1.mcap": (1.0, {"10": 0.8, "90": 1.1}),
        "r2.mcap": (100.0, {"10": 1.05, "90": 0.5}),
    }

    def error(values, seed):
        size, factors = scale[error.bag]
        return 0.002 * size * factors.get(values.get("particles"), 1.0) * (1 + 0.001 * seed)

    original = FakeMapping.__call__

    def call(self, job, **options):
        error.bag = next(Path(word).name for word in job.arguments if word.endswith(".mcap"))
        return original(self, job, **options)

    mapping.error_m = error
    FakeMapping.__call__ = call
    try:
        request = replace(request_, subjects=tuple(subjects), sets=("particles=10,90",), num_seeds=2)
        sweep, document = written(request)
    finally:
        FakeMapping.__call__ = original
    assert sweep.best.one.label == "particles=10"
    assert [one.mean_rank for one in sweep.sets] == pytest.approx([5 / 3, 2.0, 7 / 3])
    assert sweep.best.spread.median == pytest.approx(0.9, rel=1e-3)
    assert document["objective"]["relative"]
    assert sweep.best.against_baseline.pairs == 6
    assert {path.name for path in (request.output / "runs").iterdir()} == {"r0", "r1", "r2"}
    assert "mean rank" in (request.output / "sweep.md").read_text()
    assert first_deviation(document, find_schema("sweep")) is None


def test_nothing_to_vary_is_refused(mapping, request_):
    with pytest.raises(UsageError, match="nothing is varied"):
        swept(replace(request_, sets=("particles=20",), num_seeds=1))
    with pytest.raises(UsageError, match="given twice"):
        swept(replace(request_, sets=("particles=20,30", "particles=40,50")))
    assert mapping.ran == []


def test_seeds_alone_show_the_spread_of_the_baseline(mapping, request_):
    sweep, document = swept(replace(request_, sets=(), num_seeds=4))
    assert len(mapping.ran) == 4
    assert sweep.best.one.is_baseline
    assert document["parameters"] == []


def without_times(document, folder=None):
    """Return a document without what may differ from run to run."""

    def bare(value):
        if isinstance(value, dict):
            return {k: bare(v) for k, v in value.items() if k not in ("timing", "peak_memory_bytes")}
        return [bare(v) for v in value] if isinstance(value, list) else value

    text = json.dumps(bare(document))
    return text if folder is None else text.replace(str(folder), "OUT")
