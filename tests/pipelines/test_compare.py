# SPDX-License-Identifier: MIT
"""slamcli compare: fair figures, ranks, runs that fail, resuming, the same bytes twice."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slamcli.errors import ConfigError, FormatError, UsageError
from slamcli.formats.maps import read_map, write_map
from slamcli.formats.trajectories import read_tum, write_tum
from slamcli.pipelines.compare import CompareOutcome, default_output, run_compare
from slamcli.pipelines.compare_points import PointsRequest, read_points
from slamcli.pipelines.compare_request import CompareRequest, Wanted, entrants_of
from slamcli.pipelines.compare_scores import Truth, at_stamps, common_stamps, cut_to, distance
from slamcli.pipelines.consistency import consistency_of, measure_consistency
from slamcli.pipelines.schemas import SchemaName, first_deviation
from slamcli.runtime import RunLog
from slamcli.trajectory import Trajectory

SAMPLES = Path(__file__).resolve().parents[2] / "sample_data"
BAG = SAMPLES / "cluttered_room"
TRUTH = SAMPLES / "cluttered_room.truth.tum"
MAP = SAMPLES / "cluttered_room.map.yaml"


def made(folder: Path, trajectory: Trajectory, *, with_map: bool = True) -> Path:
    """A result as `slamcli map` leaves one, of a trajectory that is known."""
    folder.mkdir()
    write_tum(folder / "trajectory.tum", trajectory)
    if with_map:
        write_map(folder / "map.yaml", read_map(MAP).grid)
    run = {
        "schema": "slamcli.run.1",
        "algo": "gmapping",
        "frames": {"base": "base_link"},
        "timing": {"recording_s": 60.0, "realtime_factor": 12.0},
    }
    (folder / "run.json").write_text(json.dumps(run))
    return folder


def worsened(truth: Trajectory, metres: float) -> Trajectory:
    """Drift that grows to `metres` at the end, sideways."""
    positions = truth.positions_m.copy()
    positions[:, 1] += np.linspace(0.0, metres, len(truth))
    return replace(truth, positions_m=positions)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("results")
    truth = read_tum(TRUTH)
    half = truth.select(np.arange(len(truth) // 2))
    return {
        "true": made(base / "true", truth),
        "slight": made(base / "slight", worsened(truth, 0.15)),
        "bad": made(base / "bad", worsened(truth, 0.6)),
        "half": made(base / "half", half, with_map=False),
    }


@pytest.fixture(scope="module")
def outcome(folders: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> CompareOutcome:
    request = CompareRequest(
        inputs=[BAG], wanted=Wanted(results=[f"{name}={path}" for name, path in folders.items()]),
        references=[str(TRUTH), str(MAP)], output=tmp_path_factory.mktemp("compared") / "out",
    )  # fmt: skip
    return run_compare(request, RunLog())


def test_the_worse_ranks_worse_by_every_figure_of_points(outcome: CompareOutcome) -> None:
    figures = outcome.figures()
    for key in (
        "ate.rmse", "map.wall_thickness_m", "map.entropy", "map.mean_entropy", "revisit.distance_m", "revisit.offset.mean",
        "scan.residual.median",
    ):  # fmt: skip
        assert figures[f"true.{key}"] < figures[f"slight.{key}"] < figures[f"bad.{key}"], key
    ranks = {entry["name"]: entry["ranks"] for entry in outcome.document["results"]}
    assert [ranks[name]["map.wall_thickness_m"] for name in ("slight", "bad")] == [3, 4]
    assert outcome.document["best"]["ate.rmse"][0] in ("true", "half")


def test_figures_of_the_truth_are_what_the_simulator_made(outcome: CompareOutcome) -> None:
    figures = outcome.figures()
    assert figures["true.ate.rmse"] < 1e-6
    assert figures["true.truth.map.f_score"] == 1.0
    assert figures["true.coverage"] == 1.0
    assert figures["half.coverage"] == pytest.approx(0.5, abs=0.02)
    # Evenly growing drift of 0.6 m, aligned: at most 0.6 / sqrt(12), less what a turn takes away.
    assert 0.02 < figures["bad.ate.rmse"] < 0.6 / np.sqrt(12) + 0.01


def test_sentences_say_where_each_failed(outcome: CompareOutcome) -> None:
    told = {entry["name"]: entry for entry in outcome.document["results"]}
    assert told["true"]["sentence"] == "nothing stood out"
    assert "did not come back" in told["half"]["sentence"]
    kinds = [finding["kind"] for finding in told["bad"]["findings"]]
    assert "double walls" in kinds
    assert "drift" in kinds
    spell = next(f for f in told["half"]["findings"] if f["kind"] == "lost")
    assert spell["at_s"] == pytest.approx(30.0, abs=1.0)


def test_the_folder_holds_what_its_record_says(outcome: CompareOutcome) -> None:
    record = json.loads((outcome.output / "run.json").read_text())
    assert first_deviation(record, SchemaName("run", 1)) is None
    document = json.loads((outcome.output / "compare.json").read_text())
    assert first_deviation(document, SchemaName("compare", 1)) is None
    assert sorted(record["outputs"]) == sorted(path.name for path in outcome.output.iterdir() if path.name != "jobs")
    for name in ("maps.png", "overlay.png", "trajectories.png"):
        assert (outcome.output / name).read_bytes().startswith(b"\x89PNG")
    page = (outcome.output / "report.html").read_text()
    assert page.count("<svg") == 2
    assert "http" not in page.replace("http-equiv", "")
    table = (outcome.output / "compare.md").read_text()
    assert "| wall thickness | m | **" in table


def test_twice_the_same_bytes(folders: dict[str, Path], tmp_path: Path) -> None:
    wanted = Wanted(results=[f"{name}={folders[name]}" for name in ("true", "bad")])
    first, second = (
        run_compare(
            CompareRequest(inputs=[BAG], wanted=wanted, references=[str(TRUTH)], output=tmp_path / name), RunLog()
        ).output
        for name in ("one", "two")
    )
    for name in ("compare.json", "compare.md", "maps.png", "overlay.png", "trajectories.png", "report.html"):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name


def test_without_the_recording_only_what_the_folders_tell(folders: dict[str, Path], tmp_path: Path) -> None:
    wanted = Wanted(results=[f"a={folders['true']}", f"b={folders['bad']}"])
    log = RunLog()
    found = run_compare(CompareRequest(wanted=wanted, output=tmp_path / "out"), log)
    assert "a.map.wall_thickness_m" not in found.figures()
    assert found.figures()["b.agreement.ate"] > 0.02
    assert found.figures()["a.agreement.map"] == 1.0
    assert any("without the recording" in note for note in log.notes)
    with pytest.raises(UsageError, match="name a folder for the report with -o"):
        run_compare(CompareRequest(wanted=wanted), RunLog())


def test_runs_fail_alone_and_are_not_run_again(tmp_path: Path) -> None:
    wanted = Wanted(
        algos=["orbslam3"], variants=["broken=gmapping:particles=1", "one=gmapping:particles=1"], sets=["gmapping:delta=0.1"],
        modes=["broken=3d"],
    )  # fmt: skip
    request = CompareRequest(inputs=[BAG], wanted=wanted, duration_s=3.0, output=tmp_path / "out")
    told: list[tuple[str, bool, bool]] = []
    outcome = run_compare(request, RunLog(), lambda ended: told.append((ended.name, ended.done, ended.reused)))
    states = {entry["name"]: entry["state"] for entry in outcome.document["results"]}
    assert states == {"orbslam3": "cannot run", "broken": "failed", "one": "ran"}
    sentences = {entry["name"]: entry["sentence"] for entry in outcome.document["results"]}
    assert "needs camera images" in sentences["orbslam3"]
    assert "one mode only" in sentences["broken"]
    assert told == [("broken", False, False), ("one", True, False)]
    run = json.loads((outcome.output / "one" / "run.json").read_text())
    assert (run["parameters"]["particles"], run["parameters"]["delta"]) == (1, 0.1)
    before = json.loads((outcome.output / "compare.json").read_text())
    told.clear()
    again = run_compare(request, RunLog(), lambda ended: told.append((ended.name, ended.done, ended.reused)))
    assert told == [("broken", False, False), ("one", True, True)]
    assert again.document["results"][2] == before["results"][2]  # the times too: they are those of the run


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (Wanted(algos=["gmapping", "gmapping"]), "two of what is to be compared are called 'gmapping'"),
        (Wanted(algos=["gmaping"]), "no SLAM system 'gmaping'"),
        (Wanted(algos=["gmapping"], configs=["cartographer=x.lua"]), "'cartographer' is not compared here"),
        (Wanted(algos=["gmapping"], configs=["x.lua"]), "write it as ALGO=FILE"),
        (Wanted(algos=["gmapping"], modes=["gmapping"]), "write it as ALGO=MODE"),
        (Wanted(algos=["gmapping"], sets=["particles"]), "write it as ALGO:KEY=VALUE"),
        (Wanted(algos=["gmapping", "cartographer"], sets=["nothing=1"]), "none of cartographer, gmapping has it"),
        (Wanted(algos=["gmapping"], sets=["rtabmap:particles=1"]), "'rtabmap' is not compared here"),
        (Wanted(variants=["gmapping:particles=1"]), "write it as NAME=ALGO"),
        (Wanted(variants=["a=gmapping:particles"]), "'particles' is not KEY=VALUE"),
        (Wanted(variants=["../x=gmapping"]), "cannot be the name of a folder here"),
        (Wanted(variants=["jobs=gmapping"]), "cannot be the name of a folder here"),
        (Wanted(results=["a=nowhere"]), "no run.json in nowhere"),
    ],
)
def test_wrong_options_are_told(wanted: Wanted, message: str) -> None:
    with pytest.raises(UsageError, match=message.replace("(", r"\(")):
        entrants_of(wanted, [])


def test_options_find_their_entrants() -> None:
    found = entrants_of(
        Wanted(
            algos=["gmapping", "rtabmap"], variants=["few=gmapping:particles=5,delta=0.1", "c=cartographer"],
            sets=["particles=9", "few:lskip=2", "rtabmap:Kp/MaxFeatures=100"], configs=["c=mine.lua"], modes=["cartographer=2d"],
        ),
        [],
    )  # fmt: skip
    by_name = {entrant.name: entrant for entrant in found}
    assert by_name["gmapping"].sets == ("particles=9",)
    assert by_name["few"].sets == ("particles=5", "delta=0.1", "particles=9", "lskip=2")
    assert by_name["rtabmap"].sets == ("Kp/MaxFeatures=100",)
    assert (by_name["c"].config_files, by_name["c"].mode) == ((Path("mine.lua"),), "2d")
    assert [entrant.name for entrant in entrants_of(Wanted(), ["gmapping"])] == ["gmapping"]


def test_wrong_input_is_told_before_anything_runs(tmp_path: Path) -> None:
    for request, message in (
        (CompareRequest(), "nothing to run on"),
        (
            CompareRequest(inputs=[BAG], references=[str(TRUTH), str(TRUTH)], output=tmp_path / "o"),
            "a second trajectory",
        ),
        (
            CompareRequest(inputs=[BAG], wanted=Wanted(algos=["orbslam3"]), output=tmp_path / "o"),
            "orbslam3 needs camera images",
        ),
        (CompareRequest(inputs=[BAG], start_s=-1.0, output=tmp_path / "o"), "--start -1"),
        (CompareRequest(inputs=[BAG], duration_s=float("nan"), output=tmp_path / "o"), "--duration nan"),
        (
            CompareRequest(inputs=[BAG], judged=["gmaping.poses"], output=tmp_path / "o"),
            "no figure 'gmaping.poses' here",
        ),
    ):
        with pytest.raises(UsageError, match=message):
            run_compare(request, RunLog())
    with pytest.raises(FormatError, match="no such file"):
        run_compare(CompareRequest(inputs=[BAG], references=["none.tum"], output=tmp_path / "o"), RunLog())
    for setting in ("gmapping:particles=x", "gmapping:particle=3"):
        with pytest.raises(ConfigError, match="particle"):
            run_compare(
                CompareRequest(inputs=[BAG], wanted=Wanted(algos=["gmapping"], sets=[setting]), output=tmp_path / "o"),
                RunLog(),
            )
    assert not (tmp_path / "o").exists()
    wanted = Wanted(algos=["gmapping"], modes=["gmapping=3d"])
    with pytest.raises(UsageError, match="nothing to compare: gmapping: --mode 3d"):
        run_compare(CompareRequest(inputs=[BAG], wanted=wanted, output=tmp_path / "o"), RunLog())


def test_consistency_alone_is_what_compare_says(outcome: CompareOutcome, folders: dict[str, Path]) -> None:
    alone = measure_consistency(folders["bad"], PointsRequest(inputs=[BAG]), RunLog()).figures()
    figures = outcome.figures()
    assert len(alone) > 10
    assert alone == {key: figures[f"bad.{key}"] for key in alone}
    assert measure_consistency(folders["bad"], None, RunLog()).figures() == {}
    with pytest.raises(FormatError, match=r"no trajectory\.tum"):
        consistency_of(SAMPLES, None)


def test_points_are_read_once_thinned_and_of_the_named_part() -> None:
    found = read_points(PointsRequest(inputs=[BAG], start_s=10.0, duration_s=5.0), ["base_link"], RunLog())
    assert found is not None
    assert found.seen.planar
    assert len(found.seen.stamps_ns) == 30  # 6 Hz
    assert np.ptp(found.seen.stamps_ns) / 1e9 == pytest.approx(5.0, abs=0.4)
    assert read_points(PointsRequest(inputs=[BAG], scan_topics=["/none"]), ["base_link"], RunLog()) is None


def test_depth_images_give_points_where_there_is_no_scanner() -> None:
    found = read_points(PointsRequest(inputs=[SAMPLES / "desk_rgbd.mcap"]), ["body"], RunLog())
    assert found is not None
    assert not found.seen.planar
    assert len(found.seen) > 10_000
    result = SAMPLES / "desk_rgbd.truth.tum"
    assert len(read_tum(result)) > 2
    assert float(np.median(np.linalg.norm(found.seen.points_m, axis=1))) < 5.0


def test_common_stamps_are_no_denser_than_the_sparsest() -> None:
    dense = Trajectory.from_se2(np.arange(1000, dtype=np.int64) * 5_000_000, np.zeros((1000, 3)))
    sparse = Trajectory.from_se2(np.arange(50, dtype=np.int64) * 100_000_000, np.zeros((50, 3)))
    assert np.diff(common_stamps(dense, [dense, sparse]))[0] == 90_000_000
    assert len(common_stamps(sparse, [dense])) == 50


def test_a_truth_that_goes_on_costs_nothing() -> None:
    """Of a part of a recording (--duration) the truth is of the whole: where the estimate has ended nothing is held against it."""
    stamps = np.arange(200, dtype=np.int64) * 100_000_000
    poses = np.column_stack([np.arange(200) * 0.05, np.sin(np.arange(200) * 0.05), np.zeros(200)])
    truth = Trajectory.from_se2(stamps, poses)
    part = truth.select(np.arange(50, 101))
    assert at_stamps(part, stamps).stamps_ns.tolist() == stamps[50:101].tolist()
    assert distance(part, truth, stamps)[0]["ate.max"] < 1e-9
    cut = cut_to(Truth(trajectory=truth), [part.stamps_ns + 1, np.zeros(0, dtype=np.int64)]).trajectory
    assert cut is not None
    assert cut.stamps_ns[[0, -1]].tolist() == [stamps[50], stamps[101]]
    elsewhere = cut_to(Truth(trajectory=truth), [part.stamps_ns + 10**15]).trajectory
    assert elsewhere is truth


def test_the_folder_is_named_for_the_recording() -> None:
    assert default_output([Path("a/mit-csail.clf.gz")]) == Path("a/mit-csail-compare")
    assert default_output([Path("my.robot.bag")]).name in ("my-compare", "my.robot-compare")
